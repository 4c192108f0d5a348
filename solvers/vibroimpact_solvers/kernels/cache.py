"""Where compiled kernels are kept: a folder for each module, named by all that decides its code.

Numba stamps a compiled function with the file it stands in alone, and with its line. A function
that is compiled into others may stand elsewhere: once it changes, those would keep the code they
had, and a new version would compute the numbers of an old one; and a comment would have everything
below it compiled anew. Therefore the folders are named by what code really depends on: one for
compilers, processor and Python, and in it one for each module, by its syntax and that of all it
imports (`sources`). Equal sources share their kernels, wherever they are installed.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import sys
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import llvmlite
import numba
import numpy as np
import platformdirs
import scipy
from llvmlite import binding
from numba.core.caching import UserProvidedCacheLocator

from vibroimpact_solvers.kernels import files
from vibroimpact_solvers.kernels.sources import Sources

KERNELS: Final = Path(__file__).parent
"""The package whose functions are compiled."""
_config: Any = numba.config  # its stubs do not know the variables
_PREFIX: Final = "compiled-"
_FORMER: Final = re.compile(f"{_PREFIX}[0-9a-f]{{16}}")
"""Folders of releases up to 0.2.0, which held the kernels of one state of all sources."""
_DAY: Final = 86400.0
_UNUSED_SECONDS: Final = 30 * _DAY
"""Time without use after which what another installation or compiler may need is removed."""
_OPTIONS: Final = (
    "OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "ENABLE_AVX", "DISABLE_INTEL_SVML", "BOUNDSCHECK",
    "DEBUGINFO_DEFAULT", "LLVM_REFPRUNE_FLAGS", "EXTEND_VARIABLE_LIFETIMES",
)  # fmt: skip
"""Settings of numba that change the code: what is compiled under one must not serve another."""
_seen: dict[Path, dict[str, str]] = {}
"""Fingerprints of modules when this process first asked: it runs the sources of that time."""


def environment() -> str:
    """Return the name of all that decides compiled code besides its sources."""
    _choose_processor()
    processor = _config.CPU_NAME or binding.get_host_cpu_name()
    features = _config.CPU_FEATURES
    if features is None and not _config.CPU_NAME:
        features = binding.get_host_cpu_features().flatten()
    # Tables that are computed with numpy and scipy enter the code as constants.
    parts = [each.__version__ for each in (numba, llvmlite, np, scipy)]
    parts += [processor, features or ""]
    parts += [f"{name}={getattr(_config, name, None)}" for name in _OPTIONS]
    python = f"{sys.implementation.cache_tag}{sys.abiflags}"
    return f"{python}-{hashlib.sha256(chr(10).join(parts).encode()).hexdigest()[:16]}"


def folder(package: Path = KERNELS, user: Path | None = None) -> Path | None:
    """Return the folder for compiled kernels; remove what is of no use any more.

    It lies where ``NUMBA_CACHE_DIR`` says or, without it, in the package's folder or, where that
    cannot be written to, among the user's caches. There, what was compiled into the package's
    folder, as when an image was built, is copied to. In the package's folder, kernels of other
    sources are removed at once, and those of other compilers after a month without use; outside
    of it, several installations may meet, and only what was not used for a month is removed.

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
    name = _PREFIX + environment()
    inside = package / "__pycache__"
    if not _config.CACHE_DIR and files.made(inside / name):
        outdated = [*inside.glob("*.nbi"), *inside.glob("*.nbc")]  # of releases up to 0.1.0
        outdated += [each for each in _others(inside, name) if _FORMER.fullmatch(each.name)]
        present = _read(package, inside / name)
        outdated += [each for each in _modules(inside / name) if each.name not in present]
        files.remove([*outdated, *_unused(inside, name), *files.damaged(inside / name)])
        return inside / name
    outside = user or platformdirs.user_cache_path("vibroimpact", appauthor=False)
    if _config.CACHE_DIR:
        outside = Path(_config.CACHE_DIR)
    if not files.made(outside / name):
        return None
    if not _config.CACHE_DIR:
        files.copy(inside / name, outside / name)
    present = _read(package, outside / name)
    oldest = time.time() - _UNUSED_SECONDS
    old = (each for each in _modules(outside / name) if not _note_use(each, present, oldest))
    files.remove([*old, *_unused(outside, name), *files.damaged(outside / name)])
    return outside / name


