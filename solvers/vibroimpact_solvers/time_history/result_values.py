"""Values of a result besides the motion itself: empty tables and estimated errors."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import Floats, along, declared, nothing
from vibroimpact_solvers.results.time_history import Result
from vibroimpact_solvers.time_history.problem import Problem
from vibroimpact_solvers.time_history.run import indistinguishable_walls

TOLERANCE: Final = 1e-6
"""Tolerance where the problem names none."""

EPS: Final = float(np.finfo(np.float64).eps)
_STATEMENT = (
    "estimate: roundings of the initial state, the free motion, frequencies, impacts and walls, "
    "carried along by the linearised motion and its impacts, four times the largest of three "
    "samples, relative to the largest state; between impacts the motion is exact, and no impact "
    "can be missed but for grazings within rounding"
)
UNKNOWN: Final = "none: no estimate was asked for"
"""Error statement where errors are not estimated."""


def default_values(problem: Problem) -> dict[str, Any]:
    """Return empty tables, and all values that do not depend on the motion."""
    values, outputs = _NOTHING.copy(), problem.outputs
    if outputs & {"x", "v", "energy"}:
        values["t"] = problem.times
    if outputs & {"x", "v"}:
        values["dof"] = problem.output_dofs
    for table in outputs & {"impacts", "contacts"}:
        values.update(_TABLES[table])
    values["count_impacts"] = values["count_grazings"] = values["count_expansions"] = 0
    values["error_condition"], values["error_penetration"] = 1.0, 0.0
    values["error_predictable_until"] = problem.t_end
    values["error_tolerance"] = TOLERANCE if problem.tolerance is None else problem.tolerance
    values["error_statement"] = ""
    return values


def values_of_exact_motion(problem: Problem) -> dict[str, Any]:
    """Return `default_values` with the error statement of motions exact between impacts."""
    values = default_values(problem)
    values["error_statement"] = _STATEMENT if problem.estimate else UNKNOWN
    if not problem.estimate:
        values["error_condition"] = values["error_predictable_until"] = math.nan
    return values


def set_condition(values: dict[str, Any], largest: float, times: Floats, growth: Floats) -> None:
    """Fill in the largest deviation, and the time until which the motion is predictable.

    Parameters
    ----------
    values : dict
        As of `values_of_exact_motion`, with errors estimated.
    largest : float
        The largest deviation.
    times, growth : array, shape (impact,)
        Times of impacts, and deviations there.
    """
    values["error_condition"] = largest
    if not largest * EPS <= values["error_tolerance"]:
        lost = np.flatnonzero(~(growth * EPS <= values["error_tolerance"]))
        if lost.size:
            values["error_predictable_until"] = float(times[lost[0]])


def narrowest_gap(problem: Problem) -> float:
    """Return the smallest distance between the two walls of a coordinate, infinite for one wall."""
    return min((apart for _, apart in _gaps(problem)), default=math.inf)


def checked_penetration(problem: Problem, penetration: float) -> float:
    """Return the penetration of walls by rounding, which must be smaller than their distance."""
    for index, apart in _gaps(problem):
        if not penetration < apart:
            raise indistinguishable_walls(index, apart, penetration)
    return penetration


def _gaps(problem: Problem) -> list[tuple[int, float]]:
    return [
        (index, constraint.lower + constraint.upper)
        for index, constraint in enumerate(problem.system.constraints)
        if constraint.lower is not None and constraint.upper is not None
    ]


_NOTHING: Final = nothing(Result)
_TABLES: Final = {
    f"{dim}s": {name: np.zeros(0, declared(Result)[name].scalar) for name in along(Result, dim)}
    for dim in ("impact", "contact")
}
