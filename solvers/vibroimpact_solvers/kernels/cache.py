"""Where compiled kernels are kept: a folder of its own for everything that decides their code.

Numba stamps a compiled function with the file it stands in alone. A function that is compiled
into others may stand elsewhere: once it changes, those would keep the code they had, and a new
version would compute the numbers of an old one. Therefore the name of the folder carries a hash
of the sources of all kernels, of the compilers and of the processor.
"""

from __future__ import annotations

import contextlib
import hashlib
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
_UNUSED_SECONDS: Final = 30 * 86400.0
"""Time without use after which a folder of some other version, shared by a user, is removed."""


def fingerprint(sources: Path = KERNELS) -> str:
    """Return a hash of all that decides the compiled code of a folder of sources.

    Parameters
    ----------
    sources : Path
        Folder with Python files.
    """
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
    cannot be written to, among the user's caches. Outside the package, several installations may
    meet: there, others are removed after a month without use.

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
        _remove([*outdated, *_others(inside, name)])
        return inside / name
    outside = user or platformdirs.user_cache_path("vibroimpact", appauthor=False)
    if _config.CACHE_DIR:
        outside = Path(_config.CACHE_DIR)
    if not _made(outside / name):
        return None
    oldest = time.time() - _UNUSED_SECONDS
    _remove(other for other in _others(outside, name) if _used(other) < oldest)
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
