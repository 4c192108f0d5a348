"""The engine with more workers than there are here: a simulated study of its own rules.

Chunks, bundles of a fifth of a second or more that become smaller towards the end, bundles given
ahead, one scheduler that hands them out one after the other. The rules and numbers are those of
`vibroimpact_service.jobs`; what the scheduler takes for a bundle is measured beside it.
"""

from __future__ import annotations

import asyncio
import heapq
import math
import queue
import time
import uuid
from collections.abc import Awaitable
from contextlib import AbstractContextManager, nullcontext
from functools import cache
from typing import Any, Final, NamedTuple
from unittest import mock

import numpy as np

from benchmarks import chunks
from benchmarks.job_queue import busy, with_queue
from benchmarks.tables import Figure, Goal, Plot, Table, Trend, figures
from vibroimpact_service.jobs import bundles, shares
from vibroimpact_service.jobs.engine import BULK, Call, Engine
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
    count: int,
    workers: int,
    *,
    handing: float = HANDING,
    bundle: float | None = None,
    seed: int = 1,
) -> dict[str, float]:
    """Return what happens to a job of that many chunks.

    Every worker has a bundle that it computes and as many ahead as the rules give it. One that
    has none left is idle until the scheduler hands it one. With `bundle`, bundles have that
    length in seconds however many workers there are.

    Returns
    -------
    dict
        Seconds of the job, share of the workers' time that was spent computing, share of the
        scheduler's time, and bundles.
    """
    random = np.random.default_rng(seed)
    sizes = _sizes(count, workers, bundle)
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


def _sizes(count: int, workers: int, bundle: float | None) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Return the chunks of all bundles: towards the end smaller ones."""
    rules: AbstractContextManager[object] = nullcontext()
    if bundle is not None:
        rules = mock.patch.multiple(bundles, SECONDS=bundle, HANDED=math.inf)
    sizes, waiting = [], count
    with rules:
        while waiting:
            sizes.append(bundles.size(waiting, CHUNK, workers))
            waiting -= sizes[-1]
    return np.array(sizes, dtype=np.int64)


_BUNDLES: Final = 250
_ROUNDS: Final = 3
_BUNDLE: Final = "processor of the service for a bundle [ms]"


class Taken(NamedTuple):
    """Seconds of processor time of the process that schedules."""

    bundle: float
    """For a bundle: with the drive of its job and its records."""
    call: float
    """For a call that does nothing: Dask's client, scheduler and connections alone."""


@cache
def measured() -> Taken:
    """Return what the process that schedules takes; the least of some rounds in turns.

    What it takes while there is nothing to do is left out.
    """
    calls = []

    async def scenario(jobs: JobQueue, store: Store) -> float:
        await busy(jobs, store, "ann", 200, CHUNK)
        idle = await _spent(asyncio.sleep(3.0), 0.0) / 3.0
        found = []
        for _ in range(_ROUNDS):
            found.append(await _spent(busy(jobs, store, "ann", _BUNDLES, CHUNK), idle))
            calls.append(await _spent(asyncio.to_thread(_empty_calls, jobs.engine), idle))
        return min(found)

    with mock.patch.object(bundles, "SECONDS", CHUNK):
        bundle = with_queue(scenario, workers=2)
    return Taken(bundle / _BUNDLES, min(calls) / _BUNDLES)


async def _spent(work: Awaitable[object], idle: float) -> float:
    """Return the processor time that some work takes beyond that of a share of a core."""
    began, used = time.perf_counter(), time.process_time()
    await work
    return time.process_time() - used - idle * (time.perf_counter() - began)


def _empty_calls(engine: Engine) -> None:
    """Have calls done that do nothing, as many ahead as bundles are given ahead."""
    ended: queue.SimpleQueue[Call] = queue.SimpleQueue()
    sent = 0

    def send(count: int) -> None:
        nonlocal sent
        for _ in range(min(count, _BUNDLES - sent)):
            sent += 1
            engine.submit(f"empty-{uuid.uuid4().hex}", BULK, 0, ended.put, chunks.nothing)

    send(shares._DEEP * engine.slots)
    for _ in range(_BUNDLES):
        ended.get(timeout=60.0).future.release()
        send(1)


def handing() -> Table:
    """Measure what one bundle takes of the process that schedules."""
    found = measured()
    return figures(
        "What the scheduler takes",
        [
            Figure(_BUNDLE, 1e3 * found.bundle, 1e3 * HANDING),
            Figure("the same for a call of Dask that does nothing [ms]", 1e3 * found.call),
        ],
        f"{_BUNDLES} bundles of one chunk of 4 ms and as many empty calls, two workers, the least "
        f"of {_ROUNDS} rounds; scheduler, its client, the drive of the job and its reports, all in "
        "one process.",
        {
            _BUNDLE: f"Dask's client and scheduler take {1e3 * found.call:.2g} ms of it, for a "
            "call that does nothing: a graph of one task, three encrypted messages with the "
            "worker, and what the scheduler notes. Bundles of many workers are longer in return, "
            f"so that no more than {bundles.HANDED:g} a second are handed out."
        },
    )


def study() -> Table:
    """Simulate ten million chunks of 4 ms on one to a thousand workers."""
    rows: list[tuple[Any, ...]] = []
    alone, each = None, measured().bundle
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
                bundles.seconds(workers),
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
            "bundles [s]",
            "scheduler busy",
        ),
        rows,
        f"Simulated, with {each * 1e3:.2g} ms of the scheduler for a bundle, as measured above; "
        f"one bundle in {1 / _DEATHS:g} is lost with its worker and done again.",
        Goal("workers busy", "goal", at_least=True),
        (Plot("workers", "times faster than one"),),
        trends=(Trend("workers", "times faster than one", 0.95, at_least=True),),
        reasons={
            "": f"one scheduler hands out {1 / each:.0f} bundles a second at most; towards the "
            "end of a job, bundles of many workers are short, see the rules"
        },
    )


def lengths() -> Table:
    """Simulate a thousand workers with quicker schedulers, and with bundles of fixed lengths."""
    rows: list[tuple[Any, ...]] = []
    now = measured().bundle
    for each, bundle in (
        (now, None), (HANDING, None), (now, bundles.SECONDS), (now, 1.0), (now, 4.0),
        (HANDING, bundles.SECONDS), (HANDING, 1.0),
    ):  # fmt: skip
        found = simulate(CHUNKS, 1000, handing=each, bundle=bundle)
        length = bundles.seconds(1000) if bundle is None else bundle
        rule = "the service's" if bundle is None else "fixed"
        rows.append((rule, each * 1e3, length, found["seconds"], found["busy"], found["scheduler"]))
    return Table(
        "Simulated: a thousand workers, quicker scheduler or other bundles",
        (
            "rule",
            "scheduler [ms/bundle]",
            "bundles [s]",
            "time of the job [s]",
            "workers busy",
            "scheduler busy",
        ),
        rows,
        "Ten million chunks of 4 ms. Simulated.",
    )


TABLES: Final = (handing, study, lengths)
