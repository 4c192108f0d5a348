"""Where compiled kernels are kept: a folder of its own for everything that decides their code.

Numba stamps a compiled function with the file it stands in alone. A function that is compiled
into others may stand elsewhere: once it changes, those would keep the code they had, and a new
version would compute the numbers of an old one. Therefore the name of the folder carries a hash
of the sources of all kernels, of the compilers and of the processor.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final

import llvmlite
import numba
import platformdirs
from llvmlite import binding

KERNELS: Final = Path(__file__).parent
"""The package whose functions are compiled."""
_config: Any = numba.config  # its stubs do not know the variables
_PREFIX: Final = "compiled-"
_USED: Final = "used"  # a file that is touched by each process
WARM: Final = ".warm"
"""Ending of the files that mark what is compiled completely; they vanish with any damaged file."""
_PICKLE_END: Final = b"."
_UNUSED_SECONDS: Final = 30 * 86400.0
"""Time without use after which a folder of some other version, shared by a user, is removed."""


def fingerprint(sources: Path = KERNELS) -> str:
    """Return a hash of all that decides the compiled code of a folder of sources.

    Parameters
    ----------
    sources : Path
        Folder with Python files.
    """
    _choose_processor()
    processor = _config.CPU_NAME or binding.get_host_cpu_name()
    features = _config.CPU_FEATURES
    if features is None and not _config.CPU_NAME:
        features = binding.get_host_cpu_features().flatten()
    parts = [numba.__version__, llvmlite.__version__, processor, features or ""]
    digest = hashlib.sha256("\n".join(parts).encode())
    for file in sorted(sources.glob("*.py")):
        digest.update(f"\n{file.name}\n".encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def folder(package: Path = KERNELS, user: Path | None = None) -> Path | None:
    """Return the folder for the compiled kernels of this version; remove those of others.

    It lies where ``NUMBA_CACHE_DIR`` says or, without it, in the package's folder or, where that
    cannot be written to, among the user's caches. Numba does not even read from a folder that it
    cannot write to: what was compiled into the package's folder, as when an image was built, is
    then copied. Outside the package, several installations may meet: there, others are removed
    after a month without use.

    Parameters
    ----------
    package : Path
        Folder of the sources.
    user : Path, optional
        Folder of the user's caches; default: what the operating system has for it.

    Returns
    -------
    Path or None
        None: nothing can be written, and kernels are compiled anew in each process.
    """
    name = _PREFIX + fingerprint(package)
    inside = package / "__pycache__"
    if not _config.CACHE_DIR and _made(inside / name):
        outdated = [*inside.glob("*.nbi"), *inside.glob("*.nbc")]  # of releases up to 0.1.0
        _remove([*outdated, *_others(inside, name), *_damaged(inside / name)])
        return inside / name
    outside = user or platformdirs.user_cache_path("vibroimpact", appauthor=False)
    if _config.CACHE_DIR:
        outside = Path(_config.CACHE_DIR)
    elif (inside / name).is_dir() and not (outside / name).exists():
        _copy(inside / name, outside / name)
    if not _made(outside / name):
        return None
    oldest = time.time() - _UNUSED_SECONDS
    _remove(other for other in _others(outside, name) if _used(other) < oldest)
    _remove(_damaged(outside / name))
    return outside / name


@contextlib.contextmanager
def kept_in(place: Path) -> Iterator[None]:
    """Let numba keep the functions that are declared meanwhile in a folder."""
    before = _config.CACHE_DIR
    _config.CACHE_DIR = str(place)
    try:
        yield
    finally:
        _config.CACHE_DIR = before


def _choose_processor() -> None:
    """Compile for the processor of this machine where it lacks features that numba is told of.

    ``NUMBA_CPU_NAME`` and ``NUMBA_CPU_FEATURES`` name what all machines have on which an image is
    to run; on one that has less, compiled code would end the process.
    """
    there = binding.get_host_cpu_features()
    told = (_config.CPU_FEATURES or "").split(",")
    if any(each.startswith("+") and not there.get(each[1:]) for each in told):
        _config.CPU_NAME = _config.CPU_FEATURES = None


def _copy(source: Path, place: Path) -> None:
    """Copy a folder as a whole, as far as it is permitted: other processes may be at it."""
    passing = place.with_name(f".{place.name}-{os.getpid()}")
    try:
        shutil.copytree(source, passing, ignore=shutil.ignore_patterns(_USED))
        passing.rename(place)
    except OSError:  # nothing can be written there, or another process was first
        shutil.rmtree(passing, ignore_errors=True)


def _damaged(place: Path) -> list[Path]:
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


def _made(place: Path) -> bool:
    """Make a folder, or take note that it is used; return whether files can be written there."""
    try:
        place.mkdir(parents=True, exist_ok=True)
        (place / _USED).touch()
    except OSError:
        return False
    return True


def _used(place: Path) -> float:
    """Return when a folder was used last."""
    with contextlib.suppress(OSError):
        return (place / _USED).stat().st_mtime
    return 0.0


def _others(parent: Path, name: str) -> list[Path]:
    return [place for place in parent.glob(f"{_PREFIX}*") if place.name != name]


def _remove(places: Iterable[Path]) -> None:
    """Remove files and folders, as far as it is permitted: another process may be at it."""
    for place in places:
        if place.is_dir():
            shutil.rmtree(place, ignore_errors=True)
        else:
            with contextlib.suppress(OSError):
                place.unlink()
