"""Removal of old jobs and requests, and of results and chunks beyond an age or a size."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Sequence
from typing import Final

import sqlalchemy as sa
import structlog
from sqlalchemy.engine import Connection

from vibroimpact_service.jobs import attempts
from vibroimpact_service.jobs.database import now
from vibroimpact_service.jobs.record_access import RecordAccess
from vibroimpact_service.jobs.records import QUEUED, RUNNING
from vibroimpact_service.jobs.tables import (
    idempotency,
    jobs,
    pins,
    processes,
    requests,
    webhooks,
)
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import ContentStore, Entry, Store

log = structlog.get_logger("vibroimpact.retention")

_DAY: Final = 86400.0
_FIRST_SECONDS: Final = 60.0
_RECENT_SECONDS: Final = 3600.0  # younger blocks may belong to a job that is being submitted
_CLOCK_SECONDS: Final = 60.0
_BATCH: Final = 500  # records removed in one transaction


def _unmeasured(_area: str, _size: int) -> None:
    """Keep no account of sizes."""


class Retention:
    """Keeps records and store within the limits of the settings.

    Pinned results stay, and so does everything that unfinished jobs need. Replicas may clean at
    the same time: every step can be repeated.

    Parameters
    ----------
    settings : Settings
    store : Store
    records : RecordAccess
    measured : callable
        ``(area, bytes) -> None``: called with the size of each area that was cleaned.
    """

    def __init__(
        self,
        settings: Settings,
        store: Store,
        records: RecordAccess,
        measured: Callable[[str, int], None] = _unmeasured,
    ) -> None:
        self._settings, self._store, self._records = settings, store, records
        self._measured = measured

    async def loop(self) -> None:
        """Clean at intervals until cancelled."""
        await asyncio.sleep(min(_FIRST_SECONDS, self._settings.clean_seconds))
        while True:
            try:
                await asyncio.to_thread(self.clean)
            except Exception:
                log.exception("cleaning failed")
            await asyncio.sleep(self._settings.clean_seconds)

    def clean(self) -> None:
        """Remove everything that is too old or too large."""
        self._remove_jobs()
        self._remove_results()
        self._remove_requests()
        self._remove_chunks()
        for area in (self._store.results, self._store.requests, self._store.chunks):
            area.remove_leftovers(time.time())

    def _remove_jobs(self) -> None:
        age = self._settings.keep_jobs_days * _DAY
        while self._records.write_now(_delete_jobs, age):
            continue
        while self._records.write_now(_delete_requests):
            continue
        self._records.write_now(_delete_processes)

    def _remove_results(self) -> None:
        needed, settings = self._records.read_now(_needed), self._settings
        size = self._remove_oldest(
            self._store.results,
            settings.keep_results_days,
            settings.max_store_bytes,
            lambda entry: entry.name.split(".", 1)[0] in needed,
        )
        self._measured("results", size)

    def _remove_chunks(self) -> None:
        # Those that unfinished jobs have computed or reused stay: the jobs need them to end.
        used, settings = self._records.read_now(_earliest_start), self._settings
        size = self._remove_oldest(
            self._store.chunks,
            settings.keep_chunks_days,
            settings.max_chunks_bytes,
            lambda entry: entry.modified >= used,
        )
        self._measured("chunks", size)

    def _remove_oldest(
        self, area: ContentStore, days: float, most: int | None, stays: Callable[[Entry], bool]
    ) -> int:
        """Remove blocks beyond an age, then the oldest ones beyond a size, but those that stay.

        Returns
        -------
        int
            Size of all that is left, in bytes.
        """
        oldest = time.time() - days * _DAY
        entries = sorted(area.entries(), key=lambda entry: entry.modified)
        size = sum(entry.size for entry in entries)
        for entry in entries:
            too_much = most is not None and size > most
            if (entry.modified < oldest or too_much) and not stays(entry):
                area.remove(entry.name)
                size -= entry.size
        return size

    def _remove_requests(self) -> None:
        """Remove requests that no job refers to."""
        recent = time.time() - _RECENT_SECONDS
        entries = list(self._store.requests.entries())
        self._measured("requests", sum(entry.size for entry in entries))
        old = [entry.name for entry in entries if entry.modified < recent]
        for start in range(0, len(old), _BATCH):
            some = old[start : start + _BATCH]
            for name in set(some) - self._records.read_now(_used_requests, some):
                self._store.requests.remove(name)


def _needed(connection: Connection) -> set[str]:
    """Return the results that must stay: pinned ones, and those of unfinished jobs."""
    kept = set(connection.execute(sa.select(pins.c.result)).scalars())
    unfinished = sa.select(jobs.c.result).where(QUEUED | RUNNING)
    return kept | set(connection.execute(unfinished).scalars())


def _used_requests(connection: Connection, names: Sequence[str]) -> set[str]:
    """Return those of some requests that jobs refer to."""
    query = sa.select(jobs.c.request).where(jobs.c.request.in_(names))
    return set(connection.execute(query).scalars())


def _earliest_start(connection: Connection) -> float:
    """Return when the first of the unfinished jobs began, or infinity where none has."""
    query = sa.select(sa.func.min(jobs.c.started)).where(QUEUED | RUNNING)
    started: float | None = connection.execute(query).scalar_one()
    # The clocks of the database and of the store may differ a little.
    return float("inf") if started is None else started - _CLOCK_SECONDS


def _delete_jobs(connection: Connection, age: float) -> int:
    """Remove some jobs that ended long ago, with their idempotency keys; return how many."""
    old = sa.select(jobs.c.id).where(jobs.c.finished < now(connection) - age).limit(_BATCH)
    ids = list(connection.execute(old).scalars())
    unused = idempotency.c.job.is_(None) & (idempotency.c.created < now(connection) - age)
    connection.execute(idempotency.delete().where(unused))
    if ids:
        connection.execute(idempotency.delete().where(idempotency.c.job.in_(ids)))
        connection.execute(webhooks.delete().where(webhooks.c.job.in_(ids)))
        attempts.delete(connection, ids)
        connection.execute(jobs.delete().where(jobs.c.id.in_(ids)))
    return len(ids)


def _delete_processes(connection: Connection) -> None:
    """Remove processes that have not written for a day."""
    connection.execute(processes.delete().where(processes.c.seen < now(connection) - _DAY))


def _delete_requests(connection: Connection) -> int:
    """Remove some recorded requests that no job refers to any more; return how many."""
    unused = ~sa.exists().where(jobs.c.request == requests.c.name)
    old = requests.c.created < now(connection) - _RECENT_SECONDS
    some = sa.select(requests.c.name).where(old, unused).limit(_BATCH)
    names = list(connection.execute(some).scalars())
    if names:
        # Checked again: another replica may have recorded a job with one of them meanwhile.
        connection.execute(requests.delete().where(requests.c.name.in_(names), old, unused))
    return len(names)
