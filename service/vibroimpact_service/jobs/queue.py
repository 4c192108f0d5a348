"""The job queue as the service sees it: submit, look, wait, cancel."""

from __future__ import annotations

import asyncio
import fcntl
import os
import socket
import time
import uuid
from collections import OrderedDict
from collections.abc import AsyncIterator, Callable, Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import IO, Any, Final, TypeVar

import structlog
from sqlalchemy.engine import Connection

from vibroimpact_service.jobs import lease, ledger
from vibroimpact_service.jobs.database import failing, open_database, reader
from vibroimpact_service.jobs.drive import Drive, Driver, Surroundings
from vibroimpact_service.jobs.engine import Engine
from vibroimpact_service.jobs.group import Group
from vibroimpact_service.jobs.ledger import NewJob
from vibroimpact_service.jobs.records import JobRow
from vibroimpact_service.jobs.retention import Retention
from vibroimpact_service.jobs.shares import Shares
from vibroimpact_service.jobs.spot import Compute, Spot
from vibroimpact_service.jobs.watch import Watch
from vibroimpact_service.jobs.webhooks import Webhooks
from vibroimpact_service.jobs.work import DeadlineError, Work
from vibroimpact_service.jobs.writer import Writer
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store, StoreFullError

log = structlog.get_logger("vibroimpact.jobs")

Value = TypeVar("Value")

_RENEW_SECONDS: Final = 2.5
_LOOK_SECONDS: Final = 1.0  # how often jobs that others left behind are looked for
_SIGN_OF_LIFE_SECONDS: Final = 10.0
_GROUPS: Final = 2  # groups of quick jobs per worker: one computed, one ready behind it
_MOST_GROUPS: Final = 32
_GROUP_JOBS: Final = 64
_GROUP_SECONDS: Final = 0.1
_REMEMBERED: Final = 4096
_REMEMBERED_SECONDS: Final = 60.0


class DataInUseError(RuntimeError):
    """Another service runs on the same data folder."""


