"""Bands of any family: members between all poles, edges by bisection."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from vibroimpact_solvers import impact_modes as modes
from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.existence_bands.problem import Problem
from vibroimpact_solvers.existence_bands.ranges import Band, Findings, Rejected
from vibroimpact_solvers.existence_bands.result import Edge
from vibroimpact_solvers.impact_modes import Reason
from vibroimpact_solvers.plan import Plan
from vibroimpact_solvers.spectrum import Spectrum

STATEMENT: Final = (
    "searched: members at frequencies between all poles; a band or a gap narrower than the "
    "resolution could hide, edges are enclosed by members"
)

_BETWEEN = 16  # frequencies between neighbouring poles
_USUAL = 2000  # frequencies at least
_MOST = 400_000  # frequencies at most
_OUTPUTS: Final = frozenset({"reason"})
_REJECTED: Final = (Reason.WRONG_VELOCITY, Reason.PENETRATION)


def poles_of(problem: Problem, natural: Spectrum) -> Floats:
    """Return the poles of impulses by all natural modes.

    Odd motions have them where Omega is an odd fraction of a natural frequency, even ones where
    it is an even fraction.
    """
    roots = natural.roots[natural.roots > 0.0]
    rows = natural.along([problem.system.constraints[i] for i in problem.active])
    heard = np.abs(rows[:, natural.roots > 0.0]).max(axis=0, initial=0.0) > 0.0
    poles = [
        root / np.arange(max(1, np.ceil(root / problem.stop)), np.floor(root / problem.start) + 1.0)
        for root in roots[heard]
    ]
    return np.concatenate([np.empty(0), *poles])


def poles_around(problem: Problem, tick: Callable[[int, int], None] | None) -> Floats:
    """Return the poles of an odd motion by the natural modes around its harmonics."""
    members = problem.members(np.array([problem.start, problem.stop]), _OUTPUTS)
    waves = modes.partial_waves(members)
    odd = np.arange(1.0, waves.bound / problem.start + 2.0, 2.0)
    found = [np.empty(0)]
    for place, k in enumerate(odd):
        if tick is not None:
            tick(place, odd.size)
        found.append(waves.natural(k * problem.start, min(k * problem.stop, waves.bound)) / k)
    return np.concatenate(found)


class SearchedBands:
    """Finds the bands of one problem.

    Parameters
    ----------
    problem : Problem
    poles : array
        Frequencies Omega at which impulses pass zero, from `poles_of` or `poles_around`.
    plan : callable
        The plan of members at some frequencies.
    """

    def __init__(
        self,
        problem: Problem,
        poles: Floats,
        plan: Callable[[modes.Problem], Plan] = modes.plan,
    ) -> None:
        self.problem, self.poles, self.plan = problem, poles, plan

    def find(self, tick: Callable[[int, int], None] | None) -> Findings:
        """Return all bands that members at a grid of frequencies show."""
        grid = self._grid()
        codes, witness = self._look(grid, tick)
        changes = np.flatnonzero(codes[1:] != codes[:-1])
        low, high = self._bisect(grid, codes, changes)
        found = Findings(statement=STATEMENT)
        found.resolution = float((np.diff(grid) / grid[1:]).max())
        starts = np.concatenate([[0], changes + 1])
        stops = np.concatenate([changes, [grid.size - 1]])
        edges = np.concatenate([[grid[0]], 0.5 * (low + high), [grid[-1]]])
        errors = np.concatenate([[0.0], 0.5 * (high - low), [0.0]])
        for k, (first, last) in enumerate(zip(starts, stops, strict=True)):
            reason = Reason(codes[first])
            start, stop = float(edges[k]), float(edges[k + 1])
            if reason is Reason.OK:
                below = Edge.RANGE if k == 0 else Edge(int(codes[first - 1]))
                above = Edge.RANGE if k + 1 == starts.size else Edge(int(codes[last + 1]))
                error = float(max(errors[k], errors[k + 1])) + 4.0 * np.spacing(stop)
                found.bands.append(Band(start, stop, below, above, error, certified=False))
            elif reason in _REJECTED:
                middle = witness[(first + last) // 2]
                edge = Edge(int(reason))
                found.rejected.append(
                    Rejected(start, stop, edge, certified=False, witness=float(middle))
                )
        return found

    def _grid(self) -> Floats:
        """Return the frequencies looked at: the more the closer poles are."""
        start, stop = self.problem.start, self.problem.stop
        marks = np.unique(np.concatenate([[start, stop], self.poles]))
        between = max(2, min(_BETWEEN, _MOST // marks.size))
        # Denser towards the poles, where everything happens.
        share = 0.5 - 0.5 * np.cos(np.pi * (np.arange(between) + 0.5) / between)
        inside = marks[:-1, np.newaxis] + np.diff(marks)[:, np.newaxis] * share
        even = np.linspace(start, stop, _USUAL)
        return np.unique(np.concatenate([even, inside.ravel()]))

    def _look(
        self, Omega: Floats, tick: Callable[[int, int], None] | None = None
    ) -> tuple[Integers, Floats]:
        """Return reason codes of members and witnesses, each (frequency,)."""
        members = self.problem.members(Omega, _OUTPUTS)
        found = modes.solve(members, self.plan(members), tick)
        assert found.reason is not None
        assert found.witness is not None
        return found.reason, found.witness

    def _bisect(self, grid: Floats, codes: Integers, changes: Integers) -> tuple[Floats, Floats]:
        """Return neighbouring frequencies between which the reason changes."""
        low, high = grid[changes].copy(), grid[changes + 1].copy()
        while low.size:
            middle = 0.5 * (low + high)
            wide = (high - low > self.problem.resolution * high) & (low < middle) & (middle < high)
            if not wide.any():
                break
            below = np.zeros(low.size, dtype=np.bool_)
            below[wide] = self._look(middle[wide])[0] == codes[changes[wide]]
            low = np.where(wide & below, middle, low)
            high = np.where(wide & ~below, middle, high)
        return low, high
