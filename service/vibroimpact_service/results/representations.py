"""Results as the bytes that are sent: in the store, the most recent of them in memory too."""

from __future__ import annotations

import asyncio
import contextlib
import gzip
import multiprocessing
import tempfile
from collections import OrderedDict
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import zstandard

from vibroimpact_service import problems
from vibroimpact_service.documents import digest
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.results import encode
from vibroimpact_service.results.container import DamagedContainerError
from vibroimpact_service.results.encode import Content
from vibroimpact_service.results.encoders import ENCODERS, IN_FILES, Encoder
from vibroimpact_service.store import HEAD, Store, StoreFullError

CODINGS: Final = ("zstd", "gzip")
"""Content codings of answers, the better one first."""

LARGE: Final = 48 * 2**20
"""Size in bytes above which a result is sent from its file, never read as a whole."""
_BESIDE: Final = 1.5
"""What a result has beside what its plan counts, such as the errors of displacements."""
_CACHE_BYTES: Final = 64 * 2**20
_SMALLEST_CODED: Final = 4096
_SMALLEST_PAGE: Final = 512
"""The same of files of the console, which come once, and many of them."""


@dataclass(frozen=True, slots=True)
class Representation:
    """A result in one media type, and the SHA-256 of its bytes in hexadecimal."""

    media_type: str
    data: bytes
    """Empty if they are in a file."""
    sha256: str
    coding: str | None = None
    """Content coding of `data`."""
    file: Path | None = None
    """File of the bytes, which follow a head of `HEAD` bytes."""

    @property
    def etag(self) -> str:
        """The strong entity tag."""
        return f'"{self.sha256}"'

    @property
    def size(self) -> int:
        """Number of bytes."""
        return len(self.data) if self.file is None else self.file.stat().st_size - HEAD

    @property
    def is_coded(self) -> bool:
        """Whether it is worth a content coding: neither small nor made of binary numbers."""
        page = self._is_page
        if self.file is not None or len(self.data) < (_SMALLEST_PAGE if page else _SMALLEST_CODED):
            return False
        return page or not encoder(self.media_type).binary

    @property
    def _is_page(self) -> bool:
        """Whether it is no result but a file of the console or the contract, without encoder."""
        return self.media_type.partition(";")[0] not in ENCODERS

    def coded(self, coding: str) -> Representation:
        """Return it in a content coding."""
        page = self._is_page
        # The fastest levels for results: digits hardly get shorter by more effort, words do.
        if coding == "zstd":
            data = zstandard.ZstdCompressor(level=12 if page else 1).compress(self.data)
        else:
            data = gzip.compress(self.data, compresslevel=9 if page else 1, mtime=0)
        return Representation(self.media_type, data, digest.content(data), coding)


def encoder(media_type: str) -> Encoder:
    """Return the encoder of a media type, with its parameter or without."""
    return ENCODERS[media_type.partition(";")[0]]


def load(store: Store, name: str, media_type: str) -> Representation | None:
    """Return a stored result in a media type, encoding it the first time; None if unknown."""
    how = encoder(media_type)
    if store.results.local and (store.results.size(name) or 0) > LARGE:
        return _load_file(store, name, how.large or media_type)
    part = f"{name}.{how.suffix}"
    data = store.results.get(part) if how.stored else None
    if data is not None:
        return Representation(media_type, data, digest.content(data))
    stored = store.results.get(name)
    if stored is None:
        return None
    try:
        content = encode.unpack(stored)
    except DamagedContainerError:
        store.results.remove(name)
        return None
    made = of_content(content, media_type)
    if not how.stored:
        return made
    # It can be made again from the stored result at any time: a full store is no error.
    with contextlib.suppress(StoreFullError):
        store.results.put(part, made.data, durable=False)
    return made


def check_size(size: float, media_type: str) -> None:
    """Refuse a media type in which a result of that many bytes is not sent.

    Raises
    ------
    ProblemError
        406.
    """
    how = encoder(media_type)
    if how.convert is None and not how.large and size * _BESIDE > LARGE:
        detail = (
            f"A result of at least about {_BESIDE * size:.3g} bytes is sent as {IN_FILES} only."
        )
        raise ProblemError(problems.NOT_ACCEPTABLE, detail)


def of_content(content: Content, media_type: str) -> Representation:
    """Return the content of a result in a media type."""
    data = encoder(media_type).encode(content, media_type.partition("=")[2])
    return Representation(media_type, data, digest.content(data))


def _load_file(store: Store, name: str, media_type: str) -> Representation | None:
    how = encoder(media_type)
    part, convert = f"{name}.{how.suffix}", how.convert
    if convert is None:
        detail = f"The result is larger than {LARGE} bytes: ask for {IN_FILES}."
        raise ProblemError(problems.NOT_ACCEPTABLE, detail)
    path = store.results.file(part)
    if path is None:
        stored = store.results.file(name)
        if stored is None:
            return None
        with tempfile.TemporaryDirectory(dir=stored.parent, prefix=".") as folder:
            converted = Path(folder) / part
            # In a process of its own: HDF5 holds the interpreter's lock while it compresses,
            # and no other request would be answered.
            with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as process:
                process.submit(convert, stored, HEAD, converted).result()
            store.results.put_file(part, converted)
        path = store.results.file(part)
        if path is None:
            return None
    with path.open("rb") as file:
        sha256 = file.read(HEAD).hex()
    return Representation(media_type, b"", sha256, file=path)


class RecentRepresentations:
    """The most recent representations, up to a number of bytes."""

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes, self._bytes = max_bytes, 0
        self._items: OrderedDict[tuple[str, str, str | None], Representation] = OrderedDict()

    def get(self, name: str, media_type: str, coding: str | None = None) -> Representation | None:
        """Return a representation, or None if it is not in memory."""
        key = (name, media_type, coding)
        if key in self._items:
            self._items.move_to_end(key)
        return self._items.get(key)

    def put(self, name: str, item: Representation, coding: str | None = None) -> None:
        """Keep a representation as the answer to requests that accept a coding.

        A large one would displace too many others and is not kept.
        """
        key = (name, item.media_type, coding)
        if item.file is not None or len(item.data) > self._max_bytes // 8 or key in self._items:
            return
        self._items[key] = item
        self._bytes += len(item.data)
        while self._bytes > self._max_bytes:
            _, dropped = self._items.popitem(last=False)
            self._bytes -= len(dropped.data)


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
        if not representation.is_coded:
            return representation
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
                self._files, load, self._store, name, media_type
            )
            loading.add_done_callback(lambda future: self._loaded(key, future))
        return await asyncio.shield(loading)

    def _loaded(self, key: tuple[str, str], future: asyncio.Future[Representation | None]) -> None:
        del self._loading[key]
        if not future.cancelled():
            future.exception()  # those who waited raise it; there may be none left
