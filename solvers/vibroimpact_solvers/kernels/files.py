"""Files of compiled kernels: copied whole, found damaged, removed while others may be at them."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Final

USED: Final = "used"
"""A file that is touched by each process that uses a folder."""
DIGESTS: Final = "sources.json"
"""The file in which `sources` keeps what it has parsed."""
WARM: Final = ".warm"
"""Ending of the files that say what is compiled completely; they vanish with any damaged file."""
_COMPILED: Final = {".nbi", ".nbc"}
_PICKLE_END: Final = b"."


def made(place: Path) -> bool:
    """Make a folder, or take note that it is used; return whether files can be written there."""
    try:
        place.mkdir(parents=True, exist_ok=True)
        (place / USED).touch()
    except OSError:
        return False
    return True


def modified(path: Path) -> float:
    """Return when a file or folder was modified last."""
    with contextlib.suppress(OSError):
        return path.stat().st_mtime
    return 0.0


def copy(source: Path, place: Path) -> None:
    """Copy the files that a folder lacks, each as a whole: other processes may be at it.

    Of a kernel, the code comes before the index that names it, and marks come last.
    """
    for file in (*sorted(source.glob("*/*")), source / DIGESTS, *source.glob(f"*{WARM}")):
        target = place / file.relative_to(source)
        if target.exists() or not (file.suffix not in _COMPILED or _ends(file)):
            continue
        passing = target.with_name(f".{target.name}-{os.getpid()}")
        try:
            target.parent.mkdir(exist_ok=True)
            shutil.copyfile(file, passing)
            passing.replace(target)
        except OSError:  # there is none, nothing can be written, or no room is left
            with contextlib.suppress(OSError):
                passing.unlink()


def damaged(place: Path) -> list[Path]:
    """Return the files that a crash of the machine cut short, and with them all marks.

    Numba would fail to read them, again and again. It writes each as a whole, but does not wait
    until it is on disk.
    """
    files = [file for pattern in ("*/*.nbi", "*/*.nbc") for file in place.glob(pattern)]
    damaged = [file for file in files if not _ends(file)]
    return [*damaged, *place.glob(f"*{WARM}")] if damaged else []


def _ends(file: Path) -> bool:
    """Whether a pickled object in a file is there to its end."""
    try:
        with file.open("rb") as content:
            content.seek(-1, os.SEEK_END)
            return content.read() == _PICKLE_END
    except FileNotFoundError:  # another process removed it
        return True
    except OSError:
        return False


def remove(places: Iterable[Path]) -> None:
    """Remove files and folders, as far as it is permitted: another process may be at it."""
    for place in places:
        if place.is_dir():
            shutil.rmtree(place, ignore_errors=True)
        else:
            with contextlib.suppress(OSError):
                place.unlink()
