"""Contact phases at all frequencies: with proof that none is missed where that is quick.

Where it is not, because fast modes make boxes small (`isolation`), the structure is reduced to
its slowest modes. The motions of the whole one follow from those of the reduced one by Newton's
method; that none is missed is not known then.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Booleans, Integers
from vibroimpact_solvers.periodic_motions.problem import Problem
from vibroimpact_solvers.periodic_motions.stops import isolation, prescribed
from vibroimpact_solvers.periodic_motions.stops.existence import verdicts
from vibroimpact_solvers.periodic_motions.stops.isolation import Boxes
from vibroimpact_solvers.periodic_motions.stops.phases import Phases
from vibroimpact_solvers.periodic_motions.stops.prescribed import Cells
from vibroimpact_solvers.periodic_motions.stops.reduction import Reduced
from vibroimpact_solvers.periodic_motions.stops.solutions import (
    Solutions,
    apart,
    joined,
    polished,
    solutions,
)
from vibroimpact_solvers.results.impact_modes import Reason

WORK: Final = 1500.0
"""Work of a frequency up to which it is proved that none is missed (`Boxes.work`): about a tenth of
a second."""
_MOST: Final = 1500  # boxes of a frequency
_LESS: Final = 600  # those of a frequency at which motions may be missed
_FEW: Final = 300  # work, and boxes, of a frequency with a reduced structure
_FEWER: Final = (16, 12, 8, 5)  # modes of reduced structures
_PHANTOMS: Final = 8  # of a frequency that are listed, and all motions
_REACH: Final = 0.02  # of the period, how far durations of the whole structure may be off


class Search:
    """The search for the contact phases of a problem.

    Parameters
    ----------
    problem : Problem
    phases : Phases
    """

    def __init__(self, problem: Problem, phases: Phases) -> None:
        self._problem, self._phases = problem, phases
        self._starts = isolation.starts(phases)
        self._reduced: dict[int, Reduced | None] = {}

    def contacts(self, cells: Cells) -> tuple[Solutions, Booleans]:
        """Return the motions with one contact phase per cell, and where none can be missing."""
        phases, parts = self._phases, []
        boxes = Boxes.of(phases, cells, np.full(cells.Omega.size, _MOST))
        complete = (boxes.left == 0.0) & (boxes.work <= WORK)
        left, whole = np.flatnonzero(~complete), complete.copy()
        for size in _FEWER:
            if not left.size or (reduced := self._by_slowest(size)) is None:
                continue
            few = reduced.cells(phases.scale * cells.Omega[left])
            smaller = Boxes.of(reduced.phases, few, np.full(left.size, _FEW))
            now = (smaller.left == 0.0) & (smaller.work <= _FEW) | (size == _FEWER[-1])
            parts += self._from(reduced, few, smaller.at(now), cells, left)
            left = left[~now]
        if left.size:
            whole[left] = True
            boxes = Boxes.of(phases, cells, np.where(complete, _MOST, _LESS))
        for start in self._starts:
            durations = isolation.isolated(phases, cells, start, boxes.at(whole))
            complete &= durations.unresolved == 0.0
            reached, lost = solutions(phases, cells, start, durations)
            complete[lost] = False
            parts.append(reached)
        solved = joined(parts)
        solved = solved.at(np.lexsort((solved.d, solved.index)))
        return solved.at(self._listed(cells, solved)), complete

    def _listed(self, cells: Cells, solved: Solutions) -> Integers:
        """Return the solutions that are listed: of very many phantoms only the first ones."""
        counts = np.bincount(solved.index, minlength=cells.Omega.size)
        place = np.arange(solved.index.size) - (np.cumsum(counts) - counts)[solved.index]
        late = np.flatnonzero(place >= _PHANTOMS)
        if not late.size:
            return np.arange(solved.index.size)
        decided = verdicts(self._problem, self._phases, cells, solved.at(late))
        phantom = late[decided.reason != Reason.OK]
        return np.setdiff1d(np.arange(solved.index.size), phantom)

    def _by_slowest(self, size: int) -> Reduced | None:
        if size not in self._reduced:
            self._reduced[size] = Reduced.of(self._problem, self._phases, size)
        return self._reduced[size]

    def _from(
        self, reduced: Reduced, few: Cells, boxes: Boxes, cells: Cells, left: Integers
    ) -> list[Solutions]:
        """Return what motions of a reduced structure lead to."""
        parts, scale = [], self._phases.scale / reduced.phases.scale
        for own, start in zip(isolation.starts(reduced.phases), self._starts, strict=True):
            durations = isolation.isolated(reduced.phases, few, own, boxes)
            near, _ = solutions(reduced.phases, few, own, durations)
            index, d = left[near.index], near.d * scale
            one = [
                polished(
                    self._phases, cells, start, index[some], d[some], near.phase[some],
                    _REACH * cells.length[index[some]],
                )[0]
                for some in prescribed.pieces(self._phases, cells, index, d)
            ]  # fmt: skip
            if one:
                parts.append(apart(cells, joined(one)))
        return parts
