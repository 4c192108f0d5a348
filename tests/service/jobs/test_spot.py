"""Jobs that are done while they are submitted: once, in time, or by the workers after all."""

from __future__ import annotations

import asyncio
import threading
import time
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from vibroimpact_service import tasks
from vibroimpact_service.jobs.ledger import NewJob
from vibroimpact_service.jobs.queue import JobQueue
from vibroimpact_service.jobs.spot import Spot
from vibroimpact_service.jobs.work import StoppedError, Tick
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store, StoreFullError


def run(scenario: Any) -> Any:
    async def bounded() -> Any:
        async with asyncio.timeout(60):
            return await scenario

    return asyncio.run(bounded())


def test_equal_ones_are_computed_once() -> None:
    spot, calls, gate = Spot(2, 1.0), [], threading.Event()

    def compute(_tick: Tick) -> None:
        calls.append(1)
        gate.wait(10)

    async def scenario() -> list[bool]:
        first = [asyncio.ensure_future(spot.computed("r", compute)) for _ in range(50)]
        await asyncio.sleep(0.01)
        assert spot.knows("r")
        gate.set()
        return await asyncio.gather(*first)

    assert run(scenario()) == [True] * 50
    assert len(calls) == 1
    spot.close()


def test_what_takes_longer_is_given_up_and_holds_its_thread_until_it_stopped() -> None:
    spot, ended = Spot(1, 1.0), threading.Event()

    def compute(tick: Tick) -> None:
        try:
            while True:
                time.sleep(0.005)
                tick(0, 1)
        except StoppedError:
            ended.set()
            raise

    async def scenario() -> None:
        assert await spot.computed("r", compute) is False
        await asyncio.to_thread(ended.wait, 10)
        while spot.knows("r"):
            await asyncio.sleep(0.01)

    run(scenario())
    assert ended.is_set()
    spot.close()


def test_failures_go_to_the_workers_but_a_full_store_is_told() -> None:
    spot = Spot(1, 1.0)

    def fail(error: Exception) -> Callable[[Tick], None]:
        def compute(_tick: Tick) -> None:
            raise error

        return compute

    async def scenario() -> None:
        assert await spot.computed("r", fail(ValueError("wrong"))) is False
        with pytest.raises(StoreFullError):
            await spot.computed("s", fail(StoreFullError(28, "the store is full")))

    run(scenario())
    spot.close()


def test_the_line_is_short_and_the_work_small() -> None:
    spot, gate = Spot(1, 0.02), threading.Event()
    assert spot.takes(0.019)
    assert not spot.takes(0.02)
    assert not Spot(1, 0.0).takes(0.0)

    async def scenario() -> list[bool]:
        many = [
            asyncio.ensure_future(spot.computed(str(i), lambda _tick: gate.wait(10)))
            for i in range(40)
        ]
        await asyncio.sleep(0.01)
        assert not spot.takes(0.001)
        gate.set()
        return await asyncio.gather(*many)

    done = run(scenario())
    assert 0 < sum(done) < 40
    spot.close()


@pytest.mark.parametrize("server", ["sqlite", "postgresql"])
def test_records_of_jobs_done_at_once(
    server: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    database = request.getfixturevalue("postgresql")() if server == "postgresql" else None
    settings = Settings(data=tmp_path, database=database, workers=1, spot_seconds=0.02)
    store = Store(settings.store_url)
    queue = JobQueue(settings, store, tasks.WORK)

    def new(key: str | None = None) -> NewJob:
        return NewJob(
            f"job_{uuid.uuid4().hex}", "ann", "k", "aa" * 32, "bb" * 32, 0, 0.001, False, key,
            block=b"asked",
        )  # fmt: skip

    async def scenario() -> None:
        await queue.start()
        try:

            def compute(_tick: Tick) -> None:
                store.results.put("bb" * 32, b"found", durable=False)

            job = await queue.submit(new("key"), compute)
            assert (job.state, job.phase, job.lane) == ("succeeded", "done", "quick")
            assert (job.reused, job.attempts, job.done, job.total) == (False, 1, 1, 1)
            assert job.started is not None
            assert job.finished is not None
            assert await queue.get("ann", job.id) == job
            assert await queue.get("bob", job.id) is None
            # The same key stands for the same job, whatever was computed for it meanwhile.
            assert (await queue.submit(new("key"), compute)).id == job.id
            assert await queue.request("aa" * 32) == b"asked"
            assert store.requests.get("aa" * 32) is None  # it stands in the records only
            assert await queue.unfinished("ann", 10) == 0
        finally:
            await queue.close()

    run(scenario())
