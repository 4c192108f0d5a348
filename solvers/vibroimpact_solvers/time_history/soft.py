"""Motions with soft limiters, by Taylor series; their error is the difference of two runs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.kernels.modal import handed_over
from vibroimpact_solvers.kernels.taylor import LARGEST, Stop, follow, room
from vibroimpact_solvers.kernels.whole_soft_motion import whole_soft_motion
from vibroimpact_solvers.time_history.limiters import Power
from vibroimpact_solvers.time_history.run import Tick
from vibroimpact_solvers.time_history.single_call import MOST
from vibroimpact_solvers.time_history.structure import Configuration, Structure

_EPS: Final = 2.0**-52
_STEP: Final = 1e-2
"""Error of a step over the tolerance; and of a step of the finer run over one of the other."""
_FINEST: Final = 2.0**-53
_LEAST: Final = 1e-6
"""Smallest factor by which the error of a step is reduced at once."""
_MOST_STEPS: Final = 1e10
"""Motions that need more of them, which take hours, are refused."""
_WORK: Final = 4_000_000
"""Pairs of the state times steps between two calls of the tick."""
_FIRST: Final = 0.25
"""The first step that is tried, in units of the basis' time."""


@dataclass(frozen=True, eq=False, slots=True)
class SoftRun:
    """States at the output times, and their estimated error.

    Parameters
    ----------
    states : array, shape (time, 2, pair)
    compression : float
        The largest coordinate over scale times its gap.
    steps : int
        Steps of this run.
    difference : float
        Largest difference to the states of a run with longer steps, whose start, frequencies
        and limiters are off by their roundings; relative to the largest state. nan: not
        estimated.
    known_until : float
        Time until which this is no more than the tolerance; nan: not estimated.
    """

    states: Floats
    compression: float
    steps: int
    difference: float = math.nan
    known_until: float = math.nan


@dataclass(frozen=True, eq=False, slots=True)
class SoftHistory:
    """Displacements and velocities at the output times, each (time, dof), of one run."""

    x: Floats
    v: Floats
    compression: float
    steps: int


def order_of(eps: float) -> int:
    """Return the order of series for some error of a step, relative to the state.

    Half its logarithm makes the least work of long series (Jorba and Zou); short series are a
    little longer, as each step has a fixed cost besides.
    """
    return math.ceil(-0.5 * math.log(eps)) + 3


