"""Computes jobs of a few milliseconds on the spot: while they are submitted, in this process.

To record such a job as queued, claim it, send it to a worker and record its end would take
several times as long as the job itself. Its result is there before its record is written, and
both become durable in the one transaction after which the submission is answered. Whoever is
not answered submits again, as with any other job.

What turns out to take longer than was planned goes to the queue, and so does what fails: the
workers are where it can do no harm.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Final

import structlog

from vibroimpact_service.jobs.calls import PASSING
from vibroimpact_service.jobs.work import StoppedError, Tick

log = structlog.get_logger("vibroimpact.jobs")

Compute = Callable[[Tick], object]
"""Computes a job and stores its result."""

_LATE_SECONDS: Final = 0.25
_IN_LINE: Final = 16
"""Jobs that may be computed or wait for it, per thread: at some milliseconds each, the way through
the queue and the workers takes longer than the line."""


class _Until:
    """Stops a computation for which nobody waits any more."""

    def __init__(self) -> None:
        self.late = False

    def __call__(self, _done: int, _total: int, /) -> None:
        if self.late:
            raise StoppedError


class Spot:
    """A few threads for jobs that are done at once.

    Parameters
    ----------
    threads : int
        How many are computed at a time.
    seconds : float
        Planned work up to which a job is computed here; 0: none is.
    """

    def __init__(self, threads: int, seconds: float) -> None:
        self._seconds, self._most = seconds, threads * _IN_LINE
        self._threads = ThreadPoolExecutor(threads, "spot")
        self._flights: dict[str, asyncio.Future[None]] = {}
        self._ticks: set[_Until] = set()

    def takes(self, seconds: float) -> bool:
        """Whether a job of that planned work would be computed here now."""
        return seconds < self._seconds and len(self._flights) < self._most

    def knows(self, result: str) -> bool:
        """Whether a result is being computed here."""
        return result in self._flights

    async def computed(self, result: str, compute: Compute) -> bool:
        """Compute a result once for all who want it now; return whether it is there.

        Raises
        ------
        StoreFullError, StoreUnavailableError
            Where there is no place for it.
        """
        flight = self._flights.get(result)
        if flight is None:
            if len(self._flights) >= self._most:
                return False
            flight = asyncio.ensure_future(self._compute(result, compute))
            flight.add_done_callback(_looked_at)
            self._flights[result] = flight
        try:
            await asyncio.shield(flight)
        except PASSING:
            raise
        except Exception as error:
            log.info("goes to the workers", result=result, reason=type(error).__name__)
            return False
        return True

    def close(self) -> None:
        """Stop what is being computed: nobody waits for it any more."""
        for tick in self._ticks:
            tick.late = True
        self._threads.shutdown(wait=False, cancel_futures=True)

    async def _compute(self, result: str, compute: Compute) -> None:
        tick = _Until()
        work = asyncio.get_running_loop().run_in_executor(self._threads, compute, tick)
        # The thread is taken until it has stopped, however late that is noticed.
        self._ticks.add(tick)
        work.add_done_callback(lambda done: self._landed(result, tick, done))
        try:
            await asyncio.wait_for(asyncio.shield(work), _LATE_SECONDS)
        except TimeoutError:
            tick.late = True
            raise

    def _landed(self, result: str, tick: _Until, work: asyncio.Future[object]) -> None:
        del self._flights[result]
        self._ticks.discard(tick)
        _looked_at(work)


def _looked_at(ended: asyncio.Future[Any]) -> None:
    if not ended.cancelled():
        ended.exception()  # those who waited raise it; there may be none left
