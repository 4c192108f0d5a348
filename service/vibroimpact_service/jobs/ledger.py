"""What can be done to the records of jobs, each as one operation of a transaction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from vibroimpact_service.jobs.records import FINAL, JobRow, idempotency, jobs, now, row

LEASE_SECONDS = 10.0


class KeyReusedError(ValueError):
    """An idempotency key came back with another request."""


@dataclass(frozen=True, slots=True)
class NewJob:
    """What is known of a job when it is submitted."""

    id: str
    owner: str
    kind: str
    request: str
    result: str
    priority: int
    seconds: float
    reused: bool
    key: str | None = None


def insert(new: NewJob) -> Callable[[Connection], JobRow]:
    """Record a job; with an idempotency key, at most once."""

    def operation(connection: Connection) -> JobRow:
        if new.key is not None:
            earlier = _by_key(connection, new)
            if earlier is not None:
                return earlier
        clock = now(connection)
        state = "succeeded" if new.reused else "queued"
        values = {
            "id": new.id, "owner": new.owner, "kind": new.kind, "request": new.request,
            "result": new.result, "state": state, "phase": "done" if new.reused else "waiting",
            "priority": new.priority, "seconds": new.seconds, "done": int(new.reused),
            "total": 1, "attempts": 0, "reused": new.reused, "cancel_asked": False,
            "created": clock, "finished": clock if new.reused else None, "version": 1,
        }  # fmt: skip
        connection.execute(jobs.insert().values(values))
        return fetch_one(connection, new.id)

    return operation


def _by_key(connection: Connection, new: NewJob) -> JobRow | None:
    where = (idempotency.c.owner == new.owner) & (idempotency.c.key == new.key)
    found = connection.execute(idempotency.select().where(where)).one_or_none()
    if found is None:
        connection.execute(
            idempotency.insert().values(
                owner=new.owner,
                key=new.key,
                fingerprint=new.result,
                job=new.id,
                created=now(connection),
            )
        )
        return None
    if found.fingerprint != new.result:
        raise KeyReusedError
    return fetch_one(connection, found.job)


def fetch_one(connection: Connection, job: str) -> JobRow:
    """Return the row of a job that is known to be there."""
    return row(connection.execute(jobs.select().where(jobs.c.id == job)).one())


def find(connection: Connection, owner: str, job: str) -> JobRow | None:
    """Return a job of that owner, or None."""
    where = (jobs.c.id == job) & (jobs.c.owner == owner)
    found = connection.execute(jobs.select().where(where)).one_or_none()
    return None if found is None else row(found)


def page(
    connection: Connection, owner: str, state: str | None, kind: str | None, before: int | None,
    limit: int,
) -> list[JobRow]:  # fmt: skip
    """Return jobs of an owner, newest first."""
    query = jobs.select().where(jobs.c.owner == owner)
    if state is not None:
        query = query.where(jobs.c.state == state)
    if kind is not None:
        query = query.where(jobs.c.kind == kind)
    if before is not None:
        query = query.where(jobs.c.seq < before)
    found = connection.execute(query.order_by(jobs.c.seq.desc()).limit(limit))
    return [row(each) for each in found]


def ahead(connection: Connection, job: JobRow) -> int:
    """Return how many queued jobs go before a queued one."""
    before = (jobs.c.priority > job.priority) | (
        (jobs.c.priority == job.priority) & (jobs.c.seq < job.seq)
    )
    where = (jobs.c.state == "queued") & before
    return int(connection.execute(sa.select(sa.func.count()).where(where)).scalar_one())


def claim(me: str, limit: int, busy: dict[str, int]) -> Callable[[Connection], list[JobRow]]:
    """Take over jobs that are queued or whose lease ran out, and lease them.

    Owners with fewer jobs under way (`busy`) go first, then priority, then age. A job whose
    result another one is computing waits for it.
    """

    def operation(connection: Connection) -> list[JobRow]:
        clock = now(connection)
        other = jobs.alias()
        computing = sa.exists().where(
            (other.c.result == jobs.c.result)
            & (other.c.state == "running")
            & (other.c.id != jobs.c.id)
            & (other.c.lease_until >= clock)
        )
        free = (jobs.c.state == "queued") | (
            (jobs.c.state == "running") & (jobs.c.lease_until < clock)
        )
        load = sa.case(busy, value=jobs.c.owner, else_=0) if busy else sa.literal(0)
        query = (
            jobs.select()
            .where(free & ~computing)
            .order_by(load, jobs.c.priority.desc(), jobs.c.seq)
            .limit(limit)
            .with_for_update(skip_locked=True)
        )
        taken: list[JobRow] = []
        results: set[str] = set()
        for found in connection.execute(query).all():
            job = row(found)
            if job.result in results:
                continue
            results.add(job.result)
            values = {
                "state": "running", "phase": "starting", "attempts": job.attempts + 1,
                "started": sa.func.coalesce(jobs.c.started, clock), "lease_owner": me,
                "lease_until": clock + LEASE_SECONDS, "version": jobs.c.version + 1,
            }  # fmt: skip
            connection.execute(jobs.update().where(jobs.c.id == job.id).values(values))
            taken.append(fetch_one(connection, job.id))
        return taken

    return operation


def renew(me: str) -> Callable[[Connection], set[str]]:
    """Prolong all leases of mine; return the jobs that are still mine."""

    def operation(connection: Connection) -> set[str]:
        mine = (jobs.c.lease_owner == me) & (jobs.c.state == "running")
        until = now(connection) + LEASE_SECONDS
        connection.execute(jobs.update().where(mine).values(lease_until=until))
        return set(connection.execute(sa.select(jobs.c.id).where(mine)).scalars())

    return operation


def update(me: str, job: str, **values: Any) -> Callable[[Connection], bool]:
    """Change a running job, provided that the lease is mine; whether it was."""

    def operation(connection: Connection) -> bool:
        mine = (jobs.c.id == job) & (jobs.c.lease_owner == me) & (jobs.c.state == "running")
        changes = dict(values)
        if changes.get("state") in FINAL:
            changes["finished"] = now(connection)
        if changes.get("state") is not None:
            changes |= {"lease_owner": None, "lease_until": None}
        change = jobs.update().where(mine).values(version=jobs.c.version + 1, **changes)
        return bool(connection.execute(change).rowcount)

    return operation


def cancel(owner: str, job: str) -> Callable[[Connection], JobRow | None]:
    """Cancel a queued job at once, ask a running one to stop; anything final stays."""

    def operation(connection: Connection) -> JobRow | None:
        mine = (jobs.c.id == job) & (jobs.c.owner == owner)
        connection.execute(
            jobs.update()
            .where(mine & (jobs.c.state == "queued"))
            .values(
                state="cancelled",
                phase="done",
                finished=now(connection),
                version=jobs.c.version + 1,
            )
        )
        connection.execute(
            jobs.update()
            .where(mine & (jobs.c.state == "running") & ~jobs.c.cancel_asked)
            .values(cancel_asked=True, phase="stopping", version=jobs.c.version + 1)
        )
        return find(connection, owner, job)

    return operation


def release_all(connection: Connection) -> None:
    """Queue every running job again: for a start at which nobody else can be running them."""
    values = {
        "state": "queued", "phase": "waiting", "lease_owner": None, "lease_until": None,
        "version": jobs.c.version + 1,
    }  # fmt: skip
    connection.execute(jobs.update().where(jobs.c.state == "running").values(values))
