"""Pieces of a problem: cut by frequency, named by their content."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.impact_modes.planning import steps_like
from vibroimpact_solvers.impact_modes.problem import KIND, Problem
from vibroimpact_solvers.plan import OVERHEAD_SECONDS, Plan, Stage

_MANY = 1000  # frequencies among which the cost that all of them share is negligible


def split(problem: Problem, plan: Plan, seconds_each: float) -> list[Problem]:
    """Cut a problem by frequency into pieces of about the given cost, always the same ones.

    Pieces of equally spaced frequencies end at whole multiples of a number of steps from zero,
    so that a longer or shifted grid of the same spacing has the same pieces.
    """
    size = problem.omega.size
    each = max(_seconds_of_one(problem, plan), OVERHEAD_SECONDS * 1e-3)
    points = max(1, int(seconds_each / each))
    first = -grid_index(problem.fundamental) % points
    bounds = [0, *range(first or points, size, points), size]
    return [problem.slice(*pair) for pair in itertools.pairwise(bounds)]


def content(piece: Problem) -> bytes:
    """Return the frequencies of a piece, to the last bit."""
    frequencies = piece.frequencies
    arrays = (frequencies.omega, piece.fundamental, frequencies.rounding)
    return b"".join(array.tobytes() for array in arrays)


def _seconds_of_one(problem: Problem, plan: Plan) -> float:
    """Return the cost of one frequency among many, the same for any grid of frequencies.

    It is the mean of those at half and at twice the largest natural frequency, by the methods of
    the plan: above it displacements may be sums of series.
    """
    ends = np.array([1.0, 4.0]) * spectrum.largest_frequency(problem.system) / np.pi
    many = replace(problem, omega=np.repeat(ends, _MANY // 2), Omega=None, rounding=None)
    steps = (step for step in steps_like(plan, many) if step.stage is not Stage.SPECTRUM)
    return Plan(KIND, tuple(steps)).seconds / _MANY


def grid_index(points: Floats) -> int:
    """Return how many steps the first of equally spaced points lies from zero; else 0."""
    if points.size < 2:
        return 0
    step = float(points[-1] - points[0]) / (points.size - 1)
    if step <= 0.0 or np.abs(np.diff(points) - step).max() > 1e-6 * step:
        return 0
    return round(float(points[0]) / step)
