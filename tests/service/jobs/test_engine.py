"""Workers and the calls that they execute: values, failures, cancelling, restarts."""

from __future__ import annotations

import os
import queue
import signal
import time
import urllib.error
import urllib.request
import uuid
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vibroimpact_service.jobs import deaths, worker
from vibroimpact_service.jobs.engine import BULK, FAST, Call, Engine, EngineUnavailableError
from vibroimpact_service.jobs.work import WorkerLostError, nothing
from vibroimpact_service.settings import Settings
from vibroimpact_solvers.meter import StoppedError
from vibroimpact_solvers.plan import Tick


def double(value: int, _tick: Tick) -> int:
    return 2 * value


def fail(_tick: Tick) -> None:
    raise ValueError("no")


def die(_tick: Tick) -> None:
    signal.raise_signal(signal.SIGSEGV)


def allocate(number: int, _tick: Tick) -> float:
    return float(np.ones(number).sum())


def process(_tick: Tick) -> int:
    return os.getpid()


def turn(folder: Path, tick: Tick) -> None:
    """Work until the tick raises, and note when it began and when it was stopped."""
    (folder / "begun").touch()
    try:
        while True:
            time.sleep(0.01)
            tick(0, 1)
    finally:
        (folder / "stopped").touch()


def hang(folder: Path, _tick: Tick) -> None:
    """Work without ever calling the tick."""
    (folder / "begun").write_text(str(os.getpid()))
    time.sleep(300.0)


class Bench:
    """An engine with one worker, and a short way to call it."""

    def __init__(self, folder: Path, grace: float = 1.0) -> None:
        settings = Settings(data=folder, workers=1, grace_seconds=grace, worker_memory_bytes=2**30)
        self.engine = Engine(settings)
        self.engine.start()
        wait_for(lambda: self.engine.ready)
        self.ended: queue.SimpleQueue[Call] = queue.SimpleQueue()

    def submit(self, queue_name: str, function: Any, *args: Any) -> Call:
        """Submit a call once there is a worker, which may be replaced at this moment."""
        end = time.monotonic() + 60.0
        while True:
            wait_for(lambda: self.engine.ready)
            key = uuid.uuid4().hex
            try:
                return self.engine.submit(key, queue_name, 0, self.ended.put, function, *args)
            except EngineUnavailableError:
                assert time.monotonic() < end

    def outcome(self, queue_name: str, function: Any, *args: Any) -> Any:
        """Return what a call returns, or why it failed."""
        call = self.submit(queue_name, function, *args)
        assert self.ended.get(timeout=60) is call
        return self.engine.error(call) or self.engine.values([call])[0]


