"""A store of immutable blocks by name, in a folder or an object store, checked when read."""

from __future__ import annotations

import errno
import hashlib
import os
import re
import shutil
import tempfile
import uuid
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from datetime import datetime
from itertools import chain, count
from pathlib import Path
from typing import IO, Any, Final, NamedTuple

import fsspec
from fsspec.implementations.local import LocalFileSystem

_NAME = re.compile(r"[0-9a-z_]{8,80}(\.[0-9a-z]{1,12})?")
HEAD = 32
"""Bytes of the hash before a block."""
_PIECE = 2**20
_AT_ONCE = 32  # questions to an object store under way at once
_BROKEN_OFF_SECONDS = 3600.0


class StoreFullError(OSError):
    """The store has no room for another block."""


class StoreUnavailableError(ConnectionError):
    """The store cannot be reached, or refuses."""


class Entry(NamedTuple):
    """A stored block: its name, size in bytes and when it was written, seconds since 1970."""

    name: str
    size: int
    modified: float


class ContentStore:
    """Blocks by name below a URL that fsspec understands.

    Every block is stored behind its own SHA-256; one that does not match it any more is
    removed and treated as absent, so that it is computed again.

    Parameters
    ----------
    url : str
        Folder, or URL of a bucket.
    area : str
        Name of the part of it that this store uses.
    durable : bool
        Whether a block must survive a power failure once `put` returned.
    """

    def __init__(self, url: str, area: str, *, durable: bool = True) -> None:
        # Other processes write too: what was listed once must not be believed for ever.
        options: dict[str, Any] = {"use_listings_cache": False} if "://" in url else {}
        self._fs, root = fsspec.core.url_to_fs(url, **options)
        self._local = isinstance(self._fs, LocalFileSystem)
        self._root = f"{root.rstrip('/')}/{area}"
        self._durable = durable
        self._checked: dict[str, tuple[int, int, int]] = {}

    def put(self, name: str, data: bytes, *, durable: bool | None = None) -> None:
        """Store a block; readers see all of it or nothing.

        With `durable` false, a power failure soon after may take it away again.

        Raises
        ------
        StoreFullError
            Where there is no room.
        StoreUnavailableError
            Where the store cannot be reached.
        """
        path = self._path(name)
        digest = hashlib.sha256(data).digest()
        if self._local:
            durable = self._durable if durable is None else durable
            self._put_file(path, digest, [data], durable)
            return
        with _reaching():
            try:
                self._fs.pipe_file(path, digest + data)
            except FileNotFoundError as error:  # there is no such bucket
                raise StoreUnavailableError(errno.ENOENT, "there is no such store") from error

    def _put_file(self, target: str, digest: bytes, data: Iterable[bytes], durable: bool) -> None:
        # In plain calls of the system: chunks of some milliseconds are written by it.
        folder, name = os.path.split(target)
        passing = f"{folder}/.{name}.{_passing_name()}"
        try:
            handle = _open_new(passing, folder)
            try:
                for piece in chain([digest], data):
                    _write(handle, piece)
                if durable:
                    os.fsync(handle)
            finally:
                os.close(handle)
            os.rename(passing, target)  # noqa: PTH104 (hot path)
            if durable:
                _sync_folder(folder)
        except OSError as error:
            Path(passing).unlink(missing_ok=True)
            if error.errno in (errno.ENOSPC, errno.EDQUOT):
                raise StoreFullError(error.errno, "the store is full") from error
            raise

    def get(self, name: str) -> bytes | None:
        """Return a block, or None where it is absent or damaged.

        Raises
        ------
        StoreUnavailableError
            Where the store cannot be reached.
        """
        path = self._path(name)
        try:
            if self._local:
                content = _read(path)
            else:
                with _reaching():
                    content = self._fs.cat_file(path)
        except FileNotFoundError:
            return None
        data = content[32:]
        if hashlib.sha256(data).digest() != content[:32]:
            self.remove(name)
            return None
        return data

    def size(self, name: str) -> int | None:
        """Return the bytes of a block, or None where there is none; of a store in a folder."""
        try:
            return os.stat(self._path(name)).st_size - HEAD  # noqa: PTH116 (hot path)
        except FileNotFoundError:
            return None

    def file(self, name: str) -> Path | None:
        """Return the file of a block, for those too large for memory; None where there is none.

        The block begins behind the `HEAD` bytes of its hash. A damaged one is removed. Only a
        store in a folder has files.
        """
        path = Path(self._path(name))
        if not self._local or not path.exists():
            return None
        about = path.stat()
        mark = (about.st_ino, about.st_mtime_ns, about.st_size)
        # Read through once per process: such a file is asked for piece by piece.
        if self._checked.get(name) != mark:
            with path.open("rb") as file:
                head = file.read(HEAD)
                if _hash(file).digest() != head:
                    self.remove(name)
                    return None
            self._checked[name] = mark
        return path

    def put_file(self, name: str, source: Path) -> None:
        """Store the content of a file as a block, without having it in memory; as `put`."""
        path = self._path(name)
        with source.open("rb") as file:
            digest = _hash(file).digest()
            file.seek(0)
            pieces = iter(lambda: file.read(_PIECE), b"")
            if self._local:
                self._put_file(path, digest, pieces, self._durable)
                return
            with _reaching(), self._fs.open(path, "wb") as target:
                target.write(digest)
                for piece in pieces:
                    target.write(piece)

    @contextmanager
    def workspace(self) -> Iterator[Path]:
        """Yield an empty folder, on the disk of a local store, that is removed afterwards.

        Raises
        ------
        StoreFullError
            Where what is done in it finds no room.
        """
        beside = Path(self._root) if self._local else None
        if beside is not None:
            beside.mkdir(parents=True, exist_ok=True)
        try:
            with tempfile.TemporaryDirectory(prefix=".", dir=beside) as folder:
                yield Path(folder)
        except OSError as error:
            if error.errno in (errno.ENOSPC, errno.EDQUOT):
                raise StoreFullError(error.errno, "the store is full") from error
            raise

    @property
    def local(self) -> bool:
        """Whether the store is a folder."""
        return self._local

    def has(self, name: str) -> bool:
        """Whether there is a block of that name, sound or not."""
        path = self._path(name)
        if self._local:
            return os.path.exists(path)  # noqa: PTH110 (hot path)
        with _reaching():
            return bool(self._fs.exists(path))

    def sound(self, name: str) -> bool:
        """Whether there is a block of that name that can be read; a damaged one is removed."""
        if self._local:
            return self.file(name) is not None
        return self.has(name) and self.get(name) is not None

    def present(self, names: Sequence[str]) -> set[str]:
        """Return those of some names under which there is a block."""
        if self._local:
            return {name for name in names if self.has(name)}
        with ThreadPoolExecutor(_AT_ONCE) as threads:
            there = list(threads.map(self.has, names))
        return {name for name, found in zip(names, there, strict=True) if found}

    def remove(self, name: str) -> None:
        """Remove a block if it is there."""
        path = self._path(name)
        try:
            if self._local:
                os.unlink(path)  # noqa: PTH108 (hot path)
            else:
                with _reaching():
                    self._fs.rm_file(path)
        except FileNotFoundError:
            return

    def touch(self, name: str) -> None:
        """Make a block count as new, where the store can do that."""
        if self._local:
            try:
                os.utime(self._path(name))
            except FileNotFoundError:
                return

    def entries(self) -> Iterator[Entry]:
        """Yield all blocks."""
        if self._local:
            yield from self._files()
            return
        with _reaching():
            found = self._fs.find(self._root, detail=True)
        for path, about in found.items():
            modified = about.get("LastModified") or about.get("created")
            seconds = modified.timestamp() if isinstance(modified, datetime) else 0.0
            yield Entry(path.rsplit("/", 1)[1], int(about["size"]), seconds)

    def _files(self) -> Iterator[Entry]:
        for path in Path(self._root).glob("*/*"):
            try:
                about = path.stat()
            except FileNotFoundError:
                continue
            if _NAME.fullmatch(path.name):
                yield Entry(path.name, about.st_size, about.st_mtime)

    def tidy(self, now: float) -> None:
        """Remove what writers that died halfway left behind."""
        if not self._local:
            return
        for path in Path(self._root).glob("*/.*"):
            try:
                if now - path.stat().st_mtime > _BROKEN_OFF_SECONDS:
                    path.unlink()
            except FileNotFoundError:
                continue
        for folder in Path(self._root).glob(".*"):
            try:
                # A folder does not get younger when files in it are written on.
                newest = max(each.stat().st_mtime for each in (folder, *folder.iterdir()))
            except FileNotFoundError:
                continue
            if now - newest > _BROKEN_OFF_SECONDS:
                shutil.rmtree(folder, ignore_errors=True)

    def _path(self, name: str) -> str:
        if not _NAME.fullmatch(name):
            raise ValueError(f"{name!r} is not a name of the store")
        return f"{self._root}/{name[:2]}/{name}"


