"""What jobs cost those who submitted them: what is held ends with the job, the use is charged.

Processor time counts where it was used, in jobs that fail and are cancelled too. What was computed
for another job costs nothing.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Awaitable, Callable, Iterable, Sequence
from typing import Final

from vibroimpact_service.jobs.tables import JobRow

Settle = Callable[[str, float, float, float], Awaitable[None]]
"""``await settle(account, held, used, age)``, as `access.budget.Budget.settle`."""
_UNKNOWN: Final = ("worker_lost", "limit_passed")
"""Problems of jobs whose last call may have ended without saying what it used."""


async def nobody(_account: str, _held: float, _used: float, _age: float) -> None:
    """Charge nobody."""


class Accounts:
    """Settles the jobs that a process runs, and those that it ends.

    Parameters
    ----------
    settle : callable
        Called in the event loop in which this was made.
    """

    def __init__(self, settle: Settle) -> None:
        self._charge, self._loop = settle, asyncio.get_running_loop()
        self._running: dict[str, float] = {}  # job -> processor time so far, seconds
        self._lock = threading.Lock()

    def begin(self, jobs: Iterable[JobRow]) -> None:
        """Sum up what jobs use that are run here, until they end."""
        with self._lock:
            self._running |= {job.id: 0.0 for job in jobs if job.account is not None}

    def used(self, jobs: Sequence[JobRow], seconds: Sequence[float]) -> None:
        """Take note of the processor time of a call for each of some jobs."""
        for job, each in zip(jobs, seconds, strict=False):
            with self._lock:
                running = job.id in self._running
                if running:
                    self._running[job.id] += each
            if not running:  # it ended meanwhile
                self._settle(job, 0.0, each)

    def ended(self, jobs: Iterable[JobRow]) -> None:
        """Give back what was held for jobs that ended, and charge what they used here."""
        for job in jobs:
            used = self._sum(job)
            if job.state == "failed" and (job.error or {}).get("code") in _UNKNOWN:
                used = max(used, job.held)
            self._settle(job, job.held, used)

    def left(self, jobs: Iterable[JobRow]) -> None:
        """Charge what jobs used that go on elsewhere, or were ended there."""
        for job in jobs:
            self._settle(job, 0.0, self._sum(job))

    def _sum(self, job: JobRow) -> float:
        with self._lock:
            return self._running.pop(job.id, 0.0)

    def _settle(self, job: JobRow, held: float, used: float) -> None:
        if job.account is None or held == used == 0.0 or self._loop.is_closed():
            return
        age = 0.0 if job.finished is None else job.finished - job.created
        asyncio.run_coroutine_threadsafe(self._settled(job.account, held, used, age), self._loop)

    async def _settled(self, account: str, held: float, used: float, age: float) -> None:
        await self._charge(account, held, used, age)
