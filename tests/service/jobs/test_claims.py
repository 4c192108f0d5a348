"""Which jobs can be claimed or are overdue, and who may change a job."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

import pytest
import sqlalchemy as sa

from vibroimpact_service.jobs import claims
from vibroimpact_service.jobs.database import open_database, reader
from vibroimpact_service.jobs.records import NewJob, find, insert, page
from vibroimpact_service.jobs.tables import jobs


@pytest.fixture
def engine(tmp_path: Path) -> Iterator[sa.Engine]:
    engine = open_database(f"sqlite:///{tmp_path / 'jobs.sqlite'}")
    yield engine
    engine.dispose()


def _submitted(engine: sa.Engine, **more: float) -> str:
    new = NewJob("job_" + "1" * 32, "ann", "busy", "a" * 64, "b" * 64, 0, 5.0, False, **more)
    with engine.begin() as connection:
        return insert(connection, new).id


def _claimable_and_overdue(engine: sa.Engine) -> tuple[bool, bool]:
    with reader(engine).connect() as connection:
        return claims.claimable(connection), claims.overdue(connection)


def test_nothing_is_found_where_there_is_nothing(engine: sa.Engine) -> None:
    assert _claimable_and_overdue(engine) == (False, False)


def test_a_queued_job_is_found_until_it_is_claimed_and_when_its_claim_expired(
    engine: sa.Engine,
) -> None:
    _submitted(engine)
    assert _claimable_and_overdue(engine) == (True, False)
    with engine.begin() as connection:
        assert claims.claim(connection, "me", "bulk", 1, 1.0)
    assert _claimable_and_overdue(engine) == (False, False)
    with engine.begin() as connection:
        connection.execute(jobs.update().values(claim_until=1.0))
    assert _claimable_and_overdue(engine) == (True, False)


def test_a_job_that_is_to_be_tried_later_is_not_found_before(engine: sa.Engine) -> None:
    job = _submitted(engine)
    with engine.begin() as connection:
        claims.claim(connection, "me", "bulk", 1, 1.0)
        claims.put_back(connection, "me", [job], 1000.0)
    assert _claimable_and_overdue(engine) == (False, False)
    with engine.begin() as connection:
        connection.execute(jobs.update().values(retry_at=1.0))
    assert _claimable_and_overdue(engine) == (True, False)


def test_a_passed_deadline_is_found(engine: sa.Engine) -> None:
    _submitted(engine, deadline=1000.0)
    assert _claimable_and_overdue(engine)[1] is False
    with engine.begin() as connection:
        connection.execute(jobs.update().values(deadline=1.0))
    assert _claimable_and_overdue(engine)[1] is True


def test_a_process_changes_only_jobs_whose_claim_it_holds(engine: sa.Engine) -> None:
    job = _submitted(engine)
    with engine.begin() as connection:
        claims.claim(connection, "me", "bulk", 1, 1.0)
        assert claims.renew(connection, "other", [job]) == set()
        assert not claims.report(connection, "other", job, {"done": 1})
        assert claims.put_back(connection, "other", [job]) == set()
        assert claims.succeed(connection, "other", [job], reused=False) == {}
        assert claims.fail(connection, "other", job, {"code": "no"}) == {}
        held = find(connection, "ann", job)
        assert held is not None
        assert (held.state, held.claim_owner, held.done) == ("running", "me", 0)
        assert claims.renew(connection, "me", [job]) == {job}
        assert set(claims.succeed(connection, "me", [job], reused=False)) == {job}


def test_only_its_owner_cancels_a_job(engine: sa.Engine) -> None:
    job = _submitted(engine)
    with engine.begin() as connection:
        assert claims.cancel(connection, "bob", job) == (None, False)
        asked = find(connection, "ann", job)
        assert asked is not None
        assert asked.state == "queued"
        cancelled, ended = claims.cancel(connection, "ann", job)
        assert ended
        assert cancelled is not None
        assert cancelled.state == "cancelled"


def test_positions_are_those_in_which_jobs_are_claimed(engine: sa.Engine) -> None:
    owners = random.Random(1)
    for number in range(60):
        owner = owners.choice(["ann", "ann", "ann", "bob", "eve"])
        seconds, priority = owners.choice([0.01, 5.0]), owners.choice([0, 0, 1])
        name = f"{number:064}"
        new = NewJob(f"job_{number:032}", owner, "busy", name, name, priority, seconds, False)
        with engine.begin() as connection:
            insert(connection, new)
    for queue in ("quick", "bulk", "bulk"):  # owners run different numbers of jobs from then on
        with engine.begin() as connection:
            claims.claim(connection, "here", queue, 3, float("inf"))
    with engine.begin() as connection:
        waiting = page(connection, "ann", "queued", None, None, 60)
        assert {job.queue for job in waiting} == {"quick", "bulk"}
        positions = claims.ahead(connection, waiting)
    for queue in ("quick", "bulk"):
        with engine.connect() as connection:  # never committed
            order = [job.id for job in claims.claim(connection, "here", queue, 60, float("inf"))]
        places = {job.id: order.index(job.id) for job in waiting if job.queue == queue}
        for job, place in places.items():
            # Where two owners run as many jobs, chance decides: at most one of each of the others.
            assert positions[job] <= place <= positions[job] + 2
        assert sorted(places, key=positions.__getitem__) == sorted(places, key=places.__getitem__)
