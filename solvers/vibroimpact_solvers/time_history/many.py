"""Many motions in parallel: each as it would be alone, in as many threads as there are cores.

The compiled loops release the GIL, the Python code around them does not: threads pay where the
loops last long compared with it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from threading import Event

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import Cancelled, SolverError
from vibroimpact_solvers.kernels.threads import cores
from vibroimpact_solvers.plan import Plan
from vibroimpact_solvers.results.time_history import Result
from vibroimpact_solvers.time_history.planning import plan as plan_of
from vibroimpact_solvers.time_history.planning import windows
from vibroimpact_solvers.time_history.problem import Problem, State
from vibroimpact_solvers.time_history.run import Tick
from vibroimpact_solvers.time_history.solving import prepare
from vibroimpact_solvers.time_history.windows import solve

Outcome = Result | SolverError
"""A motion, or why there is none."""

_PIECE = 16  # motions that a thread takes at a time
_LOOK_SECONDS = 0.05  # between two calls of the caller's report


def solve_many(
    problems: Sequence[Problem], report: Callable[[], None] | None = None
) -> Iterator[Outcome]:
    """Solve many problems; errors of some do not affect the others.

    Parameters
    ----------
    problems : sequence of Problem
    report : callable, optional
        Called now and then from the calling thread; may raise to stop all.

    Yields
    ------
    Result or SolverError
        The result of each in their order, equal to the last bit to that of `solve` alone, or
        its error. Few of them are in memory at a time.
    """

    def one(place: int, tick: Tick) -> Result:
        return solve(problems[place], plan_of(problems[place]), tick)

    return in_threads(one, len(problems), report)


def solve_states(
    problem: Problem, plan: Plan, x: Floats, v: Floats, report: Callable[[], None] | None = None
) -> Iterator[Outcome]:
    """Compute the motion of a problem from many initial states.

    Parameters
    ----------
    problem : Problem
        With any initial state.
    plan : Plan
        Its plan.
    x, v : array, shape (member, dof)
    report : callable, optional
        As of `solve_many`.

    Yields
    ------
    Result or SolverError
        As `solve_many` does.
    """
    prepared = prepare(problem, plan)
    long = windows(plan) > 1

    def one(place: int, tick: Tick) -> Result:
        initial = State(x[place], v[place])
        if long:
            return solve(replace(problem, initial=initial), plan, tick)
        return prepared.solve(initial, tick)

    return in_threads(one, x.shape[0], report)


def in_threads(
    one: Callable[[int, Tick], Result], count: int, report: Callable[[], None] | None
) -> Iterator[Outcome]:
    """Yield ``one(0, tick)``, ``one(1, tick)``, … or their errors; ticks raise `Cancelled`."""
    stopped = Event()

    def check(done: int, total: int) -> None:
        if stopped.is_set():
            raise Cancelled

    def safely(place: int) -> Outcome:
        try:
            return one(place, check)
        except Cancelled:
            raise
        except SolverError as error:
            return error

    def some(start: int) -> list[Outcome]:
        return [safely(place) for place in range(start, min(start + _PIECE, count))]

    if count == 0:
        return
    # The first one alone: it prepares everything that the others share.
    yield safely(0)
    threads = max(1, min(cores(), count // _PIECE))
    starts = iter(range(1, count, _PIECE))
    with ThreadPoolExecutor(threads) as pool:
        free: deque[Future[list[Outcome]]] = deque()
        try:
            while True:
                while len(free) < 2 * threads and (start := next(starts, None)) is not None:
                    free.append(pool.submit(some, start))
                if not free:
                    return
                yield from _awaited(free.popleft(), report)
        finally:
            stopped.set()
            for piece in free:
                piece.cancel()


def _awaited(piece: Future[list[Outcome]], report: Callable[[], None] | None) -> list[Outcome]:
    """Wait for a piece, calling `report` meanwhile."""
    while True:
        if report is not None:
            report()
        try:
            return piece.result(_LOOK_SECONDS)
        except TimeoutError:
            if piece.done():
                raise
