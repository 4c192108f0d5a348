"""Jobs: small ones through the queue, chunks, workers, and what the scheduler takes.

Service, workers and clients share the cores of one machine.
"""

from __future__ import annotations

import asyncio
import hashlib
import json
import os
import queue
import statistics
import tempfile
import time
import uuid
from collections.abc import Awaitable, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final
from unittest import mock

from benchmarks.service import chunks, load
from benchmarks.service.load import Load
from benchmarks.service.requests import Request, modes, numbered
from benchmarks.service.server import Server, children, running, seconds
from benchmarks.tables import Figure, Goal, Table, figures
from vibroimpact_service.jobs import batch_size, fair_share
from vibroimpact_service.jobs.engine import BULK, Call, Engine
from vibroimpact_service.jobs.queue import JobQueue
from vibroimpact_service.jobs.records import NewJob
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store

WORKERS: Final = 2
_EACH: Final = 0.004
"""Seconds of a chunk that only keeps a core busy."""
_SHARED: Final = {
    "": "on the clock: service, workers and clients share the cores with one another, and with "
    "whatever else the machine does; see the load"
}
Scenario = Callable[[JobQueue, Store], Awaitable[float]]


def _loads() -> str:
    loads = ", ".join(f"{each:.1f}" for each in os.getloadavg())
    return f"Load of the machine after 1, 5 and 15 minutes: {loads}; the benchmark's own included."


def small_jobs() -> Table:
    """Submit durable jobs of a millisecond, alone, many at once, in batches and beside others."""
    with running(WORKERS) as server:
        numbers = [
            *_one_by_one(server),
            *_of_many_clients(server),
            *_by_batches(server),
            *_again(server),
            *_behind_a_large_one(server),
        ]
    return figures("Small jobs through the queue", numbers, _loads(), _SHARED)


