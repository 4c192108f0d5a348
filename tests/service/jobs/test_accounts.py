"""What jobs cost: their processor time, whoever computes them and however they end."""

from __future__ import annotations

import asyncio
import hashlib
import json
import sys
import uuid
from collections import defaultdict
from collections.abc import Callable, Coroutine
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parent))
import counting

from vibroimpact_service.jobs.accounts import Accounts
from vibroimpact_service.jobs.queue import JobQueue
from vibroimpact_service.jobs.records import NewJob
from vibroimpact_service.jobs.tables import JobRow
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store

PLANNED = 5.0


class Bank:
    """A queue whose settlements are written down."""

    def __init__(self, folder: Path, **more: Any) -> None:
        settings = Settings(data=folder, workers=1, grace_seconds=1.0, **more)
        self.store = Store(settings.store_url)
        self.held: dict[str, float] = defaultdict(float)
        self.used: dict[str, float] = defaultdict(float)
        self.queue = JobQueue(settings, self.store, counting.WORK, self.settle)

    async def settle(self, account: str, held: float, used: float, _age: float) -> None:
        self.held[account] += held
        self.used[account] += used

    async def submit(
        self, account: str | None, seconds: float = PLANNED, deadline: float | None = None,
        **asked: Any,
    ) -> JobRow:  # fmt: skip
        data = json.dumps({"n": 40, "chunk": 10, "of": account} | asked, sort_keys=True).encode()
        name = hashlib.sha256(data).hexdigest()
        self.store.requests.put(name, data)
        new = NewJob(
            uuid.uuid4().hex, "ann", "squares", name, hashlib.sha256(name.encode()).hexdigest(), 0,
            seconds, False, deadline=deadline, account=account,
        )  # fmt: skip
        return await self.queue.submit(new)

    async def end(self, job: JobRow) -> JobRow:
        row = await self.queue.wait("ann", job.id, 60)
        assert row is not None
        assert row.final
        return row

    async def settled(self, account: str, used: float) -> None:
        """Wait until so much was charged to an account, and all given back that was held."""
        for _ in range(400):
            if self.used[account] >= 0.9 * used and self.held[account] > 0.0:
                return
            await asyncio.sleep(0.05)
        raise AssertionError((self.held, self.used))


def run(scenario: Callable[[Bank], Coroutine[Any, Any, None]], folder: Path, **more: Any) -> None:
    async def all_of_it() -> None:
        bank = Bank(folder, **more)
        await bank.queue.start()
        try:
            await scenario(bank)
        finally:
            await bank.queue.close()

    asyncio.run(all_of_it())


def test_a_job_costs_what_its_chunks_took(tmp_path: Path) -> None:
    async def scenario(bank: Bank) -> None:
        job = await bank.submit("a", burn=0.1)
        assert (await bank.end(job)).state == "succeeded"
        await bank.settled("a", 0.4)
        assert bank.held == {"a": PLANNED}
        assert bank.used["a"] < 1.5
        free = await bank.submit(None, burn=0.01)
        assert (await bank.end(free)).state == "succeeded"
        assert set(bank.held) == {"a"}

    run(scenario, tmp_path)


def test_quick_jobs_of_one_call_cost_their_own_time(tmp_path: Path) -> None:
    async def scenario(bank: Bank) -> None:
        hold = await bank.submit("z", seconds=0.05, burn=0.3)  # the others wait, and go together
        jobs = [
            await bank.submit(account, seconds=0.02, burn=burn)
            for account, burn in (("a", 0.0), ("b", 0.1), ("c", 0.0))
        ]
        for job in (hold, *jobs):
            assert (await bank.end(job)).state == "succeeded"
        await bank.settled("b", 0.4)
        await bank.settled("a", 0.0)
        await bank.settled("c", 0.0)
        assert bank.held["a"] == bank.held["b"] == 0.02
        assert bank.used["a"] < 0.2
        assert bank.used["c"] < 0.2

    run(scenario, tmp_path)


def test_a_job_that_fails_costs_what_it_took(tmp_path: Path) -> None:
    async def scenario(bank: Bank) -> None:
        job = await bank.submit("a", burn=0.2, hungry=3)
        assert (await bank.end(job)).state == "failed"
        await bank.settled("a", 0.6)
        assert bank.held["a"] == PLANNED
        again = await bank.queue.retry("ann", job.id)
        assert again is not None
        assert (await bank.end(again)).state == "failed"
        # It was given back when the job failed first; nothing is held for the second time.
        assert bank.held["a"] == PLANNED

    run(scenario, tmp_path)


def test_a_job_that_is_cancelled_costs_what_it_took(tmp_path: Path) -> None:
    async def scenario(bank: Bank) -> None:
        job = await bank.submit("a", burn=0.3, n=1000)
        row: JobRow | None = job
        while row is not None and row.done == 0:
            row = await bank.queue.wait("ann", job.id, 30, row.version)
        await bank.queue.cancel("ann", job.id)
        await bank.settled("a", 0.3)
        assert bank.held["a"] == PLANNED

    run(scenario, tmp_path)


def test_jobs_that_never_begin_cost_nothing(tmp_path: Path) -> None:
    async def scenario(bank: Bank) -> None:
        late = await bank.submit("late", deadline=0.2)
        cancelled = await bank.submit("cancelled")
        for job in (late, cancelled):
            await bank.queue.hold("ann", job.id)
        await bank.queue.cancel("ann", cancelled.id)
        assert (await bank.end(late)).state == "failed"
        await bank.settled("late", 0.0)
        await bank.settled("cancelled", 0.0)
        assert bank.held == {"late": PLANNED, "cancelled": PLANNED}
        assert max(bank.used.values()) < 0.5

    run(scenario, tmp_path)


def test_equal_jobs_cost_the_first_who_asked(tmp_path: Path) -> None:
    async def scenario(bank: Bank) -> None:
        first = await bank.submit("a", burn=0.2, of="all")
        second = await bank.submit("b", burn=0.2, of="all")
        for job in (first, second):
            assert (await bank.end(job)).state == "succeeded"
        await bank.settled("a", 0.8)
        await bank.settled("b", 0.0)
        assert bank.held == {"a": PLANNED, "b": PLANNED}
        assert bank.used["b"] == 0.0

    run(scenario, tmp_path)


@pytest.mark.parametrize(("code", "used"), [("worker_lost", PLANNED), ("unsolvable", 0.0)])
def test_what_a_lost_call_used_is_taken_to_be_what_was_planned(code: str, used: float) -> None:
    settled: list[tuple[float, float]] = []

    async def settle(_account: str, held: float, used: float, _age: float) -> None:
        settled.append((held, used))

    async def scenario() -> None:
        accounts = Accounts(settle)
        row = JobRow(
            1, "job", "ann", "squares", "r", "s", "failed", "done", 0, PLANNED, 0, 1, 1, False,
            0.0, 0.0, 1.0, None, None, 1, {"code": code}, account="a", held=PLANNED,
        )  # fmt: skip
        accounts.begin([row])
        accounts.ended([row])
        accounts.ended([replace(row, account=None)])
        await asyncio.sleep(0.01)
        assert settled == [(PLANNED, used)]
        accounts.used([row], [0.25])  # the news of a call may come after the end of its job
        await asyncio.sleep(0.01)
        assert settled[1:] == [(0.0, 0.25)]

    asyncio.run(scenario())
