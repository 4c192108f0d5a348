"""The job queue with its real parts: SQLite and PostgreSQL, workers over TLS, a store."""

from __future__ import annotations

import asyncio
import hashlib
import json
import re
import sys
import uuid
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parent))
import counting

from vibroimpact_service.jobs.data_folder import DataInUseError
from vibroimpact_service.jobs.queue import JobQueue
from vibroimpact_service.jobs.records import KeyReusedError, NewJob
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store


@dataclass(frozen=True)
class Place:
    """Where a queue keeps what it must not lose."""

    folder: Path
    database: str | None


@pytest.fixture(params=["sqlite", "postgresql"])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> Place:
    database = None
    if request.param == "postgresql":
        database = request.getfixturevalue("postgresql")()
    return Place(tmp_path, database)


class Bench:
    """A queue, its store, and short ways to submit to it."""

    def __init__(self, queue: JobQueue, store: Store) -> None:
        self.queue, self.store = queue, store

    async def submit(
        self,
        *,
        owner: str = "ann",
        key: str | None = None,
        seconds: float = 5.0,
        deadline: float | None = None,
        stored: bool = True,
        fingerprint: str = "",
        **asked: Any,
    ) -> Any:
        data = json.dumps({"n": 100, "chunk": 10} | asked, sort_keys=True).encode()
        request = hashlib.sha256(data).hexdigest()
        if stored:
            self.store.requests.put(request, data)
        result = hashlib.sha256(owner.encode() + data).hexdigest()
        new = NewJob(
            uuid.uuid4().hex, owner, "squares", request, result, 0, seconds,
            self.store.results.has(result), key, deadline, fingerprint=fingerprint,
        )  # fmt: skip
        return await self.queue.submit(new)

    async def changes(self, job: Any) -> AsyncIterator[Any]:
        """Yield a job whenever it changed, to its end."""
        row = job
        while not row.final:
            row = await self.queue.wait("ann", job.id, 60, row.version)
            yield row

    def value(self, job: Any) -> int:
        data = self.store.results.get(job.result)
        assert data is not None
        return int(data)


@asynccontextmanager
async def bench(place: Place, **more: Any) -> AsyncIterator[Bench]:
    settings = Settings(
        data=place.folder, database=place.database, workers=1, grace_seconds=1.0, **more
    )
    store = Store(settings.store_url)
    queue = JobQueue(settings, store, counting.WORK)
    await queue.start()
    try:
        yield Bench(queue, store)
    finally:
        await queue.close()


def run(scenario: Callable[[Bench], Coroutine[Any, Any, None]], place: Place, **more: Any) -> None:
    async def all_of_it() -> None:
        async with bench(place, **more) as b:
            await scenario(b)

    asyncio.run(all_of_it())


def squares(n: int) -> int:
    return (n - 1) * n * (2 * n - 1) // 6


def test_jobs_end_as_they_should(place: Place) -> None:
    """One start of the workers serves the scenarios that do not disturb one another."""

    async def scenario(b: Bench) -> None:
        job = await b.submit(n=1000)
        assert job.state == "queued"
        done = await b.queue.wait("ann", job.id, 60)
        assert done is not None
        assert (done.state, done.reused) == ("succeeded", False)
        assert b.value(done) == squares(1000)

        again = await b.submit(n=1000)
        assert (again.state, again.reused) == ("succeeded", True)

        assert await b.queue.get("bob", job.id) is None
        assert await b.queue.cancel("bob", job.id) is None

        wrong = await b.submit(fail="three is missing")
        wrong = await b.queue.wait("ann", wrong.id, 30)
        assert wrong.state == "failed"
        assert wrong.error == {"code": "WrongRequestError", "detail": "three is missing"}

        first, second = await b.submit(n=50, sleep=0.1), await b.submit(n=50, sleep=0.1)
        ends = [await b.queue.wait("ann", j.id, 30) for j in (first, second)]
        assert [e.state for e in ends] == ["succeeded"] * 2
        assert sorted(e.reused for e in ends) == [False, True]

        keyed = await b.submit(n=10, key="k")
        assert (await b.submit(n=10, key="k")).id == keyed.id
        with pytest.raises(KeyReusedError):
            await b.submit(n=10, key="k", fingerprint="f" * 64)
        with pytest.raises(KeyReusedError):
            await b.submit(n=20, key="k")

        slow = await b.submit(n=10_000, sleep=0.2)
        states = []
        async for event in b.changes(slow):
            states.append(event.state)
            if event.done:
                await b.queue.cancel("ann", slow.id)
        assert states[-1] == "cancelled"
        assert b.store.results.get(slow.result) is None
        again = await b.queue.cancel("ann", slow.id)
        assert again is not None
        assert again.state == "cancelled"

        listed = await b.queue.list("ann", None, None, None, 3)
        assert [j.seq for j in listed] == sorted((j.seq for j in listed), reverse=True)
        assert len(await b.queue.list("ann", "cancelled", None, None, 10)) == 1

    run(scenario, place)