def latencies(server: Server, count: int, first: int) -> list[float]:
    """Return milliseconds of small jobs, one after the other, without the first tenth."""
    times = []
    for number in range(first, first + count):
        started = time.perf_counter()
        server.done(server.job(numbered(number)))
        times.append(1e3 * (time.perf_counter() - started))
    return times[count // 10 :]  # the first ones load and compile


def _milliseconds(work: Callable[[], object]) -> float:
    started = time.perf_counter()
    work()
    return 1e3 * (time.perf_counter() - started)


def _one_by_one(server: Server, count: int = 300) -> Iterator[Figure]:
    """Yield the time from submitting a durable job over HTTP to knowing that it is done."""
    latencies(server, 30, 10_000)
    before = seconds(server.processes())
    times = latencies(server, count, 0)
    used = seconds(server.processes()) - before
    yield Figure("processor of a tiny job [ms]", 1e3 * used / count)
    yield Figure("tiny job, p50 [ms]", statistics.median(times), 8.0)
    yield Figure("tiny job, p99 [ms]", statistics.quantiles(times, n=100)[98], 20.0)


def _of_many_clients(server: Server, clients: int = 32, ahead: int = 40) -> Iterator[Figure]:
    """Yield how many durable jobs a second many clients get done."""
    before = seconds(server.processes())
    several = Load(server.url, (Request.job(modes()),), clients, 2.0, 1_000_000, ahead)
    outcome = load.run(several).proper(200)
    used = seconds(server.processes()) - before
    yield Figure("processor of one of many tiny jobs [ms]", 1e3 * used / outcome.answers)
    rate = outcome.answers / outcome.seconds
    yield Figure(f"tiny jobs of {clients} clients [1/s]", rate, 300.0, True)


def _by_batches(server: Server, count: int = 6, size: int = 1000) -> Iterator[Figure]:
    """Yield how many requests a second are answered by batches."""

    def batch(number: int) -> None:
        requests = [numbered(30_000 + number * size + i) for i in range(size)]
        content = {"kind": "impact-modes", "requests": requests}
        document = server.answered("POST", "/v1/batch", content).document
        if len(document["answers"]) != size:
            raise RuntimeError(document)

    batch(0)
    before = seconds(server.processes())
    with ThreadPoolExecutor(2) as pool:
        spent = _milliseconds(lambda: list(pool.map(batch, range(1, count + 1))))
    used = seconds(server.processes()) - before
    yield Figure("processor of a request of a batch [ms]", 1e3 * used / (count * size))
    yield Figure("requests by batches [1/s]", 1e3 * count * size / spent, 3000.0, True)


def _large(number: int, num: int) -> dict[str, Any]:
    """Return the content of a request that takes many seconds."""
    return modes(0.6 + 1e-5 * number, num, 300, ("impulse", "exists"))


def _again(server: Server, count: int = 20) -> Iterator[Figure]:
    """Yield the time to get a finished sweep's job when it is submitted again."""

    def submit() -> None:
        server.done(server.job(_large(0, 30_000)))

    submit()
    times = [_milliseconds(submit) for _ in range(count)]
    yield Figure("finished sweep again [ms]", statistics.median(times), 10.0)


def _behind_a_large_one(server: Server, count: int = 100) -> Iterator[Figure]:
    """Yield the time of a tiny job while a large one keeps all workers busy."""
    job = server.job(_large(1, 3_000_000))
    time.sleep(1.0)
    times = latencies(server, count, 50_000)
    server.ask("DELETE", f"/v1/jobs/{job}")
    yield Figure("tiny job behind a bulk one, p50 [ms]", statistics.median(times), 15.0)


async def _busy(
    jobs: JobQueue, store: Store, count: int, owner: str = "ann", each: float = _EACH
) -> float:
    """Have a job done whose chunks keep a core busy for so many seconds each; return its time."""
    started = time.perf_counter()
    data = json.dumps({"chunks": count, "seconds": each, "salt": uuid.uuid4().hex}).encode()
    request = hashlib.sha256(data).hexdigest()
    store.requests.put(request, data)
    result = hashlib.sha256(data + owner.encode()).hexdigest()
    name = f"job_{uuid.uuid4().hex}"
    await jobs.submit(NewJob(name, owner, "busy", request, result, 0, 5.0, False))
    job = await jobs.wait(owner, name, 100)
    if job is None or job.state != "succeeded":
        raise RuntimeError(job)
    return time.perf_counter() - started


def _with_queue(scenario: Scenario, workers: int = 1) -> float:
    """Return what a scenario makes of a queue in this process, with workers of its own."""

    async def main(folder: str) -> float:
        settings = Settings(data=Path(folder), workers=workers)
        store = Store(settings.store_url)
        jobs = JobQueue(settings, store, chunks.WORK)
        await jobs.start()
        try:
            return await scenario(jobs, store)
        finally:
            await jobs.close()

    with tempfile.TemporaryDirectory() as folder:
        return asyncio.run(main(folder))


def chunks_of_jobs() -> Table:
    """Run jobs of thousands of chunks that take 4 ms each and compute nothing."""
    numbers = [*_chunk_overhead(), _behind_another_user()]
    return figures("Chunks", numbers, _loads(), _SHARED)


def _chunk_overhead(count: int = 2000) -> Iterator[Figure]:
    """Yield what a chunk of some milliseconds costs beside itself, with one worker.

    The processor time tells what remains on a machine on which others are at work too.
    """
    used = 0.0

    async def scenario(jobs: JobQueue, store: Store) -> float:
        nonlocal used
        await _busy(jobs, store, 100)  # learns the time of a chunk
        before = {child: seconds([child]) for child in children(os.getpid())}
        await _busy(jobs, store, 100)
        worker = max(before, key=lambda child: seconds([child]) - before[child])
        start = seconds([worker])
        spent = await _busy(jobs, store, count)
        used = seconds([worker]) - start
        return spent

    spent = _with_queue(scenario)
    yield Figure("processor overhead of a 4 ms chunk [ms]", 1e3 * (used / count - _EACH))
    yield Figure("overhead of a 4 ms chunk [ms]", 1e3 * (spent / count - _EACH), 0.15)


def _behind_another_user(count: int = 20_000) -> Figure:
    """Return the time of a small job of one user while another has thousands of chunks."""

    async def scenario(jobs: JobQueue, store: Store) -> float:
        await _busy(jobs, store, 100)
        large = asyncio.create_task(_busy(jobs, store, count))
        await asyncio.sleep(3.0)
        spent = await _busy(jobs, store, 5, "bob")
        large.cancel()
        await asyncio.gather(large, return_exceptions=True)
        return spent

    return Figure(f"job of B behind {count} chunks of A [s]", _with_queue(scenario), 0.5)


_CHUNKS: Final = 1000
_FREQUENCIES: Final = 30_000


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
        alone, both = run(1), run(2)
        rows += [(what, 1, alone, 1.0, None), (what, 2, both, alone / both, least)]
    return Table(
        "One large job, one and two workers",
        ("job", "workers", "clock [s]", "speed-up", "goal"),
        rows,
        f"{_CHUNKS} chunks; {_FREQUENCIES} frequencies of the chain, submitted over HTTP, result "
        "stored. On the clock, each after a job like it.",
        Goal("speed-up", "goal", at_least=True),
        reasons={"": "on the clock: two workers, the service and this process share the cores"},
    )


def _busy_chunks(count: int) -> float:
    async def scenario(jobs: JobQueue, store: Store) -> float:
        await _busy(jobs, store, 200 * count)
        return await _busy(jobs, store, _CHUNKS)

    return _with_queue(scenario, count)


def _real_job(count: int) -> float:
    with running(count) as server:
        # Long enough for all workers to load their kernels.
        server.done(server.job(_large(1, _FREQUENCIES)))
        return 1e-3 * _milliseconds(lambda: server.done(server.job(_large(2, _FREQUENCIES))))


_BATCHES: Final = 250
_ROUNDS: Final = 3
_AIM: Final = 1.0
_BATCH: Final = "processor of the service for a batch of chunks [ms]"


def scheduler() -> Table:
    """Measure what one batch of chunks takes of the process that schedules."""
    calls: list[float] = []

    async def scenario(jobs: JobQueue, store: Store) -> float:
        await _busy(jobs, store, 200)
        idle = await _spent(asyncio.sleep(3.0)) / 3.0
        batches = []
        for _ in range(_ROUNDS):
            batches.append(await _spent(_busy(jobs, store, _BATCHES), idle))
            calls.append(await _spent(asyncio.to_thread(_empty_calls, jobs.engine), idle))
        return min(batches)

    with mock.patch.object(batch_size, "SECONDS", _EACH):
        batch = 1e3 * _with_queue(scenario, WORKERS) / _BATCHES
    call = 1e3 * min(calls) / _BATCHES
    return figures(
        "What the scheduler takes",
        [
            Figure(_BATCH, batch, _AIM),
            Figure("the same for a call of Dask that does nothing [ms]", call),
        ],
        f"{_BATCHES} batches of one chunk of 4 ms and as many empty calls, two workers, the least "
        f"of {_ROUNDS} rounds; scheduler, its client, the run of the job and its reports, all in "
        "one process.",
        {
            _BATCH: f"Dask's client and scheduler take {call:.2g} ms of it, for a call that does "
            "nothing: a graph of one task, three encrypted messages with the worker, and what the "
            "scheduler notes. Batches of many workers are longer in return, so that no more than "
            f"{batch_size.MAX_RATE:g} a second are handed out."
        },
    )


async def _spent(work: Awaitable[object], idle: float = 0.0) -> float:
    """Return the processor time that some work takes beyond that of a share of a core."""
    began, used = time.perf_counter(), time.process_time()
    await work
    return time.process_time() - used - idle * (time.perf_counter() - began)


def _empty_calls(engine: Engine) -> None:
    """Have calls done that do nothing, as many ahead as batches are given ahead."""
    ended: queue.SimpleQueue[Call] = queue.SimpleQueue()
    sent = 0

    def send(count: int) -> None:
        nonlocal sent
        for _ in range(min(count, _BATCHES - sent)):
            sent += 1
            engine.submit(f"empty-{uuid.uuid4().hex}", BULK, 0, ended.put, chunks.nothing)

    send(fair_share.BATCHES_PER_WORKER * engine.workers)
    for _ in range(_BATCHES):
        ended.get(timeout=60.0).future.release()
        send(1)
