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
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.plan import Plan, Tick
from vibroimpact_solvers.receptance import ExpansionSize
from vibroimpact_solvers.results.existence_bands import Edge
from vibroimpact_solvers.spectrum import Spectrum

STATEMENT: Final = (
    "estimated: impact modes at frequencies between all poles; a band or a gap narrower than the "
    "resolution could be missed, edges are enclosed between two frequencies whose reasons are "
    "certain; where none is, the range is unresolved"
)
_UNPROVED: Final = (
    "estimated: impact modes at frequencies between all poles, none of whose reasons is certain; a "
    "band or a gap narrower than the resolution could be missed, and edges are as uncertain"
)

STRAIGHT: Final = (
    "certified: one solution decides all frequencies, as paths without stiffness are straight lines"
)

_BETWEEN = 16  # frequencies between neighbouring poles
_ROUNDS = 8  # of bisections where reasons hide between others
_THIN = 4.0  # widths of such a range over the resolution below which it does not count
_IN_BALLS = 16  # uncertain ends that ball arithmetic decides
_OUTWARDS = 50  # doublings of the distance from an edge, from a few roundings on
_LEAST = 2000  # frequencies at least
_MOST = 400_000  # frequencies at most
_OUTPUTS: Final = frozenset({"reason"})
_REJECTED: Final = (Reason.WRONG_VELOCITY, Reason.PENETRATION)


