r"""One branch as a curve: its equations, Newton's method on them, and steps along it.

A point of the curve has the numbers of a motion and, as the last one, the parameter as a part of
its range. The equations, one less than that, have derivatives by the motion in closed form, and by
the parameter from a difference. The null vector of all of them is the tangent; Newton's method
returns to the curve at right angles to it. Without load, where a motion may begin at any time, the
first number stays where it is, and least squares take the equation that is left over.

What the numbers and equations are is told by `impacts.Impacts` and `contacts.Contacts`.
"""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import Booleans, Floats
from vibroimpact_solvers.branches.problem import Problem
from vibroimpact_solvers.errors import SolverError
from vibroimpact_solvers.periodic_motions import Impact
from vibroimpact_solvers.periodic_motions import Problem as Motions
from vibroimpact_solvers.periodic_motions.columns import Columns
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.results.branches import Type

_DIFFERENCE = 1e-7  # of the range: step of the difference by the parameter
_ITERATIONS = 8
_CLOSE = 1e-12  # residual, relative to its terms, of a point
_BEND = 0.97  # least cosine between neighbouring tangents
_FIRST = 0.1  # first step, as a part of the longest
_SHORTEST = 1e-7  # and the shortest one
_KEPT = 4  # evaluations of the equations
_SLANTED = 1e-3  # least part of the parameter in a step that tells the derivatives by it
_SAME = 1e-6  # difference of phases and impulses of equal motions
_BESIDE = 1e-3  # of the last step: how far from rest a branch ends


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

    residual: Floats  # (number,): relative to the sizes of their terms
    jacobian: Floats  # (number, number): derivatives by all numbers of the point but the last
    size: Floats  # (number,)
    autonomous: bool  # whether the motion may begin at any time


@dataclass(frozen=True, eq=False, slots=True)
class Change:
    """Where the motions of a curve go over into those of another one.

    Parameters
    ----------
    place : Place or None
        The last point of the curve. None: it is told by the first one of the other curve.
    error : float
        Of the parameter there.
    kind : Type or None
        What is listed: nothing where neither contacts begin nor end.
    onward : tuple of Curve and two arrays, or None
        The other curve, the point at which it begins, and the direction to go. None: it ends.
    """

    place: Place | None
    error: float
    kind: Type | None
    onward: tuple[Curve, Floats, Floats] | None


class Traced(NamedTuple):
    """Points of a curve, and how it goes on."""

    places: list[Place]
    change: Change | None


@dataclass(frozen=True, eq=False, slots=True)
class Tests:
    """Test functions at points, each shape (point,) unless stated."""

    plus: Floats  # det(1 + Z), or of a half period det(1 - Z)
    minus: Floats  # det(1 - Z), or of a half period det(1 + Z)
    leaves: Booleans  # whether the largest multiplier is outside of the unit circle
    turned: Floats  # its imaginary part, beyond its error
    impulses: Floats  # (point, m), positive where they push
    kept: Floats  # 1 where all limits are kept, else -1

    def admissible(self) -> Booleans:
        """Return whether the motions are, shape (point,)."""
        return np.asarray((self.kept > 0.0) & (self.impulses > 0.0).all(axis=1))


