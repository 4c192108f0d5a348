"""Checks of settings, and of what the service needs from its machine."""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
from collections.abc import Iterable
from pathlib import Path

from vibroimpact_service.kinds import KINDS
from vibroimpact_service.operations.checks.check import Check, failed, ok, warning
from vibroimpact_service.settings import renamed, unknown
from vibroimpact_service.use_case.warming import is_warm
from vibroimpact_solvers.kernels import cache

_GB = 1e9


def settings(environment: Iterable[str]) -> list[Check]:
    """Check the names of the variables VIBROIMPACT_…; their values were checked when read."""
    given = list(environment)
    checks = [
        warning("settings", f"there is no setting {name}", "correct or remove it")
        for name in unknown(given)
    ]
    checks += [
        warning("settings", f"{old} has a new name", f"call it {new}")
        for old, new in renamed(given).items()
    ]
    return checks or [ok("settings", "all names and values are valid")]


def data_folder(data: Path) -> Check:
    """Check who can read and write the data folder."""
    name = "data folder"
    try:
        status = data.stat()
    except FileNotFoundError:
        return ok(name, f"{data} does not exist yet; the service makes it")
    except OSError as error:
        return failed(name, f"{data}: {error.strerror}", "give its path to the service's user")
    if not stat.S_ISDIR(status.st_mode):
        return failed(name, f"{data} is not a folder", "name another one with --data")
    if not os.access(data, os.R_OK | os.W_OK | os.X_OK):
        return failed(name, f"{data} cannot be written to", "give it to the service's user")
    mode = stat.S_IMODE(status.st_mode)
    if mode & 0o077:
        return warning(name, f"{data} is open to other users ({mode:04o})", f"chmod 700 {data}")
    return ok(name, f"{data}, for its owner alone")


def temporary_room(needed: int) -> Check:
    """Check the room for temporary files, in which results are assembled."""
    name = "temporary files"
    try:
        place = tempfile.gettempdir()
    except FileNotFoundError:
        return failed(name, "no folder for them can be written to", "name one with TMPDIR")
    free = shutil.disk_usage(place).free
    seen = f"{free / _GB:.1f} GB free in {place}"
    if free < needed:
        return warning(
            name, seen, f"the largest result needs {needed / _GB:.1f} GB: make room, or set TMPDIR"
        )
    return ok(name, seen)


def kernels() -> Check:
    """Check whether all kernels are compiled."""
    name = "kernels"
    place = cache.folder()
    if place is None:
        return warning(
            name,
            "they cannot be kept: each process compiles them anew",
            "name a folder with NUMBA_CACHE_DIR",
        )
    cold = [kind for kind in KINDS if not is_warm(place, kind)]
    if cold:
        return warning(name, f"not compiled yet: {', '.join(cold)}", "run  vibroimpact warm")
    return ok(name, f"compiled, in {place}")
