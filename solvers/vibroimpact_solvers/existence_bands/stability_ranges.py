"""Ranges of stability inside existence bands."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers import impact_modes as modes
from vibroimpact_solvers.arrays import Booleans, Floats
from vibroimpact_solvers.existence_bands.problem import Problem
from vibroimpact_solvers.existence_bands.ranges import Band

_UNBOUNDED: Final = 1e-6
"""What stands for errors that are not bounded: multipliers that meet on the unit circle have errors
of the square root of rounding."""

_POINTS = 33  # in each band
_STEPS = 24  # bisections where stability changes


@dataclass(frozen=True, slots=True)
class StabilityRange:
    """A range in which deviations from no evaluated impact mode grow, or from all."""

    # Edges, as Omega
    start: float
    stop: float
    stable: bool
    radius: float  # largest spectral radius of their half-period maps
    # Errors of the edges and of the radius
    start_error: float
    stop_error: float
    radius_error: float


def stability_ranges(problem: Problem, bands: Sequence[Band]) -> Iterator[StabilityRange]:
    """Yield ranges of stability inside the bands, ascending."""
    for band in bands:
        yield from _inside(problem, band)


def _inside(problem: Problem, band: Band) -> Iterator[StabilityRange]:
    # Impact modes at the edges graze: denser towards them, but not on them.
    share = 0.5 - 0.5 * np.cos(np.pi * (np.arange(_POINTS) + 0.5) / _POINTS)
    Omega = band.start + (band.stop - band.start) * share
    radius, error = _radii(problem, Omega)
    known = ~np.isnan(radius)
    Omega, radius, error = Omega[known], radius[known], error[known]
    if not Omega.size:
        return
    stable = ~grows(radius, error)
    changes = np.flatnonzero(stable[1:] != stable[:-1])
    low, high = Omega[changes].copy(), Omega[changes + 1].copy()
    for _ in range(_STEPS if changes.size else 0):
        middle = 0.5 * (low + high)
        below = ~grows(*_radii(problem, middle)) == stable[changes]
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    edges = np.concatenate([[band.start], 0.5 * (low + high), [band.stop]])
    off = np.concatenate([[band.edge_error], 0.5 * (high - low), [band.edge_error]])
    firsts = np.concatenate([[0], changes + 1, [Omega.size]])
    for k in range(firsts.size - 1):
        some = slice(firsts[k], firsts[k + 1])
        yield StabilityRange(
            float(edges[k]), float(edges[k + 1]), bool(stable[firsts[k]]),
            float(radius[some].max()), float(off[k]), float(off[k + 1]), float(error[some].max()),
        )  # fmt: skip


def grows(radius: Floats, error: Floats) -> Booleans:
    """Whether radii are larger than 1 by more than their errors; so they are where unknown."""
    bounded = np.where(np.isfinite(error), error, _UNBOUNDED)
    return np.asarray(~(radius - 1.0 <= bounded))


def _radii(problem: Problem, Omega: Floats) -> tuple[Floats, Floats]:
    """Return spectral radii and their errors."""
    solutions = problem.impact_modes_at(Omega, frozenset({"stability"}))
    result = modes.solve(solutions, modes.plan_in_doubles(solutions))
    assert result.stability is not None
    assert result.stability_error is not None
    return result.stability, result.stability_error
