"""Folders and files that only the user of the service can read, whatever the umask is."""

from __future__ import annotations

import fcntl
import os
from io import BufferedWriter
from pathlib import Path
from typing import IO


def folder(path: Path) -> None:
    """Make a folder, and those above that are missing, with access for its owner alone."""
    try:
        path.mkdir(mode=0o700, exist_ok=True)
    except FileNotFoundError:
        folder(path.parent)
        path.mkdir(mode=0o700, exist_ok=True)


def opener(path: str, flags: int) -> int:
    """Open a file with access for its owner alone where it is new; `opener` of `open`."""
    return os.open(path, flags, 0o600)


def locked(path: Path) -> IO[str]:
    """Return a file that no other process locks until it is closed or this process ends.

    Raises
    ------
    BlockingIOError
        Where another process does.
    """
    handle = open(path, "w", opener=opener)  # noqa: SIM115
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        handle.close()
        raise
    return handle


def open_new(path: str, parent: str) -> BufferedWriter:
    """Open a new file to be written, in a folder that is made where it is missing."""
    try:
        return open(path, "xb", opener=opener)
    except FileNotFoundError:
        folder(Path(parent))
        return open(path, "xb", opener=opener)


def sync_folder(path: str) -> None:
    """Make the names of the files in a folder durable."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
