"""The job queue: submit, find, list, wait for and cancel jobs."""

from __future__ import annotations

import asyncio
import os
import socket
import time
import uuid
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import replace
from typing import IO, Final

from vibroimpact_service.jobs import (
    attempts,
    claims,
    control,
    data_folder,
    records,
    sealing,
    traces,
)
from vibroimpact_service.jobs.accounts import Accounts, Settle, nobody
from vibroimpact_service.jobs.attempts import Attempt
from vibroimpact_service.jobs.database import open_database
from vibroimpact_service.jobs.engine import Engine
from vibroimpact_service.jobs.fair_share import FairShare
from vibroimpact_service.jobs.metrics import JobMetrics
from vibroimpact_service.jobs.observation import Observation, Observer
from vibroimpact_service.jobs.probes import Probes
from vibroimpact_service.jobs.record_access import RecordAccess
from vibroimpact_service.jobs.records import NewJob
from vibroimpact_service.jobs.reserve import Reserve
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
_CHUNKS_OF_RESULT: Final = 2
"""Largest size of a job's chunks, of the largest result: they hold more, such as the states between
windows of time."""
_ENDED_JOBS: Final = 4096
_ENDED_SECONDS: Final = 60.0


class JobQueue:
    """Durable jobs of one service process; any number of processes can share a database.

    Parameters
    ----------
    settings : Settings
    store : Store
    work : Work
        How the jobs are computed.
    settle : callable, optional
        Charges what jobs used to those who submitted them; absent: nobody is charged.

    Attributes
    ----------
    metrics : JobMetrics
    """

    def __init__(
        self, settings: Settings, store: Store, work: Work, settle: Settle = nobody
    ) -> None:
        self._settings, self._store, self._work = settings, store, work
        self._settle = settle
        self.metrics = JobMetrics()
        self.engine = Engine(settings, work.prepare, work.modules, self.metrics)
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
            self._lock = data_folder.lock(self._settings.data)
        self.engine.start()
        try:
            database = await asyncio.to_thread(open_database, self._settings.database_url)
        except BaseException:
            await asyncio.to_thread(self.engine.close)
            raise
        self._records = RecordAccess(database, self.metrics.transaction, Reserve(database))
        if self._lock is not None:
            await self._records.write(claims.release_all)
        self._watch = Watch(self._records)
        self._sealing = await asyncio.to_thread(sealing.of_settings, self._settings)
        name = f"{socket.gethostname()}-{os.getpid()}-{uuid.uuid4().hex[:8]}"[-64:]
        self._probes = Probes(self._records, self._store, name)
        self._accounts = Accounts(self._settle)
        self._observer = Observer(self._settings, self._records, self._store)
        context = RunContext(
            claim_owner=name,
            records=self._records,
            engine=self.engine,
            fair_share=FairShare(lambda: self.engine.workers),
            store=self._store,
            work=self._work,
            notify=self._watch.notify,
            max_chunks_bytes=_CHUNKS_OF_RESULT * self._settings.max_result_bytes,
            metrics=self.metrics,
            accounts=self._accounts,
        )
        self._runner = Runner(context, self._settings.running_jobs, self._probes.store.state)
        settings, metrics = self._settings, self.metrics
        loops = (
            self._runner.claim_loop(),
            self._runner.renew_loop(),
            self._watch.poll(),
            Retention(settings, self._store, self._records, metrics.store_size).loop(),
            Webhooks(settings, self._records, self._sealing, metrics.webhook).loop(),
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
        self._probes.close()
        self._observer.close()
        await asyncio.to_thread(self.engine.close)
        await asyncio.to_thread(self._records.close)
        if self._lock is not None:
            self._lock.close()

    async def _prepare(self) -> None:
        """Load slowly importing modules in this process too, after the workers have started."""
        while not self.engine.ready:
            await asyncio.sleep(_WORKERS_POLL_SECONDS)
        await asyncio.to_thread(self._work.prepare)

    async def checks(self) -> dict[str, str]:
        """Return what is wrong with records, store and workers, or ``ok`` for each."""
        if any(task.done() for task in self._tasks):
            return {"records": "the job queue has stopped"}
        taken = await asyncio.gather(self._probes.records.state(), self._probes.store.state())
        workers = "ok" if self.engine.ready else self.engine.failure or "starting"
        return {"records": taken[0], "store": taken[1], "workers": workers}

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
        if new.webhook is not None:
            url, secret = new.webhook
            new = replace(new, webhook=(url, self._sealing.seal(new.id, secret)))
        if not new.done and (context := traces.current()) is not None:
            new = replace(new, trace=context)
        job = await self._records.write(records.insert, new)
        if not job.final:
            self._runner.wake()
        elif job.id == new.id:  # another one was recorded before, with the same key
            self.metrics.finished([job])
        self._remember(job)
        return job

    async def keep_key(self, owner: str, key: str, result: str) -> None:
        """Record that an idempotency key stands for the request with that result.

        Raises
        ------
        KeyReusedError
            Where it stands for another one.
        """
        await self._records.write(records.keep_key, owner, key, result)

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
        if job.final and job.state != "failed":  # that can be retried
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

    async def observe(self) -> Observation:
        """Return what waits, the room in the store and the like, as of a minute ago at most."""
        return await self._observer.state()

    async def cancel(self, owner: str, job: str) -> JobRow | None:
        """Cancel a job; return it, or None where that owner has no such job.

        It is cancelled when this returns. Calls that compute it stop soon after.
        """
        row, ended = await self._records.end(claims.cancel, owner, job)
        if row is not None and ended:
            self.metrics.finished([row])
            self._accounts.ended([row])
        if row is not None and row.final:
            self._runner.claims_lost({job})
            self._watch.notify([job])
        return row

    async def hold(self, owner: str, job: str) -> JobRow | None:
        """Keep a job from running; return it, or None where that owner has no such job."""
        row = await self._records.end(control.hold, owner, job)
        if row is not None and row.state == "queued":
            self._runner.claims_lost({job})
        self._watch.notify([job])
        return row

    async def release(self, owner: str, job: str) -> JobRow | None:
        """Let a held job run; return it, or None where that owner has no such job."""
        return self._queued(job, await self._records.write(control.release, owner, job))

    async def retry(self, owner: str, job: str) -> JobRow | None:
        """Queue a failed job again; return it, or None where that owner has no such job."""
        return self._queued(job, await self._records.write(control.retry, owner, job))

    def _queued(self, job: str, row: JobRow | None) -> JobRow | None:
        self._watch.notify([job])
        self._runner.wake()
        return row

    async def retry_all(
        self, owner: str, chosen: Sequence[str] | None, kind: str | None, most: int
    ) -> Sequence[str]:
        """Queue failed jobs again and return them; parameters as of `control.retry_all`."""
        again = await self._records.write(control.retry_all, owner, chosen, kind, most)
        self._watch.notify(again)
        self._runner.wake()
        return again

    async def history(self, job: JobRow) -> Sequence[Attempt]:
        """Return the attempts at a job."""
        history = await self._records.read(attempts.of, job.id)
        if not history and job.attempts and job.started is not None:
            # It was computed while it was submitted, or before attempts were recorded.
            return [Attempt("service", job.started, job.finished, job.state)]
        return history

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
        """Return why a job is not computed yet, in words."""
        if job.state == "running":
            ahead = self._runner.ahead(job.id)
            busy = ahead >= self.engine.workers
            parts = "1 part of other jobs goes" if ahead == 1 else f"{ahead} parts of other jobs go"
            return f"the workers are busy: {parts} first" if busy else None
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
