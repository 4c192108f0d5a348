"""A store of immutable blocks by name, in a folder or an object store, with checksums."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import tempfile
import uuid
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from datetime import datetime
from itertools import chain
from pathlib import Path
from typing import IO, Any, NamedTuple

import fsspec
from fsspec.implementations.local import LocalFileSystem

from vibroimpact_service.store import private
from vibroimpact_service.store.faults import (
    Outage,
    StoreFullError,
    StoreUnavailableError,
    bucket_needed,
    fail,
)

_NAME = re.compile(r"[0-9a-z_]{8,80}(\.[0-9a-z]{1,12})?")
HEAD = 32
"""Bytes of the hash before a block."""
_READ_BYTES = 2**20
_MAX_REQUESTS = 32  # requests to an object store at the same time
_LEFTOVER_SECONDS = 3600.0
_MAX_CHECKED = 10_000
_S3_ATTEMPTS = 2
"""How often s3fs makes a request; each time, botocore tries as often as its limits say."""
_S3_LIMITS: dict[str, Any] = {
    # A server that is cut off says nothing. By default, 25 attempts of 5 s would be made, for the
    # whole of which the call of a worker, and its job, would wait for that one worker.
    "config_kwargs": {
        "connect_timeout": 2,
        "read_timeout": 10,
        "retries": {"mode": "standard", "total_max_attempts": 2},
    }
}


class Entry(NamedTuple):
    """A stored block: its name, size in bytes and when it was written, seconds since 1970."""

    name: str
    size: int
    modified: float


class Room(NamedTuple):
    """Bytes of a disk: those that are free for its users, and all."""

    free: int
    total: int


class ContentStore:
    """Blocks by name below a URL that fsspec understands.

    Every block is stored behind its own SHA-256. A block that does not match it is removed and
    treated as absent, so that it is computed again.

    Parameters
    ----------
    url : str
        Folder, or URL of a bucket.
    area : str
        Subfolder of it that this store uses.
    outage : Outage, optional
        What is known of its server.
    """

    def __init__(self, url: str, area: str, outage: Outage | None = None) -> None:
        self._outage = outage or Outage(patient=True)
        # Other processes write too, so listings must not be cached.
        options: dict[str, Any] = {"use_listings_cache": False} if "://" in url else {}
        if url.startswith("s3://"):
            options |= _S3_LIMITS
        self._fs, root = fsspec.core.url_to_fs(url, **options)
        if url.startswith("s3://"):
            self._fs.retries = _S3_ATTEMPTS
        self._local = isinstance(self._fs, LocalFileSystem)
        self._root = f"{root.rstrip('/')}/{area}"
        self._checked: dict[str, tuple[int, int, int]] = {}

    def put(self, name: str, data: bytes, *, durable: bool = True) -> None:
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
            self._put_file(path, digest, [data], durable)
            return
        with bucket_needed(), self._outage.requests():
            self._fs.pipe_file(path, digest + data)

    def _put_file(self, target: str, digest: bytes, data: Iterable[bytes], durable: bool) -> None:
        # Chunks that take some milliseconds to compute are written here.
        folder, name = os.path.split(target)
        temporary = f"{folder}/.{name}.{uuid.uuid4().hex}"
        try:
            with private.open_new(temporary, folder) as file:
                for piece in chain([digest], data):
                    file.write(piece)
                if durable:
                    file.flush()
                    os.fsync(file.fileno())
            os.rename(temporary, target)  # noqa: PTH104 (hot path)
            if durable:
                private.sync_folder(folder)
        except OSError as error:
            with suppress(OSError):
                os.unlink(temporary)  # noqa: PTH108 (hot path)
            fail(error)

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
                with open(path, "rb", buffering=0) as file:  # noqa: PTH123 (hot path)
                    content = file.readall()
            else:
                with self._outage.requests():
                    content = self._fs.cat_file(path)
        except FileNotFoundError:
            return None
        except OSError as error:
            fail(error)
        data = content[32:]
        if hashlib.sha256(data).digest() != content[:32]:
            self.remove(name)
            return None
        return data

    def size(self, name: str) -> int | None:
        """Return the size of a block in bytes, or None; of a store in a folder."""
        try:
            return os.stat(self._path(name)).st_size - HEAD  # noqa: PTH116 (hot path)
        except FileNotFoundError:
            return None
        except OSError as error:
            fail(error)

    def size_of_all(self, names: Sequence[str]) -> int:
        """Return the size in bytes of those of some blocks that are there, in any store."""
        if self._local:
            return sum(self.size(name) or 0 for name in names)
        with ThreadPoolExecutor(_MAX_REQUESTS) as threads:
            return sum(threads.map(self._remote_size, names))

    def _remote_size(self, name: str) -> int:
        with suppress(FileNotFoundError), self._outage.requests():
            return int(self._fs.size(self._path(name))) - HEAD
        return 0

    def file(self, name: str) -> Path | None:
        """Return the file of a block that is too large for memory, or None where there is none.

        The block follows the `HEAD` bytes of its hash. A damaged block is removed. Only a store
        in a folder has files.
        """
        path = Path(self._path(name))
        if not self._local:
            return None
        try:
            status = path.stat()
            version = (status.st_ino, status.st_mtime_ns, status.st_size)
            # Checked once per process: such a file is read piece by piece.
            if self._checked.get(name) == version:
                return path
            with path.open("rb") as file:
                sound = file.read(HEAD) == hashlib.file_digest(file, "sha256").digest()
        except FileNotFoundError:
            return None
        except OSError as error:
            fail(error)
        if not sound:
            self.remove(name)
            return None
        if len(self._checked) >= _MAX_CHECKED:
            self._checked.clear()
        self._checked[name] = version
        return path

    def put_file(self, name: str, source: Path) -> None:
        """Store the content of a file as a block, without reading it into memory; as `put`."""
        with source.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").digest()
            file.seek(0)
            self._put_pieces(name, digest, iter(lambda: file.read(_READ_BYTES), b""), durable=True)

    def _put_pieces(self, name: str, digest: bytes, data: Iterable[bytes], durable: bool) -> None:
        path = self._path(name)
        if self._local:
            self._put_file(path, digest, data, durable)
            return
        with bucket_needed(), self._outage.requests(), self._fs.open(path, "wb") as target:
            target.write(digest)
            for piece in data:
                target.write(piece)

    def copy(self, name: str, target: ContentStore) -> bytes | None:
        """Copy a block to another store, piece by piece.

        A power failure soon after may take the copy away again.

        Returns
        -------
        bytes or None
            Its SHA-256; None where it is absent or damaged: then the other store has none either.

        Raises
        ------
        StoreFullError, StoreUnavailableError
            As `put` and `get`.
        """
        digest = hashlib.sha256()

        def pieces(file: IO[bytes]) -> Iterator[bytes]:
            for piece in iter(lambda: file.read(_READ_BYTES), b""):
                digest.update(piece)
                yield piece

        try:
            with self._opened(name) as file:
                head = file.read(HEAD)
                target._put_pieces(name, head, pieces(file), durable=False)
        except FileNotFoundError:
            return None
        if digest.digest() != head:
            target.remove(name)
            return None
        return head

    @contextmanager
    def _opened(self, name: str) -> Iterator[IO[bytes]]:
        path = self._path(name)
        if not self._local:
            with self._outage.requests(), self._fs.open(path, "rb") as file:
                yield file
            return
        try:
            with open(path, "rb") as file:  # noqa: PTH123
                yield file
        except (FileNotFoundError, StoreFullError, StoreUnavailableError):
            raise
        except OSError as error:
            fail(error)

    def digest(self, name: str) -> bytes | None:
        """Return the SHA-256 of a block, or None where it is absent or damaged; as `readable`."""
        if not self.readable(name):
            return None
        with self._opened(name) as file:
            return file.read(HEAD)

    @contextmanager
    def workspace(self) -> Iterator[Path]:
        """Yield an empty folder, on the disk of a local store, that is removed afterwards.

        Raises
        ------
        StoreFullError
            Where the disk is full.
        """
        beside = Path(self._root) if self._local else None
        try:
            if beside is not None:
                private.folder(beside)
            with tempfile.TemporaryDirectory(prefix=".", dir=beside) as folder:
                yield Path(folder)
        except OSError as error:
            fail(error)

    @property
    def local(self) -> bool:
        """Whether the store is a folder."""
        return self._local

    def room(self) -> Room | None:
        """Return the room of the disk; None of an object store, or before the first block."""
        if not self._local or not os.path.isdir(self._root):  # noqa: PTH112
            return None
        disk = shutil.disk_usage(self._root)
        return Room(disk.free, disk.total)

    def has(self, name: str) -> bool:
        """Whether there is a block of that name, damaged or not."""
        path = self._path(name)
        if self._local:
            return os.path.exists(path)  # noqa: PTH110 (hot path)
        with self._outage.requests():
            return bool(self._fs.exists(path))

    def readable(self, name: str) -> bool:
        """Whether there is an undamaged block of that name; a damaged one is removed."""
        if self._local:
            return self.file(name) is not None
        return self.has(name) and self.get(name) is not None

    def sound(self, names: Sequence[str]) -> set[str]:
        """Return those of some names under which there is an undamaged block."""
        if self._local:
            return {name for name in names if self.readable(name)}
        with ThreadPoolExecutor(_MAX_REQUESTS) as threads:
            stored = threads.map(self.readable, names)
        return {name for name, sound in zip(names, stored, strict=True) if sound}

    def remove(self, name: str) -> None:
        """Remove a block if it is there."""
        path = self._path(name)
        try:
            if self._local:
                os.unlink(path)  # noqa: PTH108 (hot path)
            else:
                with self._outage.requests():
                    self._fs.rm_file(path)
        except FileNotFoundError:
            return
        except OSError as error:
            fail(error)

    def touch(self, name: str) -> None:
        """Make a block count as new; without effect in an object store."""
        if self._local:
            with suppress(OSError):  # retention may remove it earlier: no harm
                os.utime(self._path(name))

    def entries(self) -> Iterator[Entry]:
        """Yield all blocks."""
        if self._local:
            yield from self._files()
            return
        with self._outage.requests():
            blocks = self._fs.find(self._root, detail=True)
        for path, details in blocks.items():
            modified = details.get("LastModified") or details.get("created")
            seconds = modified.timestamp() if isinstance(modified, datetime) else 0.0
            yield Entry(path.rsplit("/", 1)[1], int(details["size"]), seconds)

    def _files(self) -> Iterator[Entry]:
        for path in Path(self._root).glob("*/*"):
            try:
                status = path.stat()
            except FileNotFoundError:
                continue
            if _NAME.fullmatch(path.name):
                yield Entry(path.name, status.st_size, status.st_mtime)

    def remove_leftovers(self, now: float) -> None:
        """Remove temporary files and folders of writers that died."""
        if not self._local:
            return
        for path in Path(self._root).glob("*/.*"):
            try:
                if now - path.stat().st_mtime > _LEFTOVER_SECONDS:
                    path.unlink()
            except FileNotFoundError:
                continue
        for folder in Path(self._root).glob(".*"):
            try:
                # Writing to a file in a folder does not change the time of the folder.
                newest = max(each.stat().st_mtime for each in (folder, *folder.iterdir()))
            except FileNotFoundError:
                continue
            if now - newest > _LEFTOVER_SECONDS:
                shutil.rmtree(folder, ignore_errors=True)

    def _path(self, name: str) -> str:
        if not _NAME.fullmatch(name):
            raise ValueError(f"{name!r} is not a name of a block")
        return f"{self._root}/{name[:2]}/{name}"
