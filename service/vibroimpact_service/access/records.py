"""The tables of API keys and of administrative acts, and their queries."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Engine

from vibroimpact_service.access import keys
from vibroimpact_service.access.caller import UNBOUNDED, Allowance, Scope
from vibroimpact_service.jobs.database import migrate, now

MIGRATIONS: Final = Path(__file__).with_name("migrations")

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


@dataclass(frozen=True, slots=True)
class KeyRow:
    """A stored key; times are seconds since 1970 by the database's clock."""

    id: str
    owner: str
    label: str
    hash: str
    scopes: frozenset[Scope]
    allowance: Allowance
    created: float
    expires: float | None
    revoked: float | None
    valid: bool


@dataclass(frozen=True, slots=True)
class NewKey:
    """What a new key permits.

    Parameters
    ----------
    owner : str
        Owner of the jobs and results that it gives access to.
    label : str
        Description of its purpose.
    scopes : frozenset of Scope
    allowance : Allowance
        Limits that replace those of the settings.
    days : float, optional
        Lifetime.
    """

    owner: str
    label: str
    scopes: frozenset[Scope]
    allowance: Allowance = UNBOUNDED
    days: float | None = None


def prepare(engine: Engine) -> None:
    """Bring the tables up to date."""
    # A version table of its own: the tables of keys and jobs change independently.
    migrate(engine, MIGRATIONS, "alembic_version_access")


def any_keys(engine: Engine) -> bool:
    """Whether a key was ever made, even if revoked; does not create the tables."""
    if not sa.inspect(engine).has_table(api_keys.name):
        return False
    with engine.connect() as connection:
        return connection.execute(sa.select(api_keys.c.id).limit(1)).first() is not None


def create(connection: Connection, actor: str, new: NewKey) -> tuple[str, KeyRow]:
    """Store a new key; return its text, which cannot be recovered later, and its row."""
    key = keys.make()
    clock = now(connection)
    values: dict[str, Any] = {
        "id": key.id,
        "owner": new.owner,
        "label": new.label,
        "hash": key.hash,
        "scopes": " ".join(sorted(new.scopes)),
        "requests_per_minute": new.allowance.requests_per_minute,
        "seconds_per_hour": new.allowance.seconds_per_hour,
        "created": clock,
        "expires": None if new.days is None else clock + 86400.0 * new.days,
    }
    connection.execute(api_keys.insert().values(values))
    row = find(connection, key.id)
    assert row is not None
    about = {"owner": new.owner, "label": new.label, "scopes": sorted(new.scopes)}
    record(connection, actor, "key created", key.id, about)
    return key.text, row


def find(connection: Connection, key: str) -> KeyRow | None:
    """Return a key by its id."""
    row = connection.execute(_rows(connection).where(api_keys.c.id == key)).one_or_none()
    return None if row is None else _key(row)


def listed(connection: Connection) -> list[KeyRow]:
    """Return all keys, oldest first."""
    query = _rows(connection).order_by(api_keys.c.created, api_keys.c.id)
    return [_key(row) for row in connection.execute(query)]


def revoke(connection: Connection, actor: str, key: str) -> KeyRow | None:
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


def _key(row: sa.Row[Any]) -> KeyRow:
    return KeyRow(
        id=row.id,
        owner=row.owner,
        label=row.label,
        hash=row.hash,
        scopes=frozenset(Scope(name) for name in row.scopes.split()),
        allowance=Allowance(row.requests_per_minute, row.seconds_per_hour),
        created=row.created,
        expires=row.expires,
        revoked=row.revoked,
        valid=bool(row.valid),
    )
