"""Small jobs through the queue: one by one, of many clients, in batches, and beside a large one.

Service, workers and clients share the cores of one machine.
"""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from typing import Final

from benchmarks.service import load
from benchmarks.service.answers import SHARED
from benchmarks.service.load import Load, Outcome
from benchmarks.service.requests import Request, modes
from benchmarks.service.server import Server, running
from benchmarks.tables import Figure, Table, figures

_WORKERS: Final = 2
_MANY: Final = 32


def small_jobs() -> Table:
    """Submit durable jobs of a millisecond, alone, many at once, in batches and beside others."""
    with running(_WORKERS) as server:
        _tiny(server, 10_000)  # workers load their kernels
        alone, many = _tiny(server, 20_000), _tiny(server, 1_000_000, _MANY, 40)
        by_batches, behind = _by_batches(server), _behind_a_large_one(server)
    numbers = [
        Figure("tiny job, p50 [ms]", 1e3 * alone.p50, 8.0),
        Figure("tiny job, p99 [ms]", 1e3 * alone.p99, 20.0),
        Figure(f"tiny jobs of {_MANY} clients [1/s]", many.answers / many.seconds, 300.0, True),
        Figure("requests by batches [1/s]", by_batches, 3000.0, True),
        Figure("tiny job behind a bulk one, p50 [ms]", 1e3 * behind.p50, 15.0),
    ]
    return figures("Small jobs through the queue", numbers, "", {"": SHARED})


def _tiny(server: Server, first: int, clients: int = 1, ahead: int = 1) -> Outcome:
    """Submit tiny jobs over HTTP, each client so many ahead, and wait until they are done."""
    return load.run(Load(server.url, (Request.job(modes()),), clients, 2.0, first, ahead)).proper()


def _by_batches(server: Server, count: int = 6, size: int = 1000) -> float:
    """Return how many requests a second are answered by batches."""

    def batch(number: int) -> None:
        requests = [modes(0.8 + 1e-5 * (number * size + i)) for i in range(size)]
        content = {"kind": "impact-modes", "requests": requests}
        document = server.answered("POST", "/v1/batch", content).json()
        if len(document["answers"]) != size:
            raise RuntimeError(document)

    batch(0)
    started = time.perf_counter()
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(batch, range(1, count + 1)))
    return count * size / (time.perf_counter() - started)


def _behind_a_large_one(server: Server) -> Outcome:
    """Submit tiny jobs while a large one keeps all workers busy."""
    job = server.job(modes(0.6, 3_000_000, 300, ("impulse", "exists")))
    time.sleep(1.0)
    outcome = _tiny(server, 3_000_000)
    server.ask("DELETE", f"/v1/jobs/{job}")
    return outcome