def folders(package: Path = KERNELS) -> Mapping[str, str]:
    """Return the names of the folders of modules, by the full names of the modules.

    They are those of the sources that this process runs, whatever has become of the files since.
    """
    if package not in _seen:
        _read(package, folder(package))
    return _seen[package]


@contextlib.contextmanager
def kept_in(place: Path) -> Iterator[None]:
    """Let numba keep the functions that are declared meanwhile in a folder."""
    before = _config.CACHE_DIR, _config.CACHE_LOCATOR_CLASSES
    _config.CACHE_DIR = str(place)
    _config.CACHE_LOCATOR_CLASSES = f"{__name__}.{Locator.__name__}"
    try:
        yield
    finally:
        _config.CACHE_DIR, _config.CACHE_LOCATOR_CLASSES = before


class Locator(UserProvidedCacheLocator):
    """Tells numba where it keeps a function: in the folder of its module, whatever its line."""

    def __init__(self, function: Any, file: str) -> None:
        super().__init__(function, file)  # type: ignore[no-untyped-call]
        self._folder = folders()[function.__module__]
        self._place = Path(_config.CACHE_DIR) / self._folder

    @classmethod
    def from_function(cls, function: Any, file: str) -> Locator:
        """Return the locator of a function; `folder` has found that files can be written."""
        return cls(function, file)

    def get_cache_path(self) -> str:
        """Return the folder."""
        return str(self._place)

    def get_source_stamp(self) -> str:
        """Return what differs once the function does; it is in the name of the folder."""
        return self._folder

    def get_disambiguator(self) -> str:
        """Return what tells functions of one name in one module apart; there are none."""
        return "kernel"


def _read(package: Path, place: Path | None) -> set[str]:
    """Return the names of the folders of all modules, as they are now."""
    sources = Sources(package.parent, place / files.DIGESTS if place else None)
    names = {
        name: f"{name.rpartition('.')[2]}-{fingerprint}"
        for name, fingerprint in sources.fingerprints(package).items()
    }
    _seen.setdefault(package, names)
    return set(names.values())


def _choose_processor() -> None:
    """Compile for the processor of this machine where it lacks features that numba is told of.

    ``NUMBA_CPU_NAME`` and ``NUMBA_CPU_FEATURES`` name what all machines have on which an image is
    to run; on one that has less, compiled code would end the process.
    """
    there = binding.get_host_cpu_features()
    told = (_config.CPU_FEATURES or "").split(",")
    if any(each.startswith("+") and not there.get(each[1:]) for each in told):
        _config.CPU_NAME = _config.CPU_FEATURES = None


def _note_use(place: Path, present: set[str], oldest: float) -> bool:
    """Take note that the folder of a module is used; return whether it was within the time."""
    modified = files.modified(place)
    if place.name in present and modified < time.time() - _DAY:
        with contextlib.suppress(OSError):
            os.utime(place)
    return place.name in present or modified >= oldest


def _modules(place: Path) -> list[Path]:
    """Return the folders of modules."""
    return [each for each in place.iterdir() if each.is_dir()]


def _unused(parent: Path, name: str) -> list[Path]:
    """Return the folders of other compilers that were not used for a month."""
    oldest = time.time() - _UNUSED_SECONDS
    return [place for place in _others(parent, name) if files.modified(place / files.USED) < oldest]


def _others(parent: Path, name: str) -> list[Path]:
    return [place for place in parent.glob(f"{_PREFIX}*") if place.name != name]
