"""Stored results as the bytes that are sent, and the most wanted of them in memory."""

from __future__ import annotations

import contextlib
import gzip
import multiprocessing
import tempfile
from collections import OrderedDict
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import zstandard

from vibroimpact_service import digest, negotiate, problems
from vibroimpact_service.bundle import DamagedBundle
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.store import HEAD, Store, StoreFullError

SUFFIXES: Final[Mapping[str, str]] = {negotiate.JSON: "json", negotiate.HDF5: "h5"}

LARGE: Final = 32 * 2**20
"""Bytes of a result from which it is never in memory as a whole, but sent from its file."""
_WORTH_CODING: Final = 4096


@dataclass(frozen=True, slots=True)
class Representation:
    """A result in one media type, and the SHA-256 of its bytes in hexadecimal.

    Parameters
    ----------
    media_type : str
    data : bytes
        Empty where they are in a file.
    sha256 : str
    coding : str, optional
        The content coding that `data` have.
    file : Path, optional
        Where the bytes are, behind `HEAD` others.
    """

    media_type: str
    data: bytes
    sha256: str
    coding: str | None = None
    file: Path | None = None

    @property
    def etag(self) -> str:
        """The strong entity tag."""
        return negotiate.entity_tag(self.sha256)

    @property
    def size(self) -> int:
        """Number of bytes."""
        return len(self.data) if self.file is None else self.file.stat().st_size - HEAD

    def coded(self, coding: str | None) -> Representation:
        """Return the same in a content coding, where it is worth it; HDF5 is compressed inside."""
        small = self.file is not None or len(self.data) < _WORTH_CODING
        if coding is None or small or self.media_type == negotiate.HDF5:
            return self
        # The fastest levels: digits of numbers hardly get shorter by more effort.
        if coding == "zstd":
            data = zstandard.ZstdCompressor(level=1).compress(self.data)
        else:
            data = gzip.compress(self.data, compresslevel=1, mtime=0)
        return Representation(self.media_type, data, digest.content(data), coding)


def load(store: Store, name: str, media_type: str) -> Representation | None:
    """Return a stored result in a media type, encoding it at the first time; None if unknown."""
    part = f"{name}.{SUFFIXES[media_type]}"
    if store.results.local and _large(store, name):
        return _load_file(store, name, part, media_type)
    data = store.results.get(part)
    if data is not None:
        return Representation(media_type, data, digest.content(data))
    stored = store.results.get(name)
    return None if stored is None else make(store, name, media_type, stored)


def make(
    store: Store, name: str, media_type: str, bundle: bytes, *, keep: bool = True
) -> Representation | None:
    """Return a result in a media type from its bundle; None where that is damaged.

    With `keep` it is stored as well; it can be made again from the bundle at any time.
    """
    from vibroimpact_service import encode

    try:
        content = encode.open_bundle(bundle)
    except DamagedBundle:
        store.results.remove(name)
        return None
    data = encode.json(content) if media_type == negotiate.JSON else encode.hdf5(content)
    if not keep:
        return Representation(media_type, data, digest.content(data))
    # It can be made again from the bundle at any time, also where there is no room to keep it.
    with contextlib.suppress(StoreFullError):
        store.results.put(f"{name}.{SUFFIXES[media_type]}", data, durable=False)
    return Representation(media_type, data, digest.content(data))


def _large(store: Store, name: str) -> bool:
    return (store.results.size(name) or 0) > LARGE


def _load_file(store: Store, name: str, part: str, media_type: str) -> Representation | None:
    from vibroimpact_service import encode

    if media_type == negotiate.JSON:
        detail = f"The result is larger than {LARGE} bytes: ask for {negotiate.HDF5}."
        raise ProblemError(problems.NOT_ACCEPTABLE, detail)
    found = store.results.file(part)
    if found is None:
        stored = store.results.file(name)
        if stored is None:
            return None
        with tempfile.TemporaryDirectory(dir=stored.parent, prefix=".") as folder:
            passing = Path(folder) / "result.h5"
            # In a process of its own: the library keeps the interpreter to itself while it
            # compresses, and nobody else would be answered.
            with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as process:
                process.submit(encode.rewrite, stored, HEAD, passing).result()
            store.results.put_file(part, passing)
        found = store.results.file(part)
        if found is None:
            return None
    with found.open("rb") as file:
        sha256 = file.read(HEAD).hex()
    return Representation(media_type, b"", sha256, file=found)


class Shelf:
    """The representations that were asked for last, up to a number of bytes."""

    def __init__(self, most_bytes: int) -> None:
        self._most, self._held = most_bytes, 0
        self._items: OrderedDict[tuple[str, str, str | None], Representation] = OrderedDict()

    def get(self, name: str, media_type: str, coding: str | None = None) -> Representation | None:
        """Return a representation if it is held."""
        key = (name, media_type, coding)
        found = self._items.get(key)
        if found is not None:
            self._items.move_to_end(key)
        return found

    def put(self, name: str, item: Representation, coding: str | None = None) -> None:
        """Hold a representation, as the answer where that coding is accepted.

        A large one would push out too many others and is not held.
        """
        key = (name, item.media_type, coding)
        if item.file is not None or len(item.data) > self._most // 8 or key in self._items:
            return
        self._items[key] = item
        self._held += len(item.data)
        while self._held > self._most:
            _, dropped = self._items.popitem(last=False)
            self._held -= len(dropped.data)
