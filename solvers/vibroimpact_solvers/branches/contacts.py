"""The curve of motions whose stops of finite stiffness switch in one order.

Its numbers are the drive's phases of the switchings and, where that is better, a velocity; its
equations what is zero at each of them, and an impulse (`bordered`). Where the second half of the
period mirrors the first, those of the first half are all. A motion in which no stop switches has
the parameter alone. Where contacts begin, or end to be, the motions go over into those of another
curve (`changes`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Final, Self

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.branches.bordered import (
    Bordered,
    bordered,
    velocity_form,
    velocity_in,
)
from vibroimpact_solvers.branches.curve import Curve, Equations, Place, Tests
from vibroimpact_solvers.branches.problem import Problem
from vibroimpact_solvers.branches.structures import Structures
from vibroimpact_solvers.errors import ConvergenceError, ModelError
from vibroimpact_solvers.periodic_motions import Problem as Motions
from vibroimpact_solvers.periodic_motions.columns import Columns
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.stops import orbit_columns
from vibroimpact_solvers.periodic_motions.stops.columns import no_impacts
from vibroimpact_solvers.periodic_motions.stops.orbit_columns import Checked
from vibroimpact_solvers.periodic_motions.stops.orbit_errors import multipliers
from vibroimpact_solvers.periodic_motions.stops.orbits import (
    Kind,
    Orbit,
    Switching,
    orbit,
    scenes_of,
)
from vibroimpact_solvers.periodic_motions.stops.scenes import Cell, Loaded
from vibroimpact_solvers.results.branches import Type

_KEPT: Final = 4  # motions
_BACKWARDS: Final = 0.02  # of the period, by which switchings may be in the wrong order meanwhile
_MOST: Final = 128  # switchings of a period
_STILL: Final = 0.01  # of the range: longest step of a motion in which no stop switches
_TOGETHER: Final = 16  # motions of one structure whose columns are computed at once


class Contacts(Curve):
    """The curve of all motions with one sequence of switchings.

    Parameters
    ----------
    problem : Problem
    motions : callable
        Returns the problem of periodic motions for a value of the parameter.
    structures : Structures
    before : Loaded
        Stops that are loaded before the first switching.
    switchings : tuple of Switching
        Of a whole period.
    """

    def __init__(
        self, problem: Problem, motions: Callable[[float], Motions], structures: Structures,
        before: Loaded, switchings: tuple[Switching, ...],
    ) -> None:  # fmt: skip
        super().__init__(problem, motions)
        self.structures, self.before, self.switchings = structures, before, switchings
        self.symmetric = self.base.symmetric
        self.m = len(switchings) // 2 if self.symmetric else len(switchings)
        self.period = 2.0 * math.pi * self.base.periods
        self.speed, self.plain = 1.0, False
        self.cell = lru_cache(_KEPT)(self._cell)
        self._bordered = lru_cache(_KEPT)(self._bordered_at)
        self._closed = lru_cache(_KEPT)(self._closed_at)
        self._checked = lru_cache(_KEPT)(self._checked_at)

    def like(
        self, before: Loaded, switchings: tuple[Switching, ...], phases: Floats, x: Floats
    ) -> tuple[Self, Floats]:
        """Return the curve of other switchings of a whole period, and a point of it.

        It has the motion at a point x of this one.
        """
        other = type(self)(self.problem, self.motions, self.structures, before, switchings)
        other.speed, other.plain = self.speed, self.plain
        return other, other.point(self.motion(x), phases, float(x[-1]))

    def point(self, one: Orbit, phases: Floats, part: float) -> Floats:
        """Return the point of a motion that switches at some phases.

        `part` is the parameter as a part of its range.
        """
        if not self.m:
            return np.array([part])
        if self.plain:
            return np.append(phases[: self.m], part)
        scene = scenes_of(self.before, self.switchings)[0]
        a = self.switchings[0].constraint
        velocity = velocity_in(one, float(phases[0]) / one.cell.Omega, scene, a)
        return np.concatenate([phases[: self.m], [velocity / self.speed, part]])

    def twin(self, x: Floats, tangent: Floats) -> tuple[Self, Floats, Floats]:
        """Return the curve by the other equations, with a point and a direction of this one."""
        other = type(self)(
            self.problem, self.motions, self.structures, self.before, self.switchings
        )
        other.speed, other.plain = self.speed, not self.plain
        point = other.point(self.motion(x), self.whole(x), float(x[-1]))
        ahead = np.zeros(point.size)
        ahead[: self.m], ahead[-1] = tangent[: self.m], tangent[-1]
        return other, point, other.tangent(other.slopes(point), ahead)

    def regular(self, first: Floats, last: Floats) -> tuple[Curve, Floats, Floats]:
        """Return two points on a curve whose equations are regular where multipliers are 1."""
        if not (self.m and self.plain):
            return self, first, last
        other, one, _ = self.twin(first, last - first)
        return other, one, other.point(self.motion(last), self.whole(last), float(last[-1]))

    def of_regular(self, x: Floats) -> Floats:
        """Return a point, or a tangent, of that curve as one of this."""
        return np.append(x[: self.m], x[-1]) if self.m and self.plain else x

    def begin(self, one: Orbit, part: float) -> Floats:
        """Return the point of a motion, whose velocities become the units of those of the curve."""
        cell = one.cell
        if self.m:
            row = np.abs(velocity_form(cell, one.scenes[0], self.switchings[0].constraint))
            moved = np.abs(one.states[0]) + np.abs(cell.steady(one.scenes[0])).sum(axis=0)
            self.speed = float(row @ moved) or 1.0
        return self.point(one, one.times * cell.Omega, part)

    # -- motions --

    def _cell(self, value: float) -> Cell:
        scenes, motions = self.structures.at(value), self.motions(value)
        try:
            return Cell(scenes, float(motions.Omega[0]), motions.periods)
        except ModelError as error:
            raise error.under("base") from None

    def whole(self, x: Floats) -> Floats:
        """Return numbers of the phases of all switchings of a period, from those of a point."""
        phases = x[: self.m]
        if not self.symmetric:
            return phases.copy()
        return np.concatenate([phases, phases + 0.5 * self.period])

    def gradient(self, k: int) -> Floats:
        """Return the derivatives of the way from a switching to the next one by a point."""
        row, count = np.zeros(self.m + (1 if self.plain else 2)), len(self.switchings)
        row[(k + 1) % count % self.m] += 1.0
        row[k % self.m] -= 1.0
        return row

    def gaps(self, x: Floats) -> Floats:
        """Return the phases from each switching to the next one."""
        phases = self.whole(x)
        return np.diff(np.append(phases, phases[:1] + self.period))

    def motion(self, x: Floats) -> Orbit:
        """Return the motion at a point, whether it is on the curve or not."""
        if self.m and not self.plain:
            return self._bordered(x.tobytes()).orbit
        return self._closed(x.tobytes())

    def _bordered_at(self, point: bytes) -> Bordered:
        x = np.frombuffer(point)
        cell, phases = self._cell_of(x), self.whole(x)
        velocity = float(x[self.m]) * self.speed
        return bordered(cell, self.before, self.switchings, phases / cell.Omega, velocity)

    def checked(self, x: Floats) -> Checked:
        """Return the motion at a point of the curve with its errors."""
        return self._checked(x.tobytes())

    def _cell_of(self, x: Floats) -> Cell:
        """Return the period at a point; raise `ConvergenceError` where it is none."""
        if self.m and float(self.gaps(x).min()) < -_BACKWARDS * self.period:
            raise ConvergenceError("switchings are not in their order")
        return self.cell(self.value(x))

    def _checked_at(self, point: bytes) -> Checked:
        return Checked.of(self._closed(point))

    def _closed_at(self, point: bytes) -> Orbit:
        x = np.frombuffer(point)
        cell = self._cell_of(x)
        one = orbit(cell, self.before, self.switchings, self.whole(x) / cell.Omega)
        if one is None:
            raise ConvergenceError("the load drives a mode without damping at its own frequency")
        return one

    def _equations_at(self, point: bytes) -> Equations:
        m = self.m
        if not m:
            return Equations(np.zeros(0), np.zeros((0, 0)), np.zeros(0), False)
        if self.plain:
            one = self._closed(point)
            both, values = one.jacobian(one.seen()) / one.cell.Omega, one.values[:m]
        else:
            whole = self._bordered(point)
            one, both = whole.orbit, whole.jacobian()
            both[:, :-1] /= one.cell.Omega
            both[:, -1] *= self.speed
            values = np.append(one.values[:m], whole.impulse)
        if self.symmetric:
            both = np.delete(both, np.s_[m : 2 * m], axis=0)
            both[:, :m] += both[:, m : 2 * m]
            both = np.delete(both, np.s_[m : 2 * m], axis=1)
        sizes = np.array([_size(one, k) for k in range(m)] + [self.speed] * (values.size - m))
        return Equations(values / sizes, both / sizes[:, np.newaxis], sizes, False)

    def longest(self, place: Place) -> float:
        """Return the longest step from a point."""
        return self.problem.step if self.m else min(self.problem.step, _STILL)

    # -- the same motions --

    def _rolled(self, other: Contacts) -> Iterator[int]:
        """Yield which switchings of another curve are the first one of this."""
        count = len(self.switchings)
        if (
            len(other.switchings) != count
            or other.symmetric != self.symmetric
            or other.base.periods != self.base.periods
        ):
            return
        scenes = [scenes_of(each.before, each.switchings) for each in (self, other)]
        if not count and self.before == other.before:
            yield 0
        for first in range(count):
            rolled = other.switchings[first:] + other.switchings[:first]
            if rolled == self.switchings and scenes[0] == scenes[1][first:] + scenes[1][:first]:
                yield first

    def _begun(self, other: Contacts, x: Floats, first: int) -> Floats:
        """Return the phases of a point of another curve from a switching on, (m,)."""
        phases = other.whole(x)
        return np.concatenate([phases[first:], phases[:first] + self.period])[: self.m]

    def _late(self, one: Floats, other: Floats) -> Floats:
        """Return differences of phases, (m,), up to turns of the drive after which it repeats."""
        apart, turn = one[: self.m] - other[: self.m], self.base.turn
        return np.asarray(apart - turn * np.round(apart[:1] / turn))

    def passing(self, places: list[Place], other: Curve, x: Floats) -> int | None:
        """Return between which points of this curve a point of another curve is, if it is."""
        if not isinstance(other, Contacts):
            return None
        for first in self._rolled(other):
            seed = self._begun(other, x, first)

            def late(point: Floats, seed: Floats = seed) -> float:
                return float(np.abs(self._late(point, seed)).max(initial=0.0))

            if (k := self.between(places, float(x[-1]), late, late)) is not None:
                return k
        return None

    def apart(self, first: Floats, other: Place) -> Iterator[tuple[Floats, Floats]]:
        """Yield the difference from a point, and the tangent there.

        Motions begin at the switching of which the velocity is one of the numbers.
        """
        apart = first - other.x
        apart[: self.m] = self._late(first, other.x)
        yield apart, other.tangent

    # -- special points --

    def tests(self, points: list[Floats], tangents: list[Floats]) -> Tests:
        """Return the test functions at points of the curve."""
        rows = [self._test(x) for x in points]
        plus, minus, leaves, turned = (np.array(each) for each in zip(*rows, strict=True))
        count = len(points)
        return Tests(plus, minus, leaves, turned, np.ones((count, 0)), np.ones(count))

    def _test(self, x: Floats) -> tuple[float, float, bool, float]:
        checked = self.checked(x)
        values, errors = multipliers(checked.orbit, checked.errors.times)
        if not values.size:
            return 1.0, 1.0, False, 0.0
        plus, minus = _determinants(values)
        imaginary = abs(float(values[0].imag))
        leaves = bool(abs(values[0]) - 1.0 > errors[0])
        turned = imaginary if imaginary > errors[0] else 0.0
        # A motion whose half mirrors the rest has squares of multipliers: none is negative.
        return 1.0 if self.symmetric else plus, minus, leaves, turned

    def value_of(self, kind: Type, which: int, x: Floats, across: Floats, margin: float) -> float:
        """Return the test function of a type at a point, of a torus less so many times its error.

        `which` has no meaning here.
        """
        checked = self.checked(x)
        values, errors = multipliers(checked.orbit, checked.errors.times)
        if kind is Type.TORUS:
            return float(abs(values[0]) - 1.0 - margin * errors[0])
        plus, minus = _determinants(values)
        return minus if kind is Type.SYMMETRY else plus

    # -- results --

    def columns(self, points: list[Floats]) -> list[Columns]:
        """Return the columns of the motions at points, in parts one after the other."""
        size = _TOGETHER if self.problem.frequency else 1
        groups = [points[k : k + size] for k in range(0, len(points), size)]
        return [self._columns(group) for group in groups]

    def _columns(self, points: list[Floats]) -> Columns:
        values = np.array([self.value(x) for x in points])
        motions = self.joint(values) if self.problem.frequency else self.motions(float(values[0]))
        checked = [(k, self.checked(x)) for k, x in enumerate(points)]
        scenes = self.structures.at(float(values[0]))
        return orbit_columns.of(motions, scenes, checked) | no_impacts()

    # -- other branches --

    def repeated(
        self, kind: Type, x: Floats, tangent: Floats
    ) -> tuple[Curve, Floats, Floats] | None:
        """Return a special point as one of the curve of motions that last twice as long."""
        if self.m and self.plain:  # the equations of both periods are singular without a border
            other, point, along = self.twin(x, tangent)
            return other.repeated(kind, point, along)
        whole, count = self.whole(x), len(self.switchings)
        mirrored = self.symmetric
        if not self.m or 2 * count > _MOST or (kind is Type.SYMMETRY and not mirrored):
            return None
        times = 1 if mirrored else 2
        new = type(self)(
            self.problem, self.twice(), self.structures, self.before, self.switchings * times
        )
        new.speed = self.speed
        phases = whole if mirrored else np.concatenate([whole, whole + self.period])
        along = np.tile(tangent[: self.m], 2)
        numbers = slice(self.m, None)
        return new, np.append(phases, x[numbers]), np.append(along, tangent[numbers])

    def unlike(self, x: Floats) -> Floats:
        """Return how unlike both halves of a repeated motion are, (m / 2,)."""
        half = self.m // 2
        if self.m % 2 or self.switchings[:half] != self.switchings[half:]:
            return np.zeros(1)  # one half has contacts that the other one lacks
        return np.asarray(x[half : 2 * half] - x[:half] - 0.5 * self.period)


def _size(one: Orbit, k: int) -> float:
    """Return the size of the terms of what is zero at a switching."""
    switching, before, form = one.switchings[k], one.before[k], one.form(k)
    side = one.cell.scenes.watching(before, *switching.stop)
    moved = np.abs(form) @ (np.abs(one.ends[k - 1]) + np.abs(one.cell.steady(before)).sum(axis=0))
    level = side.force_size
    if switching.kind is Kind.WALL:
        wall = one.cell.scenes.stop(*switching.stop).wall
        level = abs(float(side.level[switching.constraint])) + abs(wall)
    return float(moved + level) or 1.0


def _determinants(values: Complexes) -> tuple[float, float]:
    """Return ``det(1 + Z)`` and ``det(1 - Z)`` by the multipliers."""
    return float(np.prod(1.0 + values).real), float(np.prod(1.0 - values).real)


def nothing(problem: Problem, structures: Structures, x: float) -> Columns:
    """Return the columns of no motions, at a value of the parameter as a part of the range."""
    value = problem.start + x * (problem.stop - problem.start)
    motions = problem.at(value)
    try:
        Cell(structures.at(value), float(motions.Omega[0]), motions.periods)
    except ModelError as error:
        raise error.under("base") from None
    return orbit_columns.of(motions, structures.at(value), []) | no_impacts()
