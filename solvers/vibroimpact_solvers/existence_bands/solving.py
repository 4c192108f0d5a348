"""Does what a plan lists."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from vibroimpact_solvers import impact_modes as modes
from vibroimpact_solvers import receptance, spectrum
from vibroimpact_solvers.existence_bands import growth
from vibroimpact_solvers.existence_bands.certified import CertifiedBands
from vibroimpact_solvers.existence_bands.planning import Method
from vibroimpact_solvers.existence_bands.problem import Problem
from vibroimpact_solvers.existence_bands.ranges import Band, Findings, Rejected
from vibroimpact_solvers.existence_bands.result import Result
from vibroimpact_solvers.existence_bands.search import SearchedBands, poles_around, poles_of
from vibroimpact_solvers.plan import Plan, Stage


def solve(problem: Problem, plan: Plan, tick: Callable[[int, int], None] | None = None) -> Result:
    """Find the bands as the plan says.

    Parameters
    ----------
    problem : Problem
    plan : Plan
        The one that `plan(problem)` returned.
    tick : callable, optional
        Called with (done, total); may raise `Cancelled`.
    """
    steps = {step.stage: step for step in plan.steps}
    method = steps[Stage.SPECTRUM].method
    if method == receptance.METHOD:
        poles = poles_around(problem, tick)
        found = SearchedBands(problem, poles, modes.partial_plan).find(tick)
    else:
        natural = spectrum.spectrum(problem.system, spectrum.Method(method))
        if steps[Stage.BANDS].method == Method.CERTIFIED:
            found = CertifiedBands(problem, natural).find(tick)
        else:
            found = SearchedBands(problem, poles_of(problem, natural)).find(tick)
    found.bands.sort(key=lambda band: band.start)
    found.rejected.sort(key=lambda rejected: rejected.start)
    found.unresolved.sort()
    columns: dict[str, Any] = dict.fromkeys(field.name for field in fields(Result))
    columns.update(
        error_resolution=found.resolution,
        error_statement=found.statement,
        unresolved_start=np.array([start for start, _ in found.unresolved]),
        unresolved_stop=np.array([stop for _, stop in found.unresolved]),
    )
    if "bands" in problem.outputs:
        columns.update(_bands(found.bands))
    if "rejected" in problem.outputs:
        columns.update(_rejected(found.rejected))
    if Stage.STABILITY in steps:
        columns.update(_stability(problem, found))
    return Result(**columns)


def join(problem: Problem, plan: Plan, results: Sequence[Result]) -> Result:
    """Return the result of the only piece."""
    (result,) = results
    return result


def _bands(bands: Sequence[Band]) -> dict[str, Any]:
    return {
        "band_start": np.array([band.start for band in bands]),
        "band_stop": np.array([band.stop for band in bands]),
        "band_start_reason": np.array([band.below for band in bands], dtype=np.int64),
        "band_stop_reason": np.array([band.above for band in bands], dtype=np.int64),
        "band_edge_error": np.array([band.error for band in bands]),
        "band_certified": np.array([band.certified for band in bands], dtype=np.bool_),
    }


def _rejected(rejected: Sequence[Rejected]) -> dict[str, Any]:
    return {
        "rejected_start": np.array([each.start for each in rejected]),
        "rejected_stop": np.array([each.stop for each in rejected]),
        "rejected_reason": np.array([each.reason for each in rejected], dtype=np.int64),
        "rejected_certified": np.array([each.certified for each in rejected], dtype=np.bool_),
        "rejected_witness": np.array([each.witness for each in rejected]),
        "rejected_constraint": np.array([each.constraint for each in rejected], dtype=np.int64),
    }


def _stability(problem: Problem, found: Findings) -> dict[str, Any]:
    ranges = list(growth.ranges(problem, found.bands))
    return {
        "stability_start": np.array([each.start for each in ranges]),
        "stability_stop": np.array([each.stop for each in ranges]),
        "stability_stable": np.array([each.stable for each in ranges], dtype=np.bool_),
        "stability_radius": np.array([each.radius for each in ranges]),
    }
