"""Many motions in parallel: each as it would be alone, in as many threads as there are cores.

The compiled loop follows many motions in one call and releases the GIL for as long; motions with
contacts or soft limiters return to Python on their way, where threads wait for each other. Short
ones of different structures are prepared and concluded there: one thread computes them.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from threading import Event
from typing import Any, TypeVar

import numpy as np
import scipy.sparse

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import Cancelled, ModelError, SolverError, attempt
from vibroimpact_solvers.kernels.threads import cores
from vibroimpact_solvers.meter import Helpers
from vibroimpact_solvers.model import RANGE, Constraint, System
from vibroimpact_solvers.plan import Plan
from vibroimpact_solvers.results.time_history import Result
from vibroimpact_solvers.time_history.planning import plan as plan_of
from vibroimpact_solvers.time_history.planning import windows
from vibroimpact_solvers.time_history.problem import (
    Problem,
    State,
    check_followed,
    walls,
    within,
)
from vibroimpact_solvers.time_history.rigid_motions import Piece
from vibroimpact_solvers.time_history.run import Tick
from vibroimpact_solvers.time_history.solving import prepare
from vibroimpact_solvers.time_history.windows import solve, solve_until

Outcome = Result | SolverError
"""A motion, or why there is none."""

_T = TypeVar("_T")
_FEWEST, _MOST = 16, 512  # motions that a thread takes at a time
_SEARCHED = 4096  # states that are looked at together
_TOGETHER = 16  # limiters that they are compared with together
_SHORT_SECONDS = 0.005  # planned, of motions from which on threads pay
_LOOK_SECONDS = 0.05  # between two calls of the caller's report


def check_states(system: System, x: Floats, v: Floats) -> None:
    """Check initial states of many motions, displacements and velocities of shape (motion, dof).

    Whether each is inside the limits is left to its motion.

    Raises
    ------
    ModelError
    """
    for name, values in (("x", x), ("v", v)):
        if values.ndim != 2 or values.shape[1] != system.n:
            width = values.shape[-1] if values.ndim else 0
            message = f"{width} numbers for {system.n} degrees of freedom"
            raise ModelError(("initial", name), message, code="wrong_length")
        if not np.isfinite(values).all():
            message = "an entry is nan or infinite"
            raise ModelError(("initial", name), message, code="not_finite")
    if x.shape != v.shape or not len(x):
        message = f"{len(v)} velocities for {len(x)} displacements"
        raise ModelError(("initial", "v"), message, code="wrong_length")
    check_followed(system, State(x, v))


@dataclass(frozen=True, slots=True)
class Start:
    """The first of many initial states from which a motion can start."""

    row: int
    inside: bool
    """Whether it is inside the limits; where no state is, the first whose numbers are in range."""


def first_start(
    constraints: Sequence[Constraint],
    x: Floats,
    v: Floats,
    report: Callable[[], None] | None = None,
) -> Start | None:
    """Return the first state from which a motion can start; None where all are out of range.

    Parameters
    ----------
    constraints : sequence of Constraint
        The rigid limiters.
    x, v : array, shape (motion, dof)
    report : callable, optional
        Called between parts of the search; may raise to end it.
    """
    first, groups = None, _groups(constraints, x.shape[1])
    for begin in range(0, len(x), _SEARCHED):
        part = slice(begin, begin + _SEARCHED)
        left = begin + np.flatnonzero(_in_range(x[part]) & _in_range(v[part]))
        if first is None and left.size:
            first = int(left[0])
        columns = np.ascontiguousarray(x[left].T)
        inside = np.ones(left.size, dtype=bool)
        for group in groups:
            if report is not None:
                report()
            if not inside.any():
                break
            for constraint in group.left_by(columns):
                inside &= within(constraint, columns)
        if inside.any():
            return Start(int(left[inside.argmax()]), inside=True)
    return None if first is None else Start(first, inside=False)


@dataclass(frozen=True, eq=False, slots=True)
class _Group:
    """Some limiters, with which states are compared at once."""

    constraints: Sequence[Constraint]
    rows: scipy.sparse.csr_array  # of their coordinates, (constraint, dof)
    low: Floats
    high: Floats

    def left_by(self, columns: Floats) -> Iterator[Constraint]:
        """Yield those that not all displacements, (dof, state), keep without a look at rounding."""
        y = self.rows @ columns
        kept = (y.min(axis=1) >= self.low) & (y.max(axis=1) <= self.high)
        return (self.constraints[place] for place in np.flatnonzero(~kept).tolist())


def _groups(constraints: Sequence[Constraint], n: int) -> list[_Group]:
    groups = []
    for begin in range(0, len(constraints), _TOGETHER):
        some = constraints[begin : begin + _TOGETHER]
        pairs = [(row, *pair) for row, each in enumerate(some) for pair in each.coordinate]
        row, dof, weight = (np.array(part) for part in zip(*pairs, strict=True))
        rows = scipy.sparse.csr_array((weight, (row, dof)), shape=(len(some), n))
        low, high = np.array([walls(each) for each in some]).T
        groups.append(_Group(some, rows, low, high))
    return groups


def refuse_all(motion: Callable[[int], Problem]) -> None:
    """Refuse many states, none of which is in range, by what is wrong with the first.

    Parameters
    ----------
    motion : callable
        Returns the motion from a state, given its place.

    Raises
    ------
    ModelError
    """
    try:
        motion(0)
    except ModelError as error:
        message = f"no state is in range; of the first, {error.message}"
        raise ModelError(error.pointer, message, code=error.code) from None


def _in_range(values: Floats) -> Any:
    """Return whether the largest number of each row is zero or in range."""
    largest = np.abs(values).max(axis=1)
    return (largest == 0.0) | ((largest >= RANGE[0]) & (largest <= RANGE[1]))


def of_mean_speed(pattern: Problem, v: Floats) -> Problem:
    """Return a motion whose impacts, estimated by its speed, are the mean of many.

    Motions whose speeds are out of range are refused when they are computed, each by itself.

    Parameters
    ----------
    pattern : Problem
        One of the motions.
    v : array, shape (motion, dof)
        Initial velocities of all.
    """
    system, start = pattern.system, pattern.initial
    assert isinstance(start, State)
    each = np.abs(v).max(axis=1)
    usable = v[(each > RANGE[0] * system.n) & (each < RANGE[1])]
    speed = float(np.linalg.norm(usable, axis=1).mean()) if usable.size else 0.0
    mean = np.full(system.n, speed / math.sqrt(system.n))
    mean[system.massless] = 0.0  # stands for what follows from the others
    return replace(pattern, initial=State(start.x, mean))


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

    def some(start: int, stop: int, tick: Tick) -> list[Outcome]:
        given = problems[start:stop]
        return [attempt(lambda one=one: solve(one, plan_of(one), tick)) for one in given]

    most = cores() if _pays(problems) else 1
    for outcomes in _in_threads(some, len(problems), report, most=most):
        yield from outcomes


def _pays(problems: Sequence[Problem]) -> bool:
    """Whether motions like the first one are so long that threads pay.

    Short ones are mostly prepared and concluded, by one thread of Python at a time.
    """
    first = attempt(plan_of, problems[0]) if problems else None
    return isinstance(first, Plan) and first.seconds > _SHORT_SECONDS


def solve_states(
    problem: Problem,
    plan: Plan,
    x: Floats,
    v: Floats,
    report: Callable[[], None] | None = None,
    enough: Callable[[Result], bool] | None = None,
) -> Iterator[Piece]:
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
    enough : callable, optional
        Which long motions may end before their time, see `windows.solve_until`.

    Yields
    ------
    Piece
        The motions from some of the states, in their order, each equal to the last bit to that
        of `solve` alone, until its end.
    """
    prepared = prepare(problem, plan)
    long = windows(plan) > 1
    # Of another layout, the loop would be compiled once more.
    x, v = np.ascontiguousarray(x), np.ascontiguousarray(v)

    def one(place: int, tick: Tick) -> Result:
        initial = State(x[place], v[place])
        if long:
            return solve_until(replace(problem, initial=initial), plan, enough, tick)
        return prepared.solve(initial, tick)

    def some(start: int, stop: int, tick: Tick) -> Piece:
        if prepared.rigid is not None and not long:
            return prepared.rigid.solve_some(x, v, start, stop, tick)
        others = {place: attempt(one, place, tick) for place in range(start, stop)}
        return Piece(np.zeros(0, np.int64), {}, others)

    return _in_threads(some, x.shape[0], report, 1 if long else _FEWEST)


