"""Operations of users on job records: submit, find, list.

A job is cancelled where its claim is ended: `claims`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.engine import Connection

from vibroimpact_service.jobs.database import now
from vibroimpact_service.jobs.tables import (
    JobRow,
    idempotency,
    jobs,
    processes,
    requests,
    row,
    webhooks,
)

QUICK_SECONDS: Final = 0.1
"""Planned work up to which a job is sent to a worker together with others."""

# Literal, not bound: only then does a database see that the partial indices apply.
QUEUED: Final = jobs.c.state == sa.literal_column("'queued'")
UNFINISHED: Final = ("queued", "running")
RUNNING: Final = jobs.c.state == sa.literal_column("'running'")


class KeyReusedError(ValueError):
    """An idempotency key was used before, for another request."""


@dataclass(frozen=True, slots=True)
class NewJob:
    """A job as it is submitted.

    Parameters
    ----------
    id, owner, kind : str
    request, result : str
        Names of the request and of its result in the store.
    priority : int
        Higher goes first among the jobs of the same owner.
    seconds : float
        Planned work.
    reused : bool
        Whether the result is stored already.
    key : str, optional
        Idempotency key.
    deadline : float, optional
        Seconds from now after which the job fails unless it is done.
    webhook : tuple of str, optional
        URL that receives a message when the job ends, and the secret that signs it.
    block : bytes, optional
        The request itself, to be recorded with the job; absent: it is in the store already.
    computed : bool
        Whether the result was computed for this job already, before it is recorded.
    trace : str, optional
        Context of the span of the request.
    account : str, optional
        What its processor time is charged to, and the planned one until it ends; absent: nobody.
    fingerprint : str
        What the idempotency key stands for; empty: the result.
    name : str, optional
        What its owner calls it.
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
    trace: str | None = None
    account: str | None = None
    fingerprint: str = ""
    name: str | None = None

    @property
    def done(self) -> bool:
        """Whether the result is stored."""
        return self.reused or self.computed


def insert(connection: Connection, new: NewJob) -> JobRow:
    """Record a job and return it; one with an idempotency key is recorded at most once."""
    earlier = None if new.key is None else _earlier(connection, new)
    if earlier is not None:
        return earlier
    clock = now(connection)
    if new.block is not None:
        insertion = _insertion(connection, requests).values(created=clock)
        # One that was recorded before counts as new, so that retention does not remove it now.
        insertion = insertion.on_conflict_do_update(
            index_elements=["name"], set_={"created": clock}
        )
        connection.execute(insertion, {"name": new.request, "data": new.block})
    if new.webhook is not None:
        url, secret = new.webhook
        values = {"job": new.id, "url": url, "secret": secret, "attempts": 0, "due": clock}
        connection.execute(webhooks.insert().values(**values))
    if new.deadline is not None:  # from the very time that is recorded
        clock = sa.literal(connection.execute(sa.select(clock)).scalar_one())
    times = {"created": clock}
    if new.done:
        times["finished"] = clock
        if new.computed:
            times["started"] = clock
    elif new.deadline is not None:
        times["deadline"] = clock + new.deadline
    insertion = jobs.insert().values(times).returning(*jobs.c)
    return row(connection.execute(insertion, _values(new)).one())


def seen(connection: Connection, name: str) -> None:
    """Record that a service process can write."""
    clock = now(connection)
    insertion = _insertion(connection, processes).values(name=name, seen=clock)
    connection.execute(
        insertion.on_conflict_do_update(index_elements=["name"], set_={"seen": clock})
    )


def _insertion(connection: Connection, table: sa.Table) -> Any:
    """Return an insertion that can say what to do in a conflict."""
    dialect = postgresql if connection.dialect.name == "postgresql" else sqlite
    return dialect.insert(table)


def _values(new: NewJob) -> dict[str, Any]:
    return {
        "id": new.id,
        "owner": new.owner,
        "kind": new.kind,
        "request": new.request,
        "result": new.result,
        "state": "succeeded" if new.done else "queued",
        "phase": "done" if new.done else "waiting",
        "queue": "quick" if new.seconds <= QUICK_SECONDS else "bulk",
        "priority": new.priority,
        "seconds": new.seconds,
        "done": int(new.done),
        "total": 1,
        "kept": int(new.reused),
        "attempts": int(new.computed),
        "reused": new.reused,
        "version": 1,
        "trace": new.trace,
        "name": new.name,
        "account": None if new.done else new.account,
        "held": 0.0 if new.done or new.account is None else new.seconds,
    }


def keep_key(
    connection: Connection, owner: str, key: str, fingerprint: str, job: str | None = None
) -> str | None:
    """Record a key for a request, and the job that answers it; return the job it has already.

    Raises
    ------
    KeyReusedError
        Where it stands for a request with another fingerprint.
    """
    insertion = _insertion(connection, idempotency).values(
        owner=owner, key=key, fingerprint=fingerprint, job=job, created=now(connection)
    )
    recorded = connection.execute(
        insertion.on_conflict_do_nothing().returning(idempotency.c.key)
    ).all()
    if recorded:
        return None
    where = (idempotency.c.owner == owner) & (idempotency.c.key == key)
    earlier = connection.execute(idempotency.select().where(where)).one()
    if earlier.fingerprint != fingerprint:
        raise KeyReusedError
    if earlier.job is None and job is not None:
        connection.execute(idempotency.update().where(where).values(job=job))
    known: str | None = earlier.job
    return known


def _earlier(connection: Connection, new: NewJob) -> JobRow | None:
    """Return the job that was submitted with the same key, or record the key for this one."""
    assert new.key is not None
    job = keep_key(connection, new.owner, new.key, new.fingerprint or new.result, new.id)
    if job is None:
        return None
    return row(connection.execute(jobs.select().where(jobs.c.id == job)).one())


def find(connection: Connection, owner: str, job: str) -> JobRow | None:
    """Return a job of that owner, or None."""
    where = (jobs.c.id == job) & (jobs.c.owner == owner)
    selected = connection.execute(jobs.select().where(where)).one_or_none()
    return None if selected is None else row(selected)


def request(connection: Connection, name: str) -> bytes | None:
    """Return a request that was recorded with its job, or None."""
    query = sa.select(requests.c.data).where(requests.c.name == name)
    return connection.execute(query).scalar_one_or_none()


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
    rows = connection.execute(query.order_by(jobs.c.seq.desc()).limit(limit))
    return [row(each) for each in rows]


def unfinished(connection: Connection, owner: str, most: int) -> int:
    """Return how many jobs of an owner are queued or running; counting ends at `most`."""
    own = sa.select(jobs.c.seq).where(jobs.c.owner == owner, jobs.c.state.in_(UNFINISHED))
    some = own.limit(most).subquery()
    return int(connection.execute(sa.select(sa.func.count()).select_from(some)).scalar_one())


def versions(connection: Connection, asked: Sequence[str]) -> dict[str, int]:
    """Return the version of each of some jobs."""
    query = sa.select(jobs.c.id, jobs.c.version).where(jobs.c.id.in_(asked))
    return {each.id: each.version for each in connection.execute(query)}
