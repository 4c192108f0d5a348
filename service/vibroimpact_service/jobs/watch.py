"""Who waits for news of which job, and how the news comes: from here, or from the records."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Collection, Iterator, Sequence
from contextlib import contextmanager

import structlog

log = structlog.get_logger("vibroimpact.jobs")

_LOOK_SECONDS = 0.5


class Watch:
    """Wakes those who wait for a change of a job.

    Changes made in this process are told by `tell`. Those made by other replicas are found
    by one query for all watched jobs, every half second, while anybody waits.

    Parameters
    ----------
    versions : callable
        ``(jobs) -> job -> version`` from the records.
    """

    def __init__(self, versions: Callable[[Sequence[str]], Awaitable[dict[str, int]]]) -> None:
        self._versions = versions
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

    def tell(self, changed: Collection[str]) -> None:
        """Wake those who wait for these jobs; from any thread."""
        if changed and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._wake, tuple(changed))

    def _wake(self, changed: Collection[str]) -> None:
        for job in changed:
            for event in self._waiting.get(job, ()):
                event.set()

    async def look(self) -> None:
        """Look at the records for ever."""
        seen: dict[str, int] = {}
        while True:
            await asyncio.sleep(_LOOK_SECONDS)
            if not self._waiting:
                seen = {}
                continue
            try:
                found = await self._versions(list(self._waiting))
            except ConnectionError as error:
                log.warning("cannot look at the records", error=str(error))
                continue
            self._wake([job for job, version in found.items() if seen.get(job) != version])
            seen = found