class SoftMotion:
    """Solver for the motions of one structure with soft limiters.

    Parameters
    ----------
    structure : Structure
    law : Power
    output_times : array, shape (time,)
        Ascending times.
    t_end : float
    tolerance : float
        Difference of states, relative to the largest, at which steps are short enough.
    estimate : bool
        Whether a second run estimates the error of the first.
    """

    def __init__(
        self,
        structure: Structure,
        law: Power,
        output_times: Floats,
        t_end: float,
        tolerance: float,
        estimate: bool,
    ) -> None:
        configuration, scale = structure.configuration(), structure.scale
        basis = configuration.basis
        self._times, self._end = np.append(output_times, t_end) * scale, t_end * scale
        self._tolerance, self._estimate, self._scale = tolerance, estimate, scale
        self._basis, self._own, self._weights = basis, basis.own, basis.weights
        self._fixed = structure.level(configuration), _laws(structure, law), basis.weights
        self._exact = _flow(configuration)
        self._whole = float(law.exponent <= LARGEST and law.exponent == int(law.exponent))
        self._exponent = float(law.exponent)
        self._scene = configuration
        self._budget = float(max(100, _WORK // (basis.pairs + 20)))
        self._shared = None
        if basis.plain and not estimate and output_times.size <= MOST:
            free = np.full(len(structure.system.constraints), np.inf)
            self._shared = handed_over(structure.modal._replace(lower=free, upper=free))

    def follow(self, z: Floats, tick: Tick | None = None) -> SoftRun:
        """Compute a motion from a state, shape (2, pair).

        Raises
        ------
        ConvergenceError
            Where the limiters are too stiff to be followed.
        """
        if not self._estimate:
            return self._run(z, max(_STEP * self._tolerance, _FINEST), tick, 0.0, 1.0)
        rough, begin = max(_STEP * self._tolerance, 8.0 * _FINEST), 0.0
        while True:
            fine = max(_STEP * rough, _FINEST)
            middle, end = 0.5 * (1.0 + begin), 0.5 * (1.0 + 0.5 * (1.0 + begin))
            other = self._run(z, rough, tick, begin, 0.5 * (begin + middle), off=True)
            run = self._run(z, fine, tick, 0.5 * (begin + middle), end)
            run = self._judged(run, other)
            if run.difference <= self._tolerance or fine == _FINEST:
                if tick is not None:
                    tick(1000, 1000)
                return run
            # As much finer as it was too rough, and some more.
            finer = max(_STEP * self._tolerance / run.difference, _LEAST)
            rough = max(finer * rough, 8.0 * _FINEST)
            begin = end

    def single_call(self, x: Floats, v: Floats, dofs: Integers) -> SoftHistory | None:
        """Compute a motion from displacements and velocities in one call, without estimate.

        None where that was not possible: `follow` can do it, or raises the error.

        Parameters
        ----------
        x, v : array, shape (dof,)
        dofs : array of int
            Degrees of freedom of the history.
        """
        if self._shared is None or x.shape != v.shape or x.shape != self._shared[1].shape[:1]:
            return None
        eps = max(_STEP * self._tolerance, _FINEST)
        settings, clock, counts, work = self._arrays(eps)
        pairs, times = self._basis.pairs, self._times.size
        xs, vs = np.empty((times - 1, dofs.size)), np.empty((times - 1, dofs.size))
        stop = whole_soft_motion(
            x, v, self._shared, dofs, *self._exact, *self._fixed, settings, self._times,
            np.zeros((2, 2, pairs)), clock, counts, np.empty((times, 2, pairs)), work, xs, vs,
        )  # fmt: skip
        if stop != Stop.END:
            return None
        return SoftHistory(xs, vs, float(clock[4]), int(counts[0]))

    def _arrays(self, eps: float) -> tuple[Floats, Floats, Integers, Floats]:
        """Return settings, clock, counts and work array for `kernels.taylor.follow`."""
        order = order_of(eps)
        settings = np.array([self._exponent, self._whole, order, eps])
        clock = np.array([0.0, 0.0, self._end, _FIRST, 0.0, self._budget])
        work = np.empty(room(self._basis.pairs, self._fixed[0].size, order))
        return settings, clock, np.zeros(3, dtype=np.int64), work

    def _judged(self, run: SoftRun, other: SoftRun) -> SoftRun:
        """Return a run with its difference to another one as its estimated error."""
        weights = self._weights[np.newaxis]
        # Loads count by what they move: their series end somewhere, too.
        apart = (np.abs(run.states - other.states) * weights).max(axis=(1, 2))
        largest = float((np.abs(run.states) * weights).max(initial=0.0))
        apart = apart / largest if largest > 0.0 else apart
        late = np.flatnonzero(~(apart <= self._tolerance))
        until = self._times[late[0]] if late.size else self._end
        return SoftRun(
            run.states,
            run.compression,
            run.steps,
            float(apart.max()),
            float(until) / self._scale,
        )

    def _run(
        self,
        z: Floats,
        eps: float,
        tick: Tick | None,
        begin: float,
        end: float,
        *,
        off: bool = False,
    ) -> SoftRun:
        """Follow a motion with steps of some error, off: with the roundings of what is given.

        Its progress counts from one part of the whole work to another.
        """
        rates, split, forms = self._exact
        levels, laws, weights = self._fixed
        states = np.empty((self._times.size, *z.shape))
        start = np.zeros((2, *z.shape))
        start[0] = z
        if off:
            basis = self._basis
            start[0] += _EPS * float((np.abs(z) * weights).max()) * basis.signs[0] * self._own
            rates, forms = rates.copy(), forms.copy()
            rates[1] += _EPS * basis.drifts[0]
            forms[2] += _EPS * self._scene.kernel.errors.kicks[0]
        settings, clock, counts, work = self._arrays(eps)
        while True:
            stop = follow(
                rates, split, forms, levels, laws, weights, settings, self._times, start, clock,
                counts, states, work,
            )  # fmt: skip
            if stop == Stop.END:
                return SoftRun(states, float(clock[4]), int(counts[0]))
            part = float(clock[0]) / self._end
            if stop == Stop.STIFF or not counts[0] < _MOST_STEPS * part:
                message = (
                    "the limiters are so stiff that the motion needs more than "
                    f"{_MOST_STEPS:g} steps"
                )
                raise ConvergenceError(message)
            if tick is not None:
                tick(int(1e3 * (begin + (end - begin) * part)), 1000)


def _flow(configuration: Configuration) -> tuple[Floats, Integers, Floats]:
    """Return the flow and the forms as `kernels.taylor.follow` takes them."""
    flow, watched = configuration.kernel.flow, configuration.kernel.watched
    rows = np.zeros((2 * flow.drives.size, flow.nu.size))
    for row, (i, k, real, imaginary) in enumerate(flow.drives.tolist()):
        rows[2 * row, :2] = i, k
        rows[2 * row + 1, :2] = real, imaginary
    rates = np.concatenate([[flow.alpha, flow.nu, flow.rest, flow.push], rows])
    split = np.array([flow.rotations, flow.hyperbolas_end, flow.damped], dtype=np.int64)
    return np.ascontiguousarray(rates), split, np.ascontiguousarray(watched[:4])


def _laws(structure: Structure, law: Power) -> Floats:
    """Return the laws of the limiters for `kernels.taylor.follow`, shape (5, constraint)."""
    sizes = law.sizes(structure.system)
    unit = sizes.min(axis=0, initial=np.inf)
    ratios = unit / sizes
    stiffness = law.stiffness * math.ldexp(1.0, -2 * structure.exponent)
    gains = stiffness * np.array([[1.0], [-1.0]]) * ratios**law.exponent
    return np.ascontiguousarray(np.concatenate([1.0 / unit[np.newaxis], gains, ratios]))
