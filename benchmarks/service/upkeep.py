"""Start and memory of the service, lists of many jobs, idling, and what grows with jobs."""

from __future__ import annotations

import itertools
import statistics
import tempfile
import time
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from benchmarks.service import load
from benchmarks.service.bare import CLUSTER
from benchmarks.service.jobs import WORKERS, latencies
from benchmarks.service.load import Load
from benchmarks.service.requests import Request, modes, numbered
from benchmarks.service.server import Bare, Server, running, seconds, status
from benchmarks.tables import Figure, Table, figures
from vibroimpact_service.jobs.database import open_database
from vibroimpact_service.jobs.records import NewJob, insert
from vibroimpact_service.settings import Settings

_IDLE: Final = "idle processor [% of a core]"
_RESTING: Final = {
    _IDLE: "Dask's workers and a server that do nothing take more than the whole service does, see "
    "the row below: heartbeats, looks at the memory of each worker, the clock of the HTTP server "
    "ten times a second; of ours, two looks at the records a second for what other replicas left"
}


def starts() -> Table:
    """Start the service on an empty folder: ready, its first results, its memory.

    Once as after an installation, when its kernels were never compiled, and once with the
    kernels on disk.
    """
    rows: list[tuple[Any, ...]] = []
    with tempfile.TemporaryDirectory() as empty:
        for title in ("compiled", "from disk"):
            times = [time.perf_counter()]
            with running(environment={"NUMBA_CACHE_DIR": empty}) as server:
                times.append(time.perf_counter())
                for number in (1, 2):
                    server.stored(numbered(number))
                    times.append(time.perf_counter())
                server.done(server.job(numbered(3)))
                times.append(time.perf_counter())
                spent = [b - a for a, b in itertools.pairwise(times)]
                rows.append((title, *spent, len(server.processes()), server.memory_of_all()))
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


def upkeep() -> Table:
    """List jobs, do nothing, and see whether anything grows with the number of jobs."""
    numbers = [_listing()]
    with running(WORKERS) as server:
        numbers += [*_idle(server), *_growth(server)]
    return figures("Upkeep", numbers, "", _RESTING)


def _listing(rows: int = 100_000, pages: int = 50) -> Figure:
    """Return the time to list a page of many jobs, a filtered one included."""
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder) / "data"
        engine = open_database(Settings(data=data).database_url)
        for start in range(0, rows, 1000):
            with engine.begin() as connection:
                for job in map(_job, range(start, start + 1000)):
                    if job.reused:
                        insert(connection, job)
        engine.dispose()
        server = Server(data)
        times = []
        try:
            for page in range(pages):
                cursor = rows * (page + 1) // (pages + 1)
                for query in (f"cursor={cursor}", f"cursor={cursor}&state=succeeded"):
                    started = time.perf_counter()
                    server.answered("GET", f"/v1/jobs?limit=50&{query}")
                    times.append(1e3 * (time.perf_counter() - started))
        finally:
            server.stop()
    return Figure(f"page of {rows} jobs [ms]", statistics.median(times), 20.0)


def _job(number: int) -> NewJob:
    name, result = f"job_{uuid.uuid4().hex}", f"{number:064x}"
    return NewJob(name, "local", "impact-modes", "a" * 64, result, 0, 1.0, number % 7 > 0)


def _idle(server: Server, length: float = 10.0) -> Iterator[Figure]:
    """Yield how much of a core a service uses that has nothing to do."""
    latencies(server, 5, 0)
    time.sleep(10.0)  # workers load their kernels
    before, alone = seconds(server.processes()), server.processor()
    time.sleep(length)
    used, own = seconds(server.processes()) - before, server.processor() - alone
    yield Figure(_IDLE, 100.0 * used / length, 2.0)
    yield Figure("the same of the serving process alone [% of a core]", 100.0 * own / length)
    with Bare(CLUSTER, WORKERS) as other:
        time.sleep(10.0)
        before = other.processor()
        time.sleep(length)
        used = other.processor() - before
    bare = "the same of a bare server and workers of Dask [% of a core]"
    yield Figure(bare, 100.0 * used / length)


def _growth(server: Server, length: float = 10.0) -> Iterator[Figure]:
    """Yield by how much memory and file handles grow with jobs, after a warm-up."""

    def jobs(first: int) -> int:
        several = Load(server.url, (Request.job(modes()),), 16, length, first, 1)
        return load.run(several).proper(200).answers

    jobs(1_000_000)
    before = _held(server.processes())
    each = jobs(2_000_000) / 1000
    time.sleep(2.0)
    after = _held(server.processes())
    yield Figure("memory for 1000 jobs more [MB]", (after[0] - before[0]) / each, 4.0)
    yield Figure("file handles for 1000 jobs more", (after[1] - before[1]) / each, 1.0)


def _held(processes: list[int]) -> tuple[float, int]:
    """Return mebibytes and file handles that processes hold.

    Pages of files do not count: the system takes them from processes that rest, and gives them
    back later.
    """
    handles = sum(len(list(Path(f"/proc/{process}/fd").iterdir())) for process in processes)
    return sum(status(process, "RssAnon") for process in processes), handles