class Curve(ABC):
    """The curve of all motions with one sequence of impacts, or of switchings of stops.

    Parameters
    ----------
    problem : Problem
    motions : callable
        Returns the problem of periodic motions for a value of the parameter.
    """

    m: int
    """Number of impacts, or of switchings that are told apart."""
    free = False
    """Whether there is no load, at any value: motions may begin at any time."""

    def __init__(self, problem: Problem, motions: Callable[[float], Motions]) -> None:
        self.problem, self.base = problem, motions(problem.start)
        self.motions = self._at if problem.frequency else motions
        self._rate = float(self.base.Omega[0]) / problem.start if problem.frequency else math.nan
        self.span = problem.stop - problem.start
        self._largest: dict[bytes, tuple[complex, float]] = {}
        # Newton's method, tangents and tests ask for the same points one after the other.
        self._equations = lru_cache(_KEPT)(self._equations_at)

    # -- what a kind of motion tells --

    @abstractmethod
    def _equations_at(self, point: bytes) -> Equations:
        """Return the equations at a point, given by its bytes."""

    @abstractmethod
    def longest(self, place: Place) -> float:
        """Return the longest step from a point."""

    @abstractmethod
    def passing(self, places: list[Place], other: Curve, x: Floats) -> int | None:
        """Return between which points of this curve a point of another curve is, if it is."""

    @abstractmethod
    def apart(self, first: Floats, other: Place) -> Iterator[tuple[Floats, Floats]]:
        """Yield differences from a point, and tangents there, from wherever a motion may begin."""

    @abstractmethod
    def tests(self, points: list[Floats], tangents: list[Floats]) -> Tests:
        """Return the test functions at points of the curve."""

    @abstractmethod
    def value_of(self, kind: Type, which: int, x: Floats, across: Floats, margin: float) -> float:
        """Return the test function of a type at a point, of a torus less so many times its error.

        `which` tells which impact grazes.
        """

    @abstractmethod
    def columns(self, points: list[Floats]) -> list[Columns]:
        """Return the columns of the motions at points, in parts one after the other."""

    @abstractmethod
    def repeated(
        self, kind: Type, x: Floats, tangent: Floats
    ) -> tuple[Curve, Floats, Floats] | None:
        """Return a special point as one of the curve of motions that repeat after twice as long.

        And its tangent there, of any length; None where that is no branching, or too long.
        """

    @abstractmethod
    def unlike(self, x: Floats) -> Floats:
        """Return how unlike both halves of a repeated motion are."""

    def twice(self) -> Callable[[float], Motions]:
        """Return the problem of motions that repeat after twice as long, by the parameter.

        Of those whose second half mirrors the first, both halves are told apart.
        """
        before, mirrored = self.motions, self.base.symmetric

        def motions(value: float) -> Motions:
            base = before(value)
            if mirrored:
                both = Impact(base.constraint, 1), Impact(base.constraint, -1)
                return replace(base, sequence=both, phases=None)
            return replace(base, sequence=base.impacts * 2, periods=2 * base.periods, phases=None)

        return motions

    def regular(self, first: Floats, last: Floats) -> tuple[Curve, Floats, Floats]:
        """Return two points on a curve whose equations are regular where multipliers are 1."""
        return self, first, last

    def of_regular(self, x: Floats) -> Floats:
        """Return a point, or a tangent, of that curve as one of this."""
        return x

    def rests(self, end: Floats, last: Floats) -> bool:
        """Whether a point at the end of the range, after the last one, is one of rest."""
        return False

    def too_large(self, x: Floats) -> bool:
        """Whether the motion at a point is so large that a branch ends."""
        return False

    def before_step(self, place: Place, length: float) -> tuple[float, Change | None]:
        """Return how long the step from a point may be, and what happens within it if known."""
        return length, None

    def after_step(self, before: Place, after: Place) -> Change | None:
        """Return what happens between two points; raise `SolverError` where that is too far."""
        return None

    # -- points --

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

    def equations(self, x: Floats) -> Equations:
        """Return the equations at a point."""
        return self._equations(x.tobytes())

    def slopes(self, x: Floats) -> Floats:
        """Return the derivatives of the residuals, (number, number + 1)."""
        here = self.equations(x)
        h = -_DIFFERENCE if x[-1] > 0.5 else _DIFFERENCE
        ahead = x.copy()
        ahead[-1] += h
        there = self.equations(ahead)
        change = (there.residual * (there.size / here.size) - here.residual) / h
        both = np.concatenate([here.jacobian, change[:, np.newaxis]], axis=1)
        if here.autonomous:
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
                residual, jacobian, terms, autonomous = here
                if change is None:
                    change = terms * self.slopes(x)[: terms.size, -1]
                elif last is not None:
                    change = _change_along(*last, here, change)
                size = float(np.abs(residual).max(initial=0.0))
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
                if autonomous:
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
        return self.onto(moved, np.eye(1, x.size, x.size - 1)[0], np.zeros(x.size - 1))

    def between(
        self,
        places: list[Place],
        part: float,
        far: Callable[[Floats], float],
        apart: Callable[[Floats], float],
    ) -> int | None:
        """Return between which points a motion is that another curve has at a part of the range.

        `apart` tells how far a point is from it, and `far` how far it is at least.
        """
        for k, (place, after) in enumerate(itertools.pairwise(places)):
            low, high = place.x[-1], after.x[-1]
            if not min(low, high) - 1e-9 <= part <= max(low, high) + 1e-9:
                continue
            share = (part - low) / (high - low) if high != low else 0.0
            near = (1.0 - share) * place.x + share * after.x
            if far(near) > 10.0 * float(np.linalg.norm(after.x - place.x)) + _SAME:
                continue
            point = self.at_value(near, part)
            if point is not None and apart(point) < _SAME:
                return k
        return None

    def place(self, x: Floats, along: Floats) -> Place:
        """Return a point with its tangent in a direction."""
        slopes, sizes = self.slopes(x), self.equations(x).size
        return Place(x, self.tangent(slopes, along), sizes * slopes[: sizes.size, -1])

    def _next(self, x: Floats, along: Floats) -> Place | None:
        try:
            return self.place(x, along)
        except (SolverError, np.linalg.LinAlgError):
            return None

    # -- steps --

    def trace(
        self, x: Floats, direction: Floats, finished: Callable[[Floats], bool], most: int
    ) -> Traced:
        """Return the points of the curve from x on, until it leaves the range or comes back.

        They are so many at most, and none where there is no tangent at x.
        """
        begin = self._next(x, direction)
        if begin is None:
            return Traced([], None)
        place, places = begin, [begin]
        length = _FIRST * self.longest(place)
        while len(places) < most and not self.too_large(place.x):
            longest = self.longest(place)
            length, change = self.before_step(place, min(length, longest))
            if change is not None:
                return _ended(places, change)
            if length < _SHORTEST * longest:
                break
            point = self.along(place, length)
            if point is None:  # perhaps as there are no problems beyond the range
                last = self._last(place, length)
                if last is not None:
                    return Traced([*places, last], None)
            next_place = None if point is None else self._next(point, place.tangent)
            if point is None or next_place is None or next_place.tangent @ place.tangent < _BEND:
                length *= 0.5
                continue
            try:
                change = self.after_step(place, next_place)
            except SolverError:
                length *= 0.5
                continue
            if change is not None:
                return _ended(places, change)
            if not 0.0 <= point[-1] <= 1.0:
                end = self._end(place.x, point)
                if end is not None and np.abs(end - place.x).max() > _CLOSE:
                    places.append(replace(next_place, x=end))
                break
            place = next_place
            places.append(place)
            if finished(point) or self.is_closed(places):
                break
            if place.tangent @ places[-2].tangent > 0.999:
                length = min(1.5 * length, longest)
        return Traced(places, None)

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
        if end is not None and self.rests(end, last):
            return self.at_value(last, edge + _BESIDE * (float(last[-1]) - edge))
        return end

    def is_closed(self, places: list[Place]) -> bool:
        """Whether the last step has come back to the first point."""
        if len(places) <= 5:
            return False
        first, last, before = places[0], places[-1], places[-2]
        step = float(np.linalg.norm(last.x - before.x))
        return any(
            np.linalg.norm(apart) < step
            and first.tangent @ tangent > _BEND
            and first.tangent @ apart <= 0.0
            for apart, tangent in self.apart(first.x, last)
        )


def _ended(places: list[Place], change: Change) -> Traced:
    """Return points of a curve that goes over into another one."""
    return Traced(places if change.place is None else [*places, change.place], change)


def _change_along(before: Equations, step: Floats, after: Equations, change: Floats) -> Floats:
    """Return the derivatives by the parameter in the middle of a step, (number,).

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
