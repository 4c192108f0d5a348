"""Limits of memory and processor time that the operating system keeps for a whole process."""

from __future__ import annotations

import math
import os
import resource
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

from vibroimpact_solvers import meter

_AT_ONCE: Final = 2
"""Calls that a worker executes at the same time."""
_MARGIN_SECONDS: Final = 60.0
_LATE_SECONDS: Final = 5.0
_LOOK_SECONDS: Final = 0.5
_SHARED: Final = 0.8
LEAST_MEMORY: Final = 2**30
"""Bytes that a worker is given wherever nothing else is said."""
_CONTAINER: Final = Path("/sys/fs/cgroup/memory.max")


def machine_memory() -> int:
    """Return the memory of the machine, or of the container, bytes."""
    whole = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    try:
        return min(whole, int(_CONTAINER.read_text()))
    except (OSError, ValueError):  # there is none, or it is "max"
        return whole


def worker_memory(given: int | None, workers: int) -> int:
    """Return the memory of one of some worker processes of this machine, bytes.

    Unless it is given, they share most of what there is, and leave the rest to the service.
    """
    if given is not None:
        return given
    whole = machine_memory()
    return max(LEAST_MEMORY, int(min(_SHARED * whole / workers, 0.5 * whole)))


def limit_memory(limit: int | None) -> None:
    """Let requests for memory beyond a limit fail, with `MemoryError` or the end of the process.

    What counts is memory that the process may write to and does not share, used or not.
    """
    if limit is not None:
        _, most = resource.getrlimit(resource.RLIMIT_DATA)
        bound = limit if most == resource.RLIM_INFINITY else min(limit, most)
        resource.setrlimit(resource.RLIMIT_DATA, (bound, most))
        meter.limit_memory(bound)


class _Allowed(NamedTuple):
    """What a thread may do until it is ended with its process."""

    clock: int
    """Of its processor time."""
    end: float
    name: str


_allowed: Final[dict[int, _Allowed]] = {}
"""Thread -> what it may do."""
_watching: Final[list[threading.Thread]] = []
_limits: Final[dict[int, int]] = {}
"""Process -> the limit that it has set itself, in seconds of its processor time."""


def limit_call(name: str, seconds: float, tell: Callable[[str], None] | None = None) -> None:
    """End this process where this thread takes more processor time, some seconds after that.

    For loops that do not look at their signal, but let other threads run; the operating system
    ends the process for those that do not.

    Parameters
    ----------
    name : str
        Of what the thread does.
    seconds : float
        From now on.
    tell : callable, optional
        Called with the name a moment before the end.
    """
    limit_processor_time(seconds)
    if not hasattr(time, "pthread_getcpuclockid"):
        return
    thread = threading.get_ident()
    end = time.thread_time() + seconds + _LATE_SECONDS
    _allowed[thread] = _Allowed(time.pthread_getcpuclockid(thread), end, name)
    if not _watching:
        watch = threading.Thread(target=_watch, args=(tell,), name="processor time", daemon=True)
        _watching.append(watch)
        watch.start()


def call_ended() -> None:
    """Let this thread do anything again."""
    _allowed.pop(threading.get_ident(), None)


def _watch(tell: Callable[[str], None] | None) -> None:
    while True:
        time.sleep(_LOOK_SECONDS)
        for thread, allowed in list(_allowed.items()):
            late = time.clock_gettime(allowed.clock) > allowed.end
            if late and _allowed.get(thread) is allowed:
                if tell is not None:
                    tell(allowed.name)
                    time.sleep(_LOOK_SECONDS)
                os.kill(os.getpid(), signal.SIGXCPU)


def limit_processor_time(seconds: float) -> None:
    """Have the operating system end this process where calls take far more processor time.

    That is for loops that do not look at their signal. The limit is raised by later calls.
    """
    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    # Two calls at the same time, and a margin for what the signal should have noticed.
    needed = math.ceil(time.process_time() + _AT_ONCE * seconds + _MARGIN_SECONDS)
    # One that came from the parent is about the parent's time.
    needed = max(needed, _limits.get(os.getpid(), 0))
    if hard != resource.RLIM_INFINITY:
        needed = min(needed, hard)
    resource.setrlimit(resource.RLIMIT_CPU, (needed, hard))
    _limits[os.getpid()] = needed
