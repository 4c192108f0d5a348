"""Collection of cyclic garbage waits while large bodies are parsed, and while requests are planned.

The documents of a large body are millions of new objects without a cycle. Python looks at all of
them again and again while they are made: for a million initial states it takes three quarters of
the time. A plan has a tenth of a second of processor time, and the thread in which it runs may be
the one that collects what all others left.
"""

from __future__ import annotations

import gc
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

_LONGEST: Final = 10.0
"""Seconds after which nobody joins a pause, so that it ends however many bodies come."""

_lock = threading.Lock()
_waiting = 0
_began = 0.0


@contextmanager
def waiting() -> Iterator[None]:
    """Collect nothing until the end of the block, in any thread."""
    joined = _join()
    try:
        yield
    finally:
        if joined:
            _leave()


def _join() -> bool:
    """Begin a pause or join the present one; return whether that is so."""
    global _waiting, _began
    with _lock:
        now = time.monotonic()
        if _waiting == 0:
            if not gc.isenabled():
                return False
            _began = now
            gc.disable()
        elif now - _began > _LONGEST:
            return False
        _waiting += 1
        return True


def _leave() -> None:
    global _waiting
    with _lock:
        _waiting -= 1
        if _waiting == 0:
            gc.enable()
