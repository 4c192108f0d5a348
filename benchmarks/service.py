"""The service: its start and memory, latency and throughput against clients, workers."""

from __future__ import annotations

import itertools
import statistics
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from benchmarks.job_queue import Service, bulk, tiny
from benchmarks.tables import Plot, Table

CLIENTS: Final = (1, 2, 4, 8, 16, 32)
SECONDS = 1.5
"""How long clients ask."""
_BULK = 60_000  # frequencies of a job
_COUNTER = itertools.count(1)


@contextmanager
def running(workers: int) -> Iterator[tuple[Service, float]]:
    """Give a service on an empty folder, and how long it took to be ready."""
    with tempfile.TemporaryDirectory() as folder:
        started = time.perf_counter()
        found = Service(Path(folder) / "data", workers=workers)
        ready = time.perf_counter() - started
        try:
            yield found, ready
        finally:
            found.stop()


def starts() -> Table:
    """Start the service on an empty folder: ready, its first results, its memory."""
    with running(1) as (service, ready):
        first = _clock(lambda: _compute(service))
        second = _clock(lambda: _compute(service))
        job = _clock(lambda: service.done(service.job(tiny(next(_COUNTER)))))
        rows: list[tuple[Any, ...]] = [
            ("ready after [s]", ready),
            ("first result [s]", first),
            ("next result [s]", second),
            ("first job [s]", job),
            ("processes", len(service.processes())),
            ("memory, all processes [MB]", _memory(service)),
        ]
    return Table(
        "The service from a cold start",
        ("what", "figure"),
        rows,
        "One worker, SQLite, a folder; kernels from disk. Memory is that of pages, shared ones "
        "by their share.",
    )


def clients() -> Table:
    """Ask with more and more clients at once: stored results, new small ones, plans."""
    rows: list[tuple[Any, ...]] = []
    with running(1) as (service, _):
        digest = _compute(service)["digest"]
        kinds: dict[str, Callable[[], Any]] = {
            "a stored result": lambda: service.ask("GET", f"/v1/results/{digest}"),
            "a new result, inline": lambda: _compute(service),
            "a plan": lambda: service.ask("POST", "/v1/plan/impact-modes", tiny(next(_COUNTER))),
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
                )
            )
    return Table(
        "The service against clients",
        ("asked", "clients", "answers [1/s]", "p50 [ms]", "p99 [ms]"),
        rows,
        "Clients are threads of one Python process on the same cores, which share its lock: the "
        "figures are lower bounds. Chain of 13 masses, JSON.",
        plots=(
            Plot("clients", "answers [1/s]", by="asked"),
            Plot("clients", "p50 [ms]", by="asked"),
        ),
    )


def workers() -> Table:
    """Give the same large job to one worker process and to two."""
    rows: list[tuple[Any, ...]] = []
    alone = None
    for count in (1, 2):
        with running(count) as (service, _):
            service.done(service.job(bulk(1, 3000)))
            spent = _clock(lambda: service.done(service.job(bulk(2, _BULK))))
            rows.append((count, spent, (alone or spent) / spent, _memory(service)))
            alone = alone or spent
    return Table(
        "One large job, one and two workers",
        ("workers", "clock [s]", "speed-up", "memory [MB]"),
        rows,
        f"{_BULK} members of the chain; submitted over HTTP, result stored.",
    )


def _compute(service: Service) -> Any:
    status, answer = service.ask("POST", "/v1/compute/impact-modes", tiny(next(_COUNTER)))
    if status != 200:
        raise RuntimeError(answer)
    return answer


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

    threads = [threading.Thread(target=client) for _ in range(count)]
    started = time.perf_counter()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if failed:
        raise failed[0]
    return times, time.perf_counter() - started


def _memory(service: Service) -> float:
    """Return the memory of all processes, pages that several share divided among them."""
    total = 0
    for process in service.processes():
        try:
            lines = Path(f"/proc/{process}/smaps_rollup").read_text().splitlines()
        except OSError:
            continue
        total += sum(int(line.split()[1]) for line in lines if line.startswith("Pss:"))
    return total / 1024.0


def _clock(work: Callable[[], object]) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


TABLES: Final = (starts, clients, workers)