def wait_for(condition: Any, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def content(file: Path) -> str:
    """Wait until something is written to a file, and return it."""
    wait_for(lambda: file.exists() and file.read_text())
    return file.read_text()


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    bench = Bench(tmp_path_factory.mktemp("engine"))
    yield bench
    bench.engine.close()


@pytest.fixture
def patient(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    """Return one whose workers have long to stop before they are restarted."""
    bench = Bench(tmp_path_factory.mktemp("patient"), grace=60.0)
    yield bench
    bench.engine.close()


def test_values_and_errors_come_back(bench: Bench) -> None:
    assert bench.outcome(FAST, double, 21) == 42
    assert isinstance(bench.outcome(BULK, fail), ValueError)


def test_a_cancelled_call_stops_at_its_next_tick(patient: Bench, tmp_path: Path) -> None:
    """The plugin in the worker depends on the states in which Dask reports calls."""
    call = patient.submit(BULK, turn, tmp_path)
    wait_for((tmp_path / "begun").exists)
    worker = patient.outcome(FAST, process)  # the other queue is free
    assert not (tmp_path / "stopped").exists()
    patient.engine.cancel([call])
    assert patient.ended.get(timeout=60) is call
    wait_for((tmp_path / "stopped").exists)
    assert patient.outcome(FAST, process) == worker


def test_a_cancelled_call_that_does_not_stop_loses_its_worker(bench: Bench, tmp_path: Path) -> None:
    call = bench.submit(BULK, hang, tmp_path)
    worker = int(content(tmp_path / "begun"))
    bench.engine.cancel([call])
    assert bench.ended.get(timeout=60) is call
    wait_for(lambda: not Path(f"/proc/{worker}").exists())  # far sooner than the call would end
    assert bench.outcome(BULK, double, 3) == 6


def test_a_call_that_kills_its_worker_fails_and_the_worker_is_replaced(bench: Bench) -> None:
    for _ in range(2):  # the second one as soon as its worker is there
        lost = bench.outcome(BULK, die)
        assert isinstance(lost, WorkerLostError)
        assert lost.own
        assert "SIGSEGV" in lost.why
    assert bench.outcome(FAST, double, 4) == 8


def test_a_worker_that_is_killed_by_others_is_not_the_fault_of_its_call(
    bench: Bench, tmp_path: Path
) -> None:
    call = bench.submit(BULK, hang, tmp_path)
    worker = int(content(tmp_path / "begun"))  # else it would begin at the next worker
    assert bench.outcome(FAST, process) == worker
    os.kill(worker, signal.SIGKILL)
    assert bench.ended.get(timeout=60) is call
    lost = bench.engine.error(call)
    assert isinstance(lost, WorkerLostError)
    assert not lost.own
    assert "SIGKILL" in lost.why


def test_a_call_that_needs_too_much_memory_fails_alone(bench: Bench) -> None:
    wait_for(lambda: bench.engine.ready)
    worker = bench.outcome(FAST, process)
    assert isinstance(bench.outcome(BULK, allocate, 2 * 10**8), MemoryError)
    assert bench.outcome(BULK, allocate, 10**6) == 1e6
    assert bench.outcome(FAST, process) == worker  # it lives on


@pytest.mark.parametrize(
    ("exitcode", "out_of_memory", "own"),
    [
        (-signal.SIGSEGV, False, True),
        (-signal.SIGABRT, False, True),
        (-signal.SIGKILL, True, True),
        (-signal.SIGKILL, False, False),
        (-signal.SIGTERM, False, False),
        (1, False, True),
        (255, False, False),
        (0, False, False),
        (None, False, False),
    ],
)
def test_causes_of_deaths(exitcode: int | None, out_of_memory: bool, own: bool) -> None:
    why, blamed = deaths.cause(exitcode, out_of_memory=out_of_memory)
    assert why
    assert blamed is own


def test_of_two_calls_the_one_is_guilty_for_which_the_worker_says_it_ends() -> None:
    lives = deaths.Deaths(lambda cause: None)
    lives.note((0.0, {"worker": "w", "slow": "long"}))
    why = "it was killed by SIGXCPU"
    lives.note((0.0, {"worker": "w", "why": why, "own": True, "cause": "fault"}))
    guilty, other = lives.of("w", None, "long"), lives.of("w", None, "short")
    assert (guilty.own, guilty.guilty, guilty.why) == (True, True, why)
    assert (other.own, other.guilty) == (False, False)
    lives.note((0.0, {"worker": "v", "why": why, "own": True, "cause": "fault"}))
    unknown = lives.of("v", None, "long")
    assert (unknown.own, unknown.guilty) == (True, False)


def test_silent_machines_are_given_up_unless_this_process_stood_still(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = [100.0]
    monkeypatch.setattr(deaths.time, "monotonic", lambda: clock[0])
    counted: list[str] = []
    lives = deaths.Deaths(counted.append)
    for _ in range(4):
        lives.note((0.0, {"worker": "far"}))
        lives.note((0.0, {"worker": "near"}))
        clock[0] += 3.0
        assert lives.silent() == []
    silent = []
    for _ in range(5):
        lives.note((0.0, {"worker": "near"}))
        clock[0] += 3.0
        silent += lives.silent()
    assert silent == ["far"]
    clock[0] += 100.0  # this process was frozen
    assert lives.silent() == []


def test_a_call_is_stopped_where_it_was_taken_away_and_not_before() -> None:
    # A worker that has joined a restarted scheduler executes calls before it has the plugin, which
    # therefore never sees that they are assigned.
    plugin = worker.ServicePlugin(nothing)
    ticks = []

    def work(tick: Tick) -> None:
        for i in range(3):
            time.sleep(0.06)  # longer than the interval at which a signal looks
            tick(i, 3)
            ticks.append(i)
            if i == 1:
                plugin.transition("late", "executing", "cancelled")

    with pytest.raises(StoppedError):
        worker.execute(work, "late", False)
    assert ticks == [0, 1]
    worker.execute(work, "other", False)
    assert ticks == [0, 1, 0, 1, 2]


def test_a_call_that_is_wanted_again_goes_on() -> None:
    plugin = worker.ServicePlugin(nothing)

    def work(tick: Tick) -> str:
        plugin.transition("wanted", "executing", "cancelled")
        plugin.transition("wanted", "cancelled", "executing")
        time.sleep(0.06)
        tick(0, 1)
        return "done"

    assert worker.execute(work, "wanted", False) == "done"


def test_a_worker_forgets_a_cancelled_call_once_it_ended() -> None:
    plugin = worker.ServicePlugin(nothing)

    def work(tick: Tick, *, cancelled: bool) -> None:
        if cancelled:
            plugin.transition("again", "executing", "cancelled")
        assert worker.running_calls() == ["again"]
        time.sleep(0.06)
        tick(0, 1)

    with pytest.raises(StoppedError):
        worker.execute(partial(work, cancelled=True), "again", False)
    assert worker.running_calls() == []
    worker.execute(partial(work, cancelled=False), "again", False)


def test_the_status_pages_of_dask_show_nothing(bench: Bench) -> None:
    scheduler = bench.engine._cluster.scheduler  # type: ignore[union-attr]
    ports = [scheduler.http_server.port]
    ports += [worker.services["dashboard"] for worker in scheduler.workers.values()]
    for port in ports:
        for path in ("", "status", "info/main/workers.html", "individual-task-stream", "metrics"):
            with pytest.raises(urllib.error.HTTPError) as refused:
                urllib.request.urlopen(f"http://127.0.0.1:{port}/{path}", timeout=5)
            with refused.value:
                assert refused.value.code == 404, (port, path)
