"""The threads of this process in which requests are computed, each result once at a time."""

from __future__ import annotations

import asyncio
import math
import os
import time
from collections.abc import Awaitable, Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeVar

import structlog

from vibroimpact_service import problems
from vibroimpact_service.documents import parse
from vibroimpact_service.jobs.work import TRANSIENT_ERRORS
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings
from vibroimpact_solvers.meter import StoppedError, StopSignal

log = structlog.get_logger("vibroimpact.threads")

Value = TypeVar("Value")

_SMALL_BODY: Final = 2**14
"""Bytes up to which a body is parsed on the event loop: handing it to a thread costs more."""
_LARGE_BODY: Final = 2**20
"""Bytes above which few bodies are parsed at a time: as objects they take 20 times more."""
_STATM: Final = Path("/proc/self/statm")
_PAGE_BYTES: Final = os.sysconf("SC_PAGE_SIZE")
_LARGE_BODIES: Final = 2
SUBMISSION_SECONDS: Final = 0.25
"""Time after which a job that is computed while it is submitted goes to the queue instead."""
_CROWDED: Final = 0.25
"""Part of the longest wait for a thread after which those that hold one for too long give it up."""
_SUBMISSIONS: Final = 16
"""Computations waiting for each thread up to which jobs are computed while they are submitted: at
some milliseconds each, the way through the queue and the workers takes longer than waiting."""


class _Pool:
    """Threads, and how long that which is handed to them waits for one.

    Parameters
    ----------
    count : int
        Number of threads.
    name : str
    settings : Settings
    """

    def __init__(self, count: int, name: str, settings: Settings) -> None:
        self._executor = ThreadPoolExecutor(count, name)
        self._most, self._seconds = settings.max_waiting, settings.max_waiting_seconds
        self._handed: dict[object, float] = {}  # those that no thread has begun, the first first
        self.unfinished = 0

    def close(self) -> None:
        """End; what was not begun is not begun any more."""
        self._executor.shutdown(wait=False, cancel_futures=True)

    @property
    def saturated(self) -> bool:
        """Whether the first in the row has waited for too long, or the row is too long."""
        return self._waits > self._seconds or self.unfinished >= self._most

    @property
    def crowded(self) -> bool:
        """Whether the first in the row has waited for some time."""
        return self._waits > _CROWDED * self._seconds

    @property
    def _waits(self) -> float:
        """How long the first in the row has waited."""
        try:
            return time.monotonic() - next(iter(self._handed.values()))
        except (StopIteration, RuntimeError):  # there is none, or a thread takes it just now
            return 0.0

    def run(self, work: Callable[[], Value]) -> asyncio.Future[Value]:
        """Return what a function returns, called in a thread; as `Threads.run`."""
        if self.saturated:
            raise _overloaded(self.unfinished)
        loop, name = asyncio.get_running_loop(), object()
        outcome: asyncio.Future[Value] = loop.create_future()

        def begin() -> Value:
            self._handed.pop(name, None)
            return work()

        def give_up() -> None:
            if inner.cancel() and not outcome.done():
                outcome.set_exception(_overloaded(self.unfinished))

        def end(_: asyncio.Future[Value]) -> None:
            self.unfinished -= 1
            self._handed.pop(name, None)
            timer.cancel()
            inner.cancel()

        self._handed[name] = time.monotonic()
        self.unfinished += 1
        inner = self._executor.submit(begin)
        timer = loop.call_later(self._seconds, give_up)
        outcome.add_done_callback(end)
        inner.add_done_callback(partial(_hand_over, loop, outcome))
        return outcome


def _hand_over(
    loop: asyncio.AbstractEventLoop, outcome: asyncio.Future[Value], inner: Future[Value]
) -> None:
    """Pass on what a thread returned or raised, unless nobody waits for it."""

    def copy() -> None:
        if outcome.done():
            return
        if inner.cancelled():
            outcome.cancel()
        elif (error := inner.exception()) is not None:
            outcome.set_exception(error)
        else:
            outcome.set_result(inner.result())

    if not loop.is_closed():
        loop.call_soon_threadsafe(copy)


def _uncollected(work: Callable[[], Value]) -> Value:
    with parse.uncollected():
        return work()


def _overloaded(waiting: int) -> ProblemError:
    detail = f"{waiting} requests are waiting already."
    return ProblemError(problems.UNAVAILABLE, detail, headers={"Retry-After": "1"})


async def in_time(until: float | None, awaited: Awaitable[Value]) -> Value:
    """Return what an awaitable returns.

    Raises
    ------
    ProblemError
        503 where it is not there at that time of the event loop.
    """
    try:
        async with asyncio.timeout_at(until):
            return await awaited
    except TimeoutError:
        detail = "The service did not come to this request in the time for which you wait."
        raise ProblemError(problems.UNAVAILABLE, detail, headers={"Retry-After": "1"}) from None


@dataclass(slots=True)
class _Running:
    """A computation in a thread, and whether somebody waits for it without a time limit."""

    future: asyncio.Future[Any]
    signal: StopSignal
    has_unlimited_waiter: bool = False
    waiting: int = 0


