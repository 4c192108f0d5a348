"""What the job queue costs.

Each function starts what it needs and returns its figures; service, workers and clients share
the cores of one machine.
"""

from __future__ import annotations

import asyncio
import hashlib
import http.client
import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import uuid
from collections.abc import Awaitable, Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from benchmarks import chunks
from benchmarks.tables import Table
from vibroimpact_service.jobs.database import open_database
from vibroimpact_service.jobs.ledger import NewJob, insert
from vibroimpact_service.jobs.queue import JobQueue
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store

Figures = dict[str, float]

TARGETS: dict[str, tuple[float, str]] = {
    "tiny job p50, ms": (8.0, "<="),
    "tiny job p99, ms": (20.0, "<="),
    "tiny jobs of 32 clients, 1/s": (300.0, ">="),
    "requests by batches, 1/s": (3000.0, ">="),
    "overhead of a 4 ms chunk, ms": (0.15, "<="),
    "tiny job behind a bulk one p50, ms": (15.0, "<="),
    "job of B behind 20000 chunks of A, s": (0.5, "<="),
    "finished sweep again, ms": (10.0, "<="),
    "page of 100000 jobs, ms": (20.0, "<="),
    "idle processor, % of a core": (2.0, "<="),
}


class Service:
    """A service process and one connection per thread to it."""

    def __init__(self, data: Path, workers: int | None = None) -> None:
        self.data = data
        some = {} if workers is None else {"VIBROIMPACT_WORKERS": str(workers)}
        data.mkdir(parents=True, exist_ok=True)
        with (data / "log").open("wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "vibroimpact_service", "--port", "0", "--data", str(data)],
                env={**os.environ, "OMP_NUM_THREADS": "1", **some},
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        note = data / "service.json"
        end = time.monotonic() + 120
        while not note.exists():
            if self.process.poll() is not None or time.monotonic() > end:
                raise RuntimeError((data / "log").read_text())
            time.sleep(0.05)
        self.address = json.loads(note.read_text())["url"].removeprefix("http://")
        self._local = threading.local()
        while self.ask("GET", "/v1/health/ready")[0] != 200:
            time.sleep(0.05)

    def ask(self, method: str, path: str, content: Any = None) -> tuple[int, Any]:
        """Return status and document of an answer."""
        connection = getattr(self._local, "connection", None)
        if connection is None:
            connection = self._local.connection = http.client.HTTPConnection(self.address)
        body = None if content is None else json.dumps(content).encode()
        connection.request(method, path, body, {"Content-Type": "application/json"})
        answer = connection.getresponse()
        return answer.status, json.loads(answer.read())

    def job(self, request: Any) -> str:
        """Submit a job and return its id."""
        status, job = self.ask("POST", "/v1/jobs", {"kind": "impact-modes", "request": request})
        if status != 201:
            raise RuntimeError(job)
        return str(job["id"])

    def done(self, job: str) -> None:
        """Wait for a job."""
        while not (document := self.ask("GET", f"/v1/jobs/{job}?wait=20")[1])["final"]:
            continue
        if document["state"] != "succeeded":
            raise RuntimeError(document)

    def processes(self) -> list[int]:
        """Return the ids of all its processes."""
        found = []
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                fields = stat.read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if int(fields[3]) == self.process.pid:  # the session
                found.append(int(stat.parent.name))
        return found

    def stop(self) -> None:
        """Stop it."""
        self.process.terminate()
        try:
            self.process.wait(30)
        finally:
            if self.process.poll() is None:
                os.killpg(self.process.pid, signal.SIGKILL)


@contextmanager
def service() -> Iterator[Service]:
    """Give a service on an empty folder."""
    with tempfile.TemporaryDirectory() as folder:
        found = Service(Path(folder) / "data")
        try:
            yield found
        finally:
            found.stop()


def tiny(number: int) -> dict[str, Any]:
    """Return a request unlike all others that takes no time."""
    return {
        "system": {"preset": "chain", "n": 13, "constraints": [{"dof": 5, "gap": 0.2}]},
        "frequency": {"values": [0.5 + 1e-5 * number]},
        "outputs": ["impulse"],
    }


def bulk(number: int, num: int = 300_000) -> dict[str, Any]:
    """Return a request that takes many seconds."""
    return {
        "system": {"preset": "chain", "n": 300, "constraints": [{"dof": 5, "gap": 0.2}]},
        "frequency": {"start": 0.6 + 1e-5 * number, "stop": 2.4, "num": num},
        "outputs": ["impulse", "exists"],
    }


def _latencies(server: Service, count: int, first: int) -> list[float]:
    found = []
    for number in range(first, first + count):
        started = time.perf_counter()
        server.done(server.job(tiny(number)))
        found.append(1e3 * (time.perf_counter() - started))
    return found[count // 10 :]  # the first ones load and compile


def tiny_jobs(count: int = 300) -> Figures:
    """Return the time from submitting a durable job over HTTP to knowing that it is done."""
    with service() as server:
        _latencies(server, 30, 10_000)
        before = _ticks(server.processes())
        found = _latencies(server, count, 0)
        used = _ticks(server.processes()) - before
    return {
        "processor of a tiny job, ms": _milliseconds(used) / count,
        "tiny job p50, ms": statistics.median(found),
        "tiny job p99, ms": statistics.quantiles(found, n=100)[98],
    }


def tiny_jobs_of_many(clients: int = 32, each: int = 40) -> Figures:
    """Return how many durable jobs a second many clients get done."""
    with service() as server:
        _latencies(server, 20, 0)

        def client(number: int) -> None:
            first = 1000 + number * each
            for job in [server.job(tiny(i)) for i in range(first, first + each)]:
                server.done(job)

        before = _ticks(server.processes())
        started = time.perf_counter()
        with ThreadPoolExecutor(clients) as pool:
            list(pool.map(client, range(clients)))
        seconds = time.perf_counter() - started
        used = _ticks(server.processes()) - before
    return {
        "processor of one of many tiny jobs, ms": _milliseconds(used) / (clients * each),
        "tiny jobs of 32 clients, 1/s": clients * each / seconds,
    }


def batches(count: int = 6, size: int = 1000) -> Figures:
    """Return how many requests a second are answered by batches."""
    with service() as server:

        def batch(number: int) -> None:
            requests = [tiny(number * size + i) for i in range(size)]
            status, found = server.ask(
                "POST", "/v1/batch", {"kind": "impact-modes", "requests": requests}
            )
            if status != 200 or len(found["answers"]) != size:
                raise RuntimeError(found)

        batch(0)
        before = _ticks(server.processes())
        started = time.perf_counter()
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(batch, range(1, count + 1)))
        seconds = time.perf_counter() - started
        used = _ticks(server.processes()) - before
    return {
        "processor of a request of a batch, ms": _milliseconds(used) / (count * size),
        "requests by batches, 1/s": count * size / seconds,
    }


def behind_bulk(count: int = 100) -> Figures:
    """Return the time of a tiny job while a bulk one keeps all workers busy."""
    with service() as server:
        _latencies(server, 20, 0)
        server.job(bulk(0, 3_000_000))
        time.sleep(1.0)
        found = _latencies(server, count, 100)
    return {"tiny job behind a bulk one p50, ms": statistics.median(found)}


def again(count: int = 20) -> Figures:
    """Return the time to get a finished sweep's job when it is submitted again."""
    with service() as server:
        server.done(server.job(bulk(0, 100_000)))
        found = []
        for _ in range(count):
            started = time.perf_counter()
            server.done(server.job(bulk(0, 100_000)))
            found.append(1e3 * (time.perf_counter() - started))
    return {"finished sweep again, ms": statistics.median(found)}


def listing(rows: int = 100_000, pages: int = 50) -> Figures:
    """Return the time to list a page of many jobs, a filtered one included."""
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
        server = Service(data)
        try:
            found = []
            for page in range(pages):
                cursor = rows * (page + 1) // (pages + 1)
                for query in (f"cursor={cursor}", f"cursor={cursor}&state=succeeded"):
                    started = time.perf_counter()
                    status, _ = server.ask("GET", f"/v1/jobs?limit=50&{query}")
                    found.append(1e3 * (time.perf_counter() - started))
                    if status != 200:
                        raise RuntimeError(f"no page: {status}")
        finally:
            server.stop()
    return {"page of 100000 jobs, ms": statistics.median(found)}


def idle(seconds: float = 20.0) -> Figures:
    """Return how much of a core a service uses that nobody asks anything."""
    with service() as server:
        _latencies(server, 5, 0)
        time.sleep(3.0)
        before = _ticks(server.processes())
        time.sleep(seconds)
        used = _ticks(server.processes()) - before
    return {"idle processor, % of a core": 100.0 * used / os.sysconf("SC_CLK_TCK") / seconds}


def _ticks(processes: list[int]) -> int:
    total = 0
    for process in processes:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        total += int(fields[11]) + int(fields[12])
    return total


def _milliseconds(ticks: int) -> float:
    return 1e3 * ticks / os.sysconf("SC_CLK_TCK")


def soak(jobs: int = 4000, warm: int = 1000) -> Figures:
    """Return by how much memory and file handles grow with jobs, after a warm-up."""
    with service() as server:

        def client(number: int) -> None:
            server.done(server.job(tiny(number)))

        with ThreadPoolExecutor(16) as pool:
            list(pool.map(client, range(warm)))
            before = _held(server.processes())
            list(pool.map(client, range(warm, warm + jobs)))
        time.sleep(2.0)
        after = _held(server.processes())
    return {
        "memory per 1000 jobs, MB": (after[0] - before[0]) / 2**20 / (jobs / 1000),
        "file handles per 1000 jobs": (after[1] - before[1]) / (jobs / 1000),
    }


def _held(processes: list[int]) -> tuple[int, int]:
    memory = handles = 0
    for process in processes:
        pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
        memory += pages * os.sysconf("SC_PAGESIZE")
        handles += len(list(Path(f"/proc/{process}/fd").iterdir()))
    return memory, handles


def chunk_overhead(count: int = 2000, seconds: float = 0.004) -> Figures:
    """Return what a chunk of some milliseconds costs beside itself, with one worker.

    The processor time tells what remains on a machine on which others are at work too.
    """
    used = 0

    async def scenario(queue: JobQueue, store: Store) -> float:
        nonlocal used
        await _run(queue, store, "ann", 100, seconds)  # learns the time of a chunk
        worker = _busiest(lambda: _run(queue, store, "ann", 100, seconds))
        before = _ticks([process := await worker])
        started = time.perf_counter()
        await _run(queue, store, "ann", count, seconds)
        spent = time.perf_counter() - started
        used = _ticks([process]) - before
        return spent

    spent = _with_queue(scenario)
    return {
        "processor overhead of a 4 ms chunk, ms": _milliseconds(used) / count - 1e3 * seconds,
        "overhead of a 4 ms chunk, ms": 1e3 * (spent / count - seconds),
    }


async def _busiest(work: Callable[[], Awaitable[None]]) -> int:
    """Return the child process that does most of some work."""
    children = _descendants(os.getpid())
    before = {child: _ticks([child]) for child in children}
    await work()
    return max(children, key=lambda child: _ticks([child]) - before[child])


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


def behind_another_user(count: int = 20_000, seconds: float = 0.004) -> Figures:
    """Return the time of a small job of one user while another has thousands of chunks."""

    async def scenario(queue: JobQueue, store: Store) -> float:
        await _run(queue, store, "ann", 100, seconds)
        large = asyncio.create_task(_run(queue, store, "ann", count, seconds))
        await asyncio.sleep(3.0)
        started = time.perf_counter()
        await _run(queue, store, "bob", 5, seconds)
        spent = time.perf_counter() - started
        large.cancel()
        await asyncio.gather(large, return_exceptions=True)
        return spent

    return {"job of B behind 20000 chunks of A, s": _with_queue(scenario)}


async def _run(queue: JobQueue, store: Store, owner: str, count: int, seconds: float) -> None:
    data = json.dumps({"chunks": count, "seconds": seconds, "salt": uuid.uuid4().hex}).encode()
    request = hashlib.sha256(data).hexdigest()
    store.requests.put(request, data)
    result = hashlib.sha256(data + owner.encode()).hexdigest()
    name = f"job_{uuid.uuid4().hex}"
    await queue.submit(NewJob(name, owner, "busy", request, result, 0, 5.0, False))
    job = await queue.finished(owner, name, 600)
    if job is None or job.state != "succeeded":
        raise RuntimeError(job)


def _with_queue(scenario: Callable[[JobQueue, Store], Any]) -> float:
    async def main(folder: str) -> float:
        settings = Settings(data=Path(folder), workers=1)
        store = Store(settings.store_url)
        queue = JobQueue(settings, store, chunks.WORK)
        await queue.start()
        try:
            return float(await scenario(queue, store))
        finally:
            await queue.close()

    with tempfile.TemporaryDirectory() as folder:
        return asyncio.run(main(folder))


def _table(title: str, parts: Iterable[Callable[[], Figures]]) -> Table:
    rows = []
    for part in parts:
        for name, value in part().items():
            limit, sign = TARGETS.get(name, (None, ""))
            rows.append((name, value, None if limit is None else f"{sign} {limit:g}"))
    loads = ", ".join(f"{load:.1f}" for load in os.getloadavg())
    note = f"Load of the machine after 1, 5 and 15 minutes: {loads}; the benchmark's own included."
    return Table(title, ("figure", "measured", "aim"), rows, note)


def small_jobs() -> Table:
    """Submit durable jobs of a millisecond, alone, many at once, in batches and beside others."""
    parts = (tiny_jobs, tiny_jobs_of_many, batches, behind_bulk, again)
    return _table("Small jobs through the queue", parts)


def chunks_of_jobs() -> Table:
    """Run jobs of thousands of chunks that take 4 ms each and compute nothing."""
    return _table("Chunks", (chunk_overhead, behind_another_user))


def upkeep() -> Table:
    """List jobs, do nothing, and see whether anything grows with the number of jobs."""
    return _table("Upkeep", (listing, idle, soak))


TABLES: Final = (small_jobs, chunks_of_jobs, upkeep)
