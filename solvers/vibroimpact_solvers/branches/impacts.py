"""The curve of motions with one sequence of impacts at rigid stops.

Its numbers are the phases and scaled impulses of the m impacts (`periodic_motions.sequences`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property, lru_cache

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Booleans, Floats
from vibroimpact_solvers.branches.curve import Curve, Equations, Place, Tests
from vibroimpact_solvers.branches.problem import Problem
from vibroimpact_solvers.errors import ModelError, PlanError
from vibroimpact_solvers.periodic_motions import Problem as Motions
from vibroimpact_solvers.periodic_motions import columns, free_bodies, sequences, single
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.existence import verdicts
from vibroimpact_solvers.periodic_motions.multipliers import determinants, multipliers
from vibroimpact_solvers.periodic_motions.sequences import Laws, Search
from vibroimpact_solvers.periodic_motions.solutions import Cells, Solutions
from vibroimpact_solvers.results.branches import Type
from vibroimpact_solvers.results.impact_modes import Reason

_KEPT = 4  # values of the parameter
_HUGE = 1e6  # impulses of seeds, relative to the first, beyond which they are at a resonance
_REST = 1e-12  # impulses, relative to those of the point before, of rest
_LARGEST = 1e3  # impulses, relative to all that begin one, at which one without load ends
_MOST = 64  # impacts of a period


class Impacts(Curve):
    """The curve of all motions with one sequence of impacts."""

    def __init__(self, problem: Problem, motions: Callable[[float], Motions]) -> None:
        super().__init__(problem, motions)
        self.m = len(self.base.impacts)
        self.impulse = self.largest_seed = 1.0
        self._laws: Laws | None = None
        self.search = lru_cache(_KEPT)(self._search)

    def laws(self, motions: Motions) -> Laws:
        """Return the impacts of a structure, which stays the same where the frequency varies."""
        if self._laws is None or not self.problem.frequency:
            try:
                driven = Driven.of(motions, spectrum.choose(motions.system))
                free_bodies.sentence(motions, driven)
            except (ModelError, PlanError) as error:
                raise error.under("base") from None
            self._laws = Laws.of(driven, motions)
        return self._laws

    def _search(self, value: float) -> Search:
        """Return the equations at a value of the parameter."""
        motions = self.motions(value)
        laws = self.laws(motions)
        return Search(laws, Cells.of(laws.driven, motions), np.zeros(1, np.int64))

    def start(self, x: float) -> list[Floats]:
        """Return all points with a value of the parameter, as a part of the range."""
        motions = self.motions(self.value(np.array([x])))
        driven = self.laws(motions).driven
        cells = Cells.of(driven, motions)
        if self.m == 1:
            solved, _ = single.solutions(driven, cells, motions)
        else:
            solved = sequences.solutions(driven, cells, motions)
        if solved.impulse.size and self.impulse == 1.0:
            self.impulse = float(np.abs(solved.impulse).max()) or 1.0
        seeds = [
            np.concatenate([phase, impulse / self.impulse, [x]])
            for phase, impulse in zip(solved.phase, solved.impulse, strict=True)
        ]
        sizes = [size for size in map(self._impulses, seeds) if size < _HUGE]
        self.largest_seed = max([self.largest_seed, *sizes])
        return seeds

    def scaled(self, groups: list[list[Floats]]) -> list[list[Floats]]:
        """Return the points that were found at several values, in impulses of the usual size.

        The first ones may be far smaller than others, or those of a resonance. Half of the values
        have larger impulses than this size.
        """
        sizes = [max(map(self._impulses, group)) for group in groups if group]
        usual = float(np.median(sizes)) if sizes else 0.0
        if not 0.0 < usual < math.inf:
            return groups
        self.impulse, self.largest_seed = self.impulse * usual, self.largest_seed / usual
        self._equations.cache_clear()
        parts = np.ones(2 * self.m + 1)
        parts[self.m : -1] = usual
        return [[x / parts for x in group] for group in groups]

    def _equations_at(self, point: bytes) -> Equations:
        x, m = np.frombuffer(point), self.m
        search = self.search(self.value(x))
        p = x[np.newaxis, m:-1] * self.impulse
        residual, jacobian, size = search.equations(x[:m] / search.Omega, p)
        size = np.where(size > 0.0, size, 1.0)  # at gap 0, without load: those of rest
        by_phases = jacobian[0, :, m:] / search.Omega[0]
        if search.autonomous:
            by_phases[:, 0] = 0.0
        slopes = np.concatenate([by_phases, jacobian[0, :, :m] * self.impulse], axis=1)
        of_size = size[0]
        return Equations(
            residual[0] / of_size, slopes / of_size[:, np.newaxis], of_size, search.autonomous
        )

    def longest(self, place: Place) -> float:
        """Return the longest step from a point: of impulses, relative to the largest one."""
        pushed = place.tangent[self.m : -1] / max(1.0, self._impulses(place.x))
        others = np.append(place.tangent[: self.m], place.tangent[-1])
        return self.problem.step / math.hypot(np.linalg.norm(others), np.linalg.norm(pushed))

    def rests(self, end: Floats, last: Floats) -> bool:
        """Whether a point at the end of the range, after the last one, is one of rest."""
        return self._impulses(end) <= _REST * self._impulses(last)

    def too_large(self, x: Floats) -> bool:
        """Whether impulses are large where nothing bounds them: neither load nor damping acts."""
        return self.free and self._impulses(x) > _LARGEST * self.largest_seed

    def _impulses(self, x: Floats) -> float:
        return float(np.abs(x[self.m : -1]).max())

    # -- the same motions --

    def passing(self, places: list[Place], other: Curve, x: Floats) -> int | None:
        """Return between which points of this curve a point of another curve is, if it is."""
        if not isinstance(other, Impacts) or other.m != self.m:
            return None
        each = [self._passing(places, seed) for seed in self.turned(x)]
        return next((k for k in each if k is not None), None)

    def _passing(self, places: list[Place], seed: Floats) -> int | None:
        def pushed(point: Floats) -> float:
            return float(np.abs(point[self.m : -1] - seed[self.m : -1]).max())

        def apart(point: Floats) -> float:
            return max(float(np.abs(self.late(point, seed)).max()), pushed(point))

        return self.between(places, float(seed[-1]), pushed, apart)

    def turned(self, x: Floats) -> list[Floats]:
        """Return a point as it is where the motion begins at any impact where it may begin alike.

        A motion that is late by a period of the drive, or without load by any time, is the same.
        """
        period = 2.0 * np.pi * self.base.periods
        points = []
        for s in sequences.turns(self.base.impacts):
            point = self._rolled(x, s)
            point[self.m - s : self.m] += period
            if self.free:
                point[: self.m] -= point[0]
            points.append(point)
        return points

    def _rolled(self, x: Floats, s: int) -> Floats:
        """Return a point, or a tangent, with the numbers of impact s first."""
        phases, impulses = x[: self.m], x[self.m : -1]
        return np.concatenate([np.roll(phases, -s), np.roll(impulses, -s), x[-1:]])

    def late(self, one: Floats, other: Floats) -> Floats:
        """Return the differences of the phases of two points, (m,); see `sequences.same_begin`."""
        return sequences.same_begin(self.base, one[: self.m] - other[: self.m])

    def apart(self, first: Floats, other: Place) -> Iterator[tuple[Floats, Floats]]:
        """Yield differences from a point, and tangents there, from wherever a motion may begin."""
        for s, point in zip(sequences.turns(self.base.impacts), self.turned(other.x), strict=True):
            apart = first - point
            apart[: self.m] = self.late(first, point)
            yield apart, self._rolled(other.tangent, s)

    # -- special points --

    def crossing(self, x: Floats, tangent: Floats) -> float:
        """Return a determinant that changes sign where two curves of free motions cross.

        Of motions without load, ``det(1 - Z)`` is zero everywhere: they may begin at any time, and
        with more energy. Their equations are one more than needed, which a loss at the impacts
        makes up for, as one more unknown that is zero.
        """
        slopes, size = self.slopes(x), self.equations(x).size
        loss = np.zeros(slopes.shape[0])
        p = x[self.m : -1] * self.impulse
        inertia = self.search(self.value(x)).laws.impacts.inertia
        loss[self.m : 2 * self.m] = inertia * p / size[self.m :]
        rows = np.column_stack([slopes, loss])
        rows = np.concatenate([rows, [np.append(tangent, 0.0)]])
        return float(np.linalg.det(rows / np.linalg.norm(rows, axis=1, keepdims=True)))

    @cached_property
    def free(self) -> bool:  # type: ignore[override]
        """Whether there is no load, at any value: motions may begin at any time."""
        ends = [self.motions(value) for value in (self.problem.start, self.problem.stop)]
        return all(self.laws(motions).driven.harmonics.size == 0 for motions in ends)

    def tests(self, points: list[Floats], tangents: list[Floats]) -> Tests:
        """Return the test functions at points of the curve."""
        groups = [points] if self.problem.frequency else [[x] for x in points]
        parts = [self._tests(group) for group in groups]
        both = Tests(*(np.concatenate(each) for each in zip(*parts, strict=True)))
        if not self.free:
            return both
        minus = [self.crossing(*each) for each in zip(points, tangents, strict=True)]
        return replace(both, minus=np.array(minus))

    def _tests(self, points: list[Floats]) -> tuple[Floats | Booleans, ...]:
        problem, driven, cells, solved = self.solutions(points)
        problem = replace(problem, outputs=frozenset({"stability"}))
        values, errors = multipliers(problem, driven, cells, solved)
        self.keep_largest(points, values, errors)
        plus, minus = determinants(problem, driven, cells, solved)
        imaginary, leaves = np.abs(values[:, 0].imag), np.abs(values[:, 0]) - 1.0 > errors[:, 0]
        sides = np.array([-impact.side for impact in problem.impacts])
        reason = verdicts(problem, driven, cells, solved).reason
        return (
            plus, minus, leaves,
            np.where(imaginary > errors[:, 0], imaginary, 0.0),
            sides * solved.impulse,
            np.where(reason == Reason.PENETRATION, -1.0, 1.0),
        )  # fmt: skip

    def value_of(self, kind: Type, which: int, x: Floats, across: Floats, margin: float) -> float:
        """Return the test function of a type at a point, of a torus less so many times its error.

        `which` tells which impact grazes.
        """
        if kind is Type.GRAZING:
            return float(-self.base.impacts[which].side * x[self.m + which])
        problem, driven, cells, solved = self.solutions([x])
        problem = replace(problem, outputs=frozenset({"stability"}))
        if kind is Type.END:
            passed = verdicts(problem, driven, cells, solved).reason[0] == Reason.PENETRATION
            return -1.0 if passed else 1.0
        if kind is Type.TORUS:
            values, errors = multipliers(problem, driven, cells, solved)
            return float(np.abs(values[0, 0]) - 1.0 - margin * errors[0, 0])
        lost = kind is Type.SYMMETRY and not problem.symmetric
        if lost and self.free:
            return self.crossing(x, self.tangent(self.slopes(x), across))
        plus, minus = determinants(problem, driven, cells, solved)
        return float((minus if lost else plus)[0])

    # -- results --

    def columns(self, points: list[Floats]) -> list[columns.Columns]:
        """Return the columns of the motions at points, in parts one after the other."""
        groups = [points] if self.problem.frequency else [[x] for x in points]
        return [columns.of(*self.solutions(group), self.largest(group)) for group in groups]

    def solutions(self, points: list[Floats]) -> tuple[Motions, Driven, Cells, Solutions]:
        """Return the motions at points with one structure: of several frequencies, or at one."""
        x = np.array(points)
        motions = self.motions(self.value(points[0]))
        if self.problem.frequency:
            motions = self.joint(self.problem.start + x[:, -1] * self.span)
        laws = self.laws(motions)
        cells = Cells.of(laws.driven, motions)
        search = Search(laws, cells, np.arange(len(points)))
        solved = search.collected(x[:, : self.m] / search.Omega, x[:, self.m : -1] * self.impulse)
        return motions, laws.driven, cells, solved

    def nothing(self, x: float) -> tuple[Motions, Driven, Cells, Solutions]:
        """Return no motions, at a value of the parameter as a part of the range."""
        value = float(self.problem.start + x * self.span)
        search, none = self.search(value), np.empty((0, self.m))
        return self.motions(value), search.driven, search.cells, search.collected(none, none)

    # -- other branches --

    def repeated(
        self, kind: Type, x: Floats, tangent: Floats
    ) -> tuple[Curve, Floats, Floats] | None:
        """Return a special point as one of the curve of motions with twice as many impacts."""
        base, m = self.base, self.m
        mirrored = base.symmetric
        if 2 * m > _MOST or (kind is Type.SYMMETRY and not mirrored):
            return None

        new = Impacts(self.problem, self.twice())
        new.impulse, new.largest_seed = self.impulse, self.largest_seed
        turn = np.pi * base.periods * (1.0 if mirrored else 2.0)
        sign = -1.0 if mirrored else 1.0
        phases, impulses = x[:m], x[m:-1]
        twice = np.concatenate([phases, phases + turn, impulses, sign * impulses, x[-1:]])
        along = np.concatenate(
            [np.tile(tangent[:m], 2), tangent[m:-1], sign * tangent[m:-1], tangent[-1:]]
        )
        return new, twice, along

    def unlike(self, x: Floats) -> Floats:
        """Return how unlike the impulses of both halves of a repeated motion are, (m / 2,)."""
        signs = np.array([impact.side for impact in self.base.impacts], dtype=np.float64)
        push = -signs * x[self.m : -1]
        return np.asarray(push[: self.m // 2] - push[self.m // 2 :])
