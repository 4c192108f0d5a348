"""What the job queue costs.

Service, workers and clients share the cores of one machine.
"""

from __future__ import annotations

import asyncio
import hashlib
import json
import os
import statistics
import tempfile
import time
import uuid
from collections.abc import Awaitable, Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from itertools import chain
from pathlib import Path
from typing import Any, Final

from benchmarks import chunks
from benchmarks.bare import CLUSTER
from benchmarks.server import Bare, Server, bulk, running, seconds, tiny
from benchmarks.tables import Figure, Table, figures
from vibroimpact_service.jobs.database import open_database
from vibroimpact_service.jobs.ledger import NewJob, insert
from vibroimpact_service.jobs.queue import JobQueue
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store

_WORKERS: Final = 2


def _latencies(server: Server, count: int, first: int) -> list[float]:
    found = []
    for number in range(first, first + count):
        started = time.perf_counter()
        server.done(server.job(tiny(number)))
        found.append(1e3 * (time.perf_counter() - started))
    return found[count // 10 :]  # the first ones load and compile


def tiny_jobs(server: Server, count: int = 300) -> Iterable[Figure]:
    """Yield the time from submitting a durable job over HTTP to knowing that it is done."""
    _latencies(server, 30, 10_000)
    before = seconds(server.processes())
    found = _latencies(server, count, 0)
    used = seconds(server.processes()) - before
    yield Figure("processor of a tiny job [ms]", 1e3 * used / count)
    yield Figure("tiny job, p50 [ms]", statistics.median(found), 8.0)
    yield Figure("tiny job, p99 [ms]", statistics.quantiles(found, n=100)[98], 20.0)


def tiny_jobs_of_many(server: Server, clients: int = 32, each: int = 40) -> Iterable[Figure]:
    """Yield how many durable jobs a second many clients get done."""

    def client(number: int) -> None:
        first = 20_000 + number * each
        for job in [server.job(tiny(i)) for i in range(first, first + each)]:
            server.done(job)

    before = seconds(server.processes())
    started = time.perf_counter()
    with ThreadPoolExecutor(clients) as pool:
        list(pool.map(client, range(clients)))
    spent = time.perf_counter() - started
    used = seconds(server.processes()) - before
    yield Figure("processor of one of many tiny jobs [ms]", 1e3 * used / (clients * each))
    yield Figure(f"tiny jobs of {clients} clients [1/s]", clients * each / spent, 300.0, True)


def batches(server: Server, count: int = 6, size: int = 1000) -> Iterable[Figure]:
    """Yield how many requests a second are answered by batches."""

    def batch(number: int) -> None:
        requests = [tiny(30_000 + number * size + i) for i in range(size)]
        content = {"kind": "impact-modes", "requests": requests}
        found = server.asked("POST", "/v1/batch", content).document
        if len(found["answers"]) != size:
            raise RuntimeError(found)

    batch(0)
    before = seconds(server.processes())
    started = time.perf_counter()
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(batch, range(1, count + 1)))
    spent = time.perf_counter() - started
    used = seconds(server.processes()) - before
    yield Figure("processor of a request of a batch [ms]", 1e3 * used / (count * size))
    yield Figure("requests by batches [1/s]", count * size / spent, 3000.0, True)


def again(server: Server, count: int = 20) -> Iterable[Figure]:
    """Yield the time to get a finished sweep's job when it is submitted again."""
    server.done(server.job(bulk(0, 30_000)))
    found = []
    for _ in range(count):
        started = time.perf_counter()
        server.done(server.job(bulk(0, 30_000)))
        found.append(1e3 * (time.perf_counter() - started))
    yield Figure("finished sweep again [ms]", statistics.median(found), 10.0)


def behind_bulk(server: Server, count: int = 100) -> Iterable[Figure]:
    """Yield the time of a tiny job while a bulk one keeps all workers busy."""
    job = server.job(bulk(1, 3_000_000))
    time.sleep(1.0)
    found = _latencies(server, count, 50_000)
    server.ask("DELETE", f"/v1/jobs/{job}")
    yield Figure("tiny job behind a bulk one, p50 [ms]", statistics.median(found), 15.0)


