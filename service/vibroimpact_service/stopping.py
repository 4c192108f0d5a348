"""The end of a process after it was told to stop, whatever hangs in it."""

from __future__ import annotations

import faulthandler
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

import structlog

log = structlog.get_logger("vibroimpact.stopping")

_SECONDS: Final = 9.0
"""From the signal to the end, at most: 10 s are promised."""
_LAST_SECONDS: Final = 9.7
"""The same for a process whose interpreter stands still."""


def begin(seconds: float = _SECONDS, last: float = _LAST_SECONDS) -> None:
    """Have this process, and those that it started, end within some seconds.

    What was answered is durable, and files appear whole or not at all: nothing is lost where it
    does not end by itself.
    """
    timer = threading.Timer(seconds, _end)
    timer.daemon = True
    timer.start()
    # Needs no interpreter, and tells where each thread hangs.
    faulthandler.dump_traceback_later(last, exit=True)


def _end() -> None:
    # Each file that is read gives way to the other threads, for 5 ms: too long for hundreds.
    sys.setswitchinterval(1e-6)
    log.warning("something hangs: the process ends without it")
    for process in _descendants(os.getpid()):
        with suppress(OSError):
            os.kill(process, signal.SIGKILL)  # those that stand still too
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)


def _descendants(process: int) -> Iterator[int]:
    """Yield the processes that a process started, and theirs; none where there is no /proc."""
    children: dict[int, list[int]] = {}
    for file in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError, ValueError, IndexError):
            parent = int(file.read_text().rpartition(")")[2].split()[1])
            children.setdefault(parent, []).append(int(file.parent.name))
    left = [process]
    while left:
        own = children.get(left.pop(), [])
        yield from own
        left += own