def _joined(ranges: Floats) -> list[tuple[float, float]]:
    """Return ascending ranges, shape (2, range), those that overlap as one."""
    joined: list[tuple[float, float]] = []
    for start, stop in zip(*ranges.tolist(), strict=True):
        if joined and start <= joined[-1][1]:
            joined[-1] = joined[-1][0], max(joined[-1][1], stop)
        else:
            joined.append((start, stop))
    return joined


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
    ranges = FrequencyRanges(statement=STRAIGHT if certified else STATEMENT, complete=certified)
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
        plan: Callable[[modes.Problem], Plan] = modes.plan_in_doubles,
    ) -> None:
        self.problem, self.poles, self.plan = problem, poles, plan
        self.in_balls = plan is modes.plan_in_doubles

    def find(self, tick: Tick | None) -> FrequencyRanges:
        """Return the ranges between changes of the reason on a grid of frequencies."""
        grid = self._grid()
        coarse = float((np.diff(grid) / grid[1:]).max())
        codes, witness, certain = self._reasons(grid, tick)
        proved = bool(certain.any())
        grid, codes, witness = self._enclosed(grid, codes, witness)
        changes = np.flatnonzero(codes[1:] != codes[:-1])
        ends = np.stack([grid[changes], grid[changes + 1]])
        known, waits = ends, np.zeros(ends.shape, dtype=np.bool_)
        if proved:
            limits = grid[np.maximum(changes - 1, 0)], grid[np.minimum(changes + 2, grid.size - 1)]
            places = np.stack([codes[changes], codes[changes + 1]])
            known, waits = self._certain(ends, places, np.stack(limits))
        ranges = FrequencyRanges(statement=STATEMENT if proved else _UNPROVED)
        ranges.resolution = coarse
        middle = 0.5 * (ends[0] + ends[1])
        # What is not certain up to a limit belongs to no range.
        stops, starts = np.where(waits, known, middle)
        ranges.unresolved = _joined(known[:, waits.any(axis=0)])
        far = np.maximum(starts - known[0], known[1] - stops)
        starts, stops = np.append(grid[0], starts), np.append(stops, grid[-1])
        errors = np.concatenate([[0.0], far, [0.0]])
        firsts, lasts = np.append(0, changes + 1), np.append(changes, grid.size - 1)
        for k, (first, last) in enumerate(zip(firsts, lasts, strict=True)):
            reason, start, stop = Reason(codes[first]), float(starts[k]), float(stops[k])
            if start >= stop:
                continue
            error = float(max(errors[k], errors[k + 1])) + 4.0 * np.spacing(stop)
            if reason is Reason.OK:
                below = Edge.RANGE if k == 0 else Edge(int(codes[first - 1]))
                above = Edge.RANGE if last + 1 == codes.size else Edge(int(codes[last + 1]))
                ranges.bands.append(Band(start, stop, below, above, error, certified=False))
            elif reason in _REJECTED:
                at = float(witness[(first + last) // 2])
                edge = Edge(int(reason))
                ranges.rejected.append(
                    Rejected(start, stop, edge, error, certified=False, witness=at)
                )
        return ranges

    def _grid(self) -> Floats:
        """Return the frequencies that are evaluated: denser where poles are dense."""
        start, stop = self.problem.start, self.problem.stop
        if self.problem.resolution is not None:
            return self.problem.grid
        marks = np.unique(np.concatenate([[start, stop], self.poles]))
        between = max(2, min(_BETWEEN, _MOST // marks.size))
        # Denser towards the poles, where reasons change.
        share = 0.5 - 0.5 * np.cos(np.pi * (np.arange(between) + 0.5) / between)
        inside = marks[:-1, np.newaxis] + np.diff(marks)[:, np.newaxis] * share
        uniform = np.linspace(start, stop, _LEAST)
        return np.unique(np.concatenate([uniform, inside.ravel()]))

    def _enclosed(
        self, grid: Floats, codes: Integers, witness: Floats
    ) -> tuple[Floats, Integers, Floats]:
        """Return a grid with narrow pairs about all changes of the reason.

        Where a third reason begins next to the first one, there is another change behind it. A
        range no wider than the resolution, at a pole, is none.
        """
        coarse = grid
        for _ in range(_ROUNDS):
            changes = np.flatnonzero(codes[1:] != codes[:-1])
            low, high = self._bisect(grid, codes, changes)
            new = np.setdiff1d(np.concatenate([low, high]), grid)
            if not new.size:
                break
            places = np.searchsorted(grid, new)
            more, at, _ = self._reasons(new)
            grid, codes = np.insert(grid, places, new), np.insert(codes, places, more)
            witness = np.insert(witness, places, at)
        changes = np.flatnonzero(codes[1:] != codes[:-1])
        starts, stops = np.append(0, changes + 1), np.append(changes, grid.size - 1)
        narrow = grid[stops] - grid[starts] <= _THIN * self.problem.edge_width * grid[stops]
        kept = ~np.repeat(narrow, stops - starts + 1) | np.isin(grid, coarse)
        return grid[kept], codes[kept], witness[kept]

    def _certain(self, ends: Floats, codes: Integers, limits: Floats) -> tuple[Floats, Booleans]:
        """Move frequencies to both sides of edges apart until their reasons are certain.

        Returns them, and which are not certain as far as their limits, the next frequencies of
        the grid. All arrays are (side, edge). Where few are left, ball arithmetic decides.
        """
        moved, step = ends.copy(), 4.0 * np.spacing(ends) * np.array([[-1.0], [1.0]])
        waits, lost = np.ones(ends.shape, dtype=np.bool_), np.zeros(ends.shape, dtype=np.bool_)
        for _ in range(_OUTWARDS):
            if not waits.any():
                break
            plan = modes.all_modes_plan if self.in_balls and waits.sum() <= _IN_BALLS else self.plan
            reasons, _, certain = self._reasons(moved[waits], plan=plan)
            waits[waits] = ~(certain & (reasons == codes[waits]))
            at_limit = (moved == limits) & waits
            lost, waits = lost | at_limit, waits & ~at_limit
            step *= 2.0
            moved[waits] = (ends + step)[waits]
            np.clip(moved, limits[0], limits[1], out=moved)
        return moved, lost | waits

    def _reasons(
        self,
        Omega: Floats,
        tick: Tick | None = None,
        plan: Callable[[modes.Problem], Plan] | None = None,
    ) -> tuple[Integers, Floats, Booleans]:
        """Return reason codes, witnesses, and whether the codes are certain, each (frequency,)."""
        look()
        problem = self.problem.impact_modes_at(Omega, _OUTPUTS)
        result = modes.solve(problem, (plan or self.plan)(problem), tick)
        assert result.reason is not None
        assert result.witness is not None
        assert result.certified is not None
        return result.reason, result.witness, result.certified

    def _bisect(self, grid: Floats, codes: Integers, changes: Integers) -> tuple[Floats, Floats]:
        """Return neighbouring frequencies between which the reason changes."""
        low, high = grid[changes].copy(), grid[changes + 1].copy()
        while low.size:
            middle = 0.5 * (low + high)
            wide = (high - low > self.problem.edge_width * high) & (low < middle) & (middle < high)
            if not wide.any():
                break
            below = np.zeros(low.size, dtype=np.bool_)
            below[wide] = self._reasons(middle[wide])[0] == codes[changes[wide]]
            low = np.where(wide & below, middle, low)
            high = np.where(wide & ~below, middle, high)
        return low, high