def listing(rows: int = 100_000, pages: int = 50) -> Iterable[Figure]:
    """Yield the time to list a page of many jobs, a filtered one included."""
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder) / "data"
        settings = Settings(data=data)
        engine = open_database(settings.database_url)
        for start in range(0, rows, 1000):
            names = [f"job_{uuid.uuid4().hex}" for _ in range(1000)]
            news = [
                NewJob(n, "local", "impact-modes", "a" * 64, f"{i:064x}", 0, 1.0, i % 7 > 0)
                for i, n in enumerate(names, start)
            ]
            with engine.begin() as connection:
                insert([new for new in news if new.reused])(connection)
        engine.dispose()
        server = Server(data)
        try:
            found = []
            for page in range(pages):
                cursor = rows * (page + 1) // (pages + 1)
                for query in (f"cursor={cursor}", f"cursor={cursor}&state=succeeded"):
                    started = time.perf_counter()
                    server.asked("GET", f"/v1/jobs?limit=50&{query}")
                    found.append(1e3 * (time.perf_counter() - started))
        finally:
            server.stop()
    yield Figure(f"page of {rows} jobs [ms]", statistics.median(found), 20.0)


def idle(server: Server, length: float = 10.0) -> Iterable[Figure]:
    """Yield how much of a core a service uses that nobody asks anything."""
    _latencies(server, 5, 0)
    time.sleep(10.0)  # workers load their kernels
    before, alone = seconds(server.processes()), server.processor()
    time.sleep(length)
    used, own = seconds(server.processes()) - before, server.processor() - alone
    yield Figure(_IDLE, 100.0 * used / length, 2.0)
    yield Figure("the same of the serving process alone [% of a core]", 100.0 * own / length)
    with Bare(CLUSTER, _WORKERS) as other:
        time.sleep(10.0)
        before = other.processor()
        time.sleep(length)
        used = other.processor() - before
    yield Figure(
        "the same of a bare server and workers of Dask [% of a core]", 100.0 * used / length
    )


def soak(server: Server, jobs: int = 2000, warm: int = 1000) -> Iterable[Figure]:
    """Yield by how much memory and file handles grow with jobs, after a warm-up."""

    def client(number: int) -> None:
        server.done(server.job(tiny(number)))

    with ThreadPoolExecutor(16) as pool:
        list(pool.map(client, range(warm)))
        before = _held(server.processes())
        list(pool.map(client, range(warm, warm + jobs)))
    time.sleep(2.0)
    after = _held(server.processes())
    each = jobs / 1000
    yield Figure("memory for 1000 jobs more [MB]", (after[0] - before[0]) / 2**20 / each, 4.0)
    yield Figure("file handles for 1000 jobs more", (after[1] - before[1]) / each, 1.0)


def _held(processes: list[int]) -> tuple[int, int]:
    """Return bytes and file handles that processes hold.

    Pages of files do not count: the system takes them from processes that rest, and gives them
    back later.
    """
    memory = handles = 0
    for process in processes:
        words = Path(f"/proc/{process}/status").read_text().split("RssAnon:")[1].split()
        memory += 1024 * int(words[0])
        handles += len(list(Path(f"/proc/{process}/fd").iterdir()))
    return memory, handles


def chunk_overhead(count: int = 2000, each: float = 0.004) -> Iterable[Figure]:
    """Yield what a chunk of some milliseconds costs beside itself, with one worker.

    The processor time tells what remains on a machine on which others are at work too.
    """
    used = 0.0

    async def scenario(queue: JobQueue, store: Store) -> float:
        nonlocal used
        await busy(queue, store, "ann", 100, each)  # learns the time of a chunk
        worker = _busiest(lambda: busy(queue, store, "ann", 100, each))
        before = seconds([process := await worker])
        started = time.perf_counter()
        await busy(queue, store, "ann", count, each)
        spent = time.perf_counter() - started
        used = seconds([process]) - before
        return spent

    spent = with_queue(scenario)
    yield Figure("processor overhead of a 4 ms chunk [ms]", 1e3 * (used / count - each))
    yield Figure("overhead of a 4 ms chunk [ms]", 1e3 * (spent / count - each), 0.15)