class Threads:
    """The threads of this process that parse large bodies, plan, compute and encode.

    Parameters
    ----------
    settings : Settings
    ended : callable
        Called in the event loop with what a function of `once` returned, before anybody gets it.
    """

    def __init__(self, settings: Settings, ended: Callable[[Any], None]) -> None:
        self._settings, self._ended = settings, ended
        self._computing = _Pool(settings.inline_threads, "execute", settings)
        # Of their own, so that a plan does not wait for computations; a large body may hold one.
        self._planning = _Pool(1 + _LARGE_BODIES, "plan", settings)
        self._large = asyncio.Semaphore(_LARGE_BODIES)
        self._running: dict[str, _Running] = {}
        self._closed = False

    def close(self) -> None:
        """Stop what is being computed: nobody waits for it any more."""
        self._closed = True
        self._computing.close()
        self._planning.close()

    @property
    def saturated(self) -> bool:
        """Whether new work is refused because what is there already waits for too long."""
        return self._computing.saturated or self._planning.saturated

    def run(self, work: Callable[[], Value]) -> asyncio.Future[Value]:
        """Return what a function returns that takes no long time, called in a thread.

        Raises
        ------
        ProblemError
            503 where too many wait for the threads, or for too long.
        """
        return self._in(self._planning, work)

    def compute(self, work: Callable[[], Value]) -> asyncio.Future[Value]:
        """Return what a function returns that may take long; as `run`."""
        return self._in(self._computing, work)

    async def planned(self, work: Callable[[StopSignal], Value]) -> Value:
        """Return what a function returns that plans; it is stopped when the caller goes away.

        Raises
        ------
        ProblemError
            As of `run`, and 413 where it takes too long.
        """
        signal = StopSignal()
        try:
            return await self.run(lambda: work(signal))
        finally:
            signal.stop()

    def _in(self, pool: _Pool, work: Callable[[], Value]) -> asyncio.Future[Value]:
        if self._closed:
            raise problems.stopping()
        return pool.run(work)

    async def parse(self, body: bytes, work: Callable[[], Value], *, packed: bool = False) -> Value:
        """Return what a function makes of a body, called where that delays no other request.

        `packed` tells that it can be much larger than it looks.
        """
        if len(body) <= _SMALL_BODY and not packed:
            return work()
        if len(body) <= _LARGE_BODY and not packed:
            return await self.run(work)
        async with self._large:
            return await self.run(lambda: _uncollected(work))

    def running(self, name: str) -> bool:
        """Whether the result of that digest is being computed."""
        return name in self._running

    async def once(
        self,
        name: str,
        work: Callable[[StopSignal], Value],
        seconds: float | None = None,
    ) -> tuple[Value, bool]:
        """Return what a function returns, called in a thread once for all who wait for it now.

        Callers may go away; the computation goes on for the others, and the next who asks. Its
        signal tells when nobody is left.

        Parameters
        ----------
        name : str
            Digest of the result.
        work : callable
            Stopped by the signal that it gets, after ``inline_overrun_seconds`` at the latest;
            after ``inline_seconds`` of processor time, for which it was planned at most, where
            others wait.
        seconds : float, optional
            How long to wait; where nobody waits for longer, the computation is stopped then.

        Returns
        -------
        tuple
            The value, and whether the computation was under way already.

        Raises
        ------
        StoppedError
            Where it took too long.
        """
        running = self._running.get(name)
        shared = running is not None
        if running is None:
            limit = self._settings.inline_overrun_seconds
            signal = StopSignal(limit, cancelled=lambda: self._must_stop(signal))
            running = _Running(self._in(self._computing, lambda: work(signal)), signal)
            self._running[name] = running
            running.future.add_done_callback(lambda future: self._finish(name, future))
        elif running.signal.stopped:
            raise StoppedError
        running.has_unlimited_waiter = running.has_unlimited_waiter or seconds is None
        running.waiting += 1
        running.signal.wanted = True
        try:
            done, _ = await asyncio.wait([running.future], timeout=seconds)
        finally:
            running.waiting -= 1
            running.signal.wanted = running.waiting > 0
        if not done:
            if not running.has_unlimited_waiter:
                running.signal.stop()  # the thread is taken until it notices
            raise StoppedError
        return running.future.result(), shared

    def _must_stop(self, signal: StopSignal) -> bool:
        """Whether a computation is given up.

        The service ends, it uses more processor time than planned while others wait for its
        thread, or the process grows too large.
        """
        late = signal.used_seconds > self._settings.inline_seconds and self._computing.crowded
        if self._closed or late or not _STATM.exists():
            return self._closed or late
        pages = int(_STATM.read_text().split()[1])
        return pages * _PAGE_BYTES > self._settings.inline_memory_bytes

    async def ended(self, name: str, seconds: float | None = None) -> None:
        """Wait for the end of a computation under way, however it ends, for some time at most."""
        running = self._running.get(name)
        if running is not None:
            if not running.has_unlimited_waiter:
                seconds = min(SUBMISSION_SECONDS, math.inf if seconds is None else seconds)
            await asyncio.wait([running.future], timeout=seconds)

    def accepts(self, seconds: float) -> bool:
        """Whether a job of that planned work would be computed now while it is submitted."""
        few = self._computing.unfinished < _SUBMISSIONS * self._settings.inline_threads
        return seconds < self._settings.on_submission_seconds and few

    async def on_submission(self, name: str, work: Callable[[StopSignal], Value]) -> bool | None:
        """Compute and store the result of a job that is being submitted; parameters as of `once`.

        What turns out to take long, or fails, goes to the workers, where it does no harm.

        Returns
        -------
        shared : bool or None
            As `once`; None where the result is not there and the job goes to the queue.

        Raises
        ------
        StoreFullError, StoreUnavailableError
            Where the result cannot be stored.
        """
        if not self.running(name) and not self.accepts(0.0):
            return None
        try:
            _, shared = await self.once(name, work, SUBMISSION_SECONDS)
        except TRANSIENT_ERRORS:
            raise
        except Exception as error:
            log.info("goes to the workers", result=name, reason=type(error).__name__)
            return None
        return shared

    def _finish(self, name: str, future: asyncio.Future[Any]) -> None:
        del self._running[name]
        # Those who wait raise the error; there may be none left.
        if not future.cancelled() and future.exception() is None:
            self._ended(future.result())
