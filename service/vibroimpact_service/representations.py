"""Stored results as the bytes that are sent, and the most wanted of them in memory."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from vibroimpact_service import digest, negotiate
from vibroimpact_service.bundle import DamagedBundle
from vibroimpact_service.store import Store

SUFFIXES: Final[Mapping[str, str]] = {negotiate.JSON: "json", negotiate.HDF5: "h5"}


@dataclass(frozen=True, slots=True)
class Representation:
    """The bytes of a result in one media type, and their SHA-256 in hexadecimal."""

    media_type: str
    data: bytes
    sha256: str

    @property
    def etag(self) -> str:
        """The strong entity tag."""
        return negotiate.entity_tag(self.sha256)


def load(store: Store, name: str, media_type: str) -> Representation | None:
    """Return a stored result in a media type, encoding it at the first time; None if unknown."""
    from vibroimpact_service import encode  # the file libraries load at the first result

    part = f"{name}.{SUFFIXES[media_type]}"
    data = store.results.get(part)
    if data is None:
        stored = store.results.get(name)
        if stored is None:
            return None
        try:
            content = encode.open_bundle(stored)
        except DamagedBundle:
            store.results.remove(name)
            return None
        data = encode.json(content) if media_type == negotiate.JSON else encode.hdf5(content)
        store.results.put(part, data)
    return Representation(media_type, data, digest.content(data))


class Shelf:
    """The representations that were asked for last, up to a number of bytes."""

    def __init__(self, most_bytes: int) -> None:
        self._most, self._held = most_bytes, 0
        self._items: OrderedDict[tuple[str, str], Representation] = OrderedDict()

    def get(self, name: str, media_type: str) -> Representation | None:
        """Return a representation if it is held."""
        found = self._items.get((name, media_type))
        if found is not None:
            self._items.move_to_end((name, media_type))
        return found

    def put(self, name: str, item: Representation) -> None:
        """Hold a representation; a large one would push out too many others and is not held."""
        key = (name, item.media_type)
        if len(item.data) > self._most // 8 or key in self._items:
            return
        self._items[key] = item
        self._held += len(item.data)
        while self._held > self._most:
            _, dropped = self._items.popitem(last=False)
            self._held -= len(dropped.data)
