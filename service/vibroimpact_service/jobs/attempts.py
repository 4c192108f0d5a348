"""The history of jobs: who worked on them, from when to when, and why it ended."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any, Final, NamedTuple

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from vibroimpact_service.jobs.database import now
from vibroimpact_service.jobs.tables import attempts

_MAX_WHY: Final = 200
_MAX_LISTED: Final = 100
_OPEN: Final = attempts.c.ended.is_(None)


class Attempt(NamedTuple):
    """One attempt at a job, or at a part of it; times are seconds since 1970.

    Parameters
    ----------
    worker : str
        The service process that ran the job, or the worker process that was lost.
    began : float
    ended : float or None
        None while it goes on.
    why : str or None
        Why it ended.
    """

    worker: str
    began: float
    ended: float | None
    why: str | None


def begin(connection: Connection, jobs: Collection[str], worker: str) -> None:
    """Record that a process begins some jobs; attempts of others at them are over."""
    end(connection, jobs, "its claim expired")
    rows = [{"job": job, "worker": worker} for job in jobs]
    connection.execute(attempts.insert().values(began=now(connection)), rows)


def end(connection: Connection, jobs: Collection[str], why: str) -> None:
    """Record why the attempts at some jobs ended that are not over yet."""
    if jobs:
        where = attempts.c.job.in_(jobs) & _OPEN
        values: dict[str, Any] = {"ended": now(connection), "why": why[:_MAX_WHY]}
        connection.execute(attempts.update().where(where).values(**values))


def lost(
    connection: Connection, jobs: Iterable[str], worker: str, seconds: float, why: str
) -> None:
    """Record that a worker process was lost which had computed parts of jobs for some seconds."""
    clock = now(connection)
    rows = [{"job": job, "worker": worker, "why": why[:_MAX_WHY]} for job in jobs]
    connection.execute(attempts.insert().values(began=clock - seconds, ended=clock), rows)


def of(connection: Connection, job: str) -> list[Attempt]:
    """Return the last attempts at a job, the earliest first."""
    columns = attempts.c.worker, attempts.c.began, attempts.c.ended, attempts.c.why
    query = sa.select(*columns).where(attempts.c.job == job)
    rows = connection.execute(query.order_by(attempts.c.seq.desc()).limit(_MAX_LISTED)).all()
    return [Attempt(*each) for each in reversed(rows)]


def delete(connection: Connection, jobs: Collection[str]) -> None:
    """Forget the attempts at some jobs."""
    connection.execute(attempts.delete().where(attempts.c.job.in_(jobs)))