def test_a_poison_chunk_fails_its_own_job_only(place: Place) -> None:
    async def scenario(b: Bench) -> None:
        bad = await b.submit(poison=3)
        good = await b.submit(n=200, sleep=0.05)
        bad = await b.queue.wait("ann", bad.id, 120)
        good = await b.queue.wait("ann", good.id, 120)
        assert bad.state == "failed"
        assert bad.error["code"] == "WorkerLostError"
        assert good.state == "succeeded"
        assert b.value(good) == squares(200)

    run(scenario, place)


@pytest.mark.parametrize("seconds", [5.0, 0.01])
def test_a_request_that_is_nowhere_fails_its_own_job_only(place: Place, seconds: float) -> None:
    """The store has lost it, and the records do not have it either."""

    async def scenario(b: Bench) -> None:
        gone = await b.submit(seconds=seconds, n=300, stored=False)
        good = await b.submit(seconds=seconds, n=200)
        gone = await b.queue.wait("ann", gone.id, 120)
        good = await b.queue.wait("ann", good.id, 120)
        assert gone.state == "failed"
        assert gone.error["code"] == "LookupError"
        assert good.state == "succeeded"

    run(scenario, place)


def test_a_job_that_passes_a_limit_says_which_and_what_is_kept(tmp_path: Path) -> None:
    async def scenario(b: Bench) -> None:
        kept = {"n": 100, "chunk": 10, "sleep": 0.02}
        large = await b.submit(pad=300, **kept)
        quick = await b.submit(pad=300, n=100, chunk=10, seconds=0.01)
        small = await b.submit(pad=100, **kept)
        hungry = await b.submit(hungry=3, chained=True)
        endless = await b.submit(poison=3, signal="SIGXCPU", chained=True)
        for job, what in (
            (large, "more than those of a job may"),
            (hungry, "more memory than"),
            (endless, "processor time"),
        ):
            failed = await b.queue.wait("ann", job.id, 120)
            assert failed.state == "failed"
            assert failed.error["code"] == "LimitPassedError"
            assert what in failed.error["detail"]
            (done,) = re.findall(r"(\d+) of 10 pieces are kept", failed.error["detail"])
            assert 0 < int(done) < 10
        quick = await b.queue.wait("ann", quick.id, 120)
        assert quick.error["code"] == "LimitPassedError"
        assert "10 of 10 pieces are kept" in quick.error["detail"]
        assert b.store.results.has(quick.result) is False
        assert (await b.queue.wait("ann", small.id, 120)).state == "succeeded"
        again = await b.queue.retry("ann", large.id)
        assert again is not None
        again = await b.queue.wait("ann", large.id, 120)
        assert again.error["code"] == "LimitPassedError"  # what is kept counts

    run(scenario, Place(tmp_path, None), max_result_bytes=1024, worker_memory_bytes=2**30)


def test_calls_that_do_not_stop_lose_their_worker(place: Place) -> None:
    async def scenario(b: Bench) -> None:
        deaf = await b.submit(n=10, sleep=300.0)  # it never looks whether it is wanted
        next_one = await b.submit(n=20)
        while (await b.queue.get("ann", deaf.id)).state == "queued":
            await asyncio.sleep(0.05)
        started = asyncio.get_running_loop().time()
        cancelled = await b.queue.cancel("ann", deaf.id)
        assert cancelled.state == "cancelled"
        done = await b.queue.wait("ann", next_one.id, 60)
        assert done.state == "succeeded"
        assert b.value(done) == squares(20)
        assert asyncio.get_running_loop().time() - started < 60

    run(scenario, place)


def test_a_deadline_ends_a_job(place: Place) -> None:
    async def scenario(b: Bench) -> None:
        late = await b.submit(n=1000, sleep=0.2, deadline=2.0)
        assert late.deadline - late.created == pytest.approx(2.0)
        in_time = await b.submit(n=30, deadline=300.0)
        late = await b.queue.wait("ann", late.id, 60)
        assert late.state == "failed"
        assert late.error["code"] == "DeadlineError"
        assert late.finished - late.created >= 2.0
        in_time = await b.queue.wait("ann", in_time.id, 60)
        assert in_time.state == "succeeded"

    run(scenario, place)


def test_a_waiting_job_says_why_and_where(place: Place) -> None:
    async def scenario(b: Bench) -> None:
        jobs = [await b.submit(n=10, sleep=0.01, seconds=5.0, salt=i) for i in range(3)]
        assert b.queue.waiting_reason(jobs[0], 0)
        places = await b.queue.positions(jobs)
        waiting = [job.id for job in jobs if job.id in places]
        assert [places[job] for job in waiting] == sorted(places[job] for job in waiting)
        for job in jobs:
            done = await b.queue.wait("ann", job.id, 60)
            assert done.state == "succeeded"
            assert b.queue.waiting_reason(done, 0) is None

    run(scenario, place)


