"""The engine with more workers than there are here: a simulated study of its own rules.

Chunks, bundles of a fifth of a second, bundles given ahead, one scheduler that hands them out
one after the other. The rules and numbers are those of `vibroimpact_service.jobs`; the times of
the scheduler are those that `vibroimpact bench service` measures here.
"""

from __future__ import annotations

import heapq
from typing import Any, Final

import numpy as np

from benchmarks.tables import Plot, Table
from vibroimpact_service.jobs import drive, shares

CHUNK = 0.004
"""Mean seconds of a chunk; their logarithms are normal with a deviation of one half."""
HANDING = 1.0e-3
"""Seconds of the scheduler for one bundle: Dask's for a task, serialization and the answer."""
CHUNKS: Final = 10_000_000
_THREADS = 2  # of a worker
_SPREAD = 0.5
_DEATHS = 1e-5  # of bundles, which are done again by another worker


def simulate(
    chunks: int, workers: int, *, handing: float = HANDING, seed: int = 1
) -> dict[str, float]:
    """Return what happens to a job of that many chunks.

    Every worker thread has a bundle that it computes and as many ahead as the rules give it. A
    thread that has none left is idle until the scheduler hands it one.

    Returns
    -------
    dict
        Seconds of the job, share of the workers' time that was spent computing, share of the
        scheduler's time, and bundles.
    """
    random = np.random.default_rng(seed)
    size = int(min(drive._LARGEST_BUNDLE, max(1, drive._BUNDLE_SECONDS / CHUNK)))
    count = -(-chunks // size)
    lost = int(random.binomial(count, _DEATHS))
    # A sum of many chunks is normal.
    mean = CHUNK * size
    deviation = CHUNK * np.sqrt(size * (np.exp(_SPREAD**2) - 1.0))
    lengths = np.maximum(0.1 * mean, random.normal(mean, deviation, count + lost)).tolist()
    slots = workers * _THREADS
    # When the first bundles are handed out: to every slot, then once more ahead.
    free = [0.0] * slots
    heapq.heapify(free)
    flying: list[float] = []
    scheduler = 0.0
    for length in lengths:
        if len(flying) >= slots * shares._DEEP:
            # A bundle must come back before the next is given.
            scheduler = max(scheduler, heapq.heappop(flying))
        scheduler += handing
        start = max(scheduler, heapq.heappop(free))
        heapq.heappush(free, start + length)
        heapq.heappush(flying, start + length)
    total = max(free)
    return {
        "seconds": total,
        "busy": sum(lengths) / (total * slots),
        "scheduler": handing * len(lengths) / total,
        "bundles": float(len(lengths)),
    }


def study() -> Table:
    """Simulate ten million chunks of 4 ms on one to a thousand workers of two threads."""
    rows: list[tuple[Any, ...]] = []
    alone = None
    for workers in (1, 2, 10, 30, 100, 300, 1000):
        found = simulate(CHUNKS, workers)
        alone = alone or found["seconds"]
        rows.append(
            (
                workers,
                CHUNKS,
                found["seconds"],
                alone / found["seconds"],
                found["busy"],
                found["scheduler"],
            )
        )
    return Table(
        "Simulated: ten million chunks",
        (
            "workers",
            "chunks",
            "time of the job [s]",
            "times faster than one",
            "workers busy",
            "scheduler busy",
        ),
        rows,
        f"Simulated, not measured: {HANDING * 1e3:g} ms of the scheduler for a bundle, one bundle "
        f"in {1 / _DEATHS:g} lost with its worker and done again.",
        plots=(Plot("workers", "times faster than one"),),
    )


def bundles() -> Table:
    """Simulate what the size of chunks means on a thousand workers: where the scheduler limits."""
    rows: list[tuple[Any, ...]] = []
    for handing in (0.2e-3, 0.5e-3, 1e-3, 2e-3):
        found = simulate(1_000_000, 1000, handing=handing)
        rows.append((handing * 1e3, found["seconds"], found["busy"], found["scheduler"]))
    return Table(
        "Simulated: a thousand workers and a slower or quicker scheduler",
        ("scheduler [ms/bundle]", "time of the job [s]", "workers busy", "scheduler busy"),
        rows,
        "A million chunks of 4 ms. Simulated, not measured.",
    )


TABLES: Final = (study, bundles)
