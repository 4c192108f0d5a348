"""Threads that compute: each result once, in time, or by the workers after all."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import StoreFullError
from vibroimpact_service.use_case import threads as service_threads
from vibroimpact_service.use_case.threads import Threads
from vibroimpact_solvers.meter import LimitPassedError, StoppedError, StopSignal
from vibroimpact_solvers.plan import Tick


def run(scenario: Any) -> Any:
    async def bounded() -> Any:
        async with asyncio.timeout(60):
            return await scenario

    return asyncio.run(bounded())


def nothing(_: object) -> None:
    """Do nothing with what was computed."""


async def begun(threads: Threads, name: str) -> None:
    """Wait until the result of that digest is being computed."""
    while not threads.running(name):
        await asyncio.sleep(0.01)


@pytest.fixture
def long_submissions(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let jobs that are computed while they are submitted take long."""
    monkeypatch.setattr(service_threads, "SUBMISSION_SECONDS", 30.0)


@pytest.fixture
def make() -> Iterator[Callable[..., Threads]]:
    made: list[Threads] = []

    def started(count: int, ended: Callable[[Any], None] = nothing, **more: Any) -> Threads:
        values = {"inline_threads": count, "on_submission_seconds": 0.02, **more}
        made.append(Threads(Settings(data=Path("unused"), **values), ended))
        return made[-1]

    yield started
    for each in made:
        each.close()


@pytest.mark.usefixtures("long_submissions")
def test_equal_jobs_are_computed_once_while_they_are_submitted(
    make: Callable[..., Threads],
) -> None:
    noted: list[object] = []
    threads, calls, gate = make(2, noted.append), [], threading.Event()

    def compute(_tick: Tick) -> int:
        calls.append(1)
        gate.wait(60)
        return 7

    async def scenario() -> list[bool | None]:
        waiting = [asyncio.ensure_future(threads.on_submission("r", compute)) for _ in range(50)]
        await begun(threads, "r")
        gate.set()
        return await asyncio.gather(*waiting)

    assert run(scenario()) == [False] + [True] * 49
    assert len(calls) == 1
    assert noted == [7]


def test_what_takes_longer_is_given_up_and_holds_its_thread_until_it_stopped(
    make: Callable[..., Threads],
) -> None:
    threads, ended = make(1), threading.Event()

    def compute(tick: Tick) -> None:
        try:
            while True:
                time.sleep(0.005)
                tick(0, 1)
        except StoppedError:
            ended.set()
            raise

    async def scenario() -> None:
        assert await threads.on_submission("r", compute) is None
        await asyncio.to_thread(ended.wait, 10)
        while threads.running("r"):
            await asyncio.sleep(0.01)

    run(scenario())
    assert ended.is_set()


def test_a_late_job_does_not_stop_a_computation_that_others_wait_for(
    make: Callable[..., Threads],
) -> None:
    threads, gate = make(1), threading.Event()

    def compute(tick: Tick) -> str:
        while not gate.wait(0.005):
            tick(0, 1)
        return "done"

    async def scenario() -> tuple[str, bool]:
        # One begins after the other without a pause, in which the job could be given up.
        job = asyncio.ensure_future(threads.on_submission("r", compute))
        inline = asyncio.ensure_future(threads.once("r", compute))
        assert await job is None
        gate.set()
        return await inline

    assert run(scenario()) == ("done", True)


def test_a_job_that_comes_later_does_not_stop_it_either(make: Callable[..., Threads]) -> None:
    threads, gate = make(1), threading.Event()

    def compute(tick: Tick) -> str:
        while not gate.wait(0.005):
            tick(0, 1)
        return "done"

    async def scenario() -> tuple[str, bool]:
        inline = asyncio.ensure_future(threads.once("r", compute))
        await begun(threads, "r")
        assert await threads.on_submission("r", compute) is None
        await asyncio.sleep(0.05)
        gate.set()
        return await inline

    assert run(scenario()) == ("done", False)


