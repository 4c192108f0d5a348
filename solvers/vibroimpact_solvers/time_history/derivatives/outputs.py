"""Derivatives of the outputs of a motion, with their errors, and where there are none."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.derivatives import named
from vibroimpact_solvers.kernels.impact_law import NEWTON
from vibroimpact_solvers.kernels.rigid_state import Rows
from vibroimpact_solvers.time_history.derivatives.following import FACTOR, Following, Impacts
from vibroimpact_solvers.time_history.derivatives.terms import Bend
from vibroimpact_solvers.time_history.problem import MOVED, Problem, State
from vibroimpact_solvers.time_history.start import initial_state
from vibroimpact_solvers.time_history.stated_errors import Reach
from vibroimpact_solvers.time_history.structure import Structure

_SUMMED: Final = 8.0  # roundings of sums over modes
_PART: Final = 0.25  # of what an error of the state makes of a number, at least
_OF_IMPACTS: Final = ("time", "velocity", "impulse")


class Reason(IntEnum):
    """Whether there are derivatives, and why not."""

    OK = 0
    EVENT = 1
    CONTACT = 2
    ORDER = 3
    GRAZING = 4
    UNPREDICTABLE = 5
    START = 6


class _End:
    """The impacts that rates pass through, and why they pass no more."""

    def __init__(
        self, rows: Rows, errors: Floats, contact: float, until: float, grazings: int
    ) -> None:
        times = rows["time"]
        ends = [
            (int(np.searchsorted(times, contact, "right")), Reason.CONTACT),
            (_first(rows["law"] != NEWTON), Reason.ORDER),
            (_first(times >= until), Reason.UNPREDICTABLE),
            (_first((times < until) & ~np.isfinite(errors)), Reason.GRAZING),
            (_first(times <= 0.0), Reason.START),
            (0 if grazings else rows.size, Reason.GRAZING),
        ]
        self.count, self.reason = min(ends, key=lambda end: end[0])
        if self.count == rows.size:
            self.reason = Reason.OK
        self._times, self._contact, self._until, self._grazings = times, contact, until, grazings

    def stop(self, passed: int) -> None:
        """Let there be no more impacts than rates have passed: the next one is a grazing."""
        if passed < self.count:
            self.count, self.reason = passed, Reason.GRAZING

    @property
    def of_impacts(self) -> Integers:
        """The reason of each impact, shape (impact,)."""
        reasons = np.full(self._times.size, self.reason, dtype=np.int64)
        reasons[: self.count] = Reason.OK
        return reasons

    def of_times(self, times: Floats, late: Floats) -> Integers:
        """Return the reason of each output time; late are the errors of the impacts' times."""
        reasons = np.zeros(times.size, dtype=np.int64)
        reasons[times > self._contact] = Reason.CONTACT
        passed = self._times[: self.count]
        after = np.searchsorted(passed, times)
        for beside in (after - 1, after):
            near = np.clip(beside, 0, max(0, passed.size - 1))
            if passed.size:
                reasons[np.abs(times - passed[near]) <= late[near]] = Reason.EVENT
        if self.count < self._times.size:
            end = self._times[self.count] if self.reason is not Reason.START else -np.inf
            reasons[(times >= end) & (reasons != Reason.CONTACT)] = self.reason
        if self._grazings:
            reasons[:] = Reason.GRAZING
        reasons[(times >= self._until) & (reasons <= Reason.EVENT)] = Reason.UNPREDICTABLE
        return reasons


def _first(where: Any) -> int:
    return int(np.argmax(where)) if where.any() else where.size


def derived(
    problem: Problem,
    structure: Structure,
    rows: Rows,
    errors: Floats,
    contact: float,
    until: float,
    grazings: int,
    reach: Reach,
) -> dict[str, Any]:
    """Return the derivatives of a motion with rigid limiters.

    Parameters
    ----------
    problem : Problem
        With parameters.
    structure : Structure
    rows : array of `kernels.rigid_state.IMPACT`
        Its impacts.
    errors : array, shape (impact,)
        Errors of their times.
    contact : float
        Time at which the first contact begins, or infinite.
    until : float
        Time until which the motion is predictable, or infinite.
    grazings : int
        Touches of walls without an impulse.
    reach : Reach
        Of the structure without contacts.
    """
    assert isinstance(problem.initial, State)
    end = _End(rows, errors, contact, until, grazings)
    scale, times = structure.scale, problem.history_times
    following = Following(
        structure, problem.parameters, initial_state(problem, problem.initial, structure),
        Impacts.of(rows[: end.count], scale), times * scale,
    )  # fmt: skip
    outputs = _Outputs(problem, structure, following, reach)
    for some, states in following.blocks():
        outputs.take(some, states)
    end.stop(following.passed)
    values: dict[str, Any] = dict(named(problem.parameters))
    rates = [one.events.rates for one in following.motions]
    impacts = _Impacts(structure, problem, rows, rates, reach)
    values["derivative_distance"] = impacts.distance(end.count)
    if "impacts" in problem.outputs:
        values |= impacts.values(end.of_impacts)
    if times.size:
        late = np.maximum(errors, 4.0 * EPS * rows["time"])
        values |= outputs.values(end.of_times(times, late))
    return values


