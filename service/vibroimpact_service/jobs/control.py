"""Operations of users on jobs that exist: hold, release, retry.

A held job is queued, and due at a time that never comes.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, Final

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from vibroimpact_service.jobs import attempts
from vibroimpact_service.jobs.claims import QUEUED_AGAIN, change
from vibroimpact_service.jobs.database import now
from vibroimpact_service.jobs.records import QUEUED, RUNNING, find
from vibroimpact_service.jobs.tables import JobRow, jobs

_NEVER: Final = 1e12
HELD: Final = "held"
HELD_NOTE: Final = "it is held, until it is released"


def hold(connection: Connection, owner: str, job: str) -> JobRow | None:
    """Keep a job from running, and return it; the process that runs it loses its claim."""
    where = _own(owner, [job]) & (QUEUED | RUNNING) & (jobs.c.phase != HELD)
    values = QUEUED_AGAIN | {"phase": HELD, "retry_at": _NEVER, "waiting_note": HELD_NOTE}
    if connection.execute(change(where, **values)).rowcount:
        attempts.end(connection, [job], "held")
    return find(connection, owner, job)


def release(connection: Connection, owner: str, job: str) -> JobRow | None:
    """Let a held job run, and return it."""
    where = _own(owner, [job]) & QUEUED & (jobs.c.phase == HELD)
    connection.execute(change(where, **QUEUED_AGAIN, retry_at=None, waiting_note=None))
    return find(connection, owner, job)


def retry(connection: Connection, owner: str, job: str) -> JobRow | None:
    """Queue a failed job again, and return it."""
    connection.execute(_retried(connection, _own(owner, [job])))
    return find(connection, owner, job)


def retry_all(
    connection: Connection, owner: str, chosen: Collection[str] | None, kind: str | None, most: int
) -> list[str]:
    """Queue failed jobs again, the oldest first; return them.

    Parameters
    ----------
    owner : str
    chosen : collection of str, optional
        Only these.
    kind : str, optional
        Only those of this kind.
    most : int
        Largest number of them.
    """
    failed = sa.select(jobs.c.id).where(jobs.c.owner == owner, jobs.c.state == "failed")
    if chosen is not None:
        failed = failed.where(jobs.c.id.in_(chosen))
    if kind is not None:
        failed = failed.where(jobs.c.kind == kind)
    ids = list(connection.execute(failed.order_by(jobs.c.seq).limit(most)).scalars())
    update = _retried(connection, _own(owner, ids)).returning(jobs.c.id)
    again = set(connection.execute(update).scalars())
    return [job for job in ids if job in again]


def _own(owner: str, ids: Collection[str]) -> sa.ColumnElement[bool]:
    return jobs.c.id.in_(ids) & (jobs.c.owner == owner)


def _retried(connection: Connection, where: sa.ColumnElement[bool]) -> sa.Update:
    values: dict[str, Any] = {
        "error": sa.null(),
        "finished": None,
        "retry_at": None,
        "held": 0.0,  # it was given back when the job failed
        # As long from now as it was from its submission.
        "deadline": now(connection) + (jobs.c.deadline - jobs.c.created),
    }
    return change(where & (jobs.c.state == "failed"), **QUEUED_AGAIN, **values)
