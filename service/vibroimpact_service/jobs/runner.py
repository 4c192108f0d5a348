"""The runner of a process: claims queued jobs, runs them, and renews their claims."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Final

import structlog

from vibroimpact_service.jobs import claims, time_limits
from vibroimpact_service.jobs.run import Run, RunContext
from vibroimpact_service.jobs.run_many import QuickRun
from vibroimpact_service.jobs.run_one import JobRun
from vibroimpact_service.jobs.tables import JobRow
from vibroimpact_service.jobs.work import DeadlineError
from vibroimpact_service.store import StoreFullError

log = structlog.get_logger("vibroimpact.jobs")

_RENEW_SECONDS: Final = 2.5
_POLL_SECONDS: Final = 1.0
"""Interval at which the records are searched for jobs that other processes submitted or left."""
_STARTING_SECONDS: Final = 0.05
"""The same interval until there are workers."""
_QUICK_RUNS: Final = 2  # runs of quick jobs per worker: one is computed, one waits behind it
_MAX_QUICK_RUNS: Final = 32
_QUICK_RUN_JOBS: Final = 64
_QUICK_RUN_SECONDS: Final = 0.1


class Runner:
    """Claims jobs and runs each in a thread, until it is closed.

    Parameters
    ----------
    context : RunContext
    max_jobs : int
        Bulk jobs that run at once.
    store_state : callable
        Tries the store: returns ``ok``, or what is wrong.
    """

    def __init__(
        self, context: RunContext, max_jobs: int, store_state: Callable[[], Awaitable[str]]
    ) -> None:
        self._records, self._context, self._max_jobs = context.records, context, max_jobs
        self._engine, self._claim_owner = context.engine, context.claim_owner
        self._store_state = store_state
        self._threads = ThreadPoolExecutor(max_jobs + _MAX_QUICK_RUNS, "run")
        self._runs: set[Run] = set()
        self._woken = asyncio.Event()

    def wake(self) -> None:
        """Look for jobs now: some were submitted, or a run ended."""
        self._woken.set()

    def running_results(self) -> set[str]:
        """Return the results that are being computed."""
        return {job.result for run in tuple(self._runs) for job in run.jobs.values()}

    def ahead(self, job: str) -> int:
        """Return how many calls for other jobs the workers have before those for a job."""
        firsts = [next(iter(run.jobs)) for run in tuple(self._runs) if job in run.jobs]
        return max(map(self._engine.ahead, firsts), default=0)

    def claims_lost(self, lost: Collection[str]) -> None:
        """Stop the runs of jobs whose claim is lost."""
        for run in tuple(self._runs):
            for job in lost:
                if job in run.jobs:
                    run.claim_lost(job)

    async def close(self) -> None:
        """Stop all runs, which put their jobs back into the queue."""
        for run in tuple(self._runs):
            run.close()
        await asyncio.to_thread(self._threads.shutdown)

    async def claim_loop(self) -> None:
        """Claim and run jobs until cancelled."""
        woken = False
        while True:
            self._woken.clear()
            if self._engine.ready and (woken or await self._claimable()) and await self._reaches():
                await asyncio.gather(self._claim_bulk(), self._claim_quick())
            pause = _POLL_SECONDS if self._engine.ready else _STARTING_SECONDS
            try:
                async with asyncio.timeout(pause):
                    woken = await self._woken.wait()
            except TimeoutError:
                woken = False

    async def _reaches(self) -> bool:
        """Whether the store answers: others may reach it, and shall have the jobs."""
        return not self._context.store.silent or await self._store_state() == "ok"

    async def _claimable(self) -> bool:
        try:
            return await self._records.read(claims.claimable)
        except Exception as error:
            log.warning("no jobs can be looked for", error=str(error))
            return False

    async def _claim_bulk(self) -> None:
        room = self._max_jobs - self._count(JobRun)
        for job in await self._claim("bulk", room, float("inf")):
            self._start(JobRun(job, self._context))

    async def _claim_quick(self) -> None:
        room = min(_QUICK_RUNS * self._engine.workers, _MAX_QUICK_RUNS) - self._count(QuickRun)
        jobs = await self._claim("quick", room * _QUICK_RUN_JOBS, room * _QUICK_RUN_SECONDS)
        for i in range(min(room, len(jobs))):
            self._start(QuickRun(jobs[i::room], self._context))

    def _count(self, sort: type[Run]) -> int:
        return sum(isinstance(run, sort) for run in self._runs)

    async def _claim(self, queue: str, room: int, seconds: float) -> Sequence[JobRow]:
        if room <= 0:
            return []
        try:
            write, owner = self._records.write, self._claim_owner
            jobs = await write(claims.claim, owner, queue, room, seconds)
        except (ConnectionError, StoreFullError) as error:
            log.warning("no jobs can be claimed", error=str(error))
            return []
        except Exception:
            log.exception("claim failed")
            return []
        expired = sum(job.taken_over for job in jobs)
        self._context.metrics.attempts_ended("claim_expired", expired)
        return jobs

    def _start(self, run: Run) -> None:
        self._runs.add(run)
        self._context.notify(run.jobs)
        future = asyncio.get_running_loop().run_in_executor(self._threads, run.run)
        future.add_done_callback(lambda done: self._ended(run, done))

    def _ended(self, run: Run, done: asyncio.Future[None]) -> None:
        self._runs.discard(run)
        self._woken.set()
        if not done.cancelled() and (error := done.exception()) is not None:
            log.error("a run broke off; its claims will expire", exc_info=error)

    async def renew_loop(self) -> None:
        """Renew the claims of running jobs, and end what is overdue, until cancelled."""
        while True:
            await asyncio.sleep(_RENEW_SECONDS)
            try:
                await self._fail_overdue()
                if ended := await self._records.read(time_limits.end_forgotten):
                    log.warning("transactions without an end were ended", transactions=ended)
                held = {job for run in self._runs for job in run.jobs}
                if held:
                    renewed = await self._records.write(claims.renew, self._claim_owner, held)
                    self.claims_lost(held - renewed)
            except (ConnectionError, StoreFullError) as error:
                log.warning("claims cannot be renewed", error=str(error))
            except Exception:
                log.exception("renewal failed")

    async def _fail_overdue(self) -> None:
        if await self._records.read(claims.overdue):
            error = DeadlineError("the job was not done by its deadline")
            problem = self._context.work.explain(error)
            ended = await self._records.write(claims.fail_overdue, problem)
            self._context.metrics.finished(ended.values())
            self._context.accounts.ended(ended.values())
            self._context.notify(ended)
