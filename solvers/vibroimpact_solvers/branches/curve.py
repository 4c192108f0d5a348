r"""One branch as a curve: its equations, Newton's method on them, and steps along it.

A point of the curve has 2 m + 1 numbers: phases and scaled impulses of the m impacts, and the
parameter as a part of its range. The 2 m equations (`periodic_motions.sequences`) have derivatives
by phases and impulses in closed form, and by the parameter from a difference. The null vector of
all of them is the tangent; Newton's method returns to the curve at right angles to it. Without
load, where a motion may begin at any time, the first phase stays where it is, and least squares
take the equation that is left over.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.branches.problem import Problem
from vibroimpact_solvers.errors import SolverError
from vibroimpact_solvers.periodic_motions import Problem as Motions
from vibroimpact_solvers.periodic_motions import closed_form, sequences
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.sequences import Search
from vibroimpact_solvers.periodic_motions.solutions import Cells, Solutions

_DIFFERENCE = 1e-7  # of the range: step of the difference by the parameter
_ITERATIONS = 8
_CLOSE = 1e-12  # residual, relative to its terms, of a point
_BEND = 0.97  # least cosine between neighbouring tangents
_FIRST = 0.1  # first step, as a part of the longest
_SHORTEST = 1e-7  # and the shortest one


@dataclass(frozen=True, eq=False, slots=True)
class Place:
    """A point of a curve, the tangent there, and the derivatives by the parameter."""

    x: Floats
    tangent: Floats
    change: Floats


class Curve:
    """The curve of all motions with one sequence of impacts.

    Parameters
    ----------
    problem : Problem
    motions : callable
        Returns the problem of periodic motions for a value of the parameter.
    """

    def __init__(self, problem: Problem, motions: Callable[[float], Motions]) -> None:
        self.problem, self.motions = problem, motions
        base = motions(problem.start)
        self.m = len(base.impacts)
        self.span = problem.stop - problem.start
        self.impulse = 1.0
        self._driven: Driven | None = None
        self._largest: dict[bytes, tuple[complex, float]] = {}

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

    def driven(self, motions: Motions) -> Driven:
        """Return the structure, which stays the same where the frequency varies."""
        if self._driven is None or not self.problem.frequency:
            self._driven = Driven.of(motions, spectrum.choose(motions.system))
        return self._driven

    def search(self, x: Floats) -> Search:
        """Return the equations at a value of the parameter."""
        motions = self.motions(self.value(x))
        driven = self.driven(motions)
        return Search(driven, Cells.of(driven, motions), motions, 0)

    def start(self, x: float) -> list[Floats]:
        """Return all points with a value of the parameter, as a part of the range."""
        motions = self.motions(self.value(np.array([x])))
        driven = self.driven(motions)
        cells = Cells.of(driven, motions)
        if self.m == 1:
            solved = closed_form.solutions(driven, cells, motions.impacts[0])
        else:
            solved = sequences.solutions(driven, cells, motions)
        if solved.impulse.size and self.impulse == 1.0:
            self.impulse = float(np.abs(solved.impulse).max()) or 1.0
        return [
            np.concatenate([phase, impulse / self.impulse, [x]])
            for phase, impulse in zip(solved.phase, solved.impulse, strict=True)
        ]

    def equations(self, x: Floats) -> tuple[Floats, Floats, Search]:
        """Return residuals relative to their terms, derivatives by all numbers but the last."""
        search = self.search(x)
        times, impulses = x[np.newaxis, : self.m] / search.Omega, x[self.m : -1] * self.impulse
        residual, jacobian, size = search.equations(times, impulses[np.newaxis])
        jacobian[..., : self.m] *= self.impulse
        jacobian[..., self.m :] /= search.Omega
        swapped = np.concatenate([jacobian[0, :, self.m :], jacobian[0, :, : self.m]], axis=1)
        if search.autonomous:
            swapped[:, 0] = 0.0
        return residual[0] / size[0], swapped / size[0][:, np.newaxis], search

    def slopes(self, x: Floats) -> Floats:
        """Return the derivatives of the residuals, (2 m, 2 m + 1)."""
        residual, jacobian, search = self.equations(x)
        h = -_DIFFERENCE if x[-1] > 0.5 else _DIFFERENCE
        ahead = x.copy()
        ahead[-1] += h
        change = (self.equations(ahead)[0] - residual) / h
        both = np.concatenate([jacobian, change[:, np.newaxis]], axis=1)
        if search.autonomous:
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

        None where Newton's method does not reach one. Its matrix may have the derivatives by the
        parameter (`change`) of a point nearby.
        """
        first, before = x, np.inf
        try:
            for count in range(_ITERATIONS):
                residual, jacobian, search = self.equations(x)
                if change is None:
                    change = self.slopes(x)[: 2 * self.m, -1]
                size = float(np.abs(residual).max())
                if not np.isfinite(size) or (count > 2 and size > 2.0 * before):
                    return x if before < _CLOSE else None
                if size < 1e-15 or (size < _CLOSE and size > 0.25 * before):
                    return x
                before = size
                rows: list[Floats] = [np.column_stack([jacobian, change]), across[np.newaxis]]
                values: list[Floats] = [residual, np.atleast_1d(across @ (x - first))]
                if search.autonomous:
                    rows.append(np.eye(1, x.size))
                    values.append(x[:1] - first[:1])
                step = np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)[0]
                x = x - step
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
        return self.onto(moved, np.eye(1, x.size, x.size - 1)[0])

    def trace(
        self, x: Floats, direction: Floats, finished: Callable[[Floats], bool]
    ) -> list[Place]:
        """Return the points of the curve from x on, until it leaves the range or comes back."""
        place = self.place(x, direction)
        places, longest = [place], self.problem.step
        length = _FIRST * longest
        while len(places) < self.problem.points:
            point = self.along(place, length)
            next_place = None if point is None else self._next(point, place.tangent)
            if point is None or next_place is None or next_place.tangent @ place.tangent < _BEND:
                length *= 0.5
                if length < _SHORTEST * longest:
                    return places
                continue
            if not 0.0 <= point[-1] <= 1.0:
                end = self.at_value(point, 0.0 if point[-1] < 0.0 else 1.0)
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

    def place(self, x: Floats, along: Floats) -> Place:
        """Return a point with its tangent in a direction."""
        slopes = self.slopes(x)
        return Place(x, self.tangent(slopes, along), slopes[: 2 * self.m, -1])

    def _next(self, x: Floats, along: Floats) -> Place | None:
        try:
            return self.place(x, along)
        except (SolverError, np.linalg.LinAlgError):
            return None

    def is_closed(self, places: list[Place]) -> bool:
        """Whether the last step has come back to the first point."""
        first, last, before = places[0], places[-1], places[-2]
        apart = first.x - last.x
        turn = np.round(apart[0] / (2.0 * np.pi))
        apart[: self.m] -= 2.0 * np.pi * turn
        step = float(np.linalg.norm(last.x - before.x))
        return bool(
            len(places) > 5
            and np.linalg.norm(apart) < step
            and first.tangent @ last.tangent > _BEND
            and first.tangent @ apart <= 0.0
        )

    def solutions(self, points: list[Floats]) -> tuple[Motions, Driven, Cells, Solutions]:
        """Return the motions at points with one structure: of several frequencies, or at one."""
        parts = []
        for place, x in enumerate(points):
            search = self.search(x)
            times, p = x[np.newaxis, : self.m] / search.Omega, x[self.m : -1] * self.impulse
            part = search.collected(times, p[np.newaxis])
            parts.append(replace(part, index=np.full(1, place)))
        motions = [self.motions(self.value(x)) for x in points]
        problem = replace(motions[0], Omega=np.concatenate([each.Omega for each in motions]))
        names = Solutions.__dataclass_fields__
        solved = Solutions(
            *(np.concatenate([getattr(part, name) for part in parts]) for name in names)
        )
        driven = self.driven(motions[0])
        return problem, driven, Cells.of(driven, problem), solved
