"""What a run does where workers die or the store is silent, without either."""

from __future__ import annotations

import asyncio
import errno
import threading
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from vibroimpact_service.jobs.engine import EngineUnavailableError
from vibroimpact_service.jobs.metrics import JobMetrics
from vibroimpact_service.jobs.run import ClosingError, Run
from vibroimpact_service.jobs.runner import Runner
from vibroimpact_service.jobs.work import WorkerLostError
from vibroimpact_service.store import StoreUnavailableError

SLOW = WorkerLostError("tcp://a", "died of SIGXCPU", guilty=True)
FAULT, HUNGER = WorkerLostError("tcp://a", "died of SIGXCPU"), MemoryError()


class Scripted(Run):
    """A run whose calls end as they are told to."""

    def __init__(self, *errors: BaseException | None) -> None:
        engine: Any = SimpleNamespace(isolation=threading.Lock())
        context: Any = SimpleNamespace(engine=engine)
        super().__init__([], context)
        self.errors = list(errors)

    def call(
        self, queue_name: str, function: Callable[..., Any], *args: Any
    ) -> tuple[Any, BaseException | None]:
        return None, self.errors.pop(0)


@pytest.mark.parametrize(
    ("errors", "last"),
    [
        ([None], None),
        ([FAULT, None], None),  # a neighbour's
        ([FAULT, HUNGER, None], None),  # two neighbours'
        ([HUNGER, HUNGER], HUNGER),
        ([HUNGER, FAULT, HUNGER], HUNGER),  # its own, a neighbour's, its own again
        ([FAULT, WorkerLostError("tcp://b", "died of SIGXCPU")], FAULT),  # wherever it was
        ([SLOW], SLOW),  # it is known to be its own
        ([FAULT, SLOW], SLOW),
        ([ValueError()], ValueError()),
    ],
)
def test_a_suspect_is_guilty_where_it_fails_twice_for_the_same_reason(
    errors: list[BaseException | None], last: BaseException | None
) -> None:
    run = Scripted(*errors)
    _, error = run.repeat_alone(lambda: None)
    assert type(error) is type(last)
    assert run.errors == []
    assert run.context.engine.isolation.acquire(blocking=False)


def test_a_suspect_whose_worker_always_dies_is_not_repeated_for_ever() -> None:
    run = Scripted(*(WorkerLostError("tcp://a", f"died, {i}") for i in range(100)))
    _, error = run.repeat_alone(lambda: None)
    assert isinstance(error, WorkerLostError)
    assert len(run.errors) == 95


class Replaced:
    """An engine whose workers are replaced some time after they died."""

    def __init__(self, seconds: float) -> None:
        self._at = time.monotonic() + seconds

    @property
    def ready(self) -> bool:
        return time.monotonic() >= self._at

    def submit(self, *_: object, **__: object) -> str:
        if not self.ready:
            raise EngineUnavailableError
        return "call"


def waiting(engine: Replaced) -> Run:
    context: Any = SimpleNamespace(engine=engine, work=None)
    job: Any = SimpleNamespace(id="job", attempts=1, account=None)
    return Run([job], context)


def test_a_run_waits_for_workers_that_are_replaced() -> None:
    assert waiting(Replaced(1.0)).submit("bulk", 0, print) == "call"


def test_a_run_does_not_wait_for_workers_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("vibroimpact_service.jobs.run._WORKERS_SECONDS", 0.5)
    with pytest.raises(EngineUnavailableError):
        waiting(Replaced(3600.0)).submit("bulk", 0, print)


def test_a_run_that_waits_for_workers_can_be_stopped() -> None:
    run = waiting(Replaced(3600.0))
    threading.Timer(0.5, run.close).start()
    with pytest.raises(ClosingError):
        run.submit("bulk", 0, print)


def test_a_run_does_not_keep_a_job_whose_request_it_cannot_reach() -> None:
    """Its claim would be renewed all the time, and no other replica would get it."""

    def readable(_: str) -> bool:
        raise StoreUnavailableError(errno.EIO, "the store cannot be reached")

    store: Any = SimpleNamespace(requests=SimpleNamespace(readable=readable))
    context: Any = SimpleNamespace(store=store)
    job: Any = SimpleNamespace(id="job", request="name")
    with pytest.raises(StoreUnavailableError):
        Run([job], context).ensure_request(job)


def test_no_jobs_are_claimed_while_the_store_is_silent() -> None:
    tried: list[str] = []
    claimed: list[tuple[Any, ...]] = []
    store = SimpleNamespace(silent=True)

    async def state() -> str:
        tried.append("no answer" if len(tried) < 3 else "ok")
        return tried[-1]

    async def write(*arguments: Any) -> list[Any]:
        claimed.append(arguments)
        assert tried[-1] == "ok"
        return []

    async def read(_: Any) -> bool:
        return True

    engine = SimpleNamespace(ready=True, workers=1)
    context: Any = SimpleNamespace(
        records=SimpleNamespace(write=write, read=read), engine=engine, claim_owner="a",
        store=store, metrics=JobMetrics(),
    )  # fmt: skip

    async def look() -> None:
        runner = Runner(context, 1, state)
        looking = asyncio.create_task(runner.claim_loop())
        while not claimed:
            runner.wake()
            await asyncio.sleep(0.01)
        looking.cancel()

    asyncio.run(look())
    assert tried == ["no answer"] * 3 + ["ok"]
