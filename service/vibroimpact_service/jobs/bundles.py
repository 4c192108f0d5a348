"""How many chunks a call computes: a fifth of a second of them, more where workers are many.

One process hands out all bundles. With bundles of a fixed length it would have twice as much to
do for twice as many workers, and beyond some number of them they would wait for it; so bundles
become longer instead, and it hands out as many in a second as before. Whoever waits for a share
of many workers does not wait much longer for it: with as many bundles a second one ends as soon.
"""

from __future__ import annotations

import math
from typing import Final

SECONDS: Final = 0.2
"""Of a bundle, where the workers are few."""
HANDED: Final = 100.0
"""Bundles per second that are handed out at most, all workers together: each takes the process
that does it a few milliseconds."""
_LARGEST: Final = 5000
_LAST: Final = 0.25
"""Share of the usual length below which bundles of many workers do not fall towards the end."""


def seconds(slots: int) -> float:
    """Return how long a bundle should take where so many are computed at once."""
    return max(SECONDS, slots / HANDED)


def chunks(length: float, each: float) -> int:
    """Return how many chunks of a length take so many seconds; at least one."""
    return min(_LARGEST, max(1, int(length / each)))


def size(waiting: int, each: float, slots: int) -> int:
    """Return how many chunks the next bundle of a job has.

    Parameters
    ----------
    waiting : int
        Chunks that are left, at least one.
    each : float
        Seconds of one.
    slots : int
        Bundles that are computed at once.
    """
    most = chunks(seconds(slots), each)
    # Towards the end smaller ones, so that all workers end at about the same time, but not so
    # small that handing them out takes longer than what they save.
    share = math.ceil(waiting / (2 * max(1, slots)))
    least = chunks(_LAST * slots / HANDED, each)
    return min(waiting, most, max(share, least))
