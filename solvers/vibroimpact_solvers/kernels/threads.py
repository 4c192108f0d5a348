"""Runs a kernel on pieces of its range at once: kernels release the GIL."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Final

WORTH: Final = 4e6
"""Elementary steps, of a nanosecond or so, below which threads would not pay."""


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
    threads = min(cores(), size, int(work / WORTH) + 1)
    if threads <= 1:
        piece(0, size)
        return
    bounds = [size * k // threads for k in range(threads + 1)]
    # A pool of its own, as one that is kept would not survive a fork.
    with ThreadPoolExecutor(threads) as pool:
        pieces = [pool.submit(piece, *bound) for bound in itertools.pairwise(bounds)]
        for done in pieces:
            done.result()


def cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