def _in_threads(
    some: Callable[[int, int, Tick], _T],
    count: int,
    report: Callable[[], None] | None,
    fewest: int = _FEWEST,
    most: int | None = None,
) -> Iterator[_T]:
    """Yield ``some(0, 1, tick)``, ``some(1, …, tick)``, … to the count; ticks raise `Cancelled`.

    A thread takes `fewest` motions at a time, or more; so many threads at most, absent: as many
    as there are cores.
    """
    stopped = Event()

    def check(done: int, total: int) -> None:
        if stopped.is_set():
            raise Cancelled

    def told(done: int, total: int) -> None:
        if report is not None:
            report()

    def tell() -> None:
        helpers.collect()
        if report is not None:
            report()

    if count == 0:
        return
    # The first one alone: it prepares everything that the others share.
    yield some(0, 1, told)
    threads = max(1, min(most or cores(), count // fewest))
    size = max(fewest, min(_MOST, count // (8 * threads)))
    if threads == 1:
        for begin in range(1, count, size):
            yield some(begin, min(begin + size, count), told)
        return
    starts, helpers = iter(range(1, count, size)), Helpers(check)
    pieces: deque[Future[_T]] = deque()
    try:
        with ThreadPoolExecutor(threads) as pool, _ended(stopped, pieces):
            while True:
                while len(pieces) < 2 * threads and (start := next(starts, None)) is not None:
                    stop = min(start + size, count)
                    pieces.append(pool.submit(helpers.run, some, start, stop, helpers.tick))
                if not pieces:
                    return
                yield _awaited(pieces.popleft(), tell)
    finally:
        helpers.collect()


@contextmanager
def _ended(stopped: Event, pieces: deque[Future[_T]]) -> Iterator[None]:
    """Stop the pieces that are left when this ends."""
    try:
        yield
    finally:
        stopped.set()
        for piece in pieces:
            piece.cancel()


def _awaited(piece: Future[_T], report: Callable[[], None]) -> _T:
    """Wait for a piece, calling `report` meanwhile."""
    while True:
        report()
        try:
            return piece.result(_LOOK_SECONDS)
        except TimeoutError:
            if piece.done():
                raise
