"""What is thrown away and when: old jobs, results beyond an age or a size, abandoned chunks."""

from __future__ import annotations

import asyncio
import time
from typing import Final

import sqlalchemy as sa
import structlog
from sqlalchemy.engine import Connection, Engine

from vibroimpact_service.jobs.database import failing, now
from vibroimpact_service.jobs.ledger import QUEUED, RUNNING
from vibroimpact_service.jobs.records import idempotency, jobs, pins, requests, webhooks
from vibroimpact_service.jobs.writer import Writer
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Entry, Store

log = structlog.get_logger("vibroimpact.retention")

_DAY: Final = 86400.0
_FIRST_SECONDS: Final = 60.0
_FRESH_SECONDS: Final = 3600.0  # younger blocks may belong to a job that is being submitted
_APART_SECONDS: Final = 60.0
_AT_ONCE: Final = 500  # jobs removed in one transaction


class Retention:
    """Keeps records and store within the limits of the settings.

    Pinned results stay, and so does whatever unfinished jobs need. Replicas that clean at
    the same time do no harm: all that is done here can be done twice.
    """

    def __init__(self, settings: Settings, store: Store, writer: Writer, reader: Engine) -> None:
        self._settings, self._store = settings, store
        self._writer, self._reader = writer, reader

    async def loop(self) -> None:
        """Clean now and then, for ever."""
        await asyncio.sleep(_FIRST_SECONDS)
        while True:
            try:
                await asyncio.to_thread(self.clean)
            except Exception:
                log.exception("cleaning failed")
            await asyncio.sleep(self._settings.clean_seconds)

    def clean(self) -> None:
        """Remove all that has had its time."""
        self._remove_jobs()
        with failing(), self._reader.connect() as connection:
            needed = _needed(connection)
        self._remove_results(needed)
        self._remove_requests()
        self._remove_chunks()
        for area in (self._store.results, self._store.requests, self._store.chunks):
            area.tidy(time.time())

    def _remove_jobs(self) -> None:
        age = self._settings.keep_jobs_days * _DAY
        while self._writer.submit(lambda connection: _forget_jobs(connection, age)).result():
            continue
        while self._writer.submit(_forget_requests).result():
            continue

    def _remove_results(self, needed: set[str]) -> None:
        """Remove results beyond the age, then the oldest ones beyond the size."""
        store, settings = self._store.results, self._settings
        free: list[Entry] = []
        size = 0
        for entry in store.entries():
            size += entry.size
            if entry.name.split(".", 1)[0] not in needed:
                free.append(entry)
        oldest = time.time() - settings.keep_results_days * _DAY
        most = settings.max_store_bytes
        for entry in sorted(free, key=lambda each: each.modified):
            if entry.modified < oldest or (most is not None and size > most):
                store.remove(entry.name)
                size -= entry.size

    def _remove_requests(self) -> None:
        """Remove requests that no job refers to."""
        fresh = time.time() - _FRESH_SECONDS
        old = [e.name for e in self._store.requests.entries() if e.modified < fresh]
        for start in range(0, len(old), _AT_ONCE):
            some = old[start : start + _AT_ONCE]
            query = sa.select(jobs.c.request).where(jobs.c.request.in_(some))
            with failing(), self._reader.connect() as connection:
                used = set(connection.execute(query).scalars())
            for name in set(some) - used:
                self._store.requests.remove(name)

    def _remove_chunks(self) -> None:
        """Remove chunks beyond the age, then those beyond the size that were not used longest.

        What jobs under way have computed or found stays: without it they could not end.
        """
        with failing(), self._reader.connect() as connection:
            used = _began(connection)
        store, most = self._store.chunks, self._settings.max_chunks_bytes
        oldest = time.time() - self._settings.keep_chunks_days * _DAY
        entries = sorted(store.entries(), key=lambda each: each.modified)
        size = sum(entry.size for entry in entries)
        for entry in entries:
            if entry.modified >= used:
                return
            if entry.modified < oldest or (most is not None and size > most):
                store.remove(entry.name)
                size -= entry.size


def _needed(connection: Connection) -> set[str]:
    """Return the results that must stay: pinned ones, and those of unfinished jobs."""
    kept = set(connection.execute(sa.select(pins.c.result)).scalars())
    unfinished = sa.select(jobs.c.result).where(QUEUED | RUNNING)
    return kept | set(connection.execute(unfinished).scalars())


def _began(connection: Connection) -> float:
    """Return when the first of the jobs under way began, or infinity where there is none."""
    began = sa.select(sa.func.min(jobs.c.started)).where(QUEUED | RUNNING)
    found: float | None = connection.execute(began).scalar_one()
    # Clocks of the database and of the store may differ a little.
    return float("inf") if found is None else found - _APART_SECONDS


def _forget_jobs(connection: Connection, age: float) -> int:
    """Remove some jobs that ended long ago, with their idempotency keys; return how many."""
    old = sa.select(jobs.c.id).where(jobs.c.finished < now(connection) - age).limit(_AT_ONCE)
    gone = list(connection.execute(old).scalars())
    if gone:
        connection.execute(idempotency.delete().where(idempotency.c.job.in_(gone)))
        connection.execute(webhooks.delete().where(webhooks.c.job.in_(gone)))
        connection.execute(jobs.delete().where(jobs.c.id.in_(gone)))
    return len(gone)


def _forget_requests(connection: Connection) -> int:
    """Remove some recorded requests that no job refers to any more; return how many."""
    lonely = ~sa.exists().where(jobs.c.request == requests.c.name)
    old = requests.c.created < now(connection) - _FRESH_SECONDS
    some = sa.select(requests.c.name).where(old, lonely).limit(_AT_ONCE)
    names = list(connection.execute(some).scalars())
    if names:
        # Looked at again: another replica may have recorded a job with one of them meanwhile.
        connection.execute(requests.delete().where(requests.c.name.in_(names), old, lonely))
    return len(names)
