"""Impact modes: the periodic motions of a structure that strikes its limiters twice a period.

The odd family of eq. 10.49-10.59 and 10.87-10.89: every active constraint strikes its upper
wall at tau = 1 and its lower one at tau = -1. Each frequency has one member, real or phantom.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from enum import IntEnum
from typing import Annotated, Any, Final

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Booleans, Floats, Integers, Quantity
from vibroimpact_solvers.cost import OVERHEAD_SECONDS, seconds
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.kernels import response
from vibroimpact_solvers.model import System
from vibroimpact_solvers.plan import Plan, Skip, Stage, Step

KIND: Final = "impact-modes"
OUTPUTS: Final = ("impulse", "exists", "reason", "shape", "waveform", "energy")

Tick = Callable[[int, int], None]

_EPS = float(np.finfo(np.float64).eps)
_BLOCK = 4096  # frequencies between two ticks


class Reason(IntEnum):
    """Whether a member of the family is a motion of the structure, and why not."""

    OK = 0
    NEGATIVE_IMPULSE = 1
    WRONG_VELOCITY = 2
    PENETRATION = 3
    SINGULAR = 4

    @property
    def sentence(self) -> str:
        """The reason in words."""
        return _SENTENCES[self]


_SENTENCES: Final = {
    Reason.OK: "the member is a motion of the structure",
    Reason.NEGATIVE_IMPULSE: "a wall would have to pull",
    Reason.WRONG_VELOCITY: "a constrained coordinate would leave its wall before the impact",
    Reason.PENETRATION: "a limit is passed between the impacts",
    Reason.SINGULAR: "no finite impulse brings the structure to its walls at this frequency",
}
REASONS: Final = tuple(reason.name.lower() for reason in Reason)


@dataclass(frozen=True, eq=False)
class Problem:
    """Which members of which family, and what about them.

    Parameters
    ----------
    system : System
        The structure.
    omega : array, shape (frequency,)
        Triangle-wave frequencies, rad per unit of time, positive; Omega = (pi/2) omega.
    active : tuple of int
        The constraints that are struck; empty stands for all.
    outputs : frozenset of str
        What is wanted, out of `OUTPUTS`.
    dofs : array of int, optional
        Degrees of freedom of shape and waveform; None for all.
    tau : array, optional
        Triangle-wave times of the waveform, in [-1, 1].
    tolerance : float, optional
        Relative accuracy asked for.
    Omega : array, shape (frequency,), optional
        The fundamental frequencies where they were given instead of omega, kept to the bit.
    """

    system: System
    omega: Floats
    active: tuple[int, ...] = ()
    outputs: frozenset[str] = frozenset({"impulse", "exists", "reason"})
    dofs: Integers | None = None
    tau: Floats | None = None
    tolerance: float | None = None
    Omega: Floats | None = None

    def __post_init__(self) -> None:
        count = len(self.system.constraints)
        object.__setattr__(self, "active", tuple(self.active) or tuple(range(count)))
        dofs = np.arange(self.system.n) if self.dofs is None else self.dofs
        object.__setattr__(self, "dofs", np.asarray(dofs, dtype=np.int64))
        object.__setattr__(self, "omega", np.ascontiguousarray(self.omega, dtype=np.float64))
        Omega = 0.5 * np.pi * self.omega if self.Omega is None else self.Omega
        object.__setattr__(self, "Omega", np.ascontiguousarray(Omega, dtype=np.float64))
        tau = np.zeros(0) if self.tau is None else self.tau
        object.__setattr__(self, "tau", np.ascontiguousarray(tau, dtype=np.float64))
        self._check()

    def _check(self) -> None:
        if self.omega.ndim != 1 or self.omega.size == 0:
            raise ModelError(("frequency",), "there is no frequency", code="empty_grid")
        if not (np.isfinite(self.omega) & (self.omega > 0)).all():
            message = "a frequency is not positive and finite"
            raise ModelError(("frequency",), message, code="frequency_not_positive")
        if not self.system.constraints:
            message = "impact modes need a constraint"
            raise ModelError(("system", "constraints"), message, code="no_constraint")
        self._check_indices("active", self.active, len(self.system.constraints))
        self._check_indices("dofs", self.wanted_dofs.tolist(), self.system.n)
        unknown = self.outputs - set(OUTPUTS)
        if unknown or not self.outputs:
            message = f"outputs are {', '.join(OUTPUTS)}"
            raise ModelError(("outputs",), message, code="unknown_output")
        if "waveform" in self.outputs and self.times.size == 0:
            message = "the waveform needs the triangle-wave times tau"
            raise ModelError(("tau",), message, code="missing_tau")
        if not (np.abs(self.times) <= 1.0).all():
            raise ModelError(("tau",), "tau is in [-1, 1]", code="tau_out_of_range")
        self._check_supported()

    def _check_indices(self, name: str, indices: Sequence[int], limit: int) -> None:
        for place, index in enumerate(indices):
            if not 0 <= index < limit:
                message = f"{index} is not below {limit}"
                raise ModelError((name, place), message, code="index_out_of_range")
        if len(set(indices)) != len(indices):
            raise ModelError((name,), "an index is given twice", code="duplicate_index")

    def _check_supported(self) -> None:
        for index in self.active:
            if not self.system.constraints[index].symmetric:
                message = "impact modes need two walls at equal distance, as a single number"
                pointer = ("system", "constraints", index, "gap")
                raise ModelError(pointer, message, code="gap_not_symmetric")
        if self.system.force is not None and self.system.force.any():
            message = "impact modes need a structure without a static load"
            raise ModelError(("system", "force"), message, code="static_load")

    @property
    def wanted_dofs(self) -> Integers:
        """Degrees of freedom of shape and waveform, shape (dof,)."""
        assert self.dofs is not None
        return self.dofs

    @property
    def fundamental(self) -> Floats:
        """Fundamental frequencies, shape (frequency,)."""
        assert self.Omega is not None
        return self.Omega

    def slice(self, start: int, stop: int) -> Problem:
        """Return the same problem at some of its frequencies."""
        return replace(
            self, omega=self.omega[start:stop], Omega=self.fundamental[start:stop]
        )

    @property
    def times(self) -> Floats:
        """Triangle-wave times of the waveform, shape (tau,)."""
        assert self.tau is not None
        return self.tau


@dataclass(frozen=True, eq=False)
class Result:
    """Members of the family; None stands for what was not asked.

    A singular member (no finite impulse) has impulse 0 and everything else 0.
    """

    Omega: Annotated[
        Floats,
        Quantity(
            ("frequency",), "time-1", "fundamental angular frequency", True, path="frequency/Omega"
        ),
    ]
    omega: Annotated[
        Floats,
        Quantity(("frequency",), "time-1", "triangle-wave frequency", True, path="frequency/omega"),
    ]
    constraint: Annotated[
        Integers, Quantity(("constraint",), "1", "index of the active constraint", True)
    ]
    dof: Annotated[Integers | None, Quantity(("dof",), "1", "index of the degree of freedom", True)]
    tau: Annotated[Floats | None, Quantity(("tau",), "1", "triangle-wave time", True)]
    impulse: Annotated[
        Floats | None,
        Quantity(("frequency", "constraint"), "mass length time-2", "impulse parameter p"),
    ]
    exists: Annotated[
        Booleans | None,
        Quantity(
            ("frequency",),
            "1",
            "whether the member is a real motion",
            flags=("phantom", "real"),
        ),
    ]
    reason: Annotated[
        Integers | None,
        Quantity(("frequency",), "1", "why the member is a phantom", flags=REASONS),
    ]
    shape: Annotated[
        Floats | None, Quantity(("frequency", "dof"), "length", "displacement at tau = 1")
    ]
    waveform: Annotated[
        Floats | None, Quantity(("frequency", "tau", "dof"), "length", "displacement")
    ]
    energy: Annotated[
        Floats | None, Quantity(("frequency",), "mass length2 time-2", "total energy")
    ]
    impulse_error: Annotated[
        Floats,
        Quantity(
            ("frequency",), "1", "estimated relative error of the impulse", path="error/impulse"
        ),
    ]

    #: How the error was obtained.
    error_statement: str = (
        "estimate: unit roundoff times the condition of the impulse with respect to "
        "the natural frequencies and modes"
    )


def plan(problem: Problem) -> Plan:
    """Decide how the members are computed and what is left out."""
    system, outputs = problem.system, problem.outputs
    method = spectrum.choose(system)
    n, count, points = system.n, len(problem.active), problem.omega.size
    known = spectrum.key(system, method) in spectrum.CACHE
    steps = [
        Step(
            Stage.SPECTRUM,
            method,
            spectrum.REASONS[method] + ("; already known" if known else ""),
            0.0 if known else spectrum.flops(system, method),
            8.0 * n * (n + 1),
        ),
        _impulse_step(count, n, points),
    ]
    skips = [_unconstrained_rows(problem), *_silent_modes(problem)]
    if outputs & {"exists", "reason"}:
        reason = "p > 0 and the pre-impact velocities towards the walls are necessary"
        steps.append(Step(Stage.EXISTENCE, "signs", reason, 4.0 * points * count**2, points))
    dofs = problem.wanted_dofs.size
    for name, stage, times in (
        ("shape", Stage.SHAPE, 1),
        ("waveform", Stage.WAVEFORM, problem.times.size),
    ):
        if name in outputs:
            reason = f"{dofs} of {n} degrees of freedom at {times} of the times tau"
            flops = points * n * times * (2.0 * dofs + 30.0)
            steps.append(Step(stage, "modal sum", reason, flops, 8.0 * points * times * dofs))
    if "energy" in outputs:
        reason = "each mode holds a constant energy"
        steps.append(Step(Stage.ENERGY, "modal sum", reason, 4.0 * points * n, 8.0 * points))
    unasked = [name for name in OUTPUTS if name not in outputs and name != "reason"]
    skips += [Skip(name, "not asked") for name in unasked]
    return Plan(KIND, tuple(steps), tuple(skips))


def _impulse_step(count: int, n: int, points: int) -> Step:
    if count == 1:
        reason = "one constraint: a division for each frequency (eq. 10.53)"
        return Step(Stage.IMPULSE, "scalar", reason, 40.0 * n * points, 16.0 * points)
    reason = f"{count} constraints couple: one small system for each frequency (eq. 10.88)"
    work = points * (40.0 * n + 4.0 * n * count**2 + 8.0 * (count + 0.05 * n) ** 3)
    return Step(Stage.IMPULSE, "bordered", reason, work, 8.0 * points * (count + 1))


def _unconstrained_rows(problem: Problem) -> Skip:
    n, count = problem.system.n, len(problem.active)
    what = f"{n - count} of {n} rows of the modal matrix in the impulses"
    return Skip(what, "only constrained coordinates enter them")


def _silent_modes(problem: Problem) -> list[Skip]:
    """Return which modes take no part, where that is known without computing them."""
    chain = problem.system.chain
    constraints = [problem.system.constraints[a] for a in problem.active]
    if chain is None or any(len(c.coordinate) > 1 for c in constraints):
        return []
    places = [c.coordinate[0][0] + 1 for c in constraints]
    period = math.lcm(*((chain.n + 1) // math.gcd(place, chain.n + 1) for place in places))
    silent = range(period, chain.n + 1, period)
    if not silent:
        return []
    listed = ", ".join(str(j) for j in silent[:8]) + (", …" if len(silent) > 8 else "")
    return [Skip(f"modes {listed}", "they have a node at every active constraint")]


def solve(problem: Problem, plan: Plan, tick: Tick | None = None) -> Result:
    """Compute what the plan lists.

    Parameters
    ----------
    problem : Problem
    plan : Plan
        The one that `plan(problem)` returned.
    tick : callable, optional
        Called with (done, total) frequencies; may raise `Cancelled`.
    """
    total = problem.omega.size
    pieces = []
    members = _Members(problem, plan)
    for start in range(0, total, _BLOCK):
        if tick is not None:
            tick(start, total)
        pieces.append(members.at(problem.slice(start, start + _BLOCK)))
    if tick is not None:
        tick(total, total)
    return _concatenate(pieces)


class _Members:
    """The family of one problem, ready to be evaluated at frequencies."""

    def __init__(self, problem: Problem, plan: Plan) -> None:
        self.problem, self.plan = problem, plan
        step = plan.step(Stage.SPECTRUM)
        assert step is not None
        natural = spectrum.spectrum(problem.system, spectrum.Method(step.method))
        rows = np.zeros((len(problem.active), problem.system.n))
        for row, index in zip(rows, problem.active, strict=True):
            for dof, weight in problem.system.constraints[index].coordinate:
                row += weight * natural.modes[dof]
        # A mode with a node at every constraint is neither excited nor felt.
        heard = np.flatnonzero(rows.any(axis=0))
        self.rows = np.ascontiguousarray(rows[:, heard])
        self.eigenvalues = np.ascontiguousarray(natural.eigenvalues[heard])
        self.modes = np.zeros((0, heard.size))
        if plan.step(Stage.SHAPE) or plan.step(Stage.WAVEFORM):
            self.modes = natural.modes[np.ix_(problem.wanted_dofs, heard)]
        self.gaps = np.array([problem.system.constraints[a].upper for a in problem.active])
        self.mobility = self.rows @ self.rows.T

    def at(self, problem: Problem) -> Result:
        """Return the members at some of the frequencies."""
        plan, omega = self.plan, problem.omega
        p, condition, d = self._impulses(omega)
        singular: Booleans = np.logical_not(np.isfinite(p).all(axis=1))
        p[singular] = 0.0
        reason = None
        if plan.step(Stage.EXISTENCE):
            reason = self._reasons(p, singular)
        shape = waveform = energy = None
        if plan.step(Stage.SHAPE):
            shape = self._displacements(omega, p, d, np.ones(1))[:, 0]
        if plan.step(Stage.WAVEFORM):
            waveform = self._displacements(omega, p, d, problem.times)
        if plan.step(Stage.ENERGY):
            energy = response.energies(self.eigenvalues, omega, d)
        shaped = shape is not None or waveform is not None
        return Result(
            Omega=problem.fundamental,
            omega=omega,
            constraint=np.array(problem.active, dtype=np.int64),
            dof=problem.wanted_dofs if shaped else None,
            tau=problem.times if waveform is not None else None,
            impulse=p if "impulse" in problem.outputs else None,
            exists=None if reason is None or "exists" not in problem.outputs else reason == 0,
            reason=reason if "reason" in problem.outputs else None,
            shape=shape,
            waveform=waveform,
            energy=energy,
            impulse_error=np.minimum(_EPS * condition, 1.0),
        )

    def _impulses(self, omega: Floats) -> tuple[Floats, Floats, Floats]:
        """Return p (frequency, constraint), its condition and the modal amplitudes."""
        step = self.plan.step(Stage.IMPULSE)
        assert step is not None
        if step.method == "bordered":
            return response.impulses(self.eigenvalues, self.rows, omega, self.gaps)
        weight2 = self.rows[0] ** 2
        one, condition = response.impulse_one(self.eigenvalues, weight2, omega, self.gaps[0])
        p = one[:, np.newaxis]
        if any(self.plan.step(s) for s in (Stage.SHAPE, Stage.WAVEFORM, Stage.ENERGY)):
            finite = np.nan_to_num(p)
            return p, condition, response.amplitudes(self.eigenvalues, self.rows, omega, finite)
        return p, condition, np.zeros((omega.size, 0))

    def _reasons(self, p: Floats, singular: Booleans) -> Integers:
        """Return the reason codes, shape (frequency,)."""
        codes = np.zeros(p.shape[0], dtype=np.int64)
        codes[~(p @ self.mobility > 0.0).all(axis=1)] = Reason.WRONG_VELOCITY
        codes[~(p > 0.0).all(axis=1)] = Reason.NEGATIVE_IMPULSE
        codes[singular] = Reason.SINGULAR
        return codes

    def _displacements(self, omega: Floats, p: Floats, d: Floats, tau: Floats) -> Floats:
        wanted = np.ones(self.eigenvalues.size, dtype=np.bool_)
        return response.displacements(
            self.eigenvalues, self.modes, omega, d, p @ self.rows, tau, wanted
        )


def split(problem: Problem, plan: Plan, seconds_each: float) -> list[Problem]:
    """Cut a problem into deterministic pieces of about the given cost, by frequency."""
    size = problem.omega.size
    spectral = plan.step(Stage.SPECTRUM)
    shared = Plan(KIND, (spectral,)) if spectral is not None else Plan(KIND, ())
    each = (seconds(plan) - seconds(shared)) / size
    points = max(1, int(seconds_each / max(each, OVERHEAD_SECONDS * 1e-3)))
    return [
        problem.slice(start, start + points)
        for start in range(0, size, points)
    ]


def join(problem: Problem, plan: Plan, results: Sequence[Result]) -> Result:
    """Put the results of all pieces together again."""
    return _concatenate(results)


_ALONG: Final = {
    field.name
    for field in fields(Result)
    if field.name not in {"constraint", "dof", "tau", "error_statement"}
}


def _concatenate(results: Sequence[Result]) -> Result:
    if len(results) == 1:
        return results[0]
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(result, name) for result in results])
        for name in _ALONG
        if getattr(results[0], name) is not None
    }
    return replace(results[0], **joined)
