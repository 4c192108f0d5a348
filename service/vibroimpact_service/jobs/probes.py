"""Whether records and store take writes, as readiness states it: by a write."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Final

from vibroimpact_service.jobs import records
from vibroimpact_service.jobs.record_access import RecordAccess
from vibroimpact_service.store import Store

_LIMIT_SECONDS: Final = 3.0
_FRESH_SECONDS: Final = 1.0
"""Time for which an answer is given again."""


class Probe:
    """Tries something, once for all who ask at the same time.

    Parameters
    ----------
    action : callable
        ``await action()`` raises an exception where it fails.
    """

    def __init__(self, action: Callable[[], Awaitable[None]]) -> None:
        self._action = action
        self._trying: asyncio.Task[str] | None = None
        self._state, self._at = "ok", float("-inf")

    async def state(self) -> str:
        """Return ``ok``, or what is wrong."""
        if time.monotonic() - self._at < _FRESH_SECONDS:
            return self._state
        if self._trying is None or self._trying.done():
            self._trying = asyncio.create_task(self._try())
        done, _ = await asyncio.wait([self._trying], timeout=_LIMIT_SECONDS)
        return self._trying.result() if done else "no answer"

    async def _try(self) -> str:
        try:
            await self._action()
        except OSError as error:
            self._state = str(error.strerror or error)
        except Exception as error:
            self._state = type(error).__name__
        else:
            self._state = "ok"
        self._at = time.monotonic()
        return self._state


class Probes:
    """The probes of a service process."""

    def __init__(self, access: RecordAccess, store: Store, name: str) -> None:
        self._threads = ThreadPoolExecutor(1, "probe")
        block = f"probe_{os.getpid()}"

        def write() -> None:
            store.results.put(block, b"", durable=False)
            store.results.remove(block)

        async def store_takes_writes() -> None:
            await asyncio.get_running_loop().run_in_executor(self._threads, write)

        self.records = Probe(lambda: access.write(records.seen, name))
        self.store = Probe(store_takes_writes)

    def close(self) -> None:
        """Wait for nothing any more."""
        self._threads.shutdown(wait=False, cancel_futures=True)
