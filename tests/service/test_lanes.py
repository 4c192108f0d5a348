"""Lanes: whatever a computation does, its place is free again soon, and others are computed."""

from __future__ import annotations

import asyncio
import os
import signal
import time
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import Any

import orjson
import pytest
from starlette.testclient import TestClient

from vibroimpact_service import problems
from vibroimpact_service.app import create_app
from vibroimpact_service.documents import parse, requests
from vibroimpact_service.evaluate import Admission, Answer, Evaluation, Preference
from vibroimpact_service.jobs.metrics import JobMetrics
from vibroimpact_service.jobs.work import StoppedError, StopSignal
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.lanes import Lanes
from vibroimpact_service.metrics import Metrics
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.results.representations import JSON
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store
from vibroimpact_solvers.errors import ConvergenceError


def tell(value: Any, _settings: Settings, _store: Store, _signal: StopSignal) -> tuple[int, Any]:
    """Return the process, and a value."""
    return os.getpid(), value


def fail(error: Exception, _settings: Settings, _store: Store, _signal: StopSignal) -> None:
    """Raise an error."""
    raise error


def loop(_settings: Settings, _store: Store, _signal: StopSignal) -> None:
    """Never look at the signal."""
    while True:
        pass


def look(_settings: Settings, _store: Store, signal: StopSignal) -> None:
    """Look at the signal."""
    while True:
        time.sleep(0.005)
        signal(0, 1)


def grow(_settings: Settings, _store: Store, _signal: StopSignal) -> int:
    """Take memory without an end."""
    return len([bytearray(2**24) for _ in range(2**20)])


def die(_settings: Settings, _store: Store, _signal: StopSignal) -> None:
    """End the process."""
    os.kill(os.getpid(), signal.SIGSEGV)


def run(settings: Settings, main: Callable[[Lanes], Awaitable[Any]], **more: Any) -> Any:
    chosen = settings.model_copy(update={"inline_threads": 2, "inline_memory_bytes": 2**28, **more})

    async def bounded() -> Any:
        lanes = Lanes(chosen)
        lanes.start()
        try:
            async with asyncio.timeout(120):
                while lanes.state != "ok":
                    await asyncio.sleep(0.02)
                return await main(lanes)
        finally:
            lanes.close()

    return asyncio.run(bounded())


def test_one_after_the_other_goes_to_the_same_process(settings: Settings) -> None:
    async def main(lanes: Lanes) -> None:
        told = [await lanes.compute(partial(tell, i), StopSignal()) for i in range(5)]
        assert [value for _, value in told] == list(range(5))
        assert len({process for process, _ in told} - {os.getpid()}) == 1
        assert lanes.unfinished == 0

    run(settings, main)


def test_errors_are_those_of_the_computation(settings: Settings) -> None:
    async def main(lanes: Lanes) -> None:
        with pytest.raises(ConvergenceError, match="no root"):
            await lanes.compute(partial(fail, ConvergenceError("no root")), StopSignal())
        refused = problems.overloaded(1)
        with pytest.raises(ProblemError) as caught:
            await lanes.compute(partial(fail, refused), StopSignal())
        assert caught.value.headers == {"Retry-After": "1"}

    run(settings, main)


@pytest.mark.parametrize("work", [loop, look, grow, die])
def test_whatever_a_computation_does_others_are_computed_after_it(
    settings: Settings, work: Any
) -> None:
    """Both lanes are taken by it, and its callers go away."""

    async def main(lanes: Lanes) -> None:
        signals = [StopSignal() for _ in range(2)]
        taken = [lanes.compute(work, each) for each in signals]
        await asyncio.sleep(0.3)
        for each in signals:
            each.stop()
        ended = await asyncio.gather(*taken, return_exceptions=True)
        assert [type(each) for each in ended] == [StoppedError] * 2
        _, value = await lanes.compute(partial(tell, 7), StopSignal())
        assert value == 7

    run(settings, main, max_waiting_seconds=60.0)


