"""The meter of a computation, which every loop looks at.

A caller gives a tick, such as a `StopSignal`, which may raise an error to stop the computation:
when it was cancelled, or passed its limits of time and memory. Loops deep inside a computation look
at it by `look`, without being handed it, and tell it by `hold` of rows that grow beyond what a plan
knows. Threads that help a computation have `Helpers`, so that their time and memory are counted as
its own.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import Any, ClassVar, Final, TypeVar

from vibroimpact_solvers.plan import Plan, Tick

_Problem = TypeVar("_Problem")
_Result = TypeVar("_Result")

_SECONDS: Final = 0.004  # between two looks: loops may look as often as they like
_COPIES: Final = 4
"""How often rows are in memory while columns and results are made of them."""
_CANCELLED_SECONDS: Final = 0.05
"""Between two questions whether a computation was cancelled."""
_here = threading.local()
_METER: ContextVar[Meter | None] = ContextVar("meter", default=None)


class Meter:
    """A tick that can be looked at without having got on.

    Parameters
    ----------
    tick : callable
    held : Held, optional
        What the computation holds of which this is a part; absent: nothing yet.
    """

    def __init__(self, tick: Tick, held: Held | None = None) -> None:
        self._tick, self._place, self._looked = tick, (0, 1), time.monotonic()
        self.held = held or Held()

    def __call__(self, done: int, total: int) -> None:
        """Report progress."""
        self._place, self._looked = (done, total), time.monotonic()
        self._tick(done, total)

    def look(self) -> None:
        """Call the tick with the last progress, unless that was just now."""
        now = time.monotonic()
        if now - self._looked >= _SECONDS:
            self._looked = now
            self._tick(*self._place)


class Held:
    """Memory of the rows that a computation holds, in whichever of its threads."""

    most: ClassVar[int] = 2**30
    """Bytes of rows that a computation of this process may hold."""

    def __init__(self) -> None:
        self.nbytes = 0
        self._lock = threading.Lock()

    def add(self, nbytes: int) -> None:
        """Count some more; raise `MemoryError` where they are too many."""
        with self._lock:
            self.nbytes += nbytes
        if self.nbytes > self.most:
            message = f"its events take {self.nbytes:.3g} bytes, more than {self.most:.3g}"
            raise MemoryError(message)


class Helpers:
    """What threads that help a computation need: its stop signal, and an account of their time.

    Parameters
    ----------
    tick : callable
        Theirs; raises `Cancelled` where the computation stops.
    """

    def __init__(self, tick: Tick) -> None:
        self._tick, self._last = tick, threading.local()
        outer = _METER.get()
        self._held = None if outer is None else outer.held
        self._spent = deque[float]()

    def tick(self, done: int, total: int) -> None:
        """Note the time of this thread, and call the tick."""
        now = time.thread_time()
        self._spent.append(now - getattr(self._last, "time", now))
        self._last.time = now
        self._tick(done, total)

    def run(self, work: Callable[..., _Result], *args: Any) -> _Result:
        """Call a function in a thread that helps."""
        self.tick(0, 1)
        before = _METER.set(Meter(self.tick, self._held))
        try:
            return work(*args)
        finally:
            _METER.reset(before)
            now = time.thread_time()
            self._spent.append(now - self._last.time)
            self._last.time = now

    def collect(self) -> None:
        """Count what they spent since the last call as time of the calling thread."""
        while self._spent:
            _here.helped = getattr(_here, "helped", 0.0) + self._spent.popleft()


def processor_time() -> float:
    """Return the processor time of this thread and of those that helped it, seconds."""
    return time.thread_time() + float(getattr(_here, "helped", 0.0))


def limit_memory(nbytes: int) -> None:
    """Let the rows of a computation take no more than their part of the memory of this process."""
    Held.most = nbytes // _COPIES


def hold(nbytes: int) -> None:
    """Count bytes of rows that the computation of this thread holds until it ends.

    Raises
    ------
    MemoryError
        Where they are too many.
    """
    meter = _METER.get()
    if meter is not None:
        meter.held.add(nbytes)


@contextmanager
def released() -> Iterator[None]:
    """Forget the rows that are held from here on when this ends."""
    meter = _METER.get()
    before = 0 if meter is None else meter.held.nbytes
    try:
        yield
    finally:
        if meter is not None:
            meter.held.nbytes = before


def look() -> None:
    """Look at the meter of the computation that runs in this thread; it may raise `Cancelled`."""
    meter = _METER.get()
    if meter is not None:
        meter.look()


def _nothing(_done: int, _total: int) -> None:
    """Report to nobody."""


def metered(
    solve: Callable[[_Problem, Plan, Tick | None], _Result],
) -> Callable[..., _Result]:
    """Let the tick of a computation be what `look` looks at, while it runs.

    A computation within another one that is given no tick is looked after by that of the other.
    """

    @wraps(solve)
    def solved(problem: _Problem, plan: Plan, tick: Tick | None = None) -> _Result:
        outer = _METER.get()
        if tick is None and outer is not None:
            return solve(problem, plan, None)
        meter = Meter(tick or _nothing, None if outer is None else outer.held)
        before = _METER.set(meter)
        try:
            return solve(problem, plan, None if tick is None else meter)
        finally:
            _METER.reset(before)

    return solved


class StoppedError(Exception):
    """The computation took too long, or was cancelled."""


class LimitPassedError(Exception):
    """The computation passed a limit while it ran; its text says which, and what is kept."""


class StopSignal:
    """The tick of a computation that is stopped from outside, or after some time.

    Parameters
    ----------
    seconds : float
        Time allowed after the first progress. What came before, such as the compilation of
        kernels, does not count.
    cancelled : callable, optional
        Returns whether the computation was cancelled; called every 50 ms at most.
    enforce : callable, optional
        ``(seconds) -> None``: has the operating system end the process where the computation
        takes more processor time and does not notice.
    """

    def __init__(
        self,
        seconds: float = math.inf,
        cancelled: Callable[[], bool] | None = None,
        enforce: Callable[[float], None] | None = None,
    ) -> None:
        self._seconds, self._cancelled, self._enforce = seconds, cancelled, enforce
        self._began: float | None = None
        self._processor_began, self._processor_end = math.inf, math.inf
        self._next_check = time.monotonic() + _CANCELLED_SECONDS
        self.stopped = False
        self.wanted = True
        self.fraction = 0.0
        """Part of the work that was done at the last progress."""
        self.shares: list[float] = []
        """Processor times at which parts of the call ended; see `end_share`."""

    @property
    def used_seconds(self) -> float:
        """Processor time of this thread, which computes, since the first progress."""
        return processor_time() - self._processor_began

    def end_share(self) -> None:
        """Take note that one of several jobs has ended: what follows is used for the next."""
        self.shares.append(processor_time())

    def stop(self) -> None:
        """Stop the computation at its next progress."""
        self.stopped = True

    def allow(self, seconds: float) -> None:
        """Allow so much processor time of this thread, and of those that help it, from now on."""
        self._processor_end = processor_time() + seconds
        if self._enforce is not None:
            self._enforce(seconds)

    def while_wanted(self, done: int, total: int) -> None:
        """As a call of this, and raise `StoppedError` where nobody wants the outcome any more."""
        if not self.wanted:
            raise StoppedError
        self(done, total)

    def __call__(self, done: int, total: int) -> None:
        """Raise `StoppedError` or `LimitPassedError` where the computation is to stop."""
        self.fraction = done / max(1, total)
        if processor_time() > self._processor_end:
            raise LimitPassedError
        now = time.monotonic()
        if self._began is None:
            self._began, self._processor_began = now, processor_time()
        if self._cancelled is not None and now >= self._next_check:
            self._next_check = now + _CANCELLED_SECONDS
            self.stopped = self.stopped or self._cancelled()
        if self.stopped or now > self._began + self._seconds:
            raise StoppedError
