r"""One branch as a curve: its equations, Newton's method on them, and steps along it.

A point of the curve has 2 m + 1 numbers: phases and scaled impulses of the m impacts, and the
parameter as a part of its range. The 2 m equations (`periodic_motions.sequences`) have derivatives
by phases and impulses in closed form, and by the parameter from a difference. The null vector of
all of them is the tangent; Newton's method returns to the curve at right angles to it. Without
load, where a motion may begin at any time, the first phase stays where it is, and least squares
take the equation that is left over.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.branches.problem import Problem
from vibroimpact_solvers.errors import ModelError, PlanError, SolverError
from vibroimpact_solvers.periodic_motions import Problem as Motions
from vibroimpact_solvers.periodic_motions import free_bodies, sequences, single
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.sequences import Laws, Search
from vibroimpact_solvers.periodic_motions.solutions import Cells, Solutions

_DIFFERENCE = 1e-7  # of the range: step of the difference by the parameter
_ITERATIONS = 8
_CLOSE = 1e-12  # residual, relative to its terms, of a point
_BEND = 0.97  # least cosine between neighbouring tangents
_FIRST = 0.1  # first step, as a part of the longest
_SHORTEST = 1e-7  # and the shortest one
_KEPT = 4  # evaluations of the equations
_SLANTED = 1e-3  # least part of the parameter in a step that tells the derivatives by it
_HUGE = 1e6  # impulses of seeds, relative to the first, beyond which they are at a resonance
_REST = 1e-12  # impulses, relative to those of the point before, of rest
_BESIDE = 1e-3  # of the last step: how far from rest a branch ends
_LARGEST = 1e3  # impulses, relative to all that begin one, at which one without load ends


@dataclass(frozen=True, eq=False, slots=True)
class Place:
    """A point of a curve, the tangent there, and the derivatives by the parameter.

    These are not relative to the sizes of the equations' terms, which may change within a step.
    """

    x: Floats
    tangent: Floats
    change: Floats


class Equations(NamedTuple):
    """The equations at a point."""

    residual: Floats  # (2 m,): relative to the sizes of their terms
    jacobian: Floats  # (2 m, 2 m): derivatives by all numbers of the point but the last
    size: Floats  # (2 m,)
    search: Search


class Curve:
    """The curve of all motions with one sequence of impacts.

    Parameters
    ----------
    problem : Problem
    motions : callable
        Returns the problem of periodic motions for a value of the parameter.
    """

    def __init__(self, problem: Problem, motions: Callable[[float], Motions]) -> None:
        self.problem, self.base = problem, motions(problem.start)
        self.motions = self._at if problem.frequency else motions
        self._rate = float(self.base.Omega[0]) / problem.start if problem.frequency else math.nan
        self.m = len(self.base.impacts)
        self.span = problem.stop - problem.start
        self.impulse = self.largest_seed = 1.0
        self._laws: Laws | None = None
        self._largest: dict[bytes, tuple[complex, float]] = {}
        # Newton's method, tangents and tests ask for the same points one after the other.
        self.search = lru_cache(_KEPT)(self._search)
        self._equations = lru_cache(_KEPT)(self._equations_at)

    def value(self, x: Floats) -> float:
        """Return the parameter at a point."""
        return float(self.problem.start + x[-1] * self.span)

    def keep_largest(self, points: list[Floats], values: Complexes, errors: Floats) -> None:
        """Keep the largest multipliers at points, (point, 1) each, which the tables show, too."""
        for x, value, error in zip(points, values[:, 0], errors[:, 0], strict=True):
            self._largest[x.tobytes()] = complex(value), float(error)

    def largest(self, points: list[Floats]) -> tuple[Complexes, Floats] | None:
        """Return the largest multipliers at points and errors, None unless all were kept."""
        kept = [self._largest.get(x.tobytes()) for x in points]
        known = [each for each in kept if each is not None]
        if len(known) < len(kept):
            return None
        values, errors = zip(*known, strict=True)
        return np.array(values)[:, np.newaxis], np.array(errors)[:, np.newaxis]

    def joint(self, values: Floats) -> Motions:
        """Return the problem at several values of the parameter, which is the frequency."""
        return self.base.at(values * self._rate)

    def _at(self, value: float) -> Motions:
        return self.joint(np.array([value]))

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

    def equations(self, x: Floats) -> Equations:
        """Return the equations at a point."""
        return self._equations(x.tobytes())

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
        return Equations(residual[0] / size[0], slopes / size[0][:, np.newaxis], size[0], search)

    def slopes(self, x: Floats) -> Floats:
        """Return the derivatives of the residuals, (2 m, 2 m + 1)."""
        here = self.equations(x)
        h = -_DIFFERENCE if x[-1] > 0.5 else _DIFFERENCE
        ahead = x.copy()
        ahead[-1] += h
        there = self.equations(ahead)
        change = (there.residual * (there.size / here.size) - here.residual) / h
        both = np.concatenate([here.jacobian, change[:, np.newaxis]], axis=1)
        if here.search.autonomous:
            both = np.concatenate([both, np.eye(1, both.shape[1])])
        return both

    def tangent(self, slopes: Floats, along: Floats | None = None) -> Floats:
        """Return the unit vector that the derivatives take to zero, in a direction."""
        tangent = np.asarray(np.linalg.svd(slopes)[2][-1])
        if along is not None and tangent @ along < 0.0:
            return -tangent
        return tangent

    def onto(self, x: Floats, across: Floats, change: Floats | None = None) -> Floats | None:
        """Return the point of the curve near x for which ``across . (point - x)`` is zero.

        None where Newton's method does not reach one. Its matrix may begin with the derivatives by
        the parameter (`change`) of a point nearby; each step tells them more exactly.
        """
        first, before = x, np.inf
        last: tuple[Equations, Floats] | None = None
        try:
            for count in range(_ITERATIONS):
                here = self.equations(x)
                residual, jacobian, terms, search = here
                if change is None:
                    change = terms * self.slopes(x)[: 2 * self.m, -1]
                elif last is not None:
                    change = _change_along(*last, here, change)
                size = float(np.abs(residual).max())
                if not np.isfinite(size) or (count > 2 and size > 2.0 * before):
                    return x if before < _CLOSE else None
                if size < 1e-15 or (size < _CLOSE and size > 0.25 * before):
                    return x
                before = size
                rows: list[Floats] = [
                    np.column_stack([jacobian, change / terms]),
                    across[np.newaxis],
                ]
                values: list[Floats] = [residual, np.atleast_1d(across @ (x - first))]
                if search.autonomous:
                    rows.append(np.eye(1, x.size))
                    values.append(x[:1] - first[:1])
                step = -_solved(np.concatenate(rows), np.concatenate(values))
                x, last = x + step, (here, step)
        except (SolverError, np.linalg.LinAlgError):
            return None
        return x if before < _CLOSE else None

    def along(self, place: Place, length: float) -> Floats | None:
        """Return the point a length further along the tangent."""
        return self.onto(place.x + length * place.tangent, place.tangent, place.change)

    def at_value(self, x: Floats, value: float) -> Floats | None:
        """Return the point near x with a value of the parameter, as a part of the range."""
        moved = x.copy()
        moved[-1] = value
        return self.onto(moved, np.eye(1, x.size, x.size - 1)[0], np.zeros(2 * self.m))

    def trace(
        self, x: Floats, direction: Floats, finished: Callable[[Floats], bool]
    ) -> list[Place]:
        """Return the points of the curve from x on, until it leaves the range or comes back.

        Nothing bounds impulses where neither load nor damping acts: there it ends where they are
        large. Empty where there is no tangent at x.
        """
        begin = self._next(x, direction)
        if begin is None:
            return []
        place, places = begin, [begin]
        most = _LARGEST * self.largest_seed if self.free else math.inf
        length = _FIRST * self._longest(place)
        while len(places) < self.problem.points and self._impulses(place.x) <= most:
            longest = self._longest(place)
            length = min(length, longest)
            point = self.along(place, length)
            if point is None:  # perhaps as there are no problems beyond the range
                last = self._last(place, length)
                if last is not None:
                    return [*places, last]
            next_place = None if point is None else self._next(point, place.tangent)
            if point is None or next_place is None or next_place.tangent @ place.tangent < _BEND:
                length *= 0.5
                if length < _SHORTEST * longest:
                    return places
                continue
            if not 0.0 <= point[-1] <= 1.0:
                end = self._end(place.x, point)
                if end is not None:
                    places.append(replace(next_place, x=end))
                return places
            place = next_place
            places.append(place)
            if finished(point) or self.is_closed(places):
                return places
            if place.tangent @ places[-2].tangent > 0.999:
                length = min(1.5 * length, longest)
        return places

    def _last(self, place: Place, length: float) -> Place | None:
        """Return the point at the end of the range, None where a step does not reach that."""
        beyond = place.x + length * place.tangent
        if 0.0 <= beyond[-1] <= 1.0:
            return None
        end = self._end(place.x, beyond)
        if end is None or np.linalg.norm(end - place.x) > 2.0 * length:
            return None
        last = self._next(end, place.tangent)
        return last if last is not None and last.tangent @ place.tangent >= _BEND else None

    def _end(self, last: Floats, beyond: Floats) -> Floats | None:
        """Return the point at the end of the range, between one on it and one beyond it.

        Or beside the end, where there is rest: motions without gap are like their load.
        """
        edge = 0.0 if beyond[-1] < 0.0 else 1.0
        end = self.at_value(beyond, edge)
        if end is not None and self._impulses(end) <= _REST * self._impulses(last):
            return self.at_value(last, edge + _BESIDE * (float(last[-1]) - edge))
        return end

    def _impulses(self, x: Floats) -> float:
        return float(np.abs(x[self.m : -1]).max())

    def _longest(self, place: Place) -> float:
        """Return the longest step from a point: of impulses, relative to the largest one."""
        pushed = place.tangent[self.m : -1] / max(1.0, self._impulses(place.x))
        others = np.append(place.tangent[: self.m], place.tangent[-1])
        return self.problem.step / math.hypot(np.linalg.norm(others), np.linalg.norm(pushed))

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

    def crossing(self, x: Floats, tangent: Floats) -> float:
        """Return a determinant that changes sign where two curves of free motions cross.

        Of motions without load, ``det(1 - Z)`` is zero everywhere: they may begin at any time, and
        with more energy. Their equations are one more than needed, which a loss at the impacts
        makes up for, as one more unknown that is zero.
        """
        slopes, (*_, size, search) = self.slopes(x), self.equations(x)
        loss = np.zeros(slopes.shape[0])
        p = x[self.m : -1] * self.impulse
        loss[self.m : 2 * self.m] = search.laws.impacts.inertia * p / size[self.m :]
        rows = np.column_stack([slopes, loss])
        rows = np.concatenate([rows, [np.append(tangent, 0.0)]])
        return float(np.linalg.det(rows / np.linalg.norm(rows, axis=1, keepdims=True)))

    @cached_property
    def free(self) -> bool:
        """Whether there is no load, at any value: motions may begin at any time."""
        ends = [self.motions(value) for value in (self.problem.start, self.problem.stop)]
        return all(self.laws(motions).driven.harmonics.size == 0 for motions in ends)

    def place(self, x: Floats, along: Floats) -> Place:
        """Return a point with its tangent in a direction."""
        slopes = self.slopes(x)
        change = self.equations(x).size * slopes[: 2 * self.m, -1]
        return Place(x, self.tangent(slopes, along), change)

    def _next(self, x: Floats, along: Floats) -> Place | None:
        try:
            return self.place(x, along)
        except (SolverError, np.linalg.LinAlgError):
            return None

    def is_closed(self, places: list[Place]) -> bool:
        """Whether the last step has come back to the first point."""
        if len(places) <= 5:
            return False
        first, last, before = places[0], places[-1], places[-2]
        step = float(np.linalg.norm(last.x - before.x))
        for s, point in zip(sequences.turns(self.base.impacts), self.turned(last.x), strict=True):
            apart = first.x - point
            apart[: self.m] = self.late(first.x, point)
            if (
                np.linalg.norm(apart) < step
                and first.tangent @ self._rolled(last.tangent, s) > _BEND
                and first.tangent @ apart <= 0.0
            ):
                return True
        return False

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


def _change_along(before: Equations, step: Floats, after: Equations, change: Floats) -> Floats:
    """Return the derivatives by the parameter in the middle of a step, (2 m,).

    They are what all others leave of the difference of the equations, by the trapezoidal rule;
    `change` where the step hardly moves the parameter, and they hardly matter.
    """
    if not abs(step[-1]) > _SLANTED * np.linalg.norm(step):
        return change
    ends = [e.size[:, np.newaxis] * e.jacobian for e in (before, after)]
    others = 0.5 * (ends[0] + ends[1]) @ step[:-1]
    whole = after.size * after.residual - before.size * before.residual
    return np.asarray((whole - others) / step[-1])


def _solved(rows: Floats, values: Floats) -> Floats:
    """Return the solution of linear equations, that of least squares where there are more."""
    if rows.shape[0] == rows.shape[1]:
        return np.asarray(np.linalg.solve(rows, values))
    return np.asarray(np.linalg.lstsq(rows, values, rcond=None)[0])
