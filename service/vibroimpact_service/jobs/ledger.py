"""What users do to the records of jobs: submit, look, list, cancel, pin."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.engine import Connection

from vibroimpact_service.jobs.database import now
from vibroimpact_service.jobs.records import (
    JobRow,
    idempotency,
    jobs,
    pins,
    requests,
    row,
    webhooks,
)

QUICK_SECONDS: Final = 0.1
"""Planned work up to which a job goes to the workers together with others."""

# Literal, not bound: only then does a database see that the partial indices apply.
QUEUED: Final = jobs.c.state == sa.literal_column("'queued'")
UNFINISHED: Final = ("queued", "running")
RUNNING: Final = jobs.c.state == sa.literal_column("'running'")


class KeyReusedError(ValueError):
    """An idempotency key came back with another request."""


@dataclass(frozen=True, slots=True)
class NewJob:
    """What is known of a job when it is submitted.

    Parameters
    ----------
    id, owner, kind : str
    request, result : str
        Names in the store of what is asked and of what will answer it.
    priority : int
        Higher goes first among the jobs of the same owner.
    seconds : float
        Planned work.
    reused : bool
        Whether the result is there already.
    key : str, optional
        Idempotency key.
    deadline : float, optional
        Seconds from now after which the job fails, where it is not done.
    webhook : tuple of str, optional
        Where to send a message when it ends, and the secret that signs it.
    block : bytes, optional
        What is asked, to be recorded with the job; absent: it stands in the store already.
    computed : bool
        Whether the result was computed for this job, before its record is written.
    """

    id: str
    owner: str
    kind: str
    request: str
    result: str
    priority: int
    seconds: float
    reused: bool
    key: str | None = None
    deadline: float | None = None
    webhook: tuple[str, str] | None = None
    block: bytes | None = None
    computed: bool = False

    @property
    def done(self) -> bool:
        """Whether the result is there."""
        return self.reused or self.computed


def insert(news: Sequence[NewJob]) -> Callable[[Connection], list[JobRow]]:
    """Record jobs; one with an idempotency key, at most once."""

    def operation(connection: Connection) -> list[JobRow]:
        earlier = {new.id: _earlier(connection, new) for new in news if new.key is not None}
        fresh = [new for new in news if earlier.get(new.id) is None]
        _insert_requests(connection, fresh)
        known = {job.id: job for job in _insert(connection, fresh)}
        _insert_webhooks(connection, fresh)
        return [earlier.get(new.id) or known[new.id] for new in news]

    return operation


def _insert(connection: Connection, news: Sequence[NewJob]) -> list[JobRow]:
    clock = now(connection)
    found: list[sa.Row[Any]] = []
    for times in (("created",), ("created", "finished"), ("created", "started", "finished")):
        values = [_values(new) for new in news if _times(new) == times]
        if not values:
            continue
        # SQL expressions cannot stand in the rows of a bulk insertion, so they stand beside.
        clocks = dict.fromkeys(times, clock)
        insertion = jobs.insert().values(**clocks).returning(*jobs.c)
        found += connection.execute(insertion, values).all()
    if any(new.deadline is not None for new in news):
        found = _set_deadlines(connection, news)
    return [row(each) for each in found]


def _insert_requests(connection: Connection, news: Sequence[NewJob]) -> None:
    blocks = {new.request: new.block for new in news if new.block is not None}
    if not blocks:
        return
    dialect = postgresql if connection.dialect.name == "postgresql" else sqlite
    clock = now(connection)
    insertion = dialect.insert(requests).values(created=clock)
    # One that is there already counts as new: nobody may take it for abandoned now.
    again = insertion.on_conflict_do_update(index_elements=["name"], set_={"created": clock})
    # In one order everywhere: replicas that record the same ones must not wait in a circle.
    connection.execute(again, [{"name": name, "data": blocks[name]} for name in sorted(blocks)])


def _insert_webhooks(connection: Connection, news: Sequence[NewJob]) -> None:
    for new in news:
        if new.webhook is not None:
            url, secret = new.webhook
            values = {"job": new.id, "url": url, "secret": secret, "attempts": 0}
            connection.execute(webhooks.insert().values(**values, due=now(connection)))


def _times(new: NewJob) -> tuple[str, ...]:
    """Return which columns get the time of the submission."""
    if new.computed:
        return "created", "started", "finished"
    return ("created", "finished") if new.reused else ("created",)


def _values(new: NewJob) -> dict[str, Any]:
    return {
        "id": new.id,
        "owner": new.owner,
        "kind": new.kind,
        "request": new.request,
        "result": new.result,
        "state": "succeeded" if new.done else "queued",
        "phase": "done" if new.done else "waiting",
        "lane": "quick" if new.seconds <= QUICK_SECONDS else "bulk",
        "priority": new.priority,
        "seconds": new.seconds,
        "done": int(new.done),
        "total": 1,
        "kept": int(new.reused),
        "attempts": int(new.computed),
        "reused": new.reused,
        "version": 1,
    }


def _set_deadlines(connection: Connection, news: Sequence[NewJob]) -> list[sa.Row[Any]]:
    for new in news:
        if new.deadline is not None and not new.done:
            until = jobs.c.created + new.deadline
            connection.execute(jobs.update().where(jobs.c.id == new.id).values(deadline=until))
    mine = jobs.c.id.in_([new.id for new in news])
    return list(connection.execute(jobs.select().where(mine)).all())


def _earlier(connection: Connection, new: NewJob) -> JobRow | None:
    """Return the job that was submitted under the same key, or take the key for this one."""
    dialect = postgresql if connection.dialect.name == "postgresql" else sqlite
    taken = connection.execute(
        dialect.insert(idempotency)
        .values(
            owner=new.owner,
            key=new.key,
            fingerprint=new.result,
            job=new.id,
            created=now(connection),
        )
        .on_conflict_do_nothing()
        .returning(idempotency.c.key)
    ).all()
    if taken:
        return None
    where = (idempotency.c.owner == new.owner) & (idempotency.c.key == new.key)
    found = connection.execute(idempotency.select().where(where)).one()
    if found.fingerprint != new.result:
        raise KeyReusedError
    return row(connection.execute(jobs.select().where(jobs.c.id == found.job)).one())


def find(connection: Connection, owner: str, job: str) -> JobRow | None:
    """Return a job of that owner, or None."""
    where = (jobs.c.id == job) & (jobs.c.owner == owner)
    found = connection.execute(jobs.select().where(where)).one_or_none()
    return None if found is None else row(found)


def request(connection: Connection, name: str) -> bytes | None:
    """Return what a job asks, where it was recorded with the job."""
    found = connection.execute(sa.select(requests.c.data).where(requests.c.name == name))
    return found.scalar_one_or_none()


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


def ahead(connection: Connection, asked: Sequence[JobRow]) -> dict[str, int]:
    """Return how many queued jobs go before each of some queued ones.

    They are counted over the records that lie between neighbours, so that a page of jobs
    costs no more than its last one.
    """
    found = {}
    for priority in {job.priority for job in asked}:
        alike = sorted((j for j in asked if j.priority == priority), key=lambda j: j.seq)
        counted = _count(connection, jobs.c.priority > priority)
        last = 0
        for job in alike:
            between = (jobs.c.seq >= last) & (jobs.c.seq < job.seq)
            counted += _count(connection, (jobs.c.priority == priority) & between)
            found[job.id], last = counted, job.seq
    return found


def _count(connection: Connection, where: sa.ColumnElement[bool]) -> int:
    query = sa.select(sa.func.count()).select_from(jobs).where(QUEUED, where)
    return int(connection.execute(query).scalar_one())


def unfinished(connection: Connection, owner: str, most: int) -> int:
    """Return how many jobs of an owner are queued or running; counting ends at `most`."""
    found = sa.select(jobs.c.seq).where(jobs.c.owner == owner, jobs.c.state.in_(UNFINISHED))
    some = found.limit(most).subquery()
    return int(connection.execute(sa.select(sa.func.count()).select_from(some)).scalar_one())


def waiting(connection: Connection) -> dict[str, int]:
    """Return how many jobs are queued, and how many running."""
    counts = {"queued": sa.select(sa.func.count()).select_from(jobs).where(QUEUED)}
    counts["running"] = sa.select(sa.func.count()).select_from(jobs).where(RUNNING)
    return {state: int(connection.execute(q).scalar_one()) for state, q in counts.items()}


def versions(connection: Connection, asked: Sequence[str]) -> dict[str, int]:
    """Return the version of each of some jobs."""
    query = sa.select(jobs.c.id, jobs.c.version).where(jobs.c.id.in_(asked))
    return {each.id: each.version for each in connection.execute(query)}


def cancel(owner: str, job: str) -> Callable[[Connection], JobRow | None]:
    """Cancel a job that is not final, at once: whoever computes it has lost its lease."""

    def operation(connection: Connection) -> JobRow | None:
        where = (jobs.c.id == job) & (jobs.c.owner == owner) & (QUEUED | RUNNING)
        connection.execute(
            jobs.update()
            .where(where)
            .values(
                state="cancelled",
                phase="done",
                note=None,
                lease_owner=None,
                lease_until=None,
                finished=now(connection),
                version=jobs.c.version + 1,
            )
        )
        return find(connection, owner, job)

    return operation


def pin(owner: str, result: str) -> Callable[[Connection], None]:
    """Keep a result for as long as the pin is there."""

    def operation(connection: Connection) -> None:
        dialect = postgresql if connection.dialect.name == "postgresql" else sqlite
        values = {"owner": owner, "result": result, "created": now(connection)}
        connection.execute(dialect.insert(pins).values(**values).on_conflict_do_nothing())

    return operation


def unpin(owner: str, result: str) -> Callable[[Connection], bool]:
    """Take a pin away; whether there was one."""

    def operation(connection: Connection) -> bool:
        where = (pins.c.owner == owner) & (pins.c.result == result)
        return bool(connection.execute(pins.delete().where(where)).rowcount)

    return operation


def pinned(connection: Connection, owner: str) -> list[str]:
    """Return the results that an owner pinned, oldest pin first."""
    query = sa.select(pins.c.result).where(pins.c.owner == owner).order_by(pins.c.created)
    return list(connection.execute(query).scalars())
