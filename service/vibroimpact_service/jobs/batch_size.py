"""Number of chunks in one call of a worker: 0.2 s of them, more where there are many workers.

One process submits all batches, and each takes it a few milliseconds. With batches of a fixed
duration the rate of submission would grow with the number of workers until they wait for it. The
duration therefore grows with the number of workers instead, and the rate stays below `MAX_RATE`.
A user who waits for a share of many workers does not wait longer for it: as many batches end
per second as before.
"""

from __future__ import annotations

import math
from typing import Final

SECONDS: Final = 0.2
"""Duration of a batch with few workers."""
MAX_RATE: Final = 100.0
"""Batches submitted per second, at most, for all workers together."""
_MAX_CHUNKS: Final = 5000
_LAST: Final = 0.25
"""Lower limit of the last batches of a job, as a fraction of the duration for many workers."""


def seconds(workers: int) -> float:
    """Return the duration of a batch where so many are computed at once."""
    return max(SECONDS, workers / MAX_RATE)


def chunks(duration: float, each: float) -> int:
    """Return how many chunks of `each` seconds take that long; at least one."""
    return min(_MAX_CHUNKS, max(1, int(duration / each)))


def size(waiting: int, each: float, workers: int) -> int:
    """Return how many chunks the next batch of a job has.

    Parameters
    ----------
    waiting : int
        Chunks that are left, at least one.
    each : float
        Seconds that one takes.
    workers : int
        Batches that are computed at once.
    """
    most = chunks(seconds(workers), each)
    # The last batches are smaller, so that all workers end at about the same time, but not so
    # small that submitting them takes longer than what they save.
    share = math.ceil(waiting / (2 * max(1, workers)))
    least = chunks(_LAST * workers / MAX_RATE, each)
    return min(waiting, most, max(share, least))
