"""Small jobs through the queue: one by one, of many clients, in batches, and beside a large one.

Service, workers and clients share the cores of one machine.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Final

from benchmarks.service import load
from benchmarks.service.answers import SHARED
from benchmarks.service.load import Load
from benchmarks.service.requests import Request, modes, numbered
from benchmarks.service.server import Server, running
from benchmarks.tables import Figure, Table, figures

_WORKERS: Final = 2


def small_jobs() -> Table:
    """Submit durable jobs of a millisecond, alone, many at once, in batches and beside others."""
    with running(_WORKERS) as server:
        numbers = [
            *_one_by_one(server),
            _of_many_clients(server),
            _by_batches(server),
            _behind_a_large_one(server),
        ]
    return figures("Small jobs through the queue", numbers, "", {"": SHARED})


def _latencies(server: Server, count: int, first: int) -> list[float]:
    """Return milliseconds of small jobs, one after the other, without the first tenth."""
    times = []
    for number in range(first, first + count):
        started = time.perf_counter()
        server.done(server.job(numbered(number)))
        times.append(1e3 * (time.perf_counter() - started))
    return times[count // 10 :]  # the first ones load and compile


def _one_by_one(server: Server) -> Iterator[Figure]:
    """Yield the time from submitting a durable job over HTTP to knowing that it is done."""
    _latencies(server, 30, 10_000)
    times = _latencies(server, 300, 0)
    yield Figure("tiny job, p50 [ms]", statistics.median(times), 8.0)
    yield Figure("tiny job, p99 [ms]", statistics.quantiles(times, n=100)[98], 20.0)


def _of_many_clients(server: Server, clients: int = 32, ahead: int = 40) -> Figure:
    """Return how many durable jobs a second many clients get done."""
    several = Load(server.url, (Request.job(modes()),), clients, 2.0, 1_000_000, ahead)
    outcome = load.run(several).proper(200)
    rate = outcome.answers / outcome.seconds
    return Figure(f"tiny jobs of {clients} clients [1/s]", rate, 300.0, True)


def _by_batches(server: Server, count: int = 6, size: int = 1000) -> Figure:
    """Return how many requests a second are answered by batches."""

    def batch(number: int) -> None:
        requests = [numbered(30_000 + number * size + i) for i in range(size)]
        content = {"kind": "impact-modes", "requests": requests}
        document = server.answered("POST", "/v1/batch", content).json()
        if len(document["answers"]) != size:
            raise RuntimeError(document)

    batch(0)
    started = time.perf_counter()
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(batch, range(1, count + 1)))
    rate = count * size / (time.perf_counter() - started)
    return Figure("requests by batches [1/s]", rate, 3000.0, True)


def _behind_a_large_one(server: Server) -> Figure:
    """Return the time of a tiny job while a large one keeps all workers busy."""
    job = server.job(modes(0.6, 3_000_000, 300, ("impulse", "exists")))
    time.sleep(1.0)
    times = _latencies(server, 100, 50_000)
    server.ask("DELETE", f"/v1/jobs/{job}")
    return Figure("tiny job behind a bulk one, p50 [ms]", statistics.median(times), 15.0)