def test_nobody_waits_for_what_is_being_stopped(
    make: Callable[..., Threads], monkeypatch: pytest.MonkeyPatch
) -> None:
    threads, gate = make(1), threading.Event()

    async def scenario() -> None:
        assert await threads.on_submission("r", lambda _tick: gate.wait(60)) is None
        assert threads.running("r")
        with pytest.raises(StoppedError):
            await threads.once("r", lambda _tick: True)
        gate.set()
        monkeypatch.setattr(service_threads, "SUBMISSION_SECONDS", 30.0)
        await threads.ended("r")
        assert await threads.once("r", lambda _tick: True) == (True, False)

    run(scenario())


def test_few_large_bodies_are_parsed_at_a_time(make: Callable[..., Threads]) -> None:
    threads, lock, two = make(4), threading.Lock(), threading.Barrier(2)
    begun: list[int] = []
    under_way = 0

    def parse() -> None:
        nonlocal under_way
        with lock:
            under_way += 1
            begun.append(under_way)
        two.wait(60)
        time.sleep(0.02)
        with lock:
            under_way -= 1

    async def scenario() -> None:
        await asyncio.gather(*(threads.parse(bytes(2**20 + 1), parse) for _ in range(4)))

    run(scenario())
    assert len(begun) == 4
    assert max(begun) == 2


def test_what_overruns_is_stopped_for_all_who_wait(make: Callable[..., Threads]) -> None:
    threads = make(1, inline_overrun_seconds=0.05)

    def compute(tick: Tick) -> None:
        while True:
            time.sleep(0.005)
            tick(0, 1)

    async def scenario() -> list[Any]:
        waiting = (threads.once("r", compute) for _ in range(3))
        return await asyncio.gather(*waiting, return_exceptions=True)

    assert [type(each) for each in run(scenario())] == [StoppedError] * 3


def test_failures_go_to_the_workers_but_a_full_store_is_told(
    make: Callable[..., Threads],
) -> None:
    threads = make(1)

    def fail(error: Exception) -> Callable[[Tick], None]:
        def compute(_tick: Tick) -> None:
            raise error

        return compute

    async def scenario() -> None:
        assert await threads.on_submission("r", fail(ValueError("wrong"))) is None
        error = StoreFullError(28, "the store is full")
        with pytest.raises(StoreFullError):
            await threads.on_submission("s", fail(error))

    run(scenario())


@pytest.mark.usefixtures("long_submissions")
def test_few_jobs_wait_to_be_computed_and_only_small_ones(make: Callable[..., Threads]) -> None:
    threads, gate = make(1), threading.Event()
    assert threads.accepts(0.019)
    assert not threads.accepts(0.02)
    assert not make(1, on_submission_seconds=0.0).accepts(0.0)

    async def scenario() -> list[bool | None]:
        many = [
            asyncio.ensure_future(threads.on_submission(str(i), lambda _tick: gate.wait(60)))
            for i in range(40)
        ]
        await begun(threads, "0")
        assert not threads.accepts(0.001)
        gate.set()
        return await asyncio.gather(*many)

    done = [shared is not None for shared in run(scenario())]
    assert 0 < sum(done) < 40


def test_a_signal_stops_after_its_time_when_told_or_when_given_up() -> None:
    signal = StopSignal(0.02)
    time.sleep(0.03)
    signal(0, 1)  # the time begins with the first progress
    time.sleep(0.03)
    with pytest.raises(StoppedError):
        signal(1, 1)
    signal = StopSignal()
    signal(0, 1)
    signal.stop()
    with pytest.raises(StoppedError):
        signal(0, 1)
    signal = StopSignal(cancelled=lambda: True)
    time.sleep(0.06)
    with pytest.raises(StoppedError):
        signal(0, 1)


def test_who_waits_for_too_long_is_told_and_so_are_new_ones(make: Callable[..., Threads]) -> None:
    threads, gate = make(1, max_waiting_seconds=1.0), threading.Event()

    async def scenario() -> None:
        first = asyncio.ensure_future(threads.once("first", lambda _tick: gate.wait(60)))
        await asyncio.sleep(0.02)
        second = asyncio.ensure_future(threads.once("second", lambda _tick: True))
        await asyncio.sleep(0.02)
        assert not threads.saturated
        with pytest.raises(ProblemError) as refused:
            await second
        assert (refused.value.type.status, refused.value.headers["Retry-After"]) == (503, "1")
        assert not first.done()  # for which the second one would have waited
        # Plans do not wait for computations.
        assert await threads.run(lambda: 7) == 7
        waiting = asyncio.ensure_future(threads.once("third", lambda _tick: True))
        gate.set()
        assert await first == (True, False)
        assert await waiting == (True, False)

    run(scenario())


