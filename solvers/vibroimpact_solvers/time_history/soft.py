"""Motions with soft limiters, by Taylor series; their error is the difference of two runs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.kernels.modal import SAMPLES
from vibroimpact_solvers.kernels.rigid_state import Rows
from vibroimpact_solvers.kernels.soft_contacts import PHASE
from vibroimpact_solvers.kernels.taylor import (
    FINER,
    PAIR,
    PROGRESS,
    Contacts,
    Linear,
    Stop,
    follow,
)
from vibroimpact_solvers.kernels.whole_soft_motion import whole_soft_motion
from vibroimpact_solvers.meter import hold
from vibroimpact_solvers.time_history.run import Tick
from vibroimpact_solvers.time_history.soft_errors import Distance
from vibroimpact_solvers.time_history.soft_laws import SoftLaws
from vibroimpact_solvers.time_history.structure import Configuration, Structure

_EPS: Final = 2.0**-52
_STEP: Final = 1e-2
"""Error of a step over the tolerance."""
_FINEST: Final = 2.0**-53
_COARSEST_FINEST: Final = 8.0 * _FINEST
"""Error of a step of the other run that is near the roundings of both."""
_REPEATED: Final = 64.0
"""Roundings over the difference of two runs that are off by one sample of them."""
_CONVERTED: Final = 16.0
"""Roundings of displacements and velocities, which two runs have in common."""
_LEFT_OUT: Final = 0.5
"""What a series leaves out over its last term, at most: steps shrink terms by e^2 each."""
_HEED: Final = 4.0
"""Times by which the other run misses again what forces miss where the last terms vanish."""
_LEAST: Final = 1e-6
"""Smallest factor by which the error of a step is reduced at once."""
_MOST_STEPS: Final = 1e10
"""Motions that need more of them, which take hours, are refused."""
WORK: Final = 5_000_000
"""Between two calls of the tick, in nanoseconds of a usual processor, as it is counted."""
_TOLD: Final = 100_000
"""Steps after which a motion tells by its progress how many it needs."""
_FIRST: Final = 0.25
"""The first step that is tried, in units of the basis' time."""
_PHASES: Final = 64  # rows of the first table of contacts
_BESIDE: Final = 128
"""Times besides those of the output at which two runs are compared, where contacts are listed."""


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
    cut : float
        Root of the sum of the squares of what the series of the steps leave out, at most.
    difference : float
        Largest difference to the states of a run with longer steps, whose start, frequencies
        and limiters are off by their roundings, and what roundings may add to it; relative to
        the largest state, what loads carry along included. nan: not estimated.
    known_until : float
        Time until which this is no more than the tolerance; nan: not estimated.
    distance : Distance, optional
        From the other run.
    phases : array of `soft_contacts.PHASE`, optional
        Contacts, where they are asked for; stop is nan of those that go on at the end.
    """

    states: Floats
    compression: float
    steps: int
    cut: float
    difference: float = math.nan
    known_until: float = math.nan
    distance: Distance | None = None
    phases: Rows | None = None


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
    laws : SoftLaws
    output_times : array, shape (time,)
        Ascending times.
    t_end : float
    tolerance : float
        Difference of states, relative to the largest, at which steps are short enough.
    estimate : bool
        Whether a second run estimates the error of the first.
    dofs : array of int
        Degrees of freedom of the history.
    contacts : bool
        Whether contact phases are listed.

    Attributes
    ----------
    places : array of int, shape (time,)
        Where the states of a run are those at the output times.
    """

    def __init__(
        self,
        structure: Structure,
        laws: SoftLaws,
        output_times: Floats,
        t_end: float,
        tolerance: float,
        estimate: bool,
        dofs: Integers,
        contacts: bool,
    ) -> None:
        scene, scale = structure.configuration(), structure.scale
        basis = scene.basis
        beside = np.linspace(0.0, t_end, _BESIDE) if contacts and estimate else np.zeros(0)
        times = np.concatenate([output_times, beside])
        order = np.argsort(times, kind="stable")
        self.places: Integers = np.argsort(order)[: output_times.size]
        self._times, self._end = np.append(times[order], t_end) * scale, t_end * scale
        self._tolerance, self._estimate, self._scale = tolerance, estimate, scale
        self._scene, self._basis = scene, basis
        self._linear, self._limiters = _linear(scene), laws.kernel(structure, scene, off=False)
        self._others = laws.kernel(structure, scene, off=True) if estimate else self._limiters
        self._ramps, self._contacts = structure.ramps, contacts
        self._modes: Any = None
        self._shape, self._dofs = (structure.system.n,), dofs
        self._row = 100 + basis.modes.roots.size * dofs.size
        if not estimate and not contacts and not self._ramps.count:
            *modes, limits = structure.modal(scene, dofs)
            self._modes = (*modes, np.full_like(limits, np.inf))

    def follow(self, z: Floats, tick: Tick | None = None) -> SoftRun:
        """Compute a motion from a state, shape (2, pair).

        Raises
        ------
        ConvergenceError
            Where the limiters are too stiff to be followed.
        """
        if not self._estimate:
            return self._run(z, self._error, tick, 0.0, 1.0)
        rough, begin = max(_STEP * self._tolerance, _COARSEST_FINEST), 0.0
        while True:
            fine = max(FINER * rough, _FINEST)
            middle, end = 0.5 * (1.0 + begin), 0.5 * (1.0 + 0.5 * (1.0 + begin))
            other = self._run(z, rough, tick, begin, 0.5 * (begin + middle), off=True)
            run = self._run(z, fine, tick, 0.5 * (begin + middle), end)
            run = self._judged(run, other, rough)
            if run.difference <= self._tolerance or fine == _FINEST:
                if tick is not None:
                    tick(1000, 1000)
                return run
            # As much finer as it was too rough, and some more.
            finer = max(_STEP * self._tolerance / run.difference, _LEAST)
            rough = max(finer * rough, _COARSEST_FINEST)
            begin = end

    def single_call(self, x: Floats, v: Floats, tick: Tick | None = None) -> SoftHistory | None:
        """Compute a motion from displacements and velocities in few calls, without estimate.

        None where that was not possible: `follow` can do it, or raises the error.

        Parameters
        ----------
        x, v : array, shape (dof,)
        """
        if self._modes is None or not x.shape == v.shape == self._shape:
            return None
        error, shape = self._error, (self._times.size - 1, self._dofs.size)
        order, state = order_of(error), (2, self._basis.pairs)
        progress, history = self._progress(order), (np.empty(shape), np.empty(shape))
        samples = np.empty((self._times.size, *state))
        work = np.empty(state), np.empty(state), samples, self._no_contacts
        stop: int = Stop.BUDGET
        while stop == Stop.BUDGET:
            stop = whole_soft_motion(
                self._modes, self._linear, self._limiters, (order, error), self._times, progress,
                (x, v), work, history,
            )  # fmt: skip
            if stop == Stop.BUDGET and self._is_too_long(progress):
                return None
            if stop == Stop.BUDGET and tick is not None:
                tick(int(1e3 * float(progress["time"]) / self._end), 1000)
        if stop != Stop.END:
            return None
        return SoftHistory(*history, float(progress["deepest"]), int(progress["steps"]))

    @property
    def _no_contacts(self) -> Contacts:
        return Contacts(np.zeros(0, PHASE), np.full(self._limiters.laws.size, -1))

    @property
    def _error(self) -> float:
        """The error of a step of a motion without estimate."""
        return max(_STEP * self._tolerance, _FINEST)

    def _progress(self, order: int, heed: float = 0.0) -> Any:
        """Return a motion's progress at its beginning, for `kernels.taylor.follow`."""
        pairs, walls = self._linear.pairs.size, self._limiters.laws.size
        step = (10 + 4 * walls) * pairs + 10 * self._linear.drives.size + walls * (30 + 3 * order)
        most = max(1, WORK // (500 + order * step))
        rows = SAMPLES * max(1, WORK // (SAMPLES * self._row))
        begun = (0.0, 0.0, self._end, _FIRST, 0.0, 0.0, heed, 0, 0, most, 0, rows, 0)
        return np.array([begun], dtype=PROGRESS)[0]

    def _is_too_long(self, progress: Any) -> bool:
        """Return whether a motion needs more steps than are taken, by its progress so far."""
        steps, part = int(progress["steps"]), float(progress["time"]) / self._end
        return steps >= _TOLD and not steps < _MOST_STEPS * part

    def _judged(self, run: SoftRun, other: SoftRun, rough: float) -> SoftRun:
        """Return a run with its difference to another one as its estimated error.

        As far as the difference comes from longer steps, it is many times the error, unless the
        longer steps happen to err by little: what the shorter ones leave out counts at least. As
        far as it comes from roundings, it is one sample of them, and less than others may be; those
        of the states that are returned are in both runs.
        """
        basis = self._basis
        # Relative to the motion, not to where loads carry it or whence it moves there.
        states = run.states - other.states
        off = np.abs(basis.whole(states, level=0.0))
        off[:, 0] /= basis.grain
        apart = np.maximum(off.max(axis=(1, 2)), run.cut)
        largest = float(np.abs(basis.whole(run.states, level=1.0)).max(initial=0.0))
        apart = apart / largest if largest > 0.0 else apart
        sampled, rounding = 1.0 + _REPEATED * _COARSEST_FINEST / rough, _CONVERTED * _EPS
        apart = np.where(apart > 0.0, sampled * apart + rounding, 0.0)
        late = np.flatnonzero(~(apart <= self._tolerance))
        until = self._times[late[0]] if late.size else self._end
        count = int(late[0]) if late.size else apart.size
        return replace(
            run,
            difference=float(apart.max()),
            known_until=float(until) / self._scale,
            distance=Distance(
                (np.arange(apart.size - 1) < count)[self.places],
                states[:count],
                off[:count],
                run.cut,
                sampled,
                rounding * largest,
            ),
        )

    def _run(
        self,
        z: Floats,
        error: float,
        tick: Tick | None,
        begin: float,
        end: float,
        *,
        off: bool = False,
    ) -> SoftRun:
        """Follow a motion with steps of some error.

        Off: with the roundings of what is given, and with what forces miss unseen in its steps.
        Its progress counts from one part of the whole work to another.
        """
        linear, limiters, basis, scene = self._linear, self._limiters, self._basis, self._scene
        states = np.empty((self._times.size, *z.shape))
        state, lost = z.copy(), np.zeros_like(z)
        if off:
            size = float((np.abs(z) * basis.weights).max())
            noise = _EPS * size * basis.signs[0] * basis.own
            noise[0] *= basis.grain
            state += noise
            linear, limiters = _linear(scene, _EPS * basis.drifts[0]), self._others
        order = order_of(error)
        progress, contacts = self._progress(order, _HEED if off else 0.0), self._no_contacts
        if self._contacts:
            room = np.zeros(_PHASES + contacts.lasting.size, PHASE)
            contacts = contacts._replace(phases=room)
        segment = self._begin_segment(0, progress, state)
        while True:
            stop = follow(
                linear,
                limiters,
                (order, error),
                self._times,
                progress,
                state,
                lost,
                states,
                contacts,
            )
            if stop == Stop.END and progress["end"] >= self._end:
                cut = _LEFT_OUT * math.sqrt(float(progress["cut"]))
                deepest, steps = float(progress["deepest"]), int(progress["steps"])
                phases = contacts.phases[: progress["phases"]] if self._contacts else None
                return SoftRun(states, deepest, steps, cut, phases=phases)
            if stop == Stop.END:
                segment = self._begin_segment(segment + 1, progress, state)
            elif stop == Stop.PHASES:
                hold(contacts.phases.nbytes)
                room = np.concatenate([contacts.phases, np.zeros_like(contacts.phases)])
                contacts = contacts._replace(phases=room)
            part = float(progress["time"]) / self._end
            if stop == Stop.STIFF or self._is_too_long(progress):
                message = (
                    "the limiters are so stiff that the motion needs more than "
                    f"{_MOST_STEPS:g} steps"
                )
                raise ConvergenceError(message)
            if tick is not None:
                tick(int(1e3 * (begin + (end - begin) * part)), 1000)

    def _begin_segment(self, segment: int, progress: Any, state: Floats) -> int:
        """Let loads vary as they do between two samples; the motion goes on to the second."""
        ramps = self._ramps
        if not ramps.count:
            return segment
        time = float(progress["time"]) / self._scale
        segment = max(segment, ramps.segment(time))
        self._basis.set_ramps(state[np.newaxis], ramps.state(segment, time))
        until = math.inf
        if segment + 2 < ramps.times.size:
            until = float(ramps.times[segment + 1]) * self._scale
        progress["end"] = min(until, self._end)
        return segment


def _linear(scene: Configuration, drift: Floats | float = 0.0) -> Linear:
    """Return a structure without its limiters, its frequencies changed by some drift."""
    flow = scene.kernel.flow
    nu, index = flow.nu + drift, np.arange(flow.nu.size)
    rotates, swells = index < flow.rotations, index < flow.hyperbolas_end
    pairs = np.zeros(index.size, PAIR)
    pairs["alpha"], pairs["push"], pairs["weight"] = flow.alpha, flow.push, scene.basis.weights
    pairs["turn"] = np.where(swells, nu, 1.0)
    pairs["back"] = np.where(rotates, -nu, np.where(swells, nu, 0.0))
    pairs["rest"] = np.where(rotates, flow.rest, 0.0)
    return Linear(pairs, flow.drives)
