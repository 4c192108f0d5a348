"""Computes all members of an ensemble and collects their results in arrays."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Final

import numpy as np

from vibroimpact_solvers import time_history
from vibroimpact_solvers.arrays import along, declared
from vibroimpact_solvers.assembly import Assembly
from vibroimpact_solvers.ensemble.problem import Problem
from vibroimpact_solvers.errors import Status, attempt
from vibroimpact_solvers.meter import metered
from vibroimpact_solvers.plan import Plan, Tick
from vibroimpact_solvers.results.ensemble import Result
from vibroimpact_solvers.time_history import Piece, solve_states

_FIELDS: Final = declared(Result)
_NUMBERS: Final = tuple(
    name
    for name in declared(time_history.Result)
    if name in _FIELDS and _FIELDS[name].array and not _FIELDS[name].optional
)
"""Arrays of the numbers that every motion has."""
_TABLES: Final = ("impact", "contact")
_ERRORS: Final = 256  # members without motion that are looked at together


@metered
def solve(problem: Problem, plan: Plan, tick: Tick | None = None) -> Result:
    """Compute every member as the plan says.

    Parameters
    ----------
    problem : Problem
        The ensemble, or a piece of it.
    plan : Plan
        The one that `plan` returned for the whole.
    tick : callable, optional
        Called with (done, total) members; may raise `Cancelled`.
    """
    assembly = _assembly(problem)

    def report(done: int = 0) -> None:
        if tick is not None:
            tick(done, problem.size)

    for piece in _pieces(problem, report):
        if piece.places.size:
            statement = piece.arrays["error_statement"]
            assembly.put_piece((piece.places,), piece.arrays, statement, ())
        assembly.put_many(list(piece.others), list(piece.others.values()))
    report(problem.size)
    return _result(problem, assembly)


def join(problem: Problem, plan: Plan, results: Sequence[Result]) -> Result:
    """Join the results of pieces, in their order."""
    assembly, start = _assembly(problem), 0
    for result in results:
        stop = start + result.member.size
        place = (slice(start, stop),)
        assembly.put_piece(place, vars(result), result.error_statement, result.error_failures)
        start = stop
    return _result(problem, assembly)


def _assembly(problem: Problem) -> Assembly:
    def label(index: tuple[int, ...]) -> str:
        return f"member {problem.first + index[0]}"

    return Assembly(time_history.Result, (problem.size,), label, _TABLES)


def _pieces(problem: Problem, report: Callable[[], None]) -> Iterable[Piece]:
    """Compute the members; return their motions, or their errors."""
    if not problem.moves:
        return _errors(problem, report)
    pattern = problem.pattern
    # The methods are those of the whole ensemble. The windows of time depend on these members
    # alone, so that ensembles which have a piece in common share its numbers.
    return solve_states(pattern, time_history.plan(pattern), problem.x, problem.v, report)


def _errors(problem: Problem, report: Callable[[], None]) -> Iterator[Piece]:
    """Return why no member moves, few of them at a time."""
    for start in range(0, problem.size, _ERRORS):
        report()
        rows = range(start, min(start + _ERRORS, problem.size))
        errors = {index: attempt(problem.member, index) for index in rows}
        yield Piece(np.zeros(0, np.int64), {}, errors)


def _result(problem: Problem, assembly: Assembly) -> Result:
    arrays, failed = assembly.arrays(), assembly.status != Status.OK
    values: dict[str, Any] = {name: arrays.get(name) for name in _FIELDS}
    if failed.all():
        values |= _without_motions(problem)
    for name in _NUMBERS:
        if _FIELDS[name].scalar is int:
            values[name][failed] = 0
    given = problem.tolerance
    values |= {
        "member": problem.first + np.arange(problem.size),
        "error_tolerance": time_history.TOLERANCE if given is None else given,
        "error_statement": assembly.statement,
        "error_failures": assembly.failures,
        "neglected": problem.neglected or None,
    }
    return Result(**values)


def _without_motions(problem: Problem) -> dict[str, Any]:
    """Return the arrays that an ensemble has even where no member has a motion."""
    values: dict[str, Any] = {
        name: np.full(problem.size, 0 if _FIELDS[name].scalar is int else math.nan)
        for name in _NUMBERS
    }
    for dim in _TABLES:
        if f"{dim}s" in problem.outputs:
            values |= {
                name: np.zeros(0, _FIELDS[name].scalar)
                for name in along(Result, dim)
                if not _FIELDS[name].quantity.sometimes or problem.stopped
            }
            for name in (f"{dim}_count", f"{dim}_offset"):
                values[name] = np.zeros(problem.size, dtype=np.int64)
    return values