def test_a_thread_is_given_up_to_who_waits_once_its_time_is_over(
    make: Callable[..., Threads],
) -> None:
    """Without others it goes on; here until `inline_overrun_seconds`, which are ten."""
    threads = make(1, inline_seconds=0.3)

    def long(tick: StopSignal) -> None:
        while True:  # which takes processor time
            tick(0, 1)

    async def scenario() -> None:
        alone = asyncio.ensure_future(threads.once("alone", long))
        await asyncio.sleep(1.0)
        assert not alone.done()
        assert await threads.once("other", lambda _tick: True) == (True, False)
        with pytest.raises(StoppedError):
            await alone

    run(scenario())


def test_new_work_is_refused_while_old_work_waits(
    make: Callable[..., Threads], monkeypatch: pytest.MonkeyPatch
) -> None:
    threads, gate, clock = make(1, max_waiting_seconds=5.0), threading.Event(), time.monotonic

    async def scenario() -> None:
        first = asyncio.ensure_future(threads.once("first", lambda _tick: gate.wait(60)))
        second = asyncio.ensure_future(threads.once("second", lambda _tick: True))
        await asyncio.sleep(0.02)
        monkeypatch.setattr(time, "monotonic", lambda: clock() + 6.0)
        assert threads.saturated
        with pytest.raises(ProblemError, match="waiting"):
            await threads.once("third", lambda _tick: True)
        monkeypatch.undo()
        gate.set()
        assert [await first, await second] == [(True, False)] * 2
        assert not threads.saturated

    run(scenario())


def test_what_nobody_waits_for_any_more_is_not_begun_or_is_stopped(
    make: Callable[..., Threads],
) -> None:
    threads, begun, ended = make(1), threading.Event(), threading.Event()

    def plan(signal: StopSignal) -> None:
        begun.set()
        try:
            while True:
                time.sleep(0.005)
                signal(0, 1)
        except StoppedError:
            ended.set()
            raise

    async def scenario() -> None:
        planning = asyncio.ensure_future(threads.planned(plan))
        await asyncio.to_thread(begun.wait, 10)
        planning.cancel()
        assert await asyncio.to_thread(ended.wait, 10)
        gate = threading.Event()
        gates = [asyncio.ensure_future(threads.run(lambda: gate.wait(60))) for _ in range(3)]
        late: list[int] = []
        waiting = asyncio.ensure_future(threads.run(lambda: late.append(1)))
        await asyncio.sleep(0.02)
        waiting.cancel()
        await asyncio.sleep(0.02)
        gate.set()
        await asyncio.gather(*gates)
        assert await threads.run(lambda: late) == []

    run(scenario())


def test_computations_are_given_up_where_the_process_grows_too_large(
    make: Callable[..., Threads],
) -> None:
    threads = make(1, inline_memory_bytes=2**20)

    def compute(tick: Tick) -> None:
        while True:
            time.sleep(0.005)
            tick(0, 1)

    with pytest.raises(StoppedError):
        run(threads.once("r", compute))


def test_processor_time_is_limited_where_the_clock_is_not() -> None:
    enforced: list[float] = []
    signal = StopSignal(enforce=enforced.append)
    signal.allow(0.05)
    time.sleep(0.1)
    signal(0, 1)  # waiting costs nothing

    def work() -> None:
        while True:
            signal(0, 1)

    with pytest.raises(LimitPassedError):
        work()
    assert enforced == [0.05]


def test_linear_algebra_has_one_thread_in_a_service() -> None:
    """As it has in workers: its threads would spin while they wait."""
    code = """
import os, sys
from vibroimpact_service import cli
def end(modules):
    print(os.environ["OPENBLAS_NUM_THREADS"], "numpy" in sys.modules)
    raise SystemExit
cli.forkserver.start = end
cli.serve()
"""
    with tempfile.TemporaryDirectory() as data:
        environment = {**os.environ, "VIBROIMPACT_DATA": data}
        environment.pop("OPENBLAS_NUM_THREADS", None)
        command = [sys.executable, "-c", code]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "1 False"
