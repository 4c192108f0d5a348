"""Attractors of motions that start where others ended, as the points of a continued sweep do.

Each motion goes on from its own end, on the attractor that it has settled on. It ends at the
drive's phase 0, at which the next one begins: the drive goes on without a jump of its phase.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.attractors.planning import plan
from vibroimpact_solvers.attractors.problem import Problem
from vibroimpact_solvers.attractors.solving import Settled, settle
from vibroimpact_solvers.errors import SolverError, attempt
from vibroimpact_solvers.model import System
from vibroimpact_solvers.results.attractors import Result
from vibroimpact_solvers.time_history import on_stops

Outcome = Result | SolverError


@dataclass(frozen=True, eq=False, slots=True)
class End:
    """The ends of motions at the drive's phase 0, each shape (motion, dof).

    A motion that there is not has the state at which it would have begun.
    """

    x: Floats
    v: Floats


def start(system: System, end: End) -> tuple[Floats, Floats]:
    """Return the initial states of motions of a structure that begin at their ends."""
    x, v = end.x.copy(), end.v.copy()
    for values in (x, v):
        values[:, system.massless] = 0.0  # stands for what follows from the others
    return x, v


def going_on(problem: Problem, end: End) -> Problem:
    """Return the problem: its drive begins at the phase at which the last ended."""
    return problem


def motions(problem: Problem) -> int:
    """Return how many times the motions of a point are computed."""
    return 1


def solve_each(
    problems: Sequence[Problem],
    before: Sequence[End | None],
    report: Callable[[], None] | None = None,
) -> Iterator[tuple[Outcome, End | None]]:
    """Yield what the motions of some problems settle on, or why there is nothing, and their ends.

    Parameters
    ----------
    problems : sequence of Problem
    before : sequence of End or None
        The ends from which they go on.
    report : callable, optional
        Called now and then; may raise to stop all.
    """

    def tick(done: int, total: int) -> None:
        if report is not None:
            report()

    for problem in problems:
        outcome = attempt(_settled, problem, tick)
        if isinstance(outcome, SolverError):
            yield outcome, None
            continue
        rigid = () if problem.stopped else problem.system.constraints
        x = on_stops(rigid, outcome.x)
        yield outcome.result, End(x, outcome.v)


def _settled(problem: Problem, tick: Callable[[int, int], None]) -> Settled:
    return settle(problem, plan(problem), tick)
