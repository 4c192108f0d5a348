"""Existence bands of any family: impact modes between all poles, edges by bisection."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from vibroimpact_solvers import impact_modes as modes
from vibroimpact_solvers.arrays import Booleans, Floats, Integers
from vibroimpact_solvers.existence_bands.problem import Problem
from vibroimpact_solvers.existence_bands.ranges import Band, FrequencyRanges, Rejected
from vibroimpact_solvers.impact_modes import Reason
from vibroimpact_solvers.plan import Plan, Tick
from vibroimpact_solvers.receptance import ExpansionSize
from vibroimpact_solvers.results.existence_bands import Edge
from vibroimpact_solvers.spectrum import Spectrum

STATEMENT: Final = (
    "estimated: impact modes at frequencies between all poles; a band or a gap narrower than the "
    "resolution could be missed, edges are enclosed between two frequencies whose reasons are "
    "certain, if there are such within 1e-10"
)

STRAIGHT: Final = (
    "certified: one solution decides all frequencies, as paths without stiffness are straight lines"
)

_BETWEEN = 16  # frequencies between neighbouring poles
_OUTWARDS = 16  # doublings of the distance from an edge, from a few roundings on
_LEAST = 2000  # frequencies at least
_MOST = 400_000  # frequencies at most
_OUTPUTS: Final = frozenset({"reason"})
_REJECTED: Final = (Reason.WRONG_VELOCITY, Reason.PENETRATION)


def poles_of(problem: Problem, natural: Spectrum) -> Floats:
    """Return the poles of the impulses from all natural modes.

    The antisymmetric component has them where Omega is an odd fraction of a natural frequency,
    the symmetric component where it is an even fraction.
    """
    roots = natural.roots[natural.roots > 0.0]
    rows = natural.along([problem.system.constraints[i] for i in problem.active])
    participating = np.abs(rows[:, natural.roots > 0.0]).max(axis=0, initial=0.0) > 0.0
    poles = [
        root / np.arange(max(1, np.ceil(root / problem.stop)), np.floor(root / problem.start) + 1.0)
        for root in roots[participating]
    ]
    return np.concatenate([np.empty(0), *poles])


def poles_near_harmonics(
    problem: Problem, expansion: ExpansionSize, tick: Tick | None = None
) -> Floats:
    """Return the poles of an antisymmetric family from the natural modes near its harmonics."""
    ends = problem.impact_modes_at(np.array([problem.start, problem.stop]), _OUTPUTS)
    response = modes.partial_modal_response(ends, expansion)
    bound = response.bound
    odd = np.arange(1.0, bound / problem.start + 2.0, 2.0)
    poles = [np.empty(0)]
    for place, k in enumerate(odd):
        if tick is not None:
            tick(place, odd.size)
        low, high = k * problem.start, min(k * problem.stop, bound)
        poles.append(response.natural_frequencies(low, high) / k)
    return np.concatenate(poles)


def by_one_solution(problem: Problem) -> FrequencyRanges:
    """Return the ranges of a structure without stiffness: its paths are straight lines.

    They are the same at all frequencies but for the scale of time.
    """
    Omega = math.sqrt(problem.start) * math.sqrt(problem.stop)
    one = problem.impact_modes_at(np.array([Omega]), _OUTPUTS)
    result = modes.solve(one, modes.plan(one))
    assert result.reason is not None
    assert result.certified is not None
    assert result.witness is not None
    reason, certified = Reason(result.reason[0]), bool(result.certified[0])
    ranges = FrequencyRanges(statement=STRAIGHT if certified else STATEMENT)
    if reason is Reason.OK:
        ends = problem.start, problem.stop, Edge.RANGE, Edge.RANGE
        ranges.bands.append(Band(*ends, 0.0, certified))
    elif reason in _REJECTED:
        rejected = problem.start, problem.stop, Edge(int(reason)), 0.0, certified
        ranges.rejected.append(Rejected(*rejected, witness=float(result.witness[0])))
    return ranges


class SearchedBands:
    """Search for the bands of one problem.

    `poles` are those from `poles_of` or `poles_near_harmonics`; `plan` returns the plan of the
    impact modes at some frequencies.
    """

    def __init__(
        self,
        problem: Problem,
        poles: Floats,
        plan: Callable[[modes.Problem], Plan] = modes.plan,
    ) -> None:
        self.problem, self.poles, self.plan = problem, poles, plan

    def find(self, tick: Tick | None) -> FrequencyRanges:
        """Return the ranges between changes of the reason on a grid of frequencies."""
        grid = self._grid()
        codes, witness, _ = self._reasons(grid, tick)
        changes = np.flatnonzero(codes[1:] != codes[:-1])
        low, high = self._bisect(grid, codes, changes)
        middle = 0.5 * (low + high)
        ends = np.stack([low, high]), np.stack([codes[changes], codes[changes + 1]])
        low, high = self._certain(*ends, np.stack([grid[changes], grid[changes + 1]]))
        ranges = FrequencyRanges(statement=STATEMENT)
        ranges.resolution = float((np.diff(grid) / grid[1:]).max())
        starts = np.concatenate([[0], changes + 1])
        stops = np.concatenate([changes, [grid.size - 1]])
        edges = np.concatenate([[grid[0]], middle, [grid[-1]]])
        errors = np.concatenate([[0.0], np.maximum(middle - low, high - middle), [0.0]])
        for k, (first, last) in enumerate(zip(starts, stops, strict=True)):
            reason = Reason(codes[first])
            start, stop = float(edges[k]), float(edges[k + 1])
            error = float(max(errors[k], errors[k + 1])) + 4.0 * np.spacing(stop)
            if reason is Reason.OK:
                below = Edge.RANGE if k == 0 else Edge(int(codes[first - 1]))
                above = Edge.RANGE if k + 1 == starts.size else Edge(int(codes[last + 1]))
                ranges.bands.append(Band(start, stop, below, above, error, certified=False))
            elif reason in _REJECTED:
                middle = witness[(first + last) // 2]
                edge = Edge(int(reason))
                ranges.rejected.append(
                    Rejected(start, stop, edge, error, certified=False, witness=float(middle))
                )
        return ranges

    def _grid(self) -> Floats:
        """Return the frequencies that are evaluated: denser where poles are dense."""
        start, stop = self.problem.start, self.problem.stop
        marks = np.unique(np.concatenate([[start, stop], self.poles]))
        between = max(2, min(_BETWEEN, _MOST // marks.size))
        # Denser towards the poles, where reasons change.
        share = 0.5 - 0.5 * np.cos(np.pi * (np.arange(between) + 0.5) / between)
        inside = marks[:-1, np.newaxis] + np.diff(marks)[:, np.newaxis] * share
        uniform = np.linspace(start, stop, _LEAST)
        return np.unique(np.concatenate([uniform, inside.ravel()]))

    def _certain(self, ends: Floats, codes: Integers, limits: Floats) -> Floats:
        """Move frequencies to both sides of edges apart until their reasons are certain.

        All arrays are (side, edge); an end that is uncertain far from its edge stays where it was.
        """
        moved, step = ends.copy(), 4.0 * np.spacing(ends) * np.array([[-1.0], [1.0]])
        waits = np.ones(ends.shape, dtype=np.bool_)
        for _ in range(_OUTWARDS):
            if not waits.any():
                break
            reasons, _, certain = self._reasons(moved[waits])
            waits[waits] = ~(certain & (reasons == codes[waits]))
            step *= 2.0
            moved[waits] = (ends + step)[waits]
            np.clip(moved, limits[0], limits[1], out=moved)
        return np.where(waits, ends, moved)

    def _reasons(
        self, Omega: Floats, tick: Tick | None = None
    ) -> tuple[Integers, Floats, Booleans]:
        """Return reason codes, witnesses, and whether the codes are certain, each (frequency,)."""
        problem = self.problem.impact_modes_at(Omega, _OUTPUTS)
        result = modes.solve(problem, self.plan(problem), tick)
        assert result.reason is not None
        assert result.witness is not None
        assert result.certified is not None
        return result.reason, result.witness, result.certified

    def _bisect(self, grid: Floats, codes: Integers, changes: Integers) -> tuple[Floats, Floats]:
        """Return neighbouring frequencies between which the reason changes."""
        low, high = grid[changes].copy(), grid[changes + 1].copy()
        while low.size:
            middle = 0.5 * (low + high)
            wide = (high - low > self.problem.resolution * high) & (low < middle) & (middle < high)
            if not wide.any():
                break
            below = np.zeros(low.size, dtype=np.bool_)
            below[wide] = self._reasons(middle[wide])[0] == codes[changes[wide]]
            low = np.where(wide & below, middle, low)
            high = np.where(wide & ~below, middle, high)
        return low, high
