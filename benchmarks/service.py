"""The service: its start and memory, latency and throughput against clients, workers."""

from __future__ import annotations

import itertools
import statistics
import tempfile
import threading
import time
from collections.abc import Callable
from typing import Any, Final

from benchmarks.job_queue import busy, with_queue
from benchmarks.server import Server, bulk, running, tiny
from benchmarks.tables import Goal, Plot, Table, Trend
from vibroimpact_service.jobs.queue import JobQueue
from vibroimpact_service.store import Store

CLIENTS: Final = (1, 2, 4, 8, 16, 32)
SECONDS: Final = 1.5
"""How long clients ask."""
_BULK: Final = 30_000  # frequencies of a job
_CHUNKS: Final = 1000
_EACH: Final = 0.004
_COUNTER = itertools.count(1)


def starts() -> Table:
    """Start the service on an empty folder: ready, its first results, its memory.

    Once as after an installation, when its kernels were never compiled, and once with the
    kernels on disk.
    """
    rows: list[tuple[Any, ...]] = []
    with tempfile.TemporaryDirectory() as empty:
        for title in ("compiled", "from disk"):
            started = time.perf_counter()
            with running(environment={"NUMBA_CACHE_DIR": empty}) as server:
                ready = time.perf_counter() - started
                first = _clock(lambda: _compute(server))
                second = _clock(lambda: _compute(server))
                job = _clock(lambda: server.done(server.job(tiny(next(_COUNTER)))))
                count, memory = len(server.processes()), server.memory_of_all()
            rows.append((title, ready, first, second, job, count, memory))
    return Table(
        "The service from a cold start",
        (
            "kernels",
            "ready after [s]",
            "first result [s]",
            "next result [s]",
            "first job [s]",
            "processes",
            "memory of all [MB]",
        ),
        rows,
        "One worker, SQLite, a folder. Memory is that of pages, shared ones by their share.",
    )


def clients() -> Table:
    """Ask with more and more clients at once: stored results, new small ones, plans."""
    rows: list[tuple[Any, ...]] = []
    with running() as server:
        digest = _compute(server)["digest"]
        kinds: dict[str, Callable[[], Any]] = {
            "a stored result": lambda: server.asked("GET", f"/v1/results/{digest}"),
            "a new result, inline": lambda: _compute(server),
            "a plan": lambda: server.asked("POST", "/v1/plan/impact-modes", tiny(next(_COUNTER))),
        }
        for (what, ask), count in itertools.product(kinds.items(), CLIENTS):
            times, spent = _asked(ask, count)
            ordered = sorted(times)
            rows.append(
                (
                    what,
                    count,
                    len(times) / spent,
                    statistics.median(ordered) * 1e3,
                    ordered[min(len(ordered) - 1, int(0.99 * len(ordered)))] * 1e3,
                    server.memory(),
                )
            )
    return Table(
        "The service against clients",
        (
            "asked",
            "clients",
            "answers [1/s]",
            "p50 [ms]",
            "p99 [ms]",
            "memory of the server [MB]",
        ),
        rows,
        "Clients are threads of one Python process on the same cores, which share its lock: the "
        "figures are lower bounds. Chain of 13 masses, JSON. Expected: more clients do not lower "
        "the throughput, and each waits no longer than its turn.",
        plots=(
            Plot("clients", "answers [1/s]", by="asked"),
            Plot("clients", "p50 [ms]", by="asked"),
            Plot("clients", "memory of the server [MB]", by="asked"),
        ),
        trends=(
            Trend("clients", "answers [1/s]", -0.1, by="asked", at_least=True),
            Trend("clients", "p50 [ms]", 1.15, by="asked"),
            Trend("clients", "memory of the server [MB]", 0.05, by="asked"),
        ),
    )


def workers() -> Table:
    """Give the same large job to one worker process and to two.

    Chunks that only keep their core busy show what the queue makes of a second worker. The
    kernels of a real job use all cores already when there is one worker: two should not hinder
    one another.
    """
    rows: list[tuple[Any, ...]] = []
    for what, run, least in (
        ("chunks of 4 ms, one core each", _busy_chunks, 1.7),
        ("impact modes, N = 300, kernels use all cores", _real_job, 0.8),
    ):
        alone = run(1)
        rows += [(what, 1, alone, 1.0, None)]
        both = run(2)
        rows += [(what, 2, both, alone / both, least)]
    return Table(
        "One large job, one and two workers",
        ("job", "workers", "clock [s]", "speed-up", "goal"),
        rows,
        f"{_CHUNKS} chunks; {_BULK} members of the chain, submitted over HTTP, result stored. On "
        "the clock, each after a job like it.",
        Goal("speed-up", "goal", at_least=True),
        reasons={"": "on the clock: two workers, the service and this process share the cores"},
    )


def _busy_chunks(count: int) -> float:
    async def scenario(queue: JobQueue, store: Store) -> float:
        await busy(queue, store, "ann", 200 * count, _EACH)
        started = time.perf_counter()
        await busy(queue, store, "ann", _CHUNKS, _EACH)
        return time.perf_counter() - started

    return with_queue(scenario, count)


def _real_job(count: int) -> float:
    with running(count) as server:
        # Long enough for all workers to load their kernels.
        server.done(server.job(bulk(1, _BULK)))
        return _clock(lambda: server.done(server.job(bulk(2, _BULK))))


def _compute(server: Server) -> Any:
    """Return the document of a new small result, or of its job where kernels are compiled first."""
    answer = server.ask("POST", "/v1/compute/impact-modes", tiny(next(_COUNTER)))
    found = answer.document
    if answer.status == 202:
        server.done(found["id"])
    elif answer.status != 200:
        raise RuntimeError(found)
    return found


def _asked(ask: Callable[[], Any], count: int) -> tuple[list[float], float]:
    times: list[float] = []
    failed: list[BaseException] = []
    end = time.perf_counter() + SECONDS

    def client() -> None:
        try:
            while (started := time.perf_counter()) < end:
                ask()
                times.append(time.perf_counter() - started)
        except Exception as error:
            failed.append(error)

    threads = [threading.Thread(target=client, daemon=True) for _ in range(count)]
    started = time.perf_counter()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if failed:
        raise failed[0]
    return times, time.perf_counter() - started


def _clock(work: Callable[[], object]) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


TABLES: Final = (starts, clients, workers)
