"""What drivers do to the records of jobs: claim, renew, report, end. Every write is fenced.

A driver owns a running job until its lease runs out or somebody ends the job. What it writes
afterwards changes nothing, and it is told so.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Collection, Sequence
from typing import Any, Final

import sqlalchemy as sa
from sqlalchemy.engine import Connection
from sqlalchemy.exc import IntegrityError

from vibroimpact_service.jobs.database import now
from vibroimpact_service.jobs.ledger import QUEUED, RUNNING
from vibroimpact_service.jobs.records import JobRow, jobs, row

LEASE_SECONDS: Final = 8.0
_FREED: Final[dict[str, Any]] = {"lease_owner": None, "lease_until": None}


def claimable(connection: Connection) -> bool:
    """Whether there is a job that could be claimed: to look costs far less than to try.

    Of a queued one it is not asked whether its result is being computed for another.
    """
    clock = now(connection)
    orphan = sa.exists().where(RUNNING, jobs.c.lease_until < clock)
    due = jobs.c.retry_at.is_(None) | (jobs.c.retry_at <= clock)
    return bool(connection.execute(sa.select(orphan | sa.exists().where(QUEUED, due))).scalar_one())


def overdue(connection: Connection) -> bool:
    """Whether there is a job whose deadline has passed."""
    found = sa.exists().where(QUEUED | RUNNING, jobs.c.deadline < now(connection))
    return bool(connection.execute(sa.select(found)).scalar_one())


def claim(me: str, lane: str, room: int, seconds: float) -> Callable[[Connection], list[JobRow]]:
    """Lease jobs of a lane that are queued or whose lease ran out.

    Owners with fewer jobs under way go first; among the jobs of one owner, priority, then
    age. A job whose result is being computed for another one waits for it.

    Parameters
    ----------
    me : str
        Who claims.
    lane : str
    room : int
        Most jobs.
    seconds : float
        Enough planned work: no more jobs are claimed beyond it.
    """

    def operation(connection: Connection) -> list[JobRow]:
        wanted = _candidates(connection, lane, room)
        taken: list[JobRow] = []
        results: set[str] = set()
        planned = 0.0
        for job in wanted:
            if len(taken) == room or (taken and planned >= seconds):
                break
            if job.result not in results:
                results.add(job.result)
                taken.append(job)
                planned += job.seconds
        return _take(connection, me, taken)

    return operation


def _candidates(connection: Connection, lane: str, room: int) -> list[JobRow]:
    """Return jobs that can be claimed, in the order in which they should be."""
    clock = now(connection)
    orphan = RUNNING & (jobs.c.lease_until < clock) & (jobs.c.lane == lane)
    found = _locked(connection, jobs.select().where(orphan).order_by(jobs.c.seq), room)
    other = jobs.alias()
    computing = sa.exists().where(
        (other.c.result == jobs.c.result) & (other.c.state == sa.literal_column("'running'"))
    )
    due = jobs.c.retry_at.is_(None) | (jobs.c.retry_at <= clock)
    free = jobs.select().where(QUEUED, jobs.c.lane == lane, due, ~computing)
    load = _load(connection)
    owners = _owners(connection, lane)
    random.shuffle(owners)  # owners with the same load take turns
    heads: dict[str, list[JobRow]] = {}
    for owner in sorted(owners, key=lambda o: load.get(o, 0))[:room]:
        mine = free.where(jobs.c.owner == owner)
        ordered = mine.order_by(jobs.c.priority.desc(), jobs.c.seq)
        heads[owner] = _locked(connection, ordered, room)
    while len(found) < room and any(heads.values()):
        owner = min((o for o in heads if heads[o]), key=lambda o: load.get(o, 0))
        found.append(heads[owner].pop(0))
        load[owner] = load.get(owner, 0) + 1
    return found


def _locked(connection: Connection, query: sa.Select[Any], limit: int) -> list[JobRow]:
    rows = connection.execute(query.limit(limit).with_for_update(skip_locked=True))
    return [row(each) for each in rows.all()]


def _load(connection: Connection) -> dict[str, int]:
    """Return how many jobs of each owner are under way anywhere."""
    query = (
        sa.select(jobs.c.owner, sa.func.count().label("held")).where(RUNNING).group_by(jobs.c.owner)
    )
    return {each.owner: each.held for each in connection.execute(query)}


def _owners(connection: Connection, lane: str) -> list[str]:
    """Return the owners of queued jobs, by hopping through the index from one to the next."""
    first = sa.select(sa.func.min(jobs.c.owner).label("owner")).where(QUEUED, jobs.c.lane == lane)
    hops = first.cte("owners", recursive=True)
    following = (
        sa.select(sa.func.min(jobs.c.owner))
        .where(QUEUED, jobs.c.lane == lane, jobs.c.owner > hops.c.owner)
        .correlate(hops)
        .scalar_subquery()
    )
    hops = hops.union_all(sa.select(following).where(hops.c.owner.is_not(None)))
    found = connection.execute(sa.select(hops.c.owner).where(hops.c.owner.is_not(None)))
    return list(found.scalars())


def _take(connection: Connection, me: str, wanted: Sequence[JobRow]) -> list[JobRow]:
    """Lease the jobs; one whose result another replica began to compute meanwhile stays."""
    if not wanted:
        return []
    clock = now(connection)
    lease = (
        jobs.update()
        .where(jobs.c.id.in_([job.id for job in wanted]))
        .values(
            state="running",
            phase="starting",
            note=None,
            retry_at=None,
            attempts=jobs.c.attempts + 1,
            started=sa.func.coalesce(jobs.c.started, clock),
            lease_owner=me,
            lease_until=clock + LEASE_SECONDS,
            version=jobs.c.version + 1,
        )
        .returning(*jobs.c)
    )
    try:
        with connection.begin_nested():
            taken = {each.id: row(each) for each in connection.execute(lease).all()}
    except IntegrityError:
        if len(wanted) == 1:
            return []
        return [job for one in wanted for job in _take(connection, me, [one])]
    return [taken[job.id] for job in wanted if job.id in taken]


def renew(me: str, held: Collection[str]) -> Callable[[Connection], set[str]]:
    """Prolong leases; return the jobs that are still mine."""

    def operation(connection: Connection) -> set[str]:
        until = now(connection) + LEASE_SECONDS
        prolong = jobs.update().where(_mine(me, held)).values(lease_until=until)
        return set(connection.execute(prolong.returning(jobs.c.id)).scalars())

    return operation


def report(me: str, job: str, **values: Any) -> Callable[[Connection], bool]:
    """Change what a running job says about itself; whether it is still mine."""

    def operation(connection: Connection) -> bool:
        change = jobs.update().where(_mine(me, [job]))
        changed = connection.execute(change.values(version=jobs.c.version + 1, **values))
        return bool(changed.rowcount)

    return operation


def put_back(
    me: str, held: Collection[str], seconds: float = 0.0, note: str | None = None
) -> Callable[[Connection], set[str]]:
    """Queue running jobs again, not to be tried before some seconds passed."""

    def operation(connection: Connection) -> set[str]:
        change = jobs.update().where(_mine(me, held)).values(
            state="queued", phase="waiting", note=note, version=jobs.c.version + 1,
            retry_at=now(connection) + seconds if seconds else None, **_FREED,
        )  # fmt: skip
        return set(connection.execute(change.returning(jobs.c.id)).scalars())

    return operation


def succeed(me: str, held: Collection[str], reused: bool) -> Callable[[Connection], set[str]]:
    """End running jobs well, and with them the queued ones that wait for the same results.

    Returns
    -------
    set of str
        All jobs that ended.
    """

    def operation(connection: Connection) -> set[str]:
        values = {"state": "succeeded", "done": jobs.c.total, "reused": reused}
        mine, results = _end(connection, _mine(me, held), values)
        alike, _ = _end(connection, QUEUED & jobs.c.result.in_(results), values | {"reused": True})
        return mine | alike

    return operation


def fail(me: str, job: str, error: dict[str, Any]) -> Callable[[Connection], set[str]]:
    """End a running job badly, and the queued ones that ask the same; return all that ended."""

    def operation(connection: Connection) -> set[str]:
        values = {"state": "failed", "error": error}
        mine, results = _end(connection, _mine(me, [job]), values)
        alike, _ = _end(connection, QUEUED & jobs.c.result.in_(results), values)
        return mine | alike

    return operation


def fail_overdue(error: dict[str, Any]) -> Callable[[Connection], set[str]]:
    """End all jobs whose deadline has passed; return them."""

    def operation(connection: Connection) -> set[str]:
        overdue = (QUEUED | RUNNING) & (jobs.c.deadline < now(connection))
        ended, _ = _end(connection, overdue, {"state": "failed", "error": error})
        return ended

    return operation


def _end(
    connection: Connection, where: sa.ColumnElement[bool], values: dict[str, Any]
) -> tuple[set[str], set[str]]:
    """End jobs; return them and their results."""
    common = {
        "phase": "done", "note": None, "finished": now(connection),
        "version": jobs.c.version + 1, **_FREED,
    }  # fmt: skip
    end = jobs.update().where(where).values(**(common | values))
    ended = connection.execute(end.returning(jobs.c.id, jobs.c.result)).all()
    return {each.id for each in ended}, {each.result for each in ended}


def _mine(me: str, held: Collection[str]) -> sa.ColumnElement[bool]:
    return jobs.c.id.in_(held) & (jobs.c.lease_owner == me) & RUNNING


def release_all(connection: Connection) -> None:
    """Queue every running job again: for a start at which nobody else can be running them."""
    values = {"state": "queued", "phase": "waiting", "version": jobs.c.version + 1, **_FREED}
    connection.execute(jobs.update().where(RUNNING).values(**values))