class _Outputs:
    """Derivatives at the output times."""

    def __init__(
        self, problem: Problem, structure: Structure, following: Following, reach: Reach
    ) -> None:
        self._structure, self._names = structure, problem.outputs
        self._dofs, self._terms = problem.output_dofs, following.terms
        self._reach = reach
        self._times = problem.history_times * structure.scale
        pairs = zip(problem.parameters, self._terms, strict=True)
        asked = "a" in self._names
        self._bends = [Bend.of(structure, *pair) for pair in pairs] if asked else []
        count, times = len(problem.parameters), problem.history_times.size
        sizes = dict.fromkeys(MOVED, (times, self._dofs.size, count)) | {"energy": (times, count)}
        self._values = {
            name: np.full((2, *size), np.nan) for name, size in sizes.items() if name in self._names
        }

    def take(self, some: slice, states: Sequence[Floats]) -> None:
        """Take the states of some output times, of the motion and of shaken ones."""
        structure = self._structure
        basis = structure.configuration().basis
        modes = basis.modes
        apart = [basis.whole(other[:, 1:] - states[0][:, 1:], level=0.0) for other in states[1:]]
        lengths = FACTOR * np.sqrt(
            np.max([(basis.measure * each**2).sum(axis=(2, 3)) for each in apart], axis=0)
        )
        q, rate = basis.coordinates(states[0])
        shapes = modes.shapes[self._dofs].T
        rounded = _SUMMED * EPS + modes.shape_error
        of = {"x": (q, 1.0), "v": (rate, structure.scale)}
        for place, (name, (rates, unit)) in enumerate(of.items()):
            if name not in self._values:
                continue
            value, error = self._values[name]
            value[some] = unit * np.swapaxes(rates[:, 1:] @ shapes, 1, 2)
            summed = unit * rounded * np.swapaxes(np.abs(rates[:, 1:]) @ np.abs(shapes), 1, 2)
            reach = self._reach.history[place]
            error[some] = lengths[:, np.newaxis] * reach[:, np.newaxis] + summed
        if "a" in self._values:
            value, error = self._values["a"]
            value[some], size = self._accelerations(some, states[0])
            others = [self._accelerations(some, other)[0] for other in states[1:]]
            error[some] = FACTOR * np.abs(np.array(others) - value[some]).max(axis=0)
            error[some] += lengths[:, np.newaxis] * self._reach.bend[0, :, np.newaxis]
            error[some] += rounded * size
        if "energy" in self._values:
            value, error = self._values["energy"]
            value[some], size = self._energies(states[0])
            others = [self._energies(other)[0] for other in states[1:]]
            whole = basis.whole(states[0][:, :1], level=1.0)
            length = np.sqrt((basis.measure * whole**2).sum(axis=(2, 3)))
            error[some] = FACTOR * np.abs(np.array(others) - value[some]).max(axis=0)
            error[some] += _PART * structure.scale**2 * length * lengths + rounded * size

    def _accelerations(self, some: slice, states: Floats) -> tuple[Floats, Floats]:
        """Return derivatives of accelerations, and the sums of the magnitudes of their terms.

        The rates of the rates of a state have the accelerations as rates of their coordinates.
        """
        basis, unit = self._structure.configuration().basis, self._structure.scale**2
        shapes = basis.modes.shapes[self._dofs].T
        bends = basis.coordinates(basis.drift(states[:, 1:]))[1]
        sizes = np.abs(bends)
        for p, bend in enumerate(self._bends):
            more, size = bend.at(self._times[some], states[:, 0])
            bends[:, p] += more
            sizes[:, p] += size
        values = unit * np.swapaxes(bends @ shapes, 1, 2)
        return values, unit * np.swapaxes(sizes @ np.abs(shapes), 1, 2)

    def _energies(self, states: Floats) -> tuple[Floats, Floats]:
        """Return derivatives of the energy, and the sums of the magnitudes of their terms."""
        basis = self._structure.configuration().basis
        modes, scale = basis.modes, self._structure.scale
        roots = modes.roots * (1.0 + modes.rests)
        q, rate = basis.coordinates(states)
        place, speed = q[:, 0] + basis.still, scale * rate[:, 0]
        pull = place * roots * np.abs(roots) - modes.load
        moved, faster = q[:, 1:], scale * rate[:, 1:]
        total = (pull[:, np.newaxis] * moved).sum(axis=2)
        total += (speed[:, np.newaxis] * faster).sum(axis=2)
        size = (np.abs(pull)[:, np.newaxis] * np.abs(moved)).sum(axis=2)
        size += (np.abs(speed)[:, np.newaxis] * np.abs(faster)).sum(axis=2)
        for p, terms in enumerate(self._terms):
            own = 0.5 * terms.K.at(place) + 0.5 * terms.M.at(speed) - place @ terms.force
            total[:, p] += own
            size[:, p] += np.abs(own) + np.abs(place) @ np.abs(terms.force)
        return total, size

    def values(self, reasons: Integers) -> dict[str, Any]:
        """Return the fields of the result."""
        values: dict[str, Any] = {"derivative_reason": reasons}
        for name, (value, error) in self._values.items():
            value[reasons != Reason.OK] = np.nan
            error[np.isnan(value)] = np.nan
            values[f"derivative_{name}"], values[f"derivative_{name}_error"] = value, error
        return values