def test_a_job_that_waits_for_a_worker_says_so(place: Place) -> None:
    """It is running, which is that a process has claimed it."""

    async def scenario(b: Bench) -> None:
        long = await b.submit(n=10, chunk=10, sleep=5.0, seconds=5.0)
        while (await b.queue.get("ann", long.id)).phase != "computing":
            await asyncio.sleep(0.02)
        assert b.queue.waiting_reason(await b.queue.get("ann", long.id), 0) is None
        short = await b.submit(n=10, sleep=0.0, seconds=5.0, salt=1)
        told = set()
        while not (row := await b.queue.get("ann", short.id)).final:
            told.add(b.queue.waiting_reason(row, 0) if row.state == "running" else None)
            await asyncio.sleep(0.02)
        assert "the workers are busy: 1 part of other jobs goes first" in told
        done = await b.queue.wait("ann", long.id, 60)
        assert (done.state, row.state) == ("succeeded", "succeeded")
        assert b.queue.waiting_reason(done, 0) is None

    run(scenario, place)


def test_a_restart_goes_on_from_the_chunks_that_are_there(place: Place) -> None:
    log = place.folder / "log"

    async def interrupted(b: Bench) -> None:
        job = await b.submit(n=300, sleep=0.1, log=str(log))
        seen = 0
        async for event in b.changes(job):
            seen = max(seen, event.done)
            if seen >= 5:
                break

    async def resumed(b: Bench) -> None:
        (job,) = await b.queue.list("ann", None, None, None, 10)
        done = await b.queue.wait("ann", job.id, 60)
        assert done is not None
        assert done.state == "succeeded"
        assert done.attempts == 2
        assert b.value(done) == squares(300)

    run(interrupted, place)
    run(resumed, place)
    computed = [int(line) for line in log.read_text().split()]
    assert set(computed) == set(range(30))
    # At most the chunks that were running when it stopped were computed twice.
    assert len(computed) <= 30 + 8


def test_chained_chunks_are_computed_in_turn(place: Place) -> None:
    log = place.folder / "log"

    async def scenario(b: Bench) -> None:
        job = await b.submit(n=400, chained=True, sleep=0.02, log=str(log))
        states = []
        async for event in b.changes(job):
            states.append((event.state, event.done, event.total))
        assert states[-1] == ("succeeded", 40, 40)
        assert b.value(job) == squares(400)
        assert [int(line) for line in log.read_text().split()] == list(range(40))
        # Progress is told on the way, not only in the end.
        assert len({done for _, done, _ in states}) > 3

        bad = await b.submit(n=400, chained=True, poison=7)
        bad = await b.queue.wait("ann", bad.id, 120)
        assert bad.state == "failed"
        assert bad.error["code"] == "WorkerLostError"
        good = await b.submit(n=90, chained=True)
        good = await b.queue.wait("ann", good.id, 60)
        assert good.state == "succeeded"

    run(scenario, place)


def test_two_services_do_not_share_a_folder(tmp_path: Path) -> None:
    async def scenario(b: Bench) -> None:
        settings = Settings(data=tmp_path, workers=1)
        other = JobQueue(settings, b.store, counting.WORK)
        with pytest.raises(DataInUseError):
            await other.start()

    run(scenario, Place(tmp_path, None))


@pytest.mark.parametrize("server", ["sqlite", "postgresql"])
def test_records_of_jobs_computed_while_they_are_submitted(
    server: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    database = request.getfixturevalue("postgresql")() if server == "postgresql" else None
    settings = Settings(data=tmp_path, database=database, workers=1)
    store = Store(settings.store_url)
    queue = JobQueue(settings, store, counting.WORK)

    def new(key: str | None = None) -> NewJob:
        return NewJob(
            f"job_{uuid.uuid4().hex}", "ann", "k", "aa" * 32, "bb" * 32, 0, 0.001, False, key,
            block=b"asked", computed=True,
        )  # fmt: skip

    async def scenario() -> None:
        await queue.start()
        try:
            store.results.put("bb" * 32, b"result", durable=False)
            job = await queue.submit(new("key"))
            assert (job.state, job.phase, job.queue) == ("succeeded", "done", "quick")
            assert (job.reused, job.attempts, job.done, job.total) == (False, 1, 1, 1)
            assert job.started is not None
            assert job.finished is not None
            assert await queue.get("ann", job.id) == job
            assert await queue.get("bob", job.id) is None
            # The same key stands for the same job, whatever was computed for it meanwhile.
            assert (await queue.submit(new("key"))).id == job.id
            assert await queue.request("aa" * 32) == b"asked"
            assert store.requests.get("aa" * 32) is None  # it stands in the records only
            assert await queue.unfinished("ann", 10) == 0
        finally:
            await queue.close()

    asyncio.run(scenario())
