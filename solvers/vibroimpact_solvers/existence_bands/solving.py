"""Solution of existence-band problems by their plans."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vibroimpact_solvers import impact_modes, spectrum
from vibroimpact_solvers.arrays import declared, nothing
from vibroimpact_solvers.existence_bands.certified import CertifiedBands
from vibroimpact_solvers.existence_bands.planning import Method
from vibroimpact_solvers.existence_bands.problem import Problem
from vibroimpact_solvers.existence_bands.ranges import FrequencyRanges
from vibroimpact_solvers.existence_bands.search import (
    SearchedBands,
    by_one_solution,
    poles_near_harmonics,
    poles_of,
)
from vibroimpact_solvers.existence_bands.stability_ranges import stability_ranges
from vibroimpact_solvers.meter import metered
from vibroimpact_solvers.plan import Plan, Stage, Tick
from vibroimpact_solvers.receptance import ExpansionSize
from vibroimpact_solvers.results.existence_bands import Result


@metered
def solve(problem: Problem, plan: Plan, tick: Tick | None = None) -> Result:
    """Compute the bands as the plan says.

    Parameters
    ----------
    problem : Problem
    plan : Plan
        From `plan(problem)`.
    tick : callable, optional
        Called with (done, total); may raise `Cancelled`.
    """
    ranges = _ranges(problem, plan, tick)
    ranges.bands.sort(key=lambda band: band.start)
    ranges.rejected.sort(key=lambda rejected: rejected.start)
    ranges.unresolved.sort()
    columns: dict[str, Any] = nothing(Result)
    columns.update(
        error_complete=ranges.complete and not ranges.unresolved,
        error_resolution=ranges.resolution,
        error_unresolved=_unresolved(problem, ranges),
        error_statement=ranges.statement,
        neglected=problem.neglected or None,
        unresolved_start=np.array([start for start, _ in ranges.unresolved]),
        unresolved_stop=np.array([stop for _, stop in ranges.unresolved]),
    )
    if "bands" in problem.outputs:
        columns.update(_columns(ranges.bands, "bands"))
    if "rejected" in problem.outputs:
        columns.update(_columns(ranges.rejected, "rejected"))
    if plan.step(Stage.STABILITY):
        stable = list(stability_ranges(problem, ranges.bands))
        columns.update(_columns(stable, "stability"))
    return Result(**columns)


def _unresolved(problem: Problem, ranges: FrequencyRanges) -> float:
    """Return the fraction of the range of which nothing is known."""
    undecided = sum(stop - start for start, stop in ranges.unresolved)
    whole = problem.stop - problem.start
    return float(min(1.0, max(0.0, 1.0 - ranges.decided + undecided / whole)))


def _ranges(problem: Problem, plan: Plan, tick: Tick | None) -> FrequencyRanges:
    natural, bands = plan.step(Stage.SPECTRUM), plan.step(Stage.BANDS)
    assert natural is not None
    assert bands is not None
    if isinstance(natural.settings, ExpansionSize):
        poles = np.empty(0)
        if problem.resolution is None:
            poles = poles_near_harmonics(problem, natural.settings, tick)
        return SearchedBands(problem, poles, impact_modes.partial_modes_plan).find(tick)
    modes = spectrum.spectrum(problem.system, spectrum.Method(natural.method))
    if bands.method == Method.ONE_SOLUTION:
        return by_one_solution(problem)
    if bands.method == Method.CERTIFIED:
        return CertifiedBands(problem, modes).find(tick)
    poles = np.empty(0) if problem.resolution is not None else poles_of(problem, modes)
    return SearchedBands(problem, poles).find(tick)


def _columns(rows: Sequence[object], table: str) -> dict[str, Any]:
    """Return the columns of a table; its rows have the names of the paths, ``"table/name"``."""
    return {
        field.name: np.array([_value(row, field.path.split("/")) for row in rows], field.scalar)
        for field in declared(Result).values()
        if field.quantity.dims == (table,)
    }


def _value(row: Any, path: list[str]) -> Any:
    """Return what a row has at a path; both edges of a range may have one error."""
    *inside, _, name = path
    if not inside:
        return getattr(row, name)
    own = f"{name}_error"
    return getattr(row, own if hasattr(row, own) else "edge_error")
