"""Follows all members and puts their results together."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers import time_history
from vibroimpact_solvers.arrays import Integers, Quantity, quantities
from vibroimpact_solvers.ensemble.problem import Problem
from vibroimpact_solvers.ensemble.result import TABLES, Result
from vibroimpact_solvers.errors import ModelError, SolverError
from vibroimpact_solvers.plan import Plan
from vibroimpact_solvers.sweep import MOST_SENTENCES, Status
from vibroimpact_solvers.time_history import Outcome, from_states

Array = NDArray[Any]
Tick = Callable[[int, int], None]

_MEANINGS: Final = quantities(Result)
_AND: Final = "; "
_BATCH: Final = 4096
"""Members whose results are held at a time beside the arrays."""


def solve(problem: Problem, plan: Plan, tick: Tick | None = None) -> Result:
    """Follow every member as the plan says.

    Parameters
    ----------
    problem : Problem
        The ensemble, or a piece of it.
    plan : Plan
        The one that `plan` returned for the whole.
    tick : callable, optional
        Called with (done, total) members; may raise `Cancelled`.
    """
    parts = []
    for start in range(0, problem.size, _BATCH):
        stop = min(start + _BATCH, problem.size)

        def tell(done: int = start) -> None:
            if tick is not None:
                tick(done, problem.size)

        parts.append(_some(problem.piece(start, stop), tell))
    if tick is not None:
        tick(problem.size, problem.size)
    return join(problem, plan, parts)


def join(problem: Problem, plan: Plan, results: Sequence[Result]) -> Result:
    """Put the results of pieces together, in their order."""
    found: dict[str, Any] = {}
    for field in fields(Result):
        values = [getattr(result, field.name) for result in results]
        there = [value for value in values if value is not None]
        meaning = _MEANINGS.get(field.name)
        if meaning is None or not there:
            found[field.name] = there[0] if there else None
        elif meaning.dims[0] in {"time", "dof"}:
            found[field.name] = there[0]
        elif len(there) == len(results):
            found[field.name] = np.concatenate(there)
        else:
            found[field.name] = _padded(values, [r.member.size for r in results], meaning)
    for dim in TABLES:
        if found[f"{dim}_count"] is not None:
            found[f"{dim}_offset"] = _offsets(found[f"{dim}_count"])
    statements = [s for r in results for s in r.error_statement.split(_AND) if s]
    found["error_statement"] = _AND.join(dict.fromkeys(statements))
    sentences = [sentence for r in results for sentence in r.error_failures]
    found["error_failures"] = sentences[:MOST_SENTENCES]
    return Result(**found)


def _some(problem: Problem, tell: Callable[[], None]) -> Result:
    """Follow the members and collect everything."""
    pattern = problem.pattern
    if pattern.system is not problem.system:
        return _collected(problem, [_refusal(problem, index) for index in range(problem.size)])
    # What the plan of the whole decided, it decided as for this one.
    plan = time_history.plan(pattern)
    return _collected(problem, list(from_states(pattern, plan, problem.x, problem.v, tell)))


def _refusal(problem: Problem, index: int) -> SolverError:
    """Return why a member that is outside of the limits has no motion."""
    try:
        problem.member(index)
    except ModelError as error:
        return error
    raise AssertionError("a member without a motion has one")


def _collected(problem: Problem, outcomes: Sequence[Outcome]) -> Result:
    size = problem.size
    wrong = {i: o for i, o in enumerate(outcomes) if isinstance(o, SolverError)}
    motions = {i: o for i, o in enumerate(outcomes) if not isinstance(o, SolverError)}
    found: dict[str, Any] = dict.fromkeys(field.name for field in fields(Result))
    found["member"] = problem.first + np.arange(size)
    found["status"] = np.array(
        [Status.of(wrong[i]) if i in wrong else Status.OK for i in range(size)], dtype=np.int64
    )
    for name, meaning in _MEANINGS.items():
        if found[name] is None and not name.endswith(("_count", "_offset")):
            found[name] = _array(name, meaning, motions, size)
    for dim in TABLES:
        some = f"{dim}_constraint"
        if f"{dim}s" in problem.outputs:
            rows = [getattr(motions[i], some).size if i in motions else 0 for i in range(size)]
            found[f"{dim}_count"] = np.array(rows, dtype=np.int64)
            found[f"{dim}_offset"] = _offsets(found[f"{dim}_count"])
            for name, meaning in _MEANINGS.items():
                if meaning.dims == (dim,) and found[name] is None:
                    whole = name.endswith(("_constraint", "_side"))
                    found[name] = np.zeros(0, np.int64 if whole else np.float64)
    statements = dict.fromkeys(motion.error_statement for motion in motions.values())
    found["error_statement"] = _AND.join(statements)
    found["error_failures"] = [
        f"member {problem.first + i}: {error}" for i, error in wrong.items()
    ][:MOST_SENTENCES]
    given = problem.tolerance
    found["error_tolerance"] = time_history.TOLERANCE if given is None else given
    return Result(**found)


def _array(
    name: str, meaning: Quantity, motions: dict[int, time_history.Result], size: int
) -> Array | None:
    """Return one array of all members, None where none of them has it."""
    values = {i: getattr(motion, name) for i, motion in motions.items()}
    some = next((value for value in values.values() if value is not None), None)
    if meaning.dims[0] == "member":
        counts = name.startswith("count_")
        if some is None and not (counts or name in _ALWAYS):
            return None
        shape = np.shape(some) if some is not None else ()
        whole = np.full((size, *shape), 0 if counts else math.nan)
        for i, value in values.items():
            if value is not None:
                whole[i] = value
        return whole.astype(np.int64) if counts else whole
    if some is None or meaning.coordinate:
        return None if some is None else np.asarray(some)
    return np.concatenate([values[i] for i in sorted(values)])


_ALWAYS: Final = frozenset({"error_condition", "error_penetration", "error_predictable_until"})


def _offsets(counts: Integers) -> Integers:
    return np.asarray(np.cumsum(counts) - counts, dtype=np.int64)


def _padded(values: Sequence[Array | None], sizes: Sequence[int], meaning: Quantity) -> Array:
    """Join arrays of which some pieces have none, all their members being wrong."""
    if meaning.dims[0] != "member":
        return np.concatenate([value for value in values if value is not None])
    own = next(value.shape[1:] for value in values if value is not None)
    parts = [
        np.full((size, *own), math.nan) if value is None else value
        for value, size in zip(values, sizes, strict=True)
    ]
    return np.concatenate(parts)
