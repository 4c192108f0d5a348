"""The threads of this process in which requests are computed, each result once at a time."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import structlog

from vibroimpact_service import problems
from vibroimpact_service.jobs.work import StoppedError, StopSignal
from vibroimpact_service.jobs.worker_calls import TRANSIENT_ERRORS
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings

log = structlog.get_logger("vibroimpact.threads")

Value = TypeVar("Value")

_SMALL_BODY: Final = 2**14
"""Bytes up to which a body is parsed on the event loop: handing it to a thread costs more."""
_LARGE_BODY: Final = 2**20
"""Bytes above which few bodies are parsed at a time: as objects they take 20 times more."""
_SUBMISSION_SECONDS: Final = 0.25
"""Time after which a job that is computed while it is submitted goes to the queue instead."""
_SUBMISSIONS: Final = 16
"""Computations waiting for each thread up to which jobs are computed while they are submitted: at
some milliseconds each, the way through the queue and the workers takes longer than waiting."""


@dataclass(slots=True)
class _Running:
    """A computation in a thread, and whether somebody waits for it without a time limit."""

    future: asyncio.Future[Any]
    signal: StopSignal
    has_unlimited_waiter: bool = False


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
        self._threads = ThreadPoolExecutor(settings.inline_threads, "execute")
        self._waiting = 0
        self._large = asyncio.Semaphore(2)
        self._running: dict[str, _Running] = {}
        self._closed = False

    def close(self) -> None:
        """Stop what is being computed: nobody waits for it any more."""
        self._closed = True
        self._threads.shutdown(wait=False, cancel_futures=True)

    def run(self, work: Callable[[], Value]) -> asyncio.Future[Value]:
        """Return what a function returns, called in a thread.

        Raises
        ------
        ProblemError
            503 where too many wait for the threads.
        """
        if self._closed:
            raise ProblemError(problems.UNAVAILABLE, "The service ends.")
        if self._waiting >= self._settings.max_waiting:
            detail = f"{self._waiting} requests are waiting already."
            raise ProblemError(problems.UNAVAILABLE, detail, headers={"Retry-After": "1"})
        self._waiting += 1
        future = asyncio.get_running_loop().run_in_executor(self._threads, work)
        future.add_done_callback(self._no_longer_waiting)
        return future

    def _no_longer_waiting(self, _: asyncio.Future[Any]) -> None:
        self._waiting -= 1

    async def parse(self, body: bytes, work: Callable[[], Value]) -> Value:
        """Return what a function makes of a body, called where that delays no other request."""
        if len(body) <= _SMALL_BODY:
            return work()
        if len(body) <= _LARGE_BODY:
            return await self.run(work)
        async with self._large:
            return await self.run(work)

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

        Callers may go away; the computation goes on for the others.

        Parameters
        ----------
        name : str
            Digest of the result.
        work : callable
            Stopped by the signal that it gets, after ``inline_overrun_seconds`` at the latest.
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
            signal = StopSignal(limit, cancelled=lambda: self._closed)
            running = _Running(self.run(lambda: work(signal)), signal)
            self._running[name] = running
            running.future.add_done_callback(lambda future: self._finish(name, future))
        elif running.signal.stopped:
            raise StoppedError
        running.has_unlimited_waiter = running.has_unlimited_waiter or seconds is None
        done, _ = await asyncio.wait([running.future], timeout=seconds)
        if not done:
            if not running.has_unlimited_waiter:
                running.signal.stop()  # the thread is taken until it notices
            raise StoppedError
        return running.future.result(), shared

    async def ended(self, name: str) -> None:
        """Wait for the end of a computation under way, however it ends."""
        running = self._running.get(name)
        if running is not None:
            limit = None if running.has_unlimited_waiter else _SUBMISSION_SECONDS
            await asyncio.wait([running.future], timeout=limit)

    def accepts(self, seconds: float) -> bool:
        """Whether a job of that planned work would be computed now while it is submitted."""
        few = self._waiting < _SUBMISSIONS * self._settings.inline_threads
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
            _, shared = await self.once(name, work, _SUBMISSION_SECONDS)
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
