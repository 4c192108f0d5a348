"""The job queue as the service sees it: submit, look, wait, cancel."""

from __future__ import annotations

import asyncio
import fcntl
import os
import socket
import uuid
from collections import Counter
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import IO, TypeVar

import structlog
from sqlalchemy.engine import Connection

from vibroimpact_service.jobs import ledger
from vibroimpact_service.jobs.drive import Drive
from vibroimpact_service.jobs.engine import Engine
from vibroimpact_service.jobs.ledger import NewJob
from vibroimpact_service.jobs.records import JobRow, open_database
from vibroimpact_service.jobs.work import Work
from vibroimpact_service.jobs.writer import Writer
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store

log = structlog.get_logger("vibroimpact.jobs")

Value = TypeVar("Value")

_RENEW_SECONDS = 2.5
_LOOK_SECONDS = 1.0  # how often records that others changed are looked at


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
        self.engine = Engine(settings)
        self._drives: dict[str, Drive] = {}
        self._threads = ThreadPoolExecutor(settings.driven_jobs, "drive")
        self._readers = ThreadPoolExecutor(4, "records")
        self._watchers: dict[str, set[asyncio.Event]] = {}
        self._wake = asyncio.Event()
        self._tasks: list[asyncio.Task[None]] = []
        self._closing = False
        self._lock: IO[str] | None = None

    async def start(self) -> None:
        """Open the records, begin to start the workers and take up unfinished jobs."""
        self._loop = asyncio.get_running_loop()
        if self._settings.database is None:
            self._lock = _lock(self._settings.data)
        self._database = await asyncio.to_thread(open_database, self._settings.database_url)
        self._writer = Writer(self._database)
        if self._lock is not None:
            await self._write(ledger.release_all)
        self.engine.start()
        self._tasks = [asyncio.create_task(self._claim()), asyncio.create_task(self._renew())]

    async def close(self) -> None:
        """Give unfinished jobs back, stop the workers, close the records."""
        self._closing = True
        self._wake.set()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for drive in list(self._drives.values()):
            drive.closing.set()
        await asyncio.to_thread(self._threads.shutdown)
        await asyncio.to_thread(self.engine.close)
        await asyncio.to_thread(self._writer.close)
        self._readers.shutdown()
        self._database.dispose()
        if self._lock is not None:
            self._lock.close()

    async def submit(self, new: NewJob) -> JobRow:
        """Record a job and return its row; when this returns, the job is durable.

        Raises
        ------
        KeyReusedError
            Where the idempotency key was used for something else.
        """
        job = await self._write(ledger.insert(new))
        self._wake.set()
        return job

    async def get(self, owner: str, job: str) -> JobRow | None:
        """Return a job of that owner, or None."""
        return await self._read(lambda connection: ledger.find(connection, owner, job))

    async def position(self, job: JobRow) -> int:
        """Return how many jobs go before a queued one."""
        return await self._read(lambda connection: ledger.ahead(connection, job))

    async def list(
        self, owner: str, state: str | None, kind: str | None, before: int | None, limit: int
    ) -> list[JobRow]:
        """Return jobs of an owner, newest first; `before` is the `seq` to go on from."""
        return await self._read(
            lambda connection: ledger.page(connection, owner, state, kind, before, limit)
        )

    async def cancel(self, owner: str, job: str) -> JobRow | None:
        """Cancel a job; return it, or None where there is none of that owner."""
        found = await self._write(ledger.cancel(owner, job))
        if found is not None and found.cancel_asked and job in self._drives:
            self._drives[job].cancelled.set()
        self._notify(job)
        return found

    async def wait(self, owner: str, job: str, version: int, seconds: float) -> JobRow | None:
        """Return a job once it changed since that version, is final, or time is over."""
        changed = asyncio.Event()
        self._watchers.setdefault(job, set()).add(changed)
        deadline = self._loop.time() + seconds
        try:
            while True:
                changed.clear()
                found = await self.get(owner, job)
                left = deadline - self._loop.time()
                if found is None or found.final or found.version != version or left <= 0:
                    return found
                try:
                    # Another replica may drive it, so look now and then without being told.
                    await asyncio.wait_for(changed.wait(), min(left, _LOOK_SECONDS))
                except TimeoutError:
                    continue
        finally:
            self._watchers[job].discard(changed)
            if not self._watchers[job]:
                del self._watchers[job]

    async def finished(self, owner: str, job: str, seconds: float) -> JobRow | None:
        """Return a job once it is final or time is over."""
        deadline = self._loop.time() + seconds
        found = await self.get(owner, job)
        while found is not None and not found.final and self._loop.time() < deadline:
            left = deadline - self._loop.time()
            found = await self.wait(owner, job, found.version, left)
        return found

    async def events(self, owner: str, job: str, version: int) -> AsyncIterator[JobRow | None]:
        """Yield a job whenever it changed since a version, to its end; None as a sign of life."""
        while True:
            found = await self.wait(owner, job, version, 10.0)
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
        if not self.engine.ready:
            return self.engine.failure or "the workers are starting"
        return f"{position} jobs are in front of it" if position else "it is next"

    @property
    def healthy(self) -> bool:
        """Whether the tasks that drive jobs are alive."""
        return not any(task.done() for task in self._tasks)

    async def _claim(self) -> None:
        while not await asyncio.to_thread(self.engine.wait_ready, 0.1):
            await asyncio.sleep(0.05)
        # Before Python 3.12 wait_for can swallow a cancellation, hence the flag beside it.
        while not self._closing:
            self._wake.clear()
            room = self._settings.driven_jobs - len(self._drives)
            if room > 0 and self.engine.ready:
                busy = dict(Counter(drive.job.owner for drive in self._drives.values()))
                try:
                    taken = await self._write(ledger.claim(self._me, room, busy))
                except Exception:
                    log.exception("claim failed")
                    taken = []
                for job in taken:
                    self._drive(job)
            try:
                await asyncio.wait_for(self._wake.wait(), _LOOK_SECONDS)
            except TimeoutError:
                continue

    def _drive(self, job: JobRow) -> None:
        drive = Drive(
            job, self._me, self._writer, self.engine, self._store, self._work, self._changed
        )
        if job.cancel_asked:
            drive.cancelled.set()
        self._drives[job.id] = drive
        self._notify(job.id)
        future = self._loop.run_in_executor(self._threads, drive.run)
        future.add_done_callback(lambda _: self._driven(job.id))

    def _driven(self, job: str) -> None:
        self._drives.pop(job, None)
        self._wake.set()

    async def _renew(self) -> None:
        while not self._closing:
            await asyncio.sleep(_RENEW_SECONDS)
            driven = set(self._drives)
            if not driven:
                continue
            try:
                mine = await self._write(ledger.renew(self._me))
            except Exception:
                log.exception("renewal failed")
                continue
            for job in driven - mine:
                if job in self._drives:
                    self._drives[job].lost.set()
            await self._pass_on_cancellations()

    async def _pass_on_cancellations(self) -> None:
        """Stop jobs whose cancellation was asked of another replica."""
        for job, drive in list(self._drives.items()):
            found = await self.get(drive.job.owner, job)
            if found is not None and found.cancel_asked:
                drive.cancelled.set()

    def _changed(self, job: str) -> None:
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._notify, job)

    def _notify(self, job: str) -> None:
        for event in self._watchers.get(job, ()):
            event.set()

    async def _write(self, operation: Callable[[Connection], Value]) -> Value:
        return await asyncio.wrap_future(self._writer.submit(operation))

    async def _read(self, query: Callable[[Connection], Value]) -> Value:
        def run() -> Value:
            with self._database.connect() as connection:
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