async def _busiest(work: Callable[[], Awaitable[None]]) -> int:
    """Return the child process that does most of some work."""
    children = _descendants(os.getpid())
    before = {child: seconds([child]) for child in children}
    await work()
    return max(children, key=lambda child: seconds([child]) - before[child])


def _descendants(process: int) -> list[int]:
    """Return the ids of all processes below one."""
    parents: dict[int, list[int]] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        parents.setdefault(int(fields[1]), []).append(int(stat.parent.name))
    found = parents.get(process, [])
    return found + [each for child in found for each in _descendants(child)]


def behind_another_user(count: int = 20_000, each: float = 0.004) -> Iterable[Figure]:
    """Yield the time of a small job of one user while another has thousands of chunks."""

    async def scenario(queue: JobQueue, store: Store) -> float:
        await busy(queue, store, "ann", 100, each)
        large = asyncio.create_task(busy(queue, store, "ann", count, each))
        await asyncio.sleep(3.0)
        started = time.perf_counter()
        await busy(queue, store, "bob", 5, each)
        spent = time.perf_counter() - started
        large.cancel()
        await asyncio.gather(large, return_exceptions=True)
        return spent

    yield Figure(f"job of B behind {count} chunks of A [s]", with_queue(scenario), 0.5)


async def busy(queue: JobQueue, store: Store, owner: str, count: int, each: float) -> None:
    """Have a job done whose chunks keep a core busy for so many seconds each."""
    data = json.dumps({"chunks": count, "seconds": each, "salt": uuid.uuid4().hex}).encode()
    request = hashlib.sha256(data).hexdigest()
    store.requests.put(request, data)
    result = hashlib.sha256(data + owner.encode()).hexdigest()
    name = f"job_{uuid.uuid4().hex}"
    await queue.submit(NewJob(name, owner, "busy", request, result, 0, 5.0, False))
    job = await queue.finished(owner, name, 100)
    if job is None or job.state != "succeeded":
        raise RuntimeError(job)


def with_queue(scenario: Callable[[JobQueue, Store], Any], workers: int = 1) -> float:
    """Return what a scenario makes of a queue in this process, with workers of its own."""

    async def main(folder: str) -> float:
        settings = Settings(data=Path(folder), workers=workers)
        store = Store(settings.store_url)
        queue = JobQueue(settings, store, chunks.WORK)
        await queue.start()
        try:
            return float(await scenario(queue, store))
        finally:
            await queue.close()

    with tempfile.TemporaryDirectory() as folder:
        return asyncio.run(main(folder))


def _loads() -> str:
    loads = ", ".join(f"{load:.1f}" for load in os.getloadavg())
    return f"Load of the machine after 1, 5 and 15 minutes: {loads}; the benchmark's own included."


def small_jobs() -> Table:
    """Submit durable jobs of a millisecond, alone, many at once, in batches and beside others."""
    parts = (tiny_jobs, tiny_jobs_of_many, batches, again, behind_bulk)
    with running(_WORKERS) as server:
        found = list(chain.from_iterable(part(server) for part in parts))
    return figures("Small jobs through the queue", found, _loads(), _SHARED)


def chunks_of_jobs() -> Table:
    """Run jobs of thousands of chunks that take 4 ms each and compute nothing."""
    found = [*chunk_overhead(), *behind_another_user()]
    return figures("Chunks", found, _loads(), _SHARED)


def upkeep() -> Table:
    """List jobs, do nothing, and see whether anything grows with the number of jobs."""
    found = list(listing())
    with running(_WORKERS) as server:
        found += [*idle(server), *soak(server)]
    return figures("Upkeep", found, _loads(), _RESTING)


_IDLE: Final = "idle processor [% of a core]"
_RESTING: Final = {
    _IDLE: "Dask's workers and a server that do nothing take more than the whole service does, see "
    "the row below: heartbeats, looks at the memory of each worker, the clock of the HTTP server "
    "ten times a second; of ours, two looks at the records a second for what other replicas left"
}
_SHARED: Final = {
    "": "on the clock: service, workers and clients share the cores with one another, and with "
    "whatever else the machine does; see the load"
}

TABLES: Final = (small_jobs, chunks_of_jobs, upkeep)
