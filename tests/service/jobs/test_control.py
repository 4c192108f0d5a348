"""Holding, releasing and retrying jobs, and the history of attempts, in both databases."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa

from vibroimpact_service.jobs import attempts, claims, control
from vibroimpact_service.jobs.database import open_database
from vibroimpact_service.jobs.records import NewJob, find, insert
from vibroimpact_service.jobs.tables import JobRow, jobs


@pytest.fixture(params=["sqlite", "postgresql"])
def database(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[sa.Engine]:
    url = f"sqlite:///{tmp_path / 'jobs.sqlite'}"
    if request.param == "postgresql":
        url = request.getfixturevalue("postgresql")()
    engine = open_database(url)
    yield engine
    engine.dispose()


@pytest.fixture
def do(database: sa.Engine) -> Callable[..., Any]:
    def operate(operation: Callable[..., Any], *arguments: Any) -> Any:
        with database.begin() as connection:
            return operation(connection, *arguments)

    return operate


def submitted(do: Callable[..., Any], **more: Any) -> str:
    name = uuid.uuid4().hex
    new = NewJob(f"job_{name}", "ann", "busy", "a" * 64, 2 * name, 0, 5.0, False, **more)
    row: JobRow = do(insert, new)
    return row.id


def claimed(do: Callable[..., Any]) -> list[str]:
    return [job.id for job in do(claims.claim, "me", "bulk", 10, 100.0)]


def whys(do: Callable[..., Any], job: str) -> list[str | None]:
    return [each.why for each in do(attempts.of, job)]


def test_a_held_job_does_not_run_until_it_is_released(do: Callable[..., Any]) -> None:
    job = submitted(do)
    held = do(control.hold, "ann", job)
    assert (held.state, held.phase, held.waiting_note) == ("queued", "held", control.HELD_NOTE)
    assert claimed(do) == []
    assert not do(claims.claimable)
    assert do(control.hold, "ann", job).version == held.version  # nothing changed
    behind = submitted(do)
    assert do(claims.ahead, [do(find, "ann", behind)]) == {behind: 0}
    released = do(control.release, "ann", job)
    assert (released.phase, released.waiting_note, released.retry_at) == ("waiting", None, None)
    assert set(claimed(do)) == {job, behind}
    assert do(control.release, "ann", job).state == "running"


def test_a_running_job_that_is_held_loses_its_claim(do: Callable[..., Any]) -> None:
    job = submitted(do)
    assert claimed(do) == [job]
    assert do(control.hold, "ann", job).state == "queued"
    assert not do(claims.report, "me", job, {"done": 3})
    assert do(claims.renew, "me", [job]) == set()
    assert whys(do, job) == ["held"]


def test_the_jobs_of_others_do_not_change(do: Callable[..., Any]) -> None:
    job = submitted(do)
    for operation in (control.hold, control.release, control.retry):
        assert do(operation, "bob", job) is None
    assert do(control.retry_all, "bob", [job], None, 10) == []
    assert do(find, "ann", job).version == 1


def test_a_failed_job_is_queued_again_with_all_its_time(do: Callable[..., Any]) -> None:
    job, other = submitted(do, deadline=1000.0), submitted(do)
    assert set(claimed(do)) == {job, other}
    do(claims.fail, "me", job, {"code": "worker_lost", "detail": "It needs more memory."})
    before = do(find, "ann", job)
    again = do(control.retry, "ann", job)
    assert (again.state, again.error, again.finished) == ("queued", None, None)
    assert again.deadline >= before.deadline
    assert again.version > before.version
    assert do(control.retry, "ann", other).state == "running"  # it did not fail
    assert claimed(do) == [job]
    assert set(do(claims.succeed, "me", [job], False)) == {job}
    assert whys(do, job) == ["It needs more memory.", "succeeded"]
    workers = {each.worker for each in do(attempts.of, job)}
    assert workers == {"me"}


def test_failed_jobs_in_bulk(do: Callable[..., Any]) -> None:
    all_jobs = [submitted(do) for _ in range(5)]
    assert set(claimed(do)) == set(all_jobs)
    for job in all_jobs[:4]:
        do(claims.fail, "me", job, {"detail": "no"})
    assert do(control.retry_all, "ann", None, "other", 10) == []
    assert do(control.retry_all, "ann", all_jobs[1:], None, 1) == [all_jobs[1]]
    assert do(control.retry_all, "ann", None, "busy", 10) == [all_jobs[0], *all_jobs[2:4]]
    assert do(control.retry_all, "ann", None, None, 10) == []
    assert do(find, "ann", all_jobs[4]).state == "running"


def test_the_history_says_why_attempts_ended(do: Callable[..., Any], database: sa.Engine) -> None:
    job = submitted(do)
    assert do(attempts.of, job) == []
    claimed(do)
    do(claims.put_back, "me", [job], 0.0, "the store is full")
    claimed(do)
    do(attempts.lost, [job], "tls://10.0.0.7:4000", 2.5, "killed by signal 9")
    with database.begin() as connection:
        connection.execute(jobs.update().values(claim_until=1.0))
    claimed(do)
    do(claims.cancel, "ann", job)
    history = do(attempts.of, job)
    assert [each.why for each in history] == [
        "the store is full", "its claim expired", "killed by signal 9", "cancelled",
    ]  # fmt: skip
    lost = history[2]
    assert lost.worker == "tls://10.0.0.7:4000"
    assert lost.ended - lost.began == pytest.approx(2.5, abs=1e-3)
    assert all(each.ended >= each.began for each in history)


def test_a_job_keeps_its_name(do: Callable[..., Any]) -> None:
    submitted(do, name="tube, gap 0.2 mm")
    submitted(do)
    assert [job.name for job in do(claims.claim, "me", "bulk", 10, 100.0)] == [
        "tube, gap 0.2 mm", None,
    ]  # fmt: skip