def _hash(file: IO[bytes]) -> hashlib._Hash:
    """Return the hash of the rest of a file."""
    text = hashlib.sha256()
    for piece in iter(lambda: file.read(_PIECE), b""):
        text.update(piece)
    return text


_SEPARATE: Final = uuid.uuid4().hex
_counted = count()


def _passing_name() -> str:
    """Return a name that no writer uses at the same time, of this machine or another."""
    return f"{_SEPARATE}-{os.getpid()}-{next(_counted)}"  # forked processes share the first part


def _open_new(path: str, folder: str) -> int:
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
    try:
        return os.open(path, flags, 0o666)
    except FileNotFoundError:
        Path(folder).mkdir(parents=True, exist_ok=True)
        return os.open(path, flags, 0o666)


def _write(handle: int, data: bytes) -> None:
    rest = memoryview(data)
    while rest:
        rest = rest[os.write(handle, rest) :]


def _read(path: str) -> bytes:
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    with os.fdopen(handle, "rb", buffering=0) as file:
        return file.readall()


def _sync_folder(folder: str) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextmanager
def _reaching() -> Iterator[None]:
    """Turn whatever an object store raises into one error of our own."""
    try:
        yield
    except (FileNotFoundError, StoreUnavailableError):
        raise
    except Exception as error:
        reason = f"the store cannot be reached: {type(error).__name__}"
        raise StoreUnavailableError(errno.EIO, reason) from error
