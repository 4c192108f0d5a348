"""Which motions settle on the same attractor.

Periodic motions do where their periods are equal and the states of one, at the drive's phase 0, are
those of the other up to a shift by whole periods of the drive: within ten tolerances, and within
what is estimated to be left of both transients.

Chaotic motions, and quasi-periodic ones, do where their states cover the same set: of nine in ten
states of each, the nearest state of the other is no farther than ten times the distance at which
nine in ten states have their nearest neighbour in their own motion. Sets that interpenetrate are
counted as one. All undecided motions are counted together.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.attractors.problem import Problem
from vibroimpact_solvers.attractors.verdicts import Verdict
from vibroimpact_solvers.results.attractors import Nature

_TOLERANCES: Final = 10.0
_LEFT: Final = 4.0  # of what is left of transients
_MOST: Final = 1e-2  # distance of states that are never the same
_SHARE: Final = 0.9
_APART: Final = 10.0


@dataclass(eq=False, slots=True)
class Group:
    """Motions that settle on the same attractor.

    Parameters
    ----------
    shown : Verdict
        The one that stands for all: the first, or of periodic ones the one that is closest.
    count : int
    exponents, errors : list of float
        Of all motions.
    """

    shown: Verdict
    count: int = 0
    exponents: list[float] = field(default_factory=list)
    errors: list[float] = field(default_factory=list)

    def add(self, settled: Verdict) -> None:
        """Count a motion."""
        self.count += 1
        self.exponents.append(settled.exponent)
        self.errors.append(settled.error)
        if settled.nature is Nature.PERIODIC and settled.distance < self.shown.distance:
            self.shown = settled


def place(problem: Problem, groups: list[Group], settled: Verdict) -> int:
    """Count a motion in the group that it belongs to, the last one where it is a new one."""
    for index, group in enumerate(groups):
        if same(problem, group.shown, settled):
            group.add(settled)
            return index
    groups.append(Group(settled))
    groups[-1].add(settled)
    return len(groups) - 1


def same(problem: Problem, one: Verdict, other: Verdict) -> bool:
    """Whether two motions settle on the same attractor."""
    if one.nature is not other.nature or one.period != other.period:
        return False
    scale = max(one.scale, other.scale)
    if one.nature is Nature.UNDECIDED:
        return True
    if one.nature is not Nature.PERIODIC:
        return _cover(one.states / scale, other.states / scale)
    left = _LEFT * (one.distance + other.distance)
    close = min(max(_TOLERANCES * problem.close, left), _MOST)
    n = one.period
    mine, others = one.states[-n:] / scale, other.states[-n:] / scale
    return any(
        float(np.abs(mine - np.roll(others, shift, axis=0)).max()) <= close for shift in range(n)
    )


def _cover(mine: Floats, others: Floats) -> bool:
    """Whether two sets of states lie as close to each other as each to itself."""
    trees = cKDTree(mine), cKDTree(others)
    for tree, points, own in ((trees[1], mine, others), (trees[0], others, mine)):
        across = np.quantile(tree.query(points)[0], _SHARE)
        within = np.quantile(np.asarray(tree.query(own, k=2)[0])[:, 1], _SHARE)
        if across > _APART * within:
            return False
    return True
