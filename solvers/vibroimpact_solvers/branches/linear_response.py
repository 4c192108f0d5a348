"""The motion without impacts, as a branch, and where it begins to touch a rigid stop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import brentq

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.branches.impacts import Impacts
from vibroimpact_solvers.branches.problem import Problem
from vibroimpact_solvers.periodic_motions import columns
from vibroimpact_solvers.periodic_motions.existence import verdicts
from vibroimpact_solvers.periodic_motions.solutions import Cells, without_impacts
from vibroimpact_solvers.results.impact_modes import Reason

VALUES = 101
"""Values of the parameter at which it is listed."""
_ASIDE = 1e-9  # of the range: how far beside a resonance the limits are checked


class Touched(NamedTuple):
    """Where it begins to touch a stop."""

    value: float
    error: float
    row: int  # of the motion before
    along: float  # how far on the way to the next one
    along_error: float


def exists(problem: Problem) -> bool:
    """Whether there is one: a load acts, and none that is constant drives a rigid body."""
    if not problem.at(problem.start).load:
        return False
    curve = Impacts(problem, problem.at)
    return not curve.laws(curve.motions(problem.start)).driven.balance.loaded


def listed(problem: Problem) -> tuple[Floats, list[columns.Columns], list[Touched]]:
    """Return values of the parameter, columns of the motion there, and where it touches."""
    curve = Impacts(problem, problem.at)

    def solved(values: Sequence[float]) -> Any:
        joint = curve.joint(np.array(values)) if problem.frequency else curve.motions(values[0])
        driven = curve.laws(joint).driven
        cells = Cells.of(driven, joint)
        whole = cells if cells.sign > 0.0 else cells.doubled()
        return joint, driven, whole, without_impacts(whole)

    def kept(value: float) -> float:
        reason = verdicts(*solved([value])).reason[0]
        if reason == Reason.SINGULAR:  # a resonance, which is one point of the range
            other = problem.start if value != problem.start else problem.stop
            reason = verdicts(*solved([value + _ASIDE * (other - value)])).reason[0]
        return 1.0 if reason == Reason.OK else -1.0

    values = np.linspace(problem.start, problem.stop, VALUES)
    grid = values.tolist()
    groups = [grid] if problem.frequency else [[value] for value in grid]
    parts = [columns.of(*solved(group)) for group in groups]
    reasons = np.concatenate([verdicts(*solved(group)).reason for group in groups])
    keeps = np.where(reasons == Reason.OK, 1.0, -1.0)
    for k in np.flatnonzero(reasons == Reason.SINGULAR).tolist():
        keeps[k] = kept(grid[k])
    touches = []
    for k in np.flatnonzero(np.diff(keeps)).tolist():
        value = float(brentq(kept, grid[k], grid[k + 1], xtol=1e-13, rtol=4.0 * EPS))
        error = 1e-12 * abs(grid[k + 1] - grid[k]) + 1e-13 + 16.0 * EPS * abs(value)
        step = grid[k + 1] - grid[k]
        rounding = 4.0 * EPS * (abs(grid[k]) + abs(grid[k + 1])) / abs(step)
        along = (value - grid[k]) / step
        touches.append(Touched(value, error, k, along, error / abs(step) + rounding))
    return values, parts, touches
