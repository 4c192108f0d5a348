"""What results hold beside the motion itself: empty tables, and how far the numbers are known."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.time_history.problem import Problem
from vibroimpact_solvers.time_history.result import empty
from vibroimpact_solvers.time_history.run import hidden_walls

TOLERANCE: Final = 1e-6
"""Meant where none is asked for."""

EPS: Final = float(np.finfo(np.float64).eps)
_STATEMENT = (
    "estimate: roundings of the initial state, flights, frequencies, impacts and walls, carried "
    "along by the linearised motion and its impacts, four times the largest of three samples, "
    "relative to the largest state; between impacts the motion is exact, and no impact can be "
    "missed but for grazings within rounding"
)
UNKNOWN: Final = "none: no estimate was asked for"
"""What is said of errors where nothing is."""


def bare(problem: Problem) -> dict[str, Any]:
    """Return empty tables, and what is known without the motion."""
    found, outputs = _NOTHING.copy(), problem.outputs
    if outputs & {"x", "v", "energy"}:
        found["t"] = problem.times
    if outputs & {"x", "v"}:
        found["dof"] = problem.wanted_dofs
    for table in outputs & {"impacts", "contacts"}:
        found.update(_TABLES[table])
    found["count_impacts"] = found["count_grazings"] = found["count_expansions"] = 0
    found["error_condition"], found["error_penetration"] = 1.0, 0.0
    found["error_predictable_until"] = problem.t_end
    found["error_tolerance"] = TOLERANCE if problem.tolerance is None else problem.tolerance
    found["error_statement"] = ""
    return found


def bare_of_flights(problem: Problem) -> dict[str, Any]:
    """Return `bare` of a motion that is flown, with what is told of errors if nothing is lost."""
    found = bare(problem)
    found["error_statement"] = _STATEMENT if problem.estimate else UNKNOWN
    if not problem.estimate:
        found["error_condition"] = found["error_predictable_until"] = math.nan
    return found


def fill_condition(found: dict[str, Any], largest: float, times: Floats, growth: Floats) -> None:
    """Fill in the largest deviation, and until when the motion is predictable.

    Parameters
    ----------
    found : dict
        Of `bare_of_flights`, with errors estimated.
    largest : float
        The largest deviation.
    times, growth : array, shape (impact,)
        Times of impacts, and deviations there.
    """
    found["error_condition"] = largest
    if not largest * EPS <= found["error_tolerance"]:
        lost = np.flatnonzero(~(growth * EPS <= found["error_tolerance"]))
        if lost.size:
            found["error_predictable_until"] = float(times[lost[0]])


def least_gap(problem: Problem) -> float:
    """Return how near to one another two walls of a coordinate are at least, infinite for one."""
    return min((apart for _, apart in _gaps(problem)), default=math.inf)


def told_apart(problem: Problem, penetration: float) -> float:
    """Return how far rounding lets coordinates through walls, less than these are apart."""
    for index, apart in _gaps(problem):
        if not penetration < apart:
            raise hidden_walls(index, apart, penetration)
    return penetration


def _gaps(problem: Problem) -> list[tuple[int, float]]:
    return [
        (index, constraint.lower + constraint.upper)
        for index, constraint in enumerate(problem.system.constraints)
        if constraint.lower is not None and constraint.upper is not None
    ]


_NOTHING: Final = empty()
_TABLES: Final = {
    table: {
        name: np.zeros(0, np.int64 if name.endswith(("_constraint", "_side")) else np.float64)
        for name in _NOTHING
        if name.startswith(table[:-1] + "_")
    }
    for table in ("impacts", "contacts")
}
