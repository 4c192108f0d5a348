"""The results of a service: in its store, the most recent in memory too."""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor
from typing import Final

from vibroimpact_service.results import representations
from vibroimpact_service.results.representations import RecentRepresentations, Representation
from vibroimpact_service.store import Store

_CACHE_BYTES: Final = 64 * 2**20


class Results:
    """Stored results in the representations that are sent."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._cache = RecentRepresentations(_CACHE_BYTES)
        # In threads of their own: to write a large file takes long.
        self._files = ThreadPoolExecutor(2, "files")
        self._loading: dict[tuple[str, str], asyncio.Future[Representation | None]] = {}

    def close(self) -> None:
        """Give up what is being loaded."""
        self._files.shutdown(wait=False, cancel_futures=True)

    async def get(self, name: str, media_type: str) -> Representation | None:
        """Return a result in a media type, or None where there is none."""
        representation = self._cache.get(name, media_type)
        if representation is None and self._store.results.has(name):
            representation = await self._load(name, media_type)
            if representation is not None:
                self._cache.put(name, representation)
        return representation

    def keep(self, name: str, representation: Representation) -> None:
        """Hold a fresh representation in memory."""
        self._cache.put(name, representation)

    async def coded(self, name: str, representation: Representation, coding: str) -> Representation:
        """Return a representation in a content coding, where it is worth it."""
        coded = self._cache.get(name, representation.media_type, coding)
        if coded is None:
            loop = asyncio.get_running_loop()
            coded = await loop.run_in_executor(self._files, representation.coded, coding)
            self._cache.put(name, coded, coding)
        return coded

    async def _load(self, name: str, media_type: str) -> Representation | None:
        """Load a representation; once for all who ask for it at the same time."""
        key = (name, media_type)
        loading = self._loading.get(key)
        if loading is None:
            loading = self._loading[key] = asyncio.get_running_loop().run_in_executor(
                self._files, representations.load, self._store, name, media_type
            )
            loading.add_done_callback(lambda future: self._loaded(key, future))
        return await asyncio.shield(loading)

    def _loaded(self, key: tuple[str, str], future: asyncio.Future[Representation | None]) -> None:
        del self._loading[key]
        if not future.cancelled():
            future.exception()  # those who waited raise it; there may be none left
