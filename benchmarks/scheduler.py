"""The engine with more workers than there are here: a simulated study of its own rules.

Chunks, bundles of a fifth of a second that become smaller towards the end, bundles given ahead,
one scheduler that hands them out one after the other. The rules and numbers are those of
`vibroimpact_service.jobs`; what the scheduler takes for a bundle is measured beside it.
"""

from __future__ import annotations

import asyncio
import heapq
import time
from functools import cache
from typing import Any, Final
from unittest import mock

import numpy as np

from benchmarks.job_queue import busy, with_queue
from benchmarks.tables import Figure, Goal, Plot, Table, Trend, figures
from vibroimpact_service.jobs import drive, shares
from vibroimpact_service.jobs.queue import JobQueue
from vibroimpact_service.store import Store

CHUNK: Final = 0.004
"""Mean seconds of a chunk; their logarithms are normal with a deviation of one half."""
HANDING: Final = 1.0e-3
"""Seconds for one bundle that are aimed at: Dask's for a task, serialization and the answer."""
CHUNKS: Final = 10_000_000
_SPREAD: Final = 0.5
_DEATHS: Final = 1e-5  # of bundles, which are done again by another worker


def simulate(
    chunks: int,
    workers: int,
    *,
    handing: float = HANDING,
    bundle: float = drive._BUNDLE_SECONDS,
    seed: int = 1,
) -> dict[str, float]:
    """Return what happens to a job of that many chunks.

    Every worker has a bundle that it computes and as many ahead as the rules give it. One that
    has none left is idle until the scheduler hands it one.

    Returns
    -------
    dict
        Seconds of the job, share of the workers' time that was spent computing, share of the
        scheduler's time, and bundles.
    """
    random = np.random.default_rng(seed)
    sizes = _sizes(chunks, workers, bundle)
    lost = int(random.binomial(sizes.size, _DEATHS))
    sizes = np.concatenate([sizes, sizes[:lost]])
    # A sum of many chunks is normal.
    deviation = CHUNK * np.sqrt(sizes * (np.exp(_SPREAD**2) - 1.0))
    lengths = np.maximum(0.1 * CHUNK * sizes, random.normal(CHUNK * sizes, deviation)).tolist()
    # When the first bundles are handed out: to every worker, then once more ahead.
    free = [0.0] * workers
    flying: list[float] = []
    scheduler = 0.0
    for length in lengths:
        if len(flying) >= workers * shares._DEEP:
            # A bundle must come back before the next is given.
            scheduler = max(scheduler, heapq.heappop(flying))
        scheduler += handing
        start = max(scheduler, heapq.heappop(free))
        heapq.heappush(free, start + length)
        heapq.heappush(flying, start + length)
    total = max(free)
    return {
        "seconds": total,
        "busy": sum(lengths) / (total * workers),
        "scheduler": handing * len(lengths) / total,
        "bundles": float(len(lengths)),
    }


def _sizes(chunks: int, workers: int, bundle: float) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Return the chunks of all bundles: towards the end smaller ones."""
    largest = int(min(drive._LARGEST_BUNDLE, max(1, bundle / CHUNK)))
    whole = max(0, (chunks - 2 * workers * largest) // largest)
    sizes, waiting = [], chunks - whole * largest
    while waiting:
        sizes.append(min(largest, -(-waiting // (2 * workers))))
        waiting -= sizes[-1]
    return np.concatenate([np.full(whole, largest), np.array(sizes, dtype=np.int64)])


_BUNDLES: Final = 500


@cache
def measured() -> float:
    """Return the processor time of the process that schedules for one bundle, of one chunk.

    What it takes while there is nothing to do is left out.
    """

    async def scenario(queue: JobQueue, store: Store) -> float:
        await busy(queue, store, "ann", 200, CHUNK)
        began, used = time.perf_counter(), time.process_time()
        await asyncio.sleep(3.0)
        idle = (time.process_time() - used) / (time.perf_counter() - began)
        began, used = time.perf_counter(), time.process_time()
        await busy(queue, store, "ann", _BUNDLES, CHUNK)
        spent = time.perf_counter() - began
        return (time.process_time() - used - idle * spent) / _BUNDLES

    with mock.patch.object(drive, "_BUNDLE_SECONDS", CHUNK):
        return with_queue(scenario, workers=2)


def handing() -> Table:
    """Measure what one bundle takes of the process that schedules."""
    return figures(
        "What the scheduler takes",
        [Figure("processor of the service for a bundle [ms]", 1e3 * measured(), 1e3 * HANDING)],
        f"{_BUNDLES} bundles of one chunk of 4 ms, two workers; scheduler, its client, the drive "
        "of the job and its reports, all in one process.",
    )


def study() -> Table:
    """Simulate ten million chunks of 4 ms on one to a thousand workers."""
    rows: list[tuple[Any, ...]] = []
    alone, each = None, measured()
    most = drive._BUNDLE_SECONDS / each
    for workers in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000):
        found = simulate(CHUNKS, workers, handing=each)
        alone = alone or found["seconds"]
        rows.append(
            (
                workers,
                CHUNKS,
                found["seconds"],
                alone / found["seconds"],
                found["busy"],
                0.9,
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
            "goal",
            "scheduler busy",
        ),
        rows,
        f"Simulated, with {each * 1e3:.2g} ms of the scheduler for a bundle, as measured above; "
        f"one bundle in {1 / _DEATHS:g} is lost with its worker and done again. The exponent is "
        "that of half the workers that the scheduler can feed.",
        Goal("workers busy", "goal", at_least=True),
        (Plot("workers", "times faster than one"),),
        trends=(Trend("workers", "times faster than one", 0.95, until=0.5 * most, at_least=True),),
        reasons={
            "": f"one scheduler hands out {1 / each:.0f} bundles a second at most, and bundles "
            f"last {drive._BUNDLE_SECONDS:g} s: it keeps {most:.0f} workers busy. Longer bundles "
            "would feed more, see below; progress and fairness would be coarser."
        },
    )


def bundles() -> Table:
    """Simulate a thousand workers with a quicker scheduler, and with longer bundles."""
    rows: list[tuple[Any, ...]] = []
    now = measured()
    usual = drive._BUNDLE_SECONDS
    for each, bundle in ((now, usual), (now, 1.0), (now, 4.0), (HANDING, usual), (HANDING, 1.0)):
        found = simulate(CHUNKS, 1000, handing=each, bundle=bundle)
        rows.append((each * 1e3, bundle, found["seconds"], found["busy"], found["scheduler"]))
    return Table(
        "Simulated: a thousand workers, quicker scheduler or longer bundles",
        (
            "scheduler [ms/bundle]",
            "bundles [s]",
            "time of the job [s]",
            "workers busy",
            "scheduler busy",
        ),
        rows,
        "Ten million chunks of 4 ms. Simulated.",
    )


TABLES: Final = (handing, study, bundles)
