"""The job queue: submit, find, list, wait for and cancel jobs."""

from __future__ import annotations

import asyncio
import fcntl
import os
import socket
import time
import uuid
from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Final

from vibroimpact_service.jobs import claims, records
from vibroimpact_service.jobs.database import open_database
from vibroimpact_service.jobs.engine import Engine
from vibroimpact_service.jobs.fair_share import FairShare
from vibroimpact_service.jobs.record_access import RecordAccess
from vibroimpact_service.jobs.records import NewJob
from vibroimpact_service.jobs.retention import Retention
from vibroimpact_service.jobs.run import RunContext
from vibroimpact_service.jobs.runner import Runner
from vibroimpact_service.jobs.tables import JobRow
from vibroimpact_service.jobs.watch import Watch
from vibroimpact_service.jobs.webhooks import Webhooks
from vibroimpact_service.jobs.work import Work
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store

_WORKERS_POLL_SECONDS: Final = 0.25
_ENDED_JOBS: Final = 4096
_ENDED_SECONDS: Final = 60.0


class DataInUseError(RuntimeError):
    """Another service runs on the same data folder."""


class JobQueue:
    """Durable jobs of one service process; any number of processes can share a database.

    Parameters
    ----------
    settings : Settings
    store : Store
    work : Work
        How the jobs are computed.
    """

    def __init__(self, settings: Settings, store: Store, work: Work) -> None:
        self._settings, self._store, self._work = settings, store, work
        self.engine = Engine(settings, work.prepare, work.modules)
        self._ended: OrderedDict[str, tuple[float, JobRow]] = OrderedDict()
        self._tasks: list[asyncio.Task[None]] = []
        self._lock: IO[str] | None = None

    async def start(self) -> None:
        """Open the records, begin to start the workers and continue unfinished jobs.

        Raises
        ------
        DataInUseError
            Where another service runs on the data folder.
        """
        self._loop = asyncio.get_running_loop()
        if self._settings.database is None:
            self._lock = _lock(self._settings.data)
        self.engine.start()
        try:
            database = await asyncio.to_thread(open_database, self._settings.database_url)
        except BaseException:
            await asyncio.to_thread(self.engine.close)
            raise
        self._records = RecordAccess(database)
        if self._lock is not None:
            await self._records.write(claims.release_all)
        self._watch = Watch(self._records)
        context = RunContext(
            claim_owner=f"{socket.gethostname()}-{os.getpid()}-{uuid.uuid4().hex[:8]}"[-64:],
            records=self._records,
            engine=self.engine,
            fair_share=FairShare(lambda: self.engine.workers),
            store=self._store,
            work=self._work,
            notify=self._watch.notify,
        )
        self._runner = Runner(context, self._settings.running_jobs)
        loops = (
            self._runner.claim_loop(),
            self._runner.renew_loop(),
            self._watch.poll(),
            Retention(self._settings, self._store, self._records).loop(),
            Webhooks(self._settings, self._records).loop(),
        )
        self._tasks = [asyncio.create_task(loop) for loop in loops]
        self._preparing = asyncio.create_task(self._prepare())

    async def close(self) -> None:
        """Put unfinished jobs back into the queue, stop the workers, close the records."""
        tasks = [*self._tasks, self._preparing]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await self._runner.close()
        await asyncio.to_thread(self.engine.close)
        await asyncio.to_thread(self._records.close)
        if self._lock is not None:
            self._lock.close()

    async def _prepare(self) -> None:
        """Load slowly importing modules in this process too, after the workers have started."""
        while not self.engine.ready:
            await asyncio.sleep(_WORKERS_POLL_SECONDS)
        await asyncio.to_thread(self._work.prepare)

    @property
    def healthy(self) -> bool:
        """Whether the background tasks of the queue are alive."""
        return not any(task.done() for task in self._tasks)

    def computes(self, result: str) -> bool:
        """Whether a job with that result is being computed for this process."""
        return result in self._runner.running_results()

    async def submit(self, new: NewJob) -> JobRow:
        """Record a job and return its row; when this returns, the job is durable.

        Raises
        ------
        KeyReusedError
            Where the idempotency key was used for another request.
        RecordsUnavailableError
            Where the database cannot be reached.
        StoreFullError
            Where it has no room.
        """
        job = await self._records.write(records.insert, new)
        if not job.final:
            self._runner.wake()
        self._remember(job)
        return job

    async def get(self, owner: str, job: str) -> JobRow | None:
        """Return a job of that owner, or None."""
        ended, row = self._ended.get(job, (0.0, None))
        if row is not None and time.monotonic() - ended < _ENDED_SECONDS:
            return row if row.owner == owner else None
        row = await self._records.read(records.find, owner, job)
        if row is not None:
            self._remember(row)
        return row

    def _remember(self, job: JobRow) -> None:
        """Keep a job that ended in memory for a while: it does not change any more."""
        if job.final:
            self._ended[job.id] = time.monotonic(), job
            if len(self._ended) > _ENDED_JOBS:
                self._ended.popitem(last=False)

    async def positions(self, jobs: Sequence[JobRow]) -> dict[str, int]:
        """Return how many jobs are claimed before each of those jobs that are queued."""
        queued = [job for job in jobs if job.state == "queued"]
        if not queued:
            return {}
        return await self._records.read(claims.ahead, queued)

    async def list(
        self, owner: str, state: str | None, kind: str | None, before: int | None, limit: int
    ) -> list[JobRow]:
        """Return jobs of an owner, newest first; `before` is the `seq` of the last known one."""
        return await self._records.read(records.page, owner, state, kind, before, limit)

    async def unfinished(self, owner: str, most: int) -> int:
        """Return how many jobs of an owner are not final; counting ends at `most`."""
        return await self._records.read(records.unfinished, owner, most)

    async def waiting(self) -> dict[str, int]:
        """Return how many jobs are queued, and how many running."""
        return await self._records.read(records.waiting)

    async def cancel(self, owner: str, job: str) -> JobRow | None:
        """Cancel a job; return it, or None where that owner has no such job.

        It is cancelled when this returns. Calls that compute it stop soon after.
        """
        row = await self._records.write(claims.cancel, owner, job)
        if row is not None and row.final:
            self._runner.claims_lost({job})
            self._watch.notify([job])
        return row

    async def wait(
        self, owner: str, job: str, seconds: float, since: int | None = None
    ) -> JobRow | None:
        """Return a job once it is final, has another version than `since`, or time is over."""
        deadline = self._loop.time() + seconds
        with self._watch.on(job) as changed:
            while True:
                changed.clear()
                row = await self.get(owner, job)
                left = deadline - self._loop.time()
                if row is None or row.final or since not in (None, row.version) or left <= 0:
                    return row
                try:
                    await asyncio.wait_for(changed.wait(), left)
                except TimeoutError:
                    continue

    def waiting_reason(self, job: JobRow, position: int) -> str | None:
        """Return why a job is not running yet, in words."""
        if job.state != "queued":
            return None
        if job.waiting_note is not None:
            return job.waiting_note
        if not self.engine.ready:
            return self.engine.failure or "the workers are starting"
        if job.result in self._runner.running_results():
            return "an equal job is being computed; this one gets the same result"
        jobs = "1 queued job goes" if position == 1 else f"{position} queued jobs go"
        return f"{jobs} first" if position else "it is next"

    async def request(self, name: str) -> bytes | None:
        """Return the request of a job, or None where it is stored no more."""
        block = await asyncio.to_thread(self._store.requests.get, name)
        if block is None:
            block = await self._records.read(records.request, name)
        return block


def _lock(data: Path) -> IO[str]:
    """Lock the data folder for this process.

    Only the process that holds the lock may put running jobs of the records back at its start.
    """
    data.mkdir(parents=True, exist_ok=True)
    handle = (data / "lock").open("w")
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        handle.close()
        raise DataInUseError(f"another service runs on {data}") from None
    return handle