def test_what_looks_at_its_signal_keeps_its_lane(settings: Settings) -> None:
    async def main(lanes: Lanes) -> None:
        before, _ = await lanes.compute(partial(tell, 0), StopSignal())
        signal = StopSignal()
        stopped = lanes.compute(look, signal)
        signal.stop()
        with pytest.raises(StoppedError):
            await stopped
        after, _ = await lanes.compute(partial(tell, 0), StopSignal())
        assert before == after

    run(settings, main, inline_threads=1, max_waiting_seconds=60.0)


def test_what_takes_longer_than_planned_makes_room_for_who_waits(settings: Settings) -> None:
    async def main(lanes: Lanes) -> None:
        taken = lanes.compute(loop, StopSignal())
        assert (await lanes.compute(partial(tell, 7), StopSignal()))[1] == 7
        with pytest.raises(StoppedError):
            await taken

    run(settings, main, inline_threads=1, inline_seconds=0.1, max_waiting_seconds=60.0)


def test_it_overruns_for_some_time_where_nobody_waits(settings: Settings) -> None:
    async def main(lanes: Lanes) -> None:
        with pytest.raises(StoppedError):
            await lanes.compute(loop, StopSignal(0.5))

    run(settings, main, inline_threads=1)


def test_who_waits_for_too_long_is_refused(settings: Settings) -> None:
    async def main(lanes: Lanes) -> None:
        taken = lanes.compute(look, StopSignal())
        waiting = lanes.compute(partial(tell, 7), StopSignal())
        assert not lanes.saturated
        with pytest.raises(ProblemError, match="waiting"):
            await waiting
        assert not taken.done()

    run(settings, main, inline_threads=1, inline_seconds=60.0, max_waiting_seconds=0.2)


def test_readiness_says_when_no_lane_is_free(settings: Settings, queue: Any) -> None:
    class Stopped(Lanes):
        """Lanes whose processes do not start, as where the forkserver stands still."""

        def _fill(self) -> None:
            pass

    with TestClient(create_app(settings, queue, lanes=Stopped(settings))) as http:
        answer = http.get("/v1/health/ready")
        assert (answer.status_code, answer.json()["code"]) == (503, "unavailable")
        assert "lanes: none is free: starting" in answer.json()["detail"]


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("charged", [False, True])
def test_a_request_is_computed_in_a_lane_and_known_then(
    settings: Settings, store: Store, queue: Any, request_body: dict[str, Any], charged: bool
) -> None:
    charges: list[float] = []

    async def charge(plan: Any, seconds: float) -> None:
        charges.append(seconds)

    async def main(lanes: Lanes) -> None:
        use = Evaluation(settings, store, queue, Metrics(JobMetrics().registry), lanes=lanes)
        question = requests.read(
            "me", KINDS["impact-modes"], parse.json(orjson.dumps(request_body))
        )
        admission = Admission(charge, free=not charged)
        first = await use.compute(question, Preference(), JSON, admission)
        second = await use.compute(question, Preference(), JSON, admission)
        assert isinstance(first, Answer)
        assert isinstance(second, Answer)
        assert (first.cache, second.cache) == ("fwd=miss", "hit")
        assert first.representation == second.representation
        assert len(charges) == charged

    run(settings, main)


def test_the_end_of_the_service_ends_its_lanes(settings: Settings) -> None:
    async def main(lanes: Lanes) -> list[int]:
        process, _ = await lanes.compute(partial(tell, 0), StopSignal())
        asyncio.ensure_future(lanes.compute(loop, StopSignal())).cancel()
        return [process]

    for process in run(settings, main):
        end = time.monotonic() + 60.0
        while Path(f"/proc/{process}").exists() and time.monotonic() < end:
            time.sleep(0.02)
        assert not Path(f"/proc/{process}").exists()
