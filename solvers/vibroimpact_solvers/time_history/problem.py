"""The problem: the motion of a structure from an initial state, with impacts at its limiters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from vibroimpact_solvers import condensation, laws
from vibroimpact_solvers import walls as moving
from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.checks import check_indices, check_outputs
from vibroimpact_solvers.derivatives import Parameter, check_parameters
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import RANGE, Constraint, System
from vibroimpact_solvers.time_history.limiters import Power
from vibroimpact_solvers.time_history.loads import Harmonic, Load, Sampled

KIND: Final = "time-history"
EXACT: Final = "exact"
INTEGRATORS: Final = ("RK45", "RK23", "DOP853", "Radau", "BDF", "LSODA")
"""Integrators of scipy, for comparison."""
DIGITS: Final = (17, 1000)
"""Smallest and largest number of digits."""
MOST_DOFS: Final = 200
"""Degrees of freedom up to which extended precision is available."""
MOST_STOPPED: Final = 1000
"""Degrees of freedom up to which motions with stops of finite stiffness are computed."""
TOLERANCE: Final = 1e-6
"""Tolerance where the problem names none."""
_FOLLOWS: Final = 1e-9
"""Part of the largest entry by which a state may miss the static relation."""
OUTPUTS: Final = ("x", "v", "impacts", "energy", "contacts")
"""Outputs of all motions; rigid and linear stops have accelerations, too, and stops of finite
stiffness the force."""
MOVED: Final = ("x", "v", "a")
"""Outputs of each degree of freedom: displacements, velocities and accelerations."""
STATES: Final = frozenset({*MOVED, "energy"})
"""Outputs of the states at the output times."""
SAMPLED: Final = STATES | {"force"}
"""Outputs at the output times."""


@dataclass(frozen=True, eq=False, slots=True)
class State:
    """Displacements and velocities at t = 0, each shape (dof,).

    Degrees of freedom without mass follow the others: zero stands for that, and another value
    must agree with it.
    """

    x: Floats
    v: Floats


@dataclass(frozen=True, slots=True)
class ImpactMode:
    """The impact mode on which a motion starts, at tau = 0.

    Parameters
    ----------
    Omega : float
        Its fundamental frequency.
    active : tuple of int
        The constraints that it strikes; empty stands for all.
    """

    Omega: float
    active: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class Problem:
    """One motion and its outputs.

    Parameters
    ----------
    system : System
    initial : State or ImpactMode
    t_end : float
        Length of the motion, positive.
    t : array, shape (time,), optional
        Ascending times of the history, in [0, t_end].
    dofs : array of int, optional
        Degrees of freedom of the history; None for all.
    outputs : frozenset of str
        Names of outputs, out of `OUTPUTS`, ``"a"`` and ``"force"``.
    tolerance : float, optional
        Required accuracy, relative to the size of the motion; None: 1e-6.
    load : tuple of Harmonic or Sampled
        Loads that vary, beside the constant one of the system.
    limiter : Power, optional
        The law of soft limiters; None for rigid ones.
    method : str
        `EXACT`, or one of the `INTEGRATORS` to compare with.
    digits : int, optional
        Decimal digits of the arithmetic where double precision cannot keep the tolerance.
    estimate : bool
        Whether errors are estimated, and with them the time until which they are small.
    parameters : tuple of Parameter
        By which the outputs are differentiated.
    contact_impulses : bool
        Whether impulses of contacts with rigid stops are computed; nan otherwise.
    """

    system: System
    initial: State | ImpactMode
    t_end: float
    t: Floats | None = None
    dofs: Integers | None = None
    outputs: frozenset[str] = frozenset({"impacts"})
    tolerance: float | None = None
    load: tuple[Load, ...] = ()
    limiter: Power | None = None
    method: str = EXACT
    estimate: bool = True
    digits: int | None = None
    parameters: tuple[Parameter, ...] = ()
    contact_impulses: bool = True

    def __post_init__(self) -> None:
        t = np.zeros(0) if self.t is None else np.ascontiguousarray(self.t, dtype=np.float64)
        every = self.dofs is None
        dofs = np.arange(self.system.n) if self.dofs is None else self.dofs
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "dofs", np.asarray(dofs, dtype=np.int64))
        object.__setattr__(self, "outputs", frozenset(self.outputs))
        self._check_times()
        self._check_outputs()
        if not every:
            check_indices("dofs", self.output_dofs, self.system.n)
        self._check_load()
        self._check_limiter()
        self._check_laws()
        self._check_digits()
        self._check_accelerations()
        self.check(self.initial)
        if self.parameters:
            self._check_parameters()
        if isinstance(self.initial, State) and self.system.massless.size:
            object.__setattr__(self, "initial", _followed(self.system, self.initial))

    def check(self, initial: State | ImpactMode) -> None:
        """Raise `ModelError` where the motion cannot start from this state."""
        if isinstance(initial, State):
            self._check_state(initial)
        else:
            self._check_impact_mode(initial)

    def _check_times(self) -> None:
        if not 0.0 < self.t_end < math.inf:
            message = f"the end is {self.t_end!r}, not a positive time"
            raise ModelError(("t_end",), message, code="out_of_range")
        _check_magnitude(("t_end",), self.t_end)
        times = self.times
        if not times.size:
            return
        first, last = float(times[0]), float(times[-1])
        # Between finite ends times that ascend are finite.
        finite = math.isfinite(first) and math.isfinite(last)
        if not finite or not (times[1:] >= times[:-1]).all():
            raise ModelError(("t",), "the times do not ascend", code="not_ascending")
        if not 0.0 <= first <= last <= self.t_end:
            message = f"the times are not between 0 and t_end = {self.t_end!r}"
            raise ModelError(("t",), message, code="out_of_range")

    def _check_outputs(self) -> None:
        check_outputs(self.outputs, (*OUTPUTS, "a", "force"))
        if self.outputs & SAMPLED and self.times.size == 0:
            raise ModelError(("t",), "a history needs the times t", code="missing_t")
        if self.tolerance is not None and not 1e-15 <= self.tolerance < 1.0:
            message = f"the tolerance is {self.tolerance!r}; double precision gives 1e-15 at best"
            raise ModelError(("tolerance",), message, code="out_of_range")

    def _check_load(self) -> None:
        if not self.load:
            return
        n, massless = self.system.n, set(self.system.massless.tolist())
        if not massless and _harmonic_loads_are_valid(self.load, n):
            return  # thousands are compared at once
        for place, term in enumerate(self.load):
            if isinstance(term, Sampled):
                self._check_samples(place, term)
                continue
            if not 0 <= term.dof < n:
                message = f"{term.dof} is not below {n}"
                raise ModelError(("load", place, "dof"), message, code="index_out_of_range")
            if term.amplitude != 0.0 and term.dof in massless:
                force = np.zeros(n)
                force[term.dof] = 1.0
                self.system.check_load(force, ("load", place, "dof"))
            for name in ("amplitude", "frequency", "phase"):
                value = getattr(term, name)
                if not math.isfinite(value) or (name == "frequency" and value < 0.0):
                    message = f"the {name} is {value!r}"
                    raise ModelError(("load", place, name), message, code="out_of_range")
                _check_magnitude(("load", place, name), value)

    def _check_samples(self, place: int, term: Sampled) -> None:
        if term.direction.shape != (self.system.n,):
            message = f"{term.direction.size} numbers for {self.system.n} degrees of freedom"
            raise ModelError(("load", place, "direction"), message, code="wrong_length")
        self.system.check_load(term.direction, ("load", place, "direction"))
        if term.t.size < 2 or term.t.shape != term.values.shape:
            message = f"{term.values.size} values at {term.t.size} times"
            raise ModelError(("load", place, "values"), message, code="wrong_length")
        for name, values in (("t", term.t), ("values", term.values)):
            if not np.isfinite(values).all():
                message = "an entry is nan or infinite"
                raise ModelError(("load", place, name), message, code="not_finite")
            _check_magnitude(("load", place, name), float(np.abs(values).max()))
        if not (term.t[1:] > term.t[:-1]).all():
            raise ModelError(("load", place, "t"), "the times do not ascend", code="not_ascending")
        if not term.t[0] <= 0.0 or not term.t[-1] >= self.t_end:
            message = (
                f"samples from {float(term.t[0])!r} to {float(term.t[-1])!r} do not last from 0 to "
                f"t_end = {self.t_end!r}"
            )
            raise ModelError(("load", place, "t"), message, code="out_of_range")
        if self.limiter is not None or self.digits is not None:
            message = "sampled loads act on motions with rigid limiters in double precision"
            raise ModelError(("load", place), message, code="not_possible")

    def _check_limiter(self) -> None:
        if self.method not in {EXACT, *INTEGRATORS}:
            message = f"methods are {EXACT} and, to compare with, {', '.join(INTEGRATORS)}"
            raise ModelError(("method",), message, code="unknown_choice")
        if self.limiter is None:
            return
        for name, least in (("exponent", 1.0), ("stiffness", 0.0), ("scale", 0.0)):
            value = getattr(self.limiter, name)
            if not (np.isfinite(value) and value >= least and value > 0.0):
                message = f"the {name} is {value!r}"
                raise ModelError(("limiter", name), message, code="out_of_range")
        for index, constraint in enumerate(self.system.constraints):
            if any(
                wall is not None and wall <= 0.0 for wall in (constraint.lower, constraint.upper)
            ):
                message = "a soft limiter needs positive gaps"
                pointer = ("system", "constraints", index, "gap")
                raise ModelError(pointer, message, code="gap_not_positive")
        if isinstance(self.initial, ImpactMode):
            message = "impact modes are motions between rigid limiters"
            raise ModelError(("initial",), message, code="not_rigid")

    @property
    def acting(self) -> tuple[Load, ...]:
        """The loads, and one without a force for the time course of each wall that moves.

        Those of sampled walls are the last ones, in the order of the constraints.
        """
        walls, n = [c.wall for c in self.system.constraints if c.wall], self.system.n
        swings = {f for wall in walls for f, *_ in moving.parts(wall)}
        given = [wall for wall in walls if isinstance(wall, moving.Samples)]
        courses = (Sampled(np.zeros(n), np.array(wall.t), np.array(wall.y)) for wall in given)
        return *self.load, *(Harmonic(0, 0.0, f) for f in sorted(swings)), *courses

    @property
    def stopped(self) -> bool:
        """Whether the stops have a finite stiffness."""
        return any(not c.law.rigid for c in self.system.constraints)

    @property
    def powered(self) -> bool:
        """Whether the force of a stop grows with a power, so that Taylor series are followed."""
        return any(c.law.name in laws.POWERS for c in self.system.constraints)

    def _check_laws(self) -> None:
        """Refuse stops whose motions are not computed, and forces of rigid ones."""
        constraints = self.system.constraints
        laws.require(KIND, constraints)
        if any(constraint.wall for constraint in constraints):
            moving.check(constraints, self.t_end)
        if not self.stopped:
            if "force" in self.outputs and constraints:
                message = "forces are those of stops of finite stiffness: the stops are rigid"
                raise ModelError(("outputs",), message, code="not_possible")
            return
        if self.system.n > MOST_STOPPED:
            message = (
                f"{self.system.n} degrees of freedom are more than the {MOST_STOPPED} up to which "
                "motions with stops of finite stiffness are computed: reduce the model"
            )
            raise ModelError(("system", "constraints", 0, "law"), message, code="too_large")
        rigid = next((i for i, c in enumerate(constraints) if c.law.rigid), None)
        lossy = (i for i, c in enumerate(constraints) if c.law.lossy and not c.law.rigid)
        dashpot = next(lossy, None)
        if self.powered and dashpot is not None:
            message = "linear stops beside hertz or power ones are computed without damping only"
            raise ModelError(
                ("system", "constraints", dashpot, "law"), message, code="not_possible"
            )
        moved = next((i for i, c in enumerate(constraints) if c.wall), None)
        if self.powered and moved is not None:
            message = "walls do not move in structures with hertz or power stops"
            raise ModelError(("system", "constraints", moved, "wall"), message, code="not_possible")
        if self.powered and self.system.flexibility is not None:
            message = "there is no residual flexibility in structures with hertz or power stops"
            raise ModelError(("system", "residual_flexibility"), message, code="not_possible")
        if rigid is not None:
            message = (
                "rigid stops beside stops of finite stiffness are not computed: all are rigid, or "
                "all have a law with a stiffness, of which a large one stands for a rigid stop"
            )
            raise ModelError(("system", "constraints", rigid), message, code="not_possible")
        for field, given, reason in (
            ("limiter", self.limiter is not None, "the laws of the stops and a limiter exclude one "
             "another"),
            ("method", self.method != EXACT, "integrators follow rigid and power limiters only"),
            ("initial", isinstance(self.initial, ImpactMode), "impact modes are motions between "
             "rigid stops"),
            ("digits", self.digits is not None, "stops of finite stiffness are followed in double "
             "precision only"),
        ):  # fmt: skip
            if given:
                raise ModelError((field,), reason, code="not_possible")

    def _check_digits(self) -> None:
        if self.digits is None:
            return
        low, high = DIGITS
        if not low <= self.digits <= high:
            message = f"{self.digits} digits are not between {low} and {high}"
            raise ModelError(("digits",), message, code="out_of_range")
        reason = None
        if self.limiter is not None:
            reason = "soft limiters are followed in double precision only"
        elif self.method != EXACT:
            reason = "integrators know double precision only"
        elif isinstance(self.initial, ImpactMode):
            reason = "impact modes are known in double precision only: give x and v"
        elif self.system.n > MOST_DOFS:
            reason = f"{self.system.n} degrees of freedom are more than {MOST_DOFS}"
        elif not self.estimate:
            reason = "they are used where the errors say so, which are not estimated"
        if reason is not None:
            raise ModelError(("digits",), reason, code="not_possible")

    def _check_accelerations(self) -> None:
        if "a" not in self.outputs:
            return
        reason = None
        if self.limiter is not None or self.powered:
            reason = "there are no accelerations with limiters that Taylor series follow"
        elif self.method != EXACT:
            reason = "integrators give no accelerations"
        elif self.digits is not None:
            reason = "accelerations are computed in double precision only"
        if reason is not None:
            raise ModelError(("outputs",), reason, code="not_possible")

    def _check_parameters(self) -> None:
        check_parameters(self.parameters, self.system)
        reason = None
        if self.limiter is not None or self.stopped:
            reason = "motions with stops of finite stiffness have no derivatives"
        elif self.method != EXACT:
            reason = "integrators give no derivatives"
        elif self.digits is not None:
            reason = "derivatives are computed in double precision only"
        elif isinstance(self.initial, ImpactMode):
            reason = "motions that start on an impact mode have no derivatives: give x and v"
        elif any(isinstance(term, Sampled) for term in self.load):
            reason = "motions under sampled loads have no derivatives"
        elif not self.estimate:
            reason = "derivatives need the errors of the motion"
        if reason is not None:
            raise ModelError(("derivatives",), reason, code="not_possible")
        for place, parameter in enumerate(self.parameters):
            changed = bool(parameter.M.entries or parameter.K.entries or parameter.C.entries)
            if changed and self.system.massless.size:
                message = (
                    "histories of structures with degrees of freedom without mass have no "
                    "derivatives by entries of their matrices"
                )
                raise ModelError(("derivatives", place), message, code="massless")

    def _check_state(self, state: State) -> None:
        for name, values in (("x", state.x), ("v", state.v)):
            if values.shape != (self.system.n,):
                message = f"{values.size} numbers for {self.system.n} degrees of freedom"
                raise ModelError(("initial", name), message, code="wrong_length")
            largest = float(np.abs(values).max(initial=0.0))
            if not math.isfinite(largest):
                message = "an entry is nan or infinite"
                raise ModelError(("initial", name), message, code="not_finite")
            _check_magnitude(("initial", name), largest)
        check_followed(self.system, state)
        rigid = self.system.constraints if self.limiter is None and not self.stopped else ()
        x = state.x.tolist()  # of thousands of limiters, numbers of Python are quicker
        for index, constraint in enumerate(rigid):
            if not within(constraint, x):
                y = sum(weight * x[dof] for dof, weight in constraint.coordinate)
                low, high = walls(constraint)
                message = (
                    f"constraint {index} is at {y!r}, outside of its limits [{low!r}, {high!r}]"
                )
                raise ModelError(("initial", "x"), message, code="outside_limits")

    def _check_impact_mode(self, mode: ImpactMode) -> None:
        if not (np.isfinite(mode.Omega) and mode.Omega > 0.0):
            message = f"Omega is {mode.Omega!r}, not positive"
            raise ModelError(("initial", "impact_mode", "Omega"), message, code="out_of_range")
        count = len(self.system.constraints)
        for place, index in enumerate(mode.active):
            if not 0 <= index < count:
                pointer = ("initial", "impact_mode", "active", place)
                message = f"{index} is not below {count}"
                raise ModelError(pointer, message, code="index_out_of_range")

    @property
    def neglected(self) -> list[str]:
        """A sentence about each part of the structure that has no effect."""
        if self.limiter is None:
            return []
        every = range(len(self.system.constraints))
        return self.system.taken_as_elastic(every, "soft limiters give back what they take")

    @property
    def times(self) -> Floats:
        """Times of the history, shape (time,)."""
        assert self.t is not None
        return self.t

    @property
    def history_times(self) -> Floats:
        """Times at which the state is needed, shape (time,)."""
        return self.times if self.outputs & SAMPLED else self.times[:0]

    @property
    def output_dofs(self) -> Integers:
        """Degrees of freedom of the history, shape (dof,)."""
        assert self.dofs is not None
        return self.dofs


def within(constraint: Constraint, x: Floats | list[float]) -> Any:
    """Return whether displacements, shape (dof, …), keep a constraint, each but for rounding."""
    terms = [weight * x[dof] for dof, weight in constraint.coordinate]
    y, rounding = sum(terms), 1e-14 * sum(map(abs, terms))
    low, high = walls(constraint)
    return (low - rounding <= y) & (y <= high + rounding)


def walls(constraint: Constraint) -> tuple[float, float]:
    """Return the least and the largest value of the coordinate of a constraint."""
    low = -math.inf if constraint.lower is None else -constraint.lower
    return low, math.inf if constraint.upper is None else constraint.upper


def check_followed(system: System, state: State) -> None:
    """Refuse displacements and velocities, (…, dof), that contradict the static relation.

    Where there is no mass, zero stands for what follows from the other degrees of freedom.
    """
    if not system.massless.size:
        return
    condensed = condensation.of(system)
    for name, values in (("x", state.x), ("v", state.v)):
        given, others = values[..., system.massless], values[..., condensed.massive]
        if not given.any():
            continue
        follow = (condensed.static @ others.T).T
        largest = np.abs(values).max(axis=-1, keepdims=True)
        wrong = (given != 0.0) & (np.abs(given - follow) > _FOLLOWS * largest)
        if wrong.any():
            place = tuple(np.argwhere(wrong)[0].tolist())
            dof = int(system.massless[place[-1]])
            message = (
                f"dof {dof} has no mass and follows the others: it is at {float(follow[place])!r}, "
                f"not at {float(given[place])!r}; give that value, or zero"
            )
            raise ModelError(("initial", name), message, code="massless_state")


def _followed(system: System, state: State) -> State:
    """Return a state in which what has no mass follows the others."""
    condensed = condensation.of(system)
    x, v = (condensed.whole(values[condensed.massive]) for values in (state.x, state.v))
    return State(x, v)


def tolerance_of(problem: Problem) -> float:
    """Return the required accuracy, that of the problem or `TOLERANCE`."""
    return TOLERANCE if problem.tolerance is None else problem.tolerance


def _harmonic_loads_are_valid(load: Sequence[Load], n: int) -> bool:
    """Whether all loads are harmonic, on degrees of freedom that there are, and in range."""
    harmonic = [term for term in load if isinstance(term, Harmonic)]
    if len(harmonic) < len(load):
        return False
    terms = [(term.amplitude, term.frequency, term.phase) for term in harmonic]
    dofs = [term.dof for term in harmonic]
    numbers = np.array(terms, dtype=np.float64).reshape(-1, 3)
    sizes = np.abs(numbers)
    in_range = ((sizes == 0.0) | ((sizes >= RANGE[0]) & (sizes <= RANGE[1]))).all()  # nan is not
    return bool(in_range and (numbers[:, 1] >= 0.0).all()) and (
        not dofs or (min(dofs) >= 0 and max(dofs) < n)
    )


def _check_magnitude(pointer: tuple[str | int, ...], value: float) -> None:
    """Refuse a number whose square leaves the range of double precision; zero may be."""
    size = abs(value)
    if size and not RANGE[0] <= size <= RANGE[1]:
        message = f"the largest number is {value!r}, not between {RANGE[0]} and {RANGE[1]}"
        raise ModelError(pointer, message, code="out_of_range")
