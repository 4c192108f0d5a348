"""Jobs and results that their owners share with others."""

from __future__ import annotations

from collections.abc import Callable, Collection
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
    actor: str, owner: str, job: str, result: str, readers: Collection[str]
) -> Callable[[Connection], None]:
    """Share a job and its result with exactly these readers.

    Parameters
    ----------
    actor : str
        The key that does it, for the audit log.
    owner, job, result : str
    readers : collection of str
        Owners of other keys, or `EVERYBODY`; empty: the job is no longer shared.
    """

    def operation(connection: Connection) -> None:
        old, new = set(readers_of(owner, job)(connection)), set(readers)
        if old == new:
            return
        of_job = (shares.c.job == job) & (shares.c.owner == owner)
        connection.execute(shares.delete().where(of_job, shares.c.reader.in_(old - new)))
        for reader in sorted(new - old):
            values = {"job": job, "reader": reader, "owner": owner, "result": result}
            connection.execute(shares.insert().values(**values, created=now(connection)))
        record(connection, actor, "job shared", job, {"owner": owner, "readers": sorted(new)})

    return operation


def readers_of(owner: str, job: str) -> Callable[[Connection], list[str]]:
    """Return the readers of a job, beside its owner."""

    def query(connection: Connection) -> list[str]:
        of_job = (shares.c.job == job) & (shares.c.owner == owner)
        readers = sa.select(shares.c.reader).where(of_job).order_by(shares.c.reader)
        return list(connection.execute(readers).scalars())

    return query


def owner_of(job: str, reader: str) -> Callable[[Connection], str | None]:
    """Return the owner who shares a job with a reader, or None."""
    return _first(shares.c.owner, shares.c.job == job, reader)


def shows(result: str, reader: str) -> Callable[[Connection], bool]:
    """Whether a result is shared with a reader."""
    find = _first(shares.c.job, shares.c.result == result, reader)
    return lambda connection: find(connection) is not None


def _first(
    column: sa.Column[str], where: sa.ColumnElement[bool], reader: str
) -> Callable[[Connection], str | None]:
    query = sa.select(column).where(where, shares.c.reader.in_((reader, EVERYBODY))).limit(1)
    return lambda connection: connection.execute(query).scalar()
