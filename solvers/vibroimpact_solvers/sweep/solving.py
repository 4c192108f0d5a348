"""Solution of sweeps point by point, the most expensive axis slowest."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import groupby
from typing import Any, Final

from vibroimpact_solvers.arrays import Described
from vibroimpact_solvers.errors import SolverError, attempt
from vibroimpact_solvers.meter import look, metered
from vibroimpact_solvers.plan import Plan, Stage, Tick
from vibroimpact_solvers.sweep import continuing
from vibroimpact_solvers.sweep.kinds import Outcome, SweptKind
from vibroimpact_solvers.sweep.planning import spans
from vibroimpact_solvers.sweep.problem import Index, Problem
from vibroimpact_solvers.sweep.result import Result, assembly_of, result_of

_BATCH: Final = 4096
"""Points whose problems are held at a time; more if they share responses."""


@metered
def solve(problem: Problem, plan: Plan, tick: Tick | None = None) -> Result:
    """Compute every point of the grid, each by the plan that it has alone.

    Parameters
    ----------
    problem : Problem
        The sweep, or a piece of it.
    plan : Plan
        From `plan`, for the whole sweep.
    tick : callable, optional
        Called with (done, total) points; may raise `Cancelled`.
    """
    assembly = assembly_of(problem)
    sizes = zip(problem.axes, problem.shape, strict=True)
    done, total = 0, math.prod(size for axis, size in sizes if axis.stage)

    def report() -> None:
        if tick is not None:
            tick(done, total)

    report()
    outcomes = independent if problem.follow is None else continuing.outcomes
    for index, outcome in outcomes(problem, report):
        assembly.put(index, outcome)
        done += 1
    report()
    return result_of(problem, assembly)


def independent(problem: Problem, report: Callable[[], None]) -> Iterator[tuple[Index, Outcome]]:
    """Yield the result of each point, which needs no other, or the error that it has instead."""
    for batch in _batches(problem):
        points = [_problem(problem, index) for index in batch]
        report()
        yield from zip(batch, _outcomes(problem.swept_kind, points, report), strict=True)
        report()


def join(problem: Problem, plan: Plan, results: Sequence[Described]) -> Result:
    """Join the results of the pieces."""
    assembly = assembly_of(problem)
    shapes = [tuple(part.arrays[axis.name].size for axis in problem.axes) for part in results]
    for part, ranges in zip(results, spans(problem, shapes), strict=True):
        place = tuple(
            slice(start - first, stop - first)
            for (first, _), (start, stop) in zip(problem.spans, ranges, strict=True)
        )
        plain = part.plain
        assembly.neglect(plain.get("neglected"))
        assembly.put_piece(place, part.arrays, plain["error/statement"], plain["error/failures"])
    return result_of(problem, assembly)


def _problem(problem: Problem, index: Index) -> Any:
    """Return the problem of a point, or its error: thousands take a second."""
    look()
    return attempt(problem.problem, index)


def _batches(problem: Problem) -> Iterator[list[Index]]:
    """Yield points with the same natural modes; those that share responses stay together."""
    for _, same_modes in groupby(problem.points(), problem.positions(Stage.SPECTRUM)):
        batch: list[Index] = []
        for _, same_responses in groupby(same_modes, problem.positions(Stage.RESPONSE)):
            batch += same_responses
            if len(batch) >= _BATCH:
                yield batch
                batch = []
        yield batch


def _outcomes(
    kind: SweptKind, points: Sequence[Any], report: Callable[[], None]
) -> Iterator[Outcome]:
    """Yield the result of each point, or the error that it has instead."""
    possible = [point for point in points if not isinstance(point, SolverError)]
    if kind.solve_many is not None:
        outcomes: Iterator[Outcome] = iter(kind.solve_many(possible, report))
    else:
        outcomes = (attempt(_alone, kind, point, report) for point in possible)
    for point in points:
        yield point if isinstance(point, SolverError) else next(outcomes)


def _alone(kind: SweptKind, point: Any, report: Callable[[], None]) -> Any:
    return kind.solver.solve(point, kind.solver.plan(point), lambda *_: report())
