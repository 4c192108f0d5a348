"""Which kernels there are, which are not compiled yet, and about how long compiling them takes."""

from __future__ import annotations

import functools
import importlib
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from numba.core import event

from vibroimpact_solvers.kernels import cache

SECONDS: Final = {
    "rigid_motion.follow": 50.0,
    "switchings.follow": 50.0,
    "families.solutions": 14.0,
    "taylor.follow": 9.0,
    "orbit_sums.integrate": 6.0,
    "bands.survey": 5.0,
    "impact_equations.set_equations": 4.9,
    "floquet.zeros": 3.9,
    "path_check.check": 2.9,
    "limit_check.check_limits": 2.7,
    "motions.coordinates": 2.1,
    "response._response_one": 1.9,
}
"""Processor time [s] of compiling the kernels that take longest, on a Xeon of 2.1 GHz."""
_OTHER_SECONDS: Final = 0.6
_NOTICED_SECONDS: Final = 2.0
"""Time from which on a kernel is worth a line of its own."""


def kernels() -> dict[str, Any]:
    """Return all functions that are compiled for Python to call: ``"module.function"`` -> each.

    Their modules are imported.
    """
    declared: dict[str, Any] = {}
    for module in cache.folders():
        content = vars(importlib.import_module(module))
        declared |= {_name(each): each for each in content.values() if _is_kernel(each, module)}
    return declared


def missing() -> list[str]:
    """Return the names of the kernels that are not on disk: they would be compiled when called."""
    return [name for name, each in kernels().items() if not _is_kept(each)]


def estimate(names: Iterable[str], cores: int = 1) -> float:
    """Return about how many seconds compiling some kernels takes, in processes on some cores."""
    seconds = [SECONDS.get(name, _OTHER_SECONDS) for name in names]
    return max([sum(seconds) / cores, *seconds])


def notice(seconds: float) -> str:
    """Return the line that tells whoever waits what for, and about how long."""
    return f"compiling kernels, about {max(1, round(seconds))} s, once"


class Announcing(event.Listener):
    """Says that a kernel is being compiled: the first one, and each that takes long.

    Parameters
    ----------
    say : callable
        Takes the line.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say, self._silent = say, True

    def on_start(self, event: event.Event) -> None:
        """Say it where a kernel begins to be compiled; one that is read from disk does not."""
        function = event.data["dispatcher"]
        if _is_kernel(function, function.py_func.__module__):
            seconds = estimate([_name(function)])
            if self._silent or seconds >= _NOTICED_SECONDS:
                self._silent = False
                self._say(notice(seconds))

    def on_end(self, event: event.Event) -> None:
        """Do nothing."""


@contextmanager
def announced() -> Iterator[None]:
    """Say on standard error what is compiled meanwhile."""
    with event.install_listener("numba:compile", _on_stderr()):
        yield


@functools.cache
def _on_stderr() -> Announcing:
    def say(line: str) -> None:
        # Looked up for each line: progress bars put another stream in its place.
        sys.stderr.write(f"{line}\n")
        sys.stderr.flush()

    return Announcing(say)


def _is_kernel(function: Any, module: str) -> bool:
    """Whether something in a module is a function of it that Python calls, kept on disk."""
    return (
        getattr(function, "__module__", None) == module
        and module in cache.folders()
        and "no_cpython_wrapper" not in getattr(function, "targetoptions", ("no_cpython_wrapper",))
    )


def _name(function: Any) -> str:
    return f"{function.__module__.rpartition('.')[2]}.{function.__qualname__}"


def _is_kept(function: Any) -> bool:
    place = function.stats.cache_path
    return place is not None and any(Path(place).glob(f"{_name(function)}-*.nbi"))
