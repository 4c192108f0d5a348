"""Waiting for changes of jobs, whether made in this process or by other replicas."""

from __future__ import annotations

import asyncio
from collections.abc import Collection, Iterator
from contextlib import contextmanager

import structlog

from vibroimpact_service.jobs import records
from vibroimpact_service.jobs.record_access import RecordAccess

log = structlog.get_logger("vibroimpact.jobs")

_POLL_SECONDS = 0.5


class Watch:
    """Sets the events of those who wait for a change of a job.

    Changes made in this process are announced by `notify`. Those made by other replicas are
    found by one query for all watched jobs, every half second, while there are any.
    """

    def __init__(self, access: RecordAccess) -> None:
        self._access = access
        self._waiting: dict[str, set[asyncio.Event]] = {}
        self._loop = asyncio.get_running_loop()

    @contextmanager
    def on(self, job: str) -> Iterator[asyncio.Event]:
        """Give an event that is set whenever the job may have changed."""
        changed = asyncio.Event()
        self._waiting.setdefault(job, set()).add(changed)
        try:
            yield changed
        finally:
            self._waiting[job].discard(changed)
            if not self._waiting[job]:
                del self._waiting[job]

    def notify(self, changed: Collection[str]) -> None:
        """Announce that these jobs changed; from any thread."""
        if changed and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._set, tuple(changed))

    def _set(self, changed: Collection[str]) -> None:
        for job in changed:
            for event in self._waiting.get(job, ()):
                event.set()

    async def poll(self) -> None:
        """Look for new versions of the watched jobs in the records, until cancelled."""
        last: dict[str, int] = {}
        while True:
            await asyncio.sleep(_POLL_SECONDS)
            if not self._waiting:
                last = {}
                continue
            try:
                versions = await self._access.read(records.versions, list(self._waiting))
            except ConnectionError as error:
                log.warning("job records cannot be read", error=str(error))
                continue
            self._set([job for job, version in versions.items() if last.get(job) != version])
            last = versions
