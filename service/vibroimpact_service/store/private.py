"""Folders and files that only the user of the service can read, whatever the umask is."""

from __future__ import annotations

import os
from pathlib import Path


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
