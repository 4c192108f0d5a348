"""Values of a result besides the motion itself: empty tables and estimated errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from operator import itemgetter
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import along, declared, nothing
from vibroimpact_solvers.errors import Status
from vibroimpact_solvers.kernels.rigid_state import PROGRESS, Rows
from vibroimpact_solvers.results.time_history import OF_STOPS, Result
from vibroimpact_solvers.time_history.contact_errors import masked
from vibroimpact_solvers.time_history.history import History, requested
from vibroimpact_solvers.time_history.problem import MOVED, SAMPLED, Problem, tolerance_of
from vibroimpact_solvers.time_history.run import ContactInterval, indistinguishable_walls
from vibroimpact_solvers.time_history.stated_errors import OF_IMPACTS, StatedErrors
from vibroimpact_solvers.time_history.structure import Structure

EPS: Final = float(np.finfo(np.float64).eps)
_STATEMENT = (
    "estimate: roundings of the initial state, the free motion, frequencies, impacts and walls, "
    "carried along by the linearised motion and its impacts, three times the largest of five "
    "samples, relative to the largest state in condition, absolute and infinite from "
    "predictable_until on in each output; between impacts the motion is exact, and no impact is "
    "missed; grazings and orders of coupled impacts that errors decide are part of the errors, and "
    "the time of an impact that they might leave out is unknown"
)
UNKNOWN: Final = "none: no estimate was asked for"
"""Error statement where errors are not estimated."""


def default_values(problem: Problem) -> dict[str, Any]:
    """Return empty tables, and all values that do not depend on the motion."""
    values, outputs = _NOTHING.copy(), problem.outputs
    if outputs & SAMPLED:
        values["t"] = problem.times
    if outputs & {*MOVED}:
        values["dof"] = problem.output_dofs
    for table in outputs & {"impacts", "contacts"}:
        values.update(_TABLES[table])
    if not problem.estimate:
        values.update(dict.fromkeys((*OF_IMPACTS, *OF_CONTACTS)))
    values["count_impacts"] = values["count_grazings"] = values["count_expansions"] = 0
    values["error_condition"], values["error_penetration"] = 1.0, 0.0
    values["error_predictable_until"] = problem.t_end
    values["error_tolerance"] = tolerance_of(problem)
    values["error_statement"] = ""
    values["neglected"] = problem.neglected or None
    return values


def values_of_exact_motion(problem: Problem) -> dict[str, Any]:
    """Return `default_values` with the error statement of motions exact between impacts."""
    values = default_values(problem)
    values["error_statement"] = _STATEMENT if problem.estimate else UNKNOWN
    if not problem.estimate:
        values["error_condition"] = values["error_predictable_until"] = math.nan
    return values


def result_of(
    values: dict[str, Any],
    problem: Problem,
    structure: Structure,
    progress: np.void,
    impacts: Rows,
    history: History,
    errors: StatedErrors,
    intervals: Sequence[ContactInterval] = (),
) -> Result:
    """Return the result of a motion with rigid limiters that reached its end.

    Parameters
    ----------
    values : dict
        `values_of_exact_motion`, which become those of the result.
    problem : Problem
    structure : Structure
    progress, impacts : array
        See `kernels.rigid_state`.
    history : tuple
    errors : StatedErrors
        Of the configurations that the motion has been in.
    intervals : sequence of ContactInterval
    """
    penetration, growth, known_until, grazings, expansions, largest = _numbers(progress.item())
    for name, value in requested(problem, history).items():
        values[name] = value[0]
    if problem.estimate:
        state = np.array([largest]), np.array([known_until])
        for name, value in errors.history(history[-1], history[2], *state).items():
            values[name] = value[0]
    if "impacts" in problem.outputs:
        for name, column in _COLUMNS.items():
            values[name] = impacts[column].copy()
        if problem.estimate:
            gap = np.array([penetration])
            values.update(errors.impacts(impacts, np.array([impacts.size]), *state, gap))
    if intervals and "contacts" in problem.outputs:
        scale = structure.scale
        values.update(
            contact_start=np.array([r.start for r in intervals]) / scale,
            contact_rest=np.array([r.rest for r in intervals]) / scale,
            contact_stop=np.array([r.stop for r in intervals]) / scale,
            contact_constraint=np.array([r.contact[0] for r in intervals], dtype=np.int64),
            contact_side=np.array([r.contact[1] for r in intervals], dtype=np.int64),
            contact_impulse=np.array([r.impulse for r in intervals]) / scale,
        )
        if problem.estimate:
            of = {
                name: np.array([getattr(r, f"{name}_error") for r in intervals])
                for name in ("start", "rest", "stop", "impulse")
            }
            latest = values["contact_stop"] + of["stop"]
            ends = {"start": values["contact_start"], "rest": values["contact_rest"]}
            for name, each in of.items():
                values[f"error_contact_{name}"] = masked(ends.get(name, latest), each, known_until)
    values["count_impacts"] = impacts.size
    values["count_grazings"], values["count_expansions"] = grazings, expansions
    if not penetration < structure.narrowest_gap:
        checked_penetration(problem, penetration)
    values["error_penetration"] = penetration
    if problem.estimate:
        values["error_condition"] = growth
        if known_until < math.inf:
            values["error_predictable_until"] = known_until
    return Result(**values)


def arrays_of(
    values: dict[str, Any],
    problem: Problem,
    progress: Rows,
    impacts: Rows,
    history: History,
    errors: StatedErrors,
) -> dict[str, Any]:
    """Return the values of many motions that reached their ends, as `results.ensemble` has them.

    Parameters are those of `result_of`, with rows of the progress and of the history for all.
    """
    outputs, size = problem.outputs, progress.size
    state = progress["largest"], progress["known_until"]
    arrays = {name: values[name] for name in ("t", "dof", "error_statement")}
    arrays |= requested(problem, history) | {"status": np.full(size, Status.OK)}
    if "impacts" in outputs:
        arrays |= {name: impacts[column] for name, column in _COLUMNS.items()}
        counts = arrays["impact_count"] = progress["rows"] - progress["first_row"]
        if problem.estimate:
            arrays |= errors.impacts(impacts, counts, *state, progress["penetration"])
    if "contacts" in outputs:
        arrays |= {name: values[name] for name in _TABLES["contacts"]}
        arrays["contact_count"] = np.zeros(size, dtype=np.int64)
    for name in ("error_condition", "error_predictable_until"):
        arrays[name] = np.full(size, values[name])
    if problem.estimate:
        arrays |= errors.history(history[-1], history[2], *state)
        known = progress["known_until"]
        arrays["error_condition"] = progress["growth"]
        arrays["error_predictable_until"] = np.where(known < math.inf, known, problem.t_end)
    arrays["count_impacts"] = progress["rows"] - progress["first_row"]
    arrays["count_grazings"] = progress["grazings"]
    arrays["count_expansions"] = progress["expansions"]
    arrays["error_penetration"] = progress["penetration"]
    return arrays


def checked_penetration(problem: Problem, penetration: float) -> None:
    """Refuse a penetration of walls by rounding that is not smaller than their distance."""
    for index, constraint in enumerate(problem.system.constraints):
        apart = (constraint.lower or 0.0) + (constraint.upper or 0.0)
        if None not in (constraint.lower, constraint.upper) and not penetration < apart:
            raise indistinguishable_walls(index, apart, penetration)


_NOTHING: Final = nothing(Result)
_TABLES: Final = {
    f"{dim}s": {
        name: np.zeros(0, declared(Result)[name].scalar)
        for name in along(Result, dim)
        if not name.endswith(OF_STOPS) and not name.startswith("derivative")
    }
    for dim in ("impact", "contact")
}
"""Empty tables of motions with rigid stops, without derivatives."""
_COLUMNS: Final = {
    "impact_time": "time",
    "impact_constraint": "constraint",
    "impact_side": "side",
    "impact_velocity": "velocity",
    "impact_impulse": "impulse",
    "impact_condition": "deviation",
    "impact_law": "law",
}
"""Fields of the result, and columns of the table of impacts."""
OF_CONTACTS: Final = tuple(f"error_contact_{name}" for name in ("start", "rest", "stop", "impulse"))
_NAMES: Final[tuple[str, ...]] = PROGRESS.names or ()
_numbers: Final = itemgetter(
    *map(
        _NAMES.index,
        ("penetration", "growth", "known_until", "grazings", "expansions", "largest"),
    )
)
