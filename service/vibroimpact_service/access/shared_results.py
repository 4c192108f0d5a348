"""Jobs and results that their owners share with others."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from vibroimpact_service.access.records import metadata, record
from vibroimpact_service.jobs.database import now

EVERYBODY: Final = "*"
"""Reader that stands for every key with the scope read."""

shares = sa.Table(
    "shares",
    metadata,
    sa.Column("job", sa.String(40), primary_key=True),
    sa.Column("reader", sa.String(80), primary_key=True),
    sa.Column("owner", sa.String(80)),
    sa.Column("result", sa.String(64)),
    sa.Column("created", sa.Float),
)


def share(
    connection: Connection, actor: str, owner: str, job: str, result: str, readers: Collection[str]
) -> None:
    """Share a job and its result with exactly these readers.

    Parameters
    ----------
    connection : Connection
    actor : str
        The key that does it, for the audit log.
    owner, job, result : str
    readers : collection of str
        Owners of other keys, or `EVERYBODY`; empty: the job is no longer shared.
    """
    old, new = set(readers_of(connection, owner, job)), set(readers)
    if old == new:
        return
    of_job = (shares.c.job == job) & (shares.c.owner == owner)
    connection.execute(shares.delete().where(of_job, shares.c.reader.in_(old - new)))
    for reader in sorted(new - old):
        values = {"job": job, "reader": reader, "owner": owner, "result": result}
        connection.execute(shares.insert().values(**values, created=now(connection)))
    record(connection, actor, "job shared", job, {"owner": owner, "readers": sorted(new)})


def readers_of(connection: Connection, owner: str, job: str) -> list[str]:
    """Return the readers of a job, beside its owner."""
    of_job = (shares.c.job == job) & (shares.c.owner == owner)
    readers = sa.select(shares.c.reader).where(of_job).order_by(shares.c.reader)
    return list(connection.execute(readers).scalars())


def owner_of(connection: Connection, job: str, reader: str) -> str | None:
    """Return the owner who shares a job with a reader, or None."""
    return _first(connection, shares.c.owner, shares.c.job == job, reader)


def shows(connection: Connection, result: str, reader: str) -> bool:
    """Whether a result is shared with a reader."""
    return _first(connection, shares.c.job, shares.c.result == result, reader) is not None


def _first(
    connection: Connection, column: sa.Column[str], where: sa.ColumnElement[bool], reader: str
) -> str | None:
    query = sa.select(column).where(where, shares.c.reader.in_((reader, EVERYBODY))).limit(1)
    return connection.execute(query).scalar()
