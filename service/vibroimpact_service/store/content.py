"""A store of immutable blocks by name, in a folder or an object store, checked when read."""

from __future__ import annotations

import errno
import hashlib
import os
import re
import uuid
from pathlib import Path

import fsspec
from fsspec.implementations.local import LocalFileSystem

_NAME = re.compile(r"[0-9a-z_]{8,80}(\.[0-9a-z]{1,12})?")


class StoreFullError(OSError):
    """The store has no room for another block."""


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
    """

    def __init__(self, url: str, area: str) -> None:
        self._fs, root = fsspec.core.url_to_fs(url)
        self._root = f"{root.rstrip('/')}/{area}"

    def put(self, name: str, data: bytes) -> None:
        """Store a block; readers see all of it or nothing.

        Raises
        ------
        StoreFullError
            Where there is no room.
        """
        path = self._path(name)
        content = hashlib.sha256(data).digest() + data
        if not isinstance(self._fs, LocalFileSystem):
            self._fs.pipe_file(path, content)
            return
        target = Path(path)
        passing = target.with_name(f".{target.name}.{uuid.uuid4().hex}")
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            passing.write_bytes(content)
            passing.replace(target)
        except OSError as error:
            passing.unlink(missing_ok=True)
            if error.errno in (errno.ENOSPC, errno.EDQUOT):
                raise StoreFullError(error.errno, "the store is full") from error
            raise

    def get(self, name: str) -> bytes | None:
        """Return a block, or None where it is absent or damaged."""
        path = self._path(name)
        try:
            content: bytes = self._fs.cat_file(path)
        except FileNotFoundError:
            return None
        data = content[32:]
        if hashlib.sha256(data).digest() != content[:32]:
            self.remove(name)
            return None
        return data

    def has(self, name: str) -> bool:
        """Whether there is a block of that name."""
        if isinstance(self._fs, LocalFileSystem):
            return os.path.exists(self._path(name))  # noqa: PTH110 (hot path)
        return bool(self._fs.exists(self._path(name)))

    def remove(self, name: str) -> None:
        """Remove a block if it is there."""
        try:
            self._fs.rm_file(self._path(name))
        except FileNotFoundError:
            return

    def _path(self, name: str) -> str:
        if not _NAME.fullmatch(name):
            raise ValueError(f"{name!r} is not a name of the store")
        return f"{self._root}/{name[:2]}/{name}"
