"""Requests, systems, chunks and results by content, in a folder or an object store."""

from __future__ import annotations

from vibroimpact_service.store.content import HEAD, ContentStore, Entry, Room
from vibroimpact_service.store.faults import Outage, StoreFullError, StoreUnavailableError

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
    patient : bool
        Whether requests to a server that does not answer all wait for it; see `Outage`.
    """

    def __init__(self, url: str, *, patient: bool = True) -> None:
        self.url = url
        self._outage = outage = Outage(patient=patient)
        self.requests = ContentStore(url, "requests", outage)
        self.systems = ContentStore(url, "systems", outage)
        self.chunks = ContentStore(url, "chunks", outage)
        self.results = ContentStore(url, "results", outage)

    @property
    def silent(self) -> bool:
        """Whether the server of the store is known not to answer."""
        return self._outage.known

    @property
    def areas(self) -> dict[str, ContentStore]:
        """All areas by name."""
        return {
            "requests": self.requests,
            "systems": self.systems,
            "chunks": self.chunks,
            "results": self.results,
        }
