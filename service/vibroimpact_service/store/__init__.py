"""Requests, systems, chunks and results by content, in a folder or an object store."""

from __future__ import annotations

from vibroimpact_service.store.content import (
    HEAD,
    ContentStore,
    Entry,
    Room,
    StoreFullError,
    StoreUnavailableError,
)

__all__ = [
    "HEAD",
    "ContentStore",
    "Entry",
    "Room",
    "Store",
    "StoreFullError",
    "StoreUnavailableError",
]


class Store:
    """The areas of one store.

    Parameters
    ----------
    url : str
        Folder, or URL that fsspec understands.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self.requests = ContentStore(url, "requests")
        self.systems = ContentStore(url, "systems")
        self.chunks = ContentStore(url, "chunks")
        self.results = ContentStore(url, "results")

    @property
    def areas(self) -> dict[str, ContentStore]:
        """All areas by name."""
        return {
            "requests": self.requests,
            "systems": self.systems,
            "chunks": self.chunks,
            "results": self.results,
        }
