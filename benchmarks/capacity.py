"""Figures of `docs/service/capacity.md`: ``python -m benchmarks.capacity PART``.

``rates`` are jobs a second and the memory of each process, ``kinds`` the disk that a job of each
kind takes, ``simulated`` a scheduler with up to a thousand workers by the rules of the service,
``workers`` a real scheduler with so many real worker processes whose chunks only wait.
"""

from __future__ import annotations

import argparse
import heapq
import os
import queue
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.service import load
from benchmarks.service.load import Load
from benchmarks.service.requests import Request, modes
from benchmarks.service.server import Server, running, seconds, session
from vibroimpact_schema import examples
from vibroimpact_service.jobs import certificates
from vibroimpact_service.jobs.engine import BULK, Call, Engine
from vibroimpact_service.jobs.fair_share import BATCHES_PER_WORKER
from vibroimpact_service.jobs.run_one import batch_seconds, batch_size
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.settings import Settings

_LARGE: Final = {"impact-modes": modes(0.6, 100_000, 40, ("impulse", "exists"))}
_CLIENTS: Final = 32
_MEBI: Final = 1024.0  # kibibytes
_BUSY_SECONDS: Final = 20.0
_STARTING_SECONDS: Final = 600.0


def main() -> None:
    """Print one part of the figures."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.capacity", description=__doc__)
    parser.add_argument("part", choices=("rates", "kinds", "simulated", "workers"))
    parser.add_argument("--database", action="append", default=[], help="an empty PostgreSQL")
    parser.add_argument("--count", type=int, default=100, help="workers")
    given = parser.parse_args()
    print("load of the machine:", *(f"{each:.1f}" for each in os.getloadavg()))
    if given.part == "rates":
        rates(given.database)
    elif given.part == "kinds":
        kinds()
    elif given.part == "simulated":
        simulated()
    else:
        workers(given.count)


def rates(databases: list[str]) -> None:
    """Submit small jobs to one service, and to two replicas on PostgreSQL."""
    with running(2) as server:
        _rate("one service, SQLite", [server])
        _roles(server.processes())
    for database in databases:
        with ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            shared = {
                "VIBROIMPACT_DATABASE": database,
                "VIBROIMPACT_STORE": str(folder / "store"),
            }
            pair = [
                stack.enter_context(closing(Server(folder / name, environment=shared)))
                for name in "ab"
            ]
            _rate("one replica, PostgreSQL", pair[:1])
            _rate("two replicas, PostgreSQL", pair)


def _rate(what: str, servers: list[Server]) -> None:
    """Print how many jobs a second are done by some services at once."""
    loads = [
        Load(server.url, (Request.job(modes()),), _CLIENTS // len(servers), 5.0, 10**6 * i, 40)
        for i, server in enumerate(servers, 1)
    ]
    for warm in loads:
        load.run(Load(warm.url, warm.requests, 4, 2.0, warm.first + 500_000, 10))
    with ThreadPoolExecutor(len(loads)) as pool:
        outcomes = [each.proper() for each in pool.map(load.run, loads)]
    print(f"{what}: {sum(each.answers / each.seconds for each in outcomes):.0f} jobs/s")


def _memory(process: int) -> dict[str, float]:
    """Return mebibytes of a process: all (Rss) and with shared pages divided (Pss)."""
    with suppress(OSError):
        lines = Path(f"/proc/{process}/smaps_rollup").read_text().splitlines()[1:]
        return {line.split()[0]: int(line.split()[1]) / _MEBI for line in lines}
    return {"Rss:": 0.0, "Pss:": 0.0}


def _roles(processes: list[int]) -> None:
    """Print the memory of processes."""
    for process in processes:
        with suppress(OSError):
            command = Path(f"/proc/{process}/cmdline").read_text().replace("\0", " ")
            sizes = _memory(process)
            print(f"{sizes['Rss:']:.0f} MiB, by share {sizes['Pss:']:.0f}: {command[:70]}")


def kinds() -> None:
    """Print what a job of each kind takes of the store and of the records."""
    with running(1, {"VIBROIMPACT_ON_SUBMISSION_SECONDS": "0"}) as server:
        for kind in KINDS:
            for name, example in examples.requests(kind).items():
                _disk(server, f"{kind}, {name}", kind, example["request"])
        for kind, content in _LARGE.items():
            _disk(server, f"{kind}, large", kind, content)
        before = _records(server.data)
        load.run(Load(server.url, (Request.job(modes()),), 8, 5.0, 1, 20)).proper()
        count, size = (b - a for a, b in zip(before, _records(server.data), strict=True))
        print(f"records: {size / count:.0f} B a job, of {count}")


def _records(data: Path) -> tuple[int, int]:
    """Return the number of jobs in the records, and their bytes."""
    (file,) = data.glob("*.sqlite")
    with closing(sqlite3.connect(file)) as connection:
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        (count,) = connection.execute("SELECT count(*) FROM jobs").fetchone()
    return count, file.stat().st_size


def _disk(server: Server, what: str, kind: str, content: Any) -> None:
    before = {area: _size(server.data / "store" / area) for area in ("chunks", "results")}
    began = time.perf_counter()
    job = server.answered("POST", "/v1/jobs", {"kind": kind, "request": content}, 201).json()["id"]
    server.done(job)
    took = time.perf_counter() - began
    grown = {area: _size(server.data / "store" / area) - size for area, size in before.items()}
    print(f"{what}: result {grown['results']} B, chunks {grown['chunks']} B, {took:.2f} s")


def _size(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.glob("*/*"))


def simulated() -> None:
    """Simulate a job of many chunks on one to a thousand workers, by the rules of the service."""
    for handing in (0.001, 0.003, 0.01):
        for count in (1, 10, 32, 100, 300, 1000):
            took, busy, scheduler = simulate(count, handing)
            print(
                f"{1e3 * handing:g} ms for a batch, {count} workers: job {took:.0f} s, "
                f"workers busy {100 * busy:.0f} %, scheduler busy {100 * scheduler:.0f} %"
            )


def simulate(
    count: int, handing: float, chunks: int = 1_000_000, each: float = 0.01
) -> tuple[float, float, float]:
    """Return the seconds of a job, and the shares of their time that workers and scheduler work.

    Each worker has the batches ahead that the rules give it; a batch takes `handing` seconds of
    the one scheduler. Lengths of chunks scatter by a half.
    """
    random = np.random.default_rng(1)
    free, ahead = [0.0] * count, list[float]()
    scheduler, batches, spent, waiting = 0.0, 0, 0.0, chunks
    while waiting:
        size = batch_size(waiting, each, count)
        waiting -= size
        length = max(0.1 * each * size, random.normal(each * size, 0.5 * each * np.sqrt(size)))
        if len(ahead) >= BATCHES_PER_WORKER * count:
            scheduler = max(scheduler, heapq.heappop(ahead))
        scheduler += handing
        end = max(scheduler, heapq.heappop(free)) + length
        heapq.heappush(free, end)
        heapq.heappush(ahead, end)
        batches, spent = batches + 1, spent + length
    took = max(free)
    return took, spent / (took * count), handing * batches / took


def workers(count: int) -> None:
    """Have a real scheduler hand calls to so many worker processes, which only wait."""
    with tempfile.TemporaryDirectory() as name, _cluster(Path(name), count) as (engine, parts):
        for what, part in parts.items():
            shares = sum(_memory(each)["Pss:"] for each in session(part))
            print(f"{what}: {shares:.0f} MiB, pages of several processes divided among them")
        length = batch_seconds(count)
        processes = {**parts, "service": os.getpid()}
        used = {what: seconds([each]) for what, each in processes.items()}
        began = time.perf_counter()
        calls = _keep_busy(engine, count, length)
        took = time.perf_counter() - began
        print(
            f"{count} workers, {calls} calls of {length:.2g} s: {calls / took:.0f} calls/s, "
            f"workers busy {100 * calls * length / (took * count):.0f} %"
        )
        for what, each in processes.items():
            spent = seconds([each]) - used[what]
            print(f"{what}: {1e3 * spent / calls:.1f} ms of a core for a call")


def wait(duration: float, _tick: Any) -> None:
    """Take time, and no processor."""
    time.sleep(duration)


def _keep_busy(engine: Engine, count: int, length: float) -> int:
    """Send calls as many ahead as the service does; return how many there were."""
    ended: queue.SimpleQueue[Call] = queue.SimpleQueue()
    total = max(4 * count, int(_BUSY_SECONDS * count / length))
    for number in range(total):
        if number >= BATCHES_PER_WORKER * count:
            ended.get(timeout=120.0).release()
        engine.submit(f"wait-{uuid.uuid4().hex}", BULK, 0, ended.put, wait, length)
    for _ in range(BATCHES_PER_WORKER * count):
        ended.get(timeout=120.0).release()
    return total


@contextmanager
def _cluster(folder: Path, count: int) -> Iterator[tuple[Engine, dict[str, int]]]:
    """Give an engine with so many workers elsewhere, and the processes of scheduler and workers."""
    certificates.write(folder / "tls", days=2)
    tls = [str(folder / "tls" / name) for name in certificates.FILES.values()]
    names = [f"VIBROIMPACT_TLS_{name}" for name in certificates.FILES]
    os.environ |= dict(zip(names, tls, strict=True))
    address = "tls://127.0.0.1:8786"
    words = {"scheduler": ["scheduler"], "workers": ["worker", address, "--workers", str(count)]}
    started: dict[str, subprocess.Popen[bytes]] = {}
    engine = Engine(Settings(scheduler=address, data=folder))
    try:
        for what, arguments in words.items():
            command = [sys.executable, "-m", "vibroimpact_service.cli", *arguments]
            started[what] = subprocess.Popen(command, start_new_session=True)
        engine.start()
        end = time.monotonic() + _STARTING_SECONDS
        while engine.workers < count:
            if time.monotonic() > end:
                raise RuntimeError(f"{engine.workers} workers: {engine.failure}")
            time.sleep(0.5)
        time.sleep(30.0)  # they load what they need
        yield engine, {what: process.pid for what, process in started.items()}
    finally:
        engine.close()
        for process in reversed(started.values()):  # workers first: they would look for it
            process.terminate()
            with suppress(subprocess.TimeoutExpired):
                process.wait(60)
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


if __name__ == "__main__":
    main()
