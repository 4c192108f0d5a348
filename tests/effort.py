"""Processor time in units of a fixed piece of work, slowed down by a busy machine just as much."""

from __future__ import annotations

import time
from collections.abc import Callable

PIECE_SECONDS = 0.012
"""Time of `piece` on the processor of which limits in seconds are meant, when it is idle."""


def piece() -> float:
    """Return the processor time of a fixed piece of work.

    It is longer on a slow processor, and on one whose caches or other thread are busy.
    """
    began, table = time.thread_time(), {}
    for i in range(100_000):
        table[i % 1000] = (i, str(i))
    return time.thread_time() - began


def usual(work: Callable[[], float]) -> float:
    """Return the processor time that some work would take on the usual processor.

    `work` does it and returns the processor time that it took; a piece is done before and after.
    """
    before, seconds, after = piece(), work(), piece()
    return seconds * PIECE_SECONDS / max(before, after, PIECE_SECONDS)


def least(work: Callable[[], float], limit: float, attempts: int = 5) -> float:
    """Return the smallest usual time of some attempts.

    Others on this machine disturb them, and nothing makes work quicker than it is: no more are
    made after one that took no longer than the limit.
    """
    found = usual(work)
    for _ in range(attempts - 1):
        if found <= limit:
            break
        found = min(found, usual(work))
    return found