class _Impacts:
    """Derivatives of the impacts."""

    def __init__(
        self,
        structure: Structure,
        problem: Problem,
        rows: Rows,
        rates: Sequence[Floats],
        reach: Reach,
    ) -> None:
        self._structure, self._rows, self._rates = structure, rows, rates
        self._place, self._speed, _ = reach.coordinates
        self._count = len(problem.parameters)

    def distance(self, count: int) -> Floats:
        """Return changes of the parameters to where an impact grazes, or coupled ones meet."""
        rows, times = self._rows[:count], self._rates[0][0][:count] / self._structure.scale
        velocities = self._rates[0][1][:count] * self._structure.scale
        if not count:
            return np.full(self._count, np.inf)
        with np.errstate(divide="ignore", invalid="ignore"):
            # The square of the velocity is what goes to zero in proportion.
            nearest = np.abs(rows["velocity"][:, np.newaxis] / (2.0 * velocities))
            i, k = rows["constraint"][:-1], rows["constraint"][1:]
            coupled = (i != k) & (self._structure.mobility[i, k] != 0.0)
            apart = np.diff(rows["time"])[:, np.newaxis] / np.abs(np.diff(times, axis=0))
        apart[~coupled] = np.inf
        every = np.concatenate([nearest, apart])
        return np.asarray(np.where(np.isnan(every), np.inf, every).min(axis=0))

    def values(self, reasons: Integers) -> dict[str, Any]:
        """Return the fields of the result."""
        rows, scale, count = self._rows, self._structure.scale, self._rates[0].shape[1]
        shape = rows.size, self._count
        value, error = np.full((2, 3, *shape), np.nan)
        units = np.array([1.0 / scale, scale, scale])[:, np.newaxis, np.newaxis]
        value[:, :count] = units * self._rates[0]
        apart = np.max([np.abs(other - self._rates[0]) for other in self._rates[1:]], axis=0)
        error[:, :count] = FACTOR * units * apart
        some = rows[:count]
        speed = np.abs(some["velocity"])[:, np.newaxis]
        bend = np.abs(some["acceleration"])[:, np.newaxis]
        place, fast = (each[some["constraint"], np.newaxis] for each in (self._place, self._speed))
        late, faster, kicked = error[:, :count]
        # An error of the state is at least what it is in two numbers that it makes.
        state = _PART * np.maximum(late * speed / place, faster / fast)
        mass = np.abs(some["impulse"])[:, np.newaxis] / speed
        least = fast + bend / speed * place
        np.maximum(late, state * place / speed, out=late)
        np.maximum(faster, state * least, out=faster)
        np.maximum(kicked, state * least * mass, out=kicked)
        error[:, :count] += _SUMMED * EPS * np.abs(value[:, :count])
        values: dict[str, Any] = {"derivative_impact_reason": reasons}
        for name, one, its in zip(_OF_IMPACTS, value, error, strict=True):
            one[reasons != Reason.OK] = np.nan
            its[np.isnan(one)] = np.nan
            values[f"derivative_impact_{name}"] = one
            values[f"derivative_impact_{name}_error"] = its
        return values
