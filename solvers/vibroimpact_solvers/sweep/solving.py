"""Solution of sweeps point by point, the most expensive axis slowest."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any, Final

from vibroimpact_solvers.arrays import Described
from vibroimpact_solvers.errors import SolverError, attempt
from vibroimpact_solvers.plan import Plan, Stage, Tick
from vibroimpact_solvers.sweep import result
from vibroimpact_solvers.sweep.kinds import Outcome
from vibroimpact_solvers.sweep.planning import spans
from vibroimpact_solvers.sweep.problem import Index, Problem
from vibroimpact_solvers.sweep.result import Result, assembly_of, result_of

_BATCH: Final = 4096
"""Points whose problems are held at a time; more if they share responses."""


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
    batches = _Batches(problem, tick)
    for _, same_modes in groupby(problem.points(), problem.positions(Stage.SPECTRUM)):
        for _, same_responses in groupby(same_modes, problem.positions(Stage.RESPONSE)):
            for index in same_responses:
                batches.take(index)
            if len(batches.batch) >= _BATCH:
                batches.solve()
        batches.solve()
    return result_of(problem, batches.assembly)


def join(problem: Problem, plan: Plan, results: Sequence[Described]) -> Result:
    """Join the results of the pieces."""
    places = spans(problem, [_shape(problem, part) for part in results])
    pieces = [problem.piece(place) for place in places]
    return result.join(problem, list(zip(pieces, results, strict=True)))


def _shape(problem: Problem, part: Described) -> Index:
    return tuple(part.arrays[axis.name].size for axis in problem.axes)


class _Batches:
    """The points to be solved next, and the results of those before."""

    def __init__(self, problem: Problem, tick: Tick | None) -> None:
        self.assembly = assembly_of(problem)
        self.batch: list[tuple[Index, Any]] = []
        self._problem, self._kind, self._tick = problem, problem.swept_kind, tick
        self._done, self._total = 0, sum(1 for _ in problem.points())

    def take(self, index: Index) -> None:
        """Add a point to the batch, with its problem or the error that it has instead."""
        self.batch.append((index, attempt(self._problem.problem, index)))

    def solve(self) -> None:
        """Solve the batch."""
        batch, self.batch = self.batch, []
        self._report()
        possible = [problem for _, problem in batch if not isinstance(problem, SolverError)]
        if self._kind.solve_many is not None:
            outcomes: Iterator[Outcome] = iter(self._kind.solve_many(possible, self._report))
        else:
            outcomes = (attempt(self._alone, problem) for problem in possible)
        for index, problem in batch:
            outcome = problem if isinstance(problem, SolverError) else next(outcomes)
            self.assembly.put(index, outcome)
            self._done += 1
        self._report()

    def _alone(self, problem: Any) -> Any:
        solver = self._kind.solver
        return solver.solve(problem, solver.plan(problem), lambda *_: self._report())

    def _report(self) -> None:
        if self._tick is not None:
            self._tick(self._done, self._total)
