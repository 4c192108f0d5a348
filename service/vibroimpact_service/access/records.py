"""The tables of API keys and of administrative acts, and their queries."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Engine

from vibroimpact_schema.keys import KeyRequest
from vibroimpact_service.access import keys
from vibroimpact_service.jobs.database import now, open_database
from vibroimpact_service.jobs.revisions import Migrations

MIGRATIONS: Final = Migrations(Path(__file__).with_name("migrations"), "alembic_version_access")

metadata = sa.MetaData()

api_keys = sa.Table(
    "api_keys",
    metadata,
    sa.Column("id", sa.String(12), primary_key=True),
    sa.Column("owner", sa.String(80)),
    sa.Column("label", sa.String(80)),
    sa.Column("hash", sa.String(64)),
    sa.Column("scopes", sa.String(80)),
    sa.Column("requests_per_minute", sa.Integer),
    sa.Column("seconds_per_hour", sa.Float),
    sa.Column("created", sa.Float),
    sa.Column("expires", sa.Float),
    sa.Column("revoked", sa.Float),
)

audit = sa.Table(
    "audit",
    metadata,
    sa.Column("seq", sa.BigInteger().with_variant(sa.Integer(), "sqlite"), primary_key=True),
    sa.Column("time", sa.Float),
    sa.Column("actor", sa.String(80)),
    sa.Column("act", sa.String(40)),
    sa.Column("subject", sa.String(80)),
    sa.Column("about", sa.Text),
)


def open_keys(url: str) -> Engine:
    """Open the database, with these tables brought up to date."""
    return open_database(url, MIGRATIONS)


def any_keys(engine: Engine) -> bool:
    """Whether a key was ever made, even if revoked; does not create the tables."""
    if not sa.inspect(engine).has_table(api_keys.name):
        return False
    with engine.connect() as connection:
        return connection.execute(sa.select(api_keys.c.id).limit(1)).first() is not None


def create(connection: Connection, actor: str, new: KeyRequest) -> tuple[str, sa.Row[Any]]:
    """Store a new key; return its text, which cannot be recovered later, and its row."""
    name, text, secret_hash = keys.make()
    clock = now(connection)
    scopes = sorted(set(new.scopes))
    values: dict[str, Any] = {
        "id": name,
        "owner": new.owner,
        "label": new.label,
        "hash": secret_hash,
        "scopes": " ".join(scopes),
        "requests_per_minute": new.requests_per_minute,
        "seconds_per_hour": new.seconds_per_hour,
        "created": clock,
        "expires": None if new.days is None else clock + 86400.0 * new.days,
    }
    connection.execute(api_keys.insert().values(values))
    about = {"owner": new.owner, "label": new.label, "scopes": scopes}
    record(connection, actor, "key created", name, about)
    return text, connection.execute(_rows(connection).where(api_keys.c.id == name)).one()


def find(connection: Connection, key: str) -> sa.Row[Any] | None:
    """Return a key by its id: the columns of `api_keys`, and whether it is ``valid`` now."""
    return connection.execute(_rows(connection).where(api_keys.c.id == key)).one_or_none()


def listed(connection: Connection) -> Sequence[sa.Row[Any]]:
    """Return all keys, oldest first; rows as of `find`."""
    query = _rows(connection).order_by(api_keys.c.created, api_keys.c.id)
    return connection.execute(query).all()


def revoke(connection: Connection, actor: str, key: str) -> sa.Row[Any] | None:
    """Revoke a key; return it, or None if there is none."""
    where = (api_keys.c.id == key) & api_keys.c.revoked.is_(None)
    change = api_keys.update().where(where).values(revoked=now(connection))
    if connection.execute(change).rowcount:
        record(connection, actor, "key revoked", key, {})
    return find(connection, key)


def record(
    connection: Connection, actor: str, act: str, subject: str, about: Mapping[str, Any]
) -> None:
    """Add an act to the audit log."""
    values = {
        "time": now(connection),
        "actor": actor,
        "act": act,
        "subject": subject,
        "about": json.dumps(dict(about)),
    }
    connection.execute(audit.insert().values(values))


def acts(connection: Connection, before: int | None, limit: int) -> Sequence[sa.Row[Any]]:
    """Return administrative acts, newest first."""
    query = audit.select().order_by(audit.c.seq.desc()).limit(limit)
    if before is not None:
        query = query.where(audit.c.seq < before)
    return connection.execute(query).all()


def _rows(connection: Connection) -> sa.Select[Any]:
    clock = now(connection)
    unexpired = api_keys.c.expires.is_(None) | (api_keys.c.expires > clock)
    return sa.select(api_keys, (api_keys.c.revoked.is_(None) & unexpired).label("valid"))