class JobQueue:
    """Durable jobs of one service process; any number of them can share a database.

    Parameters
    ----------
    settings : Settings
    store : Store
    work : Work
        What the jobs do.
    """

    def __init__(self, settings: Settings, store: Store, work: Work) -> None:
        self._settings, self._store, self._work = settings, store, work
        self._me = f"{socket.gethostname()}-{os.getpid()}-{uuid.uuid4().hex[:8]}"[-64:]
        self.engine = Engine(settings, work.prepare, work.modules)
        self._drivers: set[Driver] = set()
        self._threads = ThreadPoolExecutor(settings.driven_jobs + _MOST_GROUPS, "drive")
        self._readers = ThreadPoolExecutor(4, "records")
        self._spot = Spot(settings.inline_threads, settings.spot_seconds)
        self._ended: OrderedDict[str, tuple[float, JobRow]] = OrderedDict()
        self._wake = asyncio.Event()
        self._tasks: list[asyncio.Task[None]] = []
        self._closing = False
        self._lock: IO[str] | None = None

    async def start(self) -> None:
        """Open the records, begin to start the workers and take up unfinished jobs.

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
        self._database, self._reader = database, reader(database)
        self._writer = Writer(database)
        if self._lock is not None:
            await self._write(lease.release_all)
        self._watch = Watch(self._versions)
        self._around = Surroundings(
            self._me, self._writer, self.engine, Shares(lambda: self.engine.slots), self._store,
            self._work, self._watch.tell, self._supply,
        )  # fmt: skip
        retention = Retention(self._settings, self._store, self._writer, self._reader)
        webhooks = Webhooks(self._settings, self._writer, self._reader)
        loops = (
            self._claim(),
            self._renew(),
            self._watch.look(),
            retention.loop(),
            webhooks.loop(),
        )
        self._tasks = [asyncio.create_task(loop) for loop in loops]
        self._loading = asyncio.create_task(self._load())

    async def close(self) -> None:
        """Give unfinished jobs back, stop the workers, close the records."""
        self._closing = True
        self._wake.set()
        ending = [*self._tasks, self._loading]
        for task in ending:
            task.cancel()
        await asyncio.gather(*ending, return_exceptions=True)
        for driver in tuple(self._drivers):
            driver.close()
        self._spot.close()
        await asyncio.to_thread(self._threads.shutdown)
        await asyncio.to_thread(self.engine.close)
        await asyncio.to_thread(self._writer.close)
        self._readers.shutdown()
        self._database.dispose()
        if self._lock is not None:
            self._lock.close()

    def takes(self, seconds: float) -> bool:
        """Whether a job of that planned work would be computed while it is submitted."""
        return self._spot.takes(seconds)

    async def submit(self, new: NewJob, compute: Compute | None = None) -> JobRow:
        """Record a job and return its row; when this returns, the job is durable.

        With `compute` it is computed here first, where there is a thread free for it.

        Raises
        ------
        KeyReusedError
            Where the idempotency key was used for something else.
        RecordsUnavailableError
            Where the database cannot be reached.
        StoreFullError
            Where it has no room.
        """
        if compute is not None and new.result not in self._driven_results():
            known = self._spot.knows(new.result)
            if await self._spot.computed(new.result, compute):
                new = replace(new, computed=not known, reused=known)
        return (await self.submit_many([new]))[0]

    async def submit_many(self, news: Sequence[NewJob]) -> list[JobRow]:
        """Record jobs, all or none, and return their rows in the same order; as `submit`."""
        jobs = await self._write(ledger.insert(news))
        if not all(job.final for job in jobs):
            self._wake.set()
        for job in jobs:
            self._remember(job)
        return jobs

    async def get(self, owner: str, job: str) -> JobRow | None:
        """Return a job of that owner, or None."""
        ended, found = self._ended.get(job, (0.0, None))
        if found is not None and time.monotonic() - ended < _REMEMBERED_SECONDS:
            return found if found.owner == owner else None
        found = await self._read(lambda connection: ledger.find(connection, owner, job))
        if found is not None:
            self._remember(found)
        return found

    def _remember(self, job: JobRow) -> None:
        """Keep a job that ended at hand for a while: nothing of it will change."""
        if job.final:
            self._ended[job.id] = time.monotonic(), job
            if len(self._ended) > _REMEMBERED:
                self._ended.popitem(last=False)

    async def positions(self, jobs: Sequence[JobRow]) -> dict[str, int]:
        """Return how many jobs go before each of those jobs that are queued."""
        queued = [job for job in jobs if job.state == "queued"]
        if not queued:
            return {}
        return await self._read(lambda connection: ledger.ahead(connection, queued))

    async def list(
        self, owner: str, state: str | None, kind: str | None, before: int | None, limit: int
    ) -> list[JobRow]:
        """Return jobs of an owner, newest first; `before` is the `seq` to go on from."""
        return await self._read(
            lambda connection: ledger.page(connection, owner, state, kind, before, limit)
        )

    async def unfinished(self, owner: str, most: int) -> int:
        """Return how many jobs of an owner are not final; counting ends at `most`."""
        return await self._read(lambda connection: ledger.unfinished(connection, owner, most))

    async def waiting(self) -> dict[str, int]:
        """Return how many jobs are queued, and how many running."""
        return await self._read(ledger.waiting)

    async def cancel(self, owner: str, job: str) -> JobRow | None:
        """Cancel a job; return it, or None where there is none of that owner.

        It is cancelled when this returns. What is being computed for it stops soon after.
        """
        found = await self._write(ledger.cancel(owner, job))
        if found is not None and found.final:
            self._lose({job})
            self._watch.tell([job])
        return found

    async def pin(self, owner: str, result: str) -> None:
        """Keep a result, whatever its age and the size of the store."""
        await self._write(ledger.pin(owner, result))

    async def unpin(self, owner: str, result: str) -> bool:
        """Let a result go when its time comes; whether it was pinned."""
        return await self._write(ledger.unpin(owner, result))

    async def pinned(self, owner: str) -> Sequence[str]:
        """Return the results that an owner pinned."""
        return await self._read(lambda connection: ledger.pinned(connection, owner))

    async def wait(self, owner: str, job: str, version: int, seconds: float) -> JobRow | None:
        """Return a job once it changed since that version, is final, or time is over."""
        deadline = self._loop.time() + seconds
        with self._watch.on(job) as changed:
            while True:
                changed.clear()
                found = await self.get(owner, job)
                left = deadline - self._loop.time()
                if found is None or found.final or found.version != version or left <= 0:
                    return found
                try:
                    await asyncio.wait_for(changed.wait(), left)
                except TimeoutError:
                    continue

    async def finished(self, owner: str, job: str, seconds: float) -> JobRow | None:
        """Return a job once it is final or time is over."""
        deadline = self._loop.time() + seconds
        with self._watch.on(job) as changed:
            while True:
                changed.clear()
                found = await self.get(owner, job)
                left = deadline - self._loop.time()
                if found is None or found.final or left <= 0:
                    return found
                try:
                    await asyncio.wait_for(changed.wait(), left)
                except TimeoutError:
                    continue

    async def events(self, owner: str, job: str, version: int) -> AsyncIterator[JobRow | None]:
        """Yield a job whenever it changed since a version, to its end; None as a sign of life."""
        while True:
            found = await self.wait(owner, job, version, _SIGN_OF_LIFE_SECONDS)
            if found is None:
                return
            yield found if found.version != version else None
            version = found.version
            if found.final:
                return

    def waiting_reason(self, job: JobRow, position: int) -> str | None:
        """Return why a job does not run yet, in words."""
        if job.state != "queued":
            return None
        if job.note is not None:
            return job.note
        if not self.engine.ready:
            return self.engine.failure or "the workers are starting"
        if job.result in self._driven_results():
            return "an equal job is being computed; this one gets the same result"
        return f"{position} jobs are in front of it" if position else "it is next"

    def _driven_results(self) -> set[str]:
        drivers = tuple(self._drivers)
        return {job.result for driver in drivers for job in driver.held.values()}

    @property
    def healthy(self) -> bool:
        """Whether the tasks that drive jobs are alive."""
        return not any(task.done() for task in self._tasks)

    async def _load(self) -> None:
        """Load what is slow to load here too, once that keeps no worker from starting."""
        while not self.engine.ready:
            await asyncio.sleep(_LOOK_SECONDS / 4)
        await asyncio.to_thread(self._work.prepare)

    async def _claim(self) -> None:
        # Before Python 3.12 wait_for can swallow a cancellation, hence the flag beside it.
        woken = False
        while not self._closing:
            self._wake.clear()
            if self.engine.ready and (woken or await self._claimable()):
                await asyncio.gather(self._claim_bulk(), self._claim_quick())
            try:
                # Until there are workers, look often whether they have come.
                pause = _LOOK_SECONDS if self.engine.ready else 0.05
                await asyncio.wait_for(self._wake.wait(), pause)
                woken = True
            except TimeoutError:
                woken = False

    async def _claimable(self) -> bool:
        """Look for jobs of which nobody here was told: of other replicas, or to be tried again."""
        try:
            return await self._read(lease.claimable)
        except Exception as error:
            log.warning("no jobs can be looked for", error=str(error))
            return False

    async def _claim_bulk(self) -> None:
        room = self._settings.driven_jobs - self._count(Drive)
        for job in await self._take("bulk", room, float("inf")):
            self._drive(Drive(job, self._around))

    async def _claim_quick(self) -> None:
        groups = min(_GROUPS * self.engine.slots, _MOST_GROUPS) - self._count(Group)
        jobs = await self._take("quick", groups * _GROUP_JOBS, groups * _GROUP_SECONDS)
        for i in range(min(groups, len(jobs))):
            self._drive(Group(jobs[i::groups], self._around))

    def _count(self, sort: type[Driver]) -> int:
        return sum(isinstance(driver, sort) for driver in self._drivers)

    async def _take(self, lane: str, room: int, seconds: float) -> Sequence[JobRow]:
        if room <= 0:
            return []
        try:
            return await self._write(lease.claim(self._me, lane, room, seconds))
        except (ConnectionError, StoreFullError) as error:
            log.warning("no jobs can be claimed", error=str(error))
            return []
        except Exception:
            log.exception("claim failed")
            return []

    def _drive(self, driver: Drive | Group) -> None:
        self._drivers.add(driver)
        self._watch.tell(driver.held)
        future = self._loop.run_in_executor(self._threads, driver.run)
        future.add_done_callback(lambda done: self._driven(driver, done))

    def _driven(self, driver: Driver, done: asyncio.Future[None]) -> None:
        self._drivers.discard(driver)
        self._wake.set()
        if not done.cancelled() and (error := done.exception()) is not None:
            log.error("a drive broke off; its lease will run out", exc_info=error)

    def _lose(self, lost: Collection[str]) -> None:
        for driver in tuple(self._drivers):
            for job in lost:
                if job in driver.held:
                    driver.lose(job)

    async def _renew(self) -> None:
        while not self._closing:
            await asyncio.sleep(_RENEW_SECONDS)
            try:
                if await self._read(lease.overdue):
                    self._watch.tell(await self._write(lease.fail_overdue(self._overdue)))
                held = {job for driver in self._drivers for job in driver.held}
                if held:
                    mine = await self._write(lease.renew(self._me, held))
                    self._lose(held - mine)
            except (ConnectionError, StoreFullError) as error:
                log.warning("leases cannot be renewed", error=str(error))
            except Exception:
                log.exception("renewal failed")

    @property
    def _overdue(self) -> dict[str, Any]:
        return self._work.explain(DeadlineError("the job was not done by its deadline"))

    async def _versions(self, jobs: Sequence[str]) -> dict[str, int]:
        return await self._read(lambda connection: ledger.versions(connection, jobs))

    async def request(self, name: str) -> bytes | None:
        """Return what a job asks, or None where that is known no more."""
        block = await asyncio.to_thread(self._store.requests.get, name)
        if block is None:
            block = await self._read(lambda connection: ledger.request(connection, name))
        return block

    def _supply(self, name: str) -> None:
        """See to it that workers find what a job asks; called in threads of drives."""
        if self._store.requests.sound(name):
            return
        with failing(), self._reader.connect() as connection:
            block = ledger.request(connection, name)
        if block is not None:
            # It stands in the records too, and can be put here again.
            self._store.requests.put(name, block, durable=False)

    async def _write(self, operation: Callable[[Connection], Value]) -> Value:
        return await asyncio.wrap_future(self._writer.submit(operation))

    async def _read(self, query: Callable[[Connection], Value]) -> Value:
        def run() -> Value:
            with failing(), self._reader.connect() as connection:
                return query(connection)

        return await self._loop.run_in_executor(self._readers, run)


def _lock(data: Path) -> IO[str]:
    """Hold the data folder for this process alone.

    Only whoever holds it may take running jobs of the records for orphans.
    """
    data.mkdir(parents=True, exist_ok=True)
    handle = (data / "lock").open("w")
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        handle.close()
        raise DataInUseError(f"another service runs on {data}") from None
    return handle
