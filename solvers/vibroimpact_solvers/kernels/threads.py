"""Threads that run a kernel on pieces of its range in parallel: kernels release the GIL."""

from __future__ import annotations

import itertools
import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Final

WORTH: Final = 4e6
"""Elementary steps, of a nanosecond or so, below which threads would not pay."""

_kept: list[ThreadPoolExecutor] = []
_keeping = threading.Lock()
_here = threading.local()


def over_ranges(piece: Callable[[int, int], object], size: int, work: float) -> None:
    """Call ``piece(start, stop)`` for ranges that cover ``0 ... size``.

    Parameters
    ----------
    piece : callable
        Computes one range, in any thread.
    size : int
        Length of the range.
    work : float
        Elementary steps of all of it; little work stays in the calling thread.
    """
    threads = min(size, int(work / WORTH) + 1)
    if threads > 1:
        threads = min(threads, cores())
    if threads <= 1 or getattr(_here, "kept", False):  # a thread of the pool must not wait for it
        piece(0, size)
        return
    bounds = [size * k // threads for k in range(threads + 1)]
    own, *others = itertools.pairwise(bounds)
    pieces = [_pool().submit(piece, *bound) for bound in others]
    try:
        piece(*own)
    finally:
        wait(pieces)  # they write into arrays of the caller
    for done in pieces:
        done.result()


def _pool() -> ThreadPoolExecutor:
    """Return the pool that all callers share: starting new threads takes as long as a kernel."""
    with _keeping:
        if not _kept:
            _kept.append(ThreadPoolExecutor(max(1, cores() - 1), "kernels", _note))
        return _kept[0]


def _note() -> None:
    _here.kept = True


def _forget() -> None:
    """Drop the pool after a fork: its threads exist in the parent process only."""
    global _keeping  # it may have been held there
    _keeping = threading.Lock()
    _kept.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)


def cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
