"""Goes through the lattice, the dearest axis slowest, and puts the results together."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final

from vibroimpact_solvers.arrays import Described
from vibroimpact_solvers.errors import Cancelled, SolverError
from vibroimpact_solvers.plan import Plan, Stage
from vibroimpact_solvers.sweep import result
from vibroimpact_solvers.sweep.planning import spans
from vibroimpact_solvers.sweep.problem import Index, Problem
from vibroimpact_solvers.sweep.result import Assembly, Result
from vibroimpact_solvers.sweep.stages import Outcome

Tick = Callable[[int, int], None]

_BATCH: Final = 4096
"""Points whose problems are held at a time; more where they share their responses."""


def solve(problem: Problem, plan: Plan, tick: Tick | None = None) -> Result:
    """Compute every point of the lattice, each by the plan that it would have alone.

    Parameters
    ----------
    problem : Problem
        The lattice, or a piece of it.
    plan : Plan
        The one that `plan` returned for the whole.
    tick : callable, optional
        Called with (done, total) points; may raise `Cancelled`.
    """
    walk = _Walk(problem, tick)
    for slow in problem.points(upto=Stage.SPECTRUM):
        for middle in problem.points(upto=Stage.RESPONSE, above=Stage.SPECTRUM):
            for fast in problem.points(above=Stage.RESPONSE):
                walk.take(tuple(map(sum, zip(slow, middle, fast, strict=True))))
            if len(walk.batch) >= _BATCH:
                walk.solve()
        walk.solve()
    return walk.assembly.result()


def join(problem: Problem, plan: Plan, results: Sequence[Described]) -> Result:
    """Put the results of the pieces together."""
    places = spans(problem, [_shape(problem, part) for part in results])
    pieces = [problem.piece(place) for place in places]
    return result.join(problem, list(zip(pieces, results, strict=True)))


def _shape(problem: Problem, part: Described) -> Index:
    return tuple(part.arrays[axis.name].size for axis in problem.axes)


class _Walk:
    """The points that are to be solved next, and what was found before."""

    def __init__(self, problem: Problem, tick: Tick | None) -> None:
        self.assembly = Assembly(problem)
        self.batch: list[tuple[Index, Any]] = []
        self._problem, self._swept, self._tick = problem, problem.swept, tick
        self._done, self._total = 0, sum(1 for _ in problem.points())

    def take(self, index: Index) -> None:
        """Put a point into the batch, with its problem or the reason why there is none."""
        try:
            self.batch.append((index, self._problem.problem(index)))
        except SolverError as error:
            self.batch.append((index, error))

    def solve(self) -> None:
        """Solve the batch."""
        batch, self.batch = self.batch, []
        self._tell()
        possible = [problem for _, problem in batch if not isinstance(problem, SolverError)]
        if self._swept.together is not None:
            found: Iterator[Outcome] = iter(self._swept.together(possible, self._tell))
        else:
            found = map(self._alone, possible)
        for index, problem in batch:
            outcome = problem if isinstance(problem, SolverError) else next(found)
            self.assembly.put(index, outcome)
            self._done += 1
        self._tell()

    def _alone(self, problem: Any) -> Outcome:
        solver = self._swept.solver
        try:
            return solver.solve(problem, solver.plan(problem), lambda *_: self._tell())
        except Cancelled:
            raise
        except SolverError as error:
            return error

    def _tell(self) -> None:
        if self._tick is not None:
            self._tick(self._done, self._total)
