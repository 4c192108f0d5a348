"""The tables of API keys and of administrative acts, and what is done to them."""

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
    """A key on record; times are seconds since 1970 by the database's clock."""

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
    """What a key is to be good for.

    Parameters
    ----------
    owner : str
        Whose jobs and results it shows.
    label : str
        What it is for, in words.
    scopes : frozenset of Scope
    allowance : Allowance
        Bounds that differ from those of the settings.
    days : float, optional
        After which it expires.
    """

    owner: str
    label: str
    scopes: frozenset[Scope]
    allowance: Allowance = UNBOUNDED
    days: float | None = None


def prepare(engine: Engine) -> None:
    """Bring the tables up to date."""
    # A line of versions of its own: keys and jobs change independently.
    migrate(engine, MIGRATIONS, "alembic_version_access")


def any_keys(engine: Engine) -> bool:
    """Whether a key was ever made, revoked ones too; without making the tables."""
    if not sa.inspect(engine).has_table(api_keys.name):
        return False
    with engine.connect() as connection:
        return connection.execute(sa.select(api_keys.c.id).limit(1)).first() is not None


def create(connection: Connection, actor: str, new: NewKey) -> tuple[str, KeyRow]:
    """Record a new key; return its text, which nobody can find out later, and its row."""
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
    found = find(connection, key.id)
    assert found is not None
    about = {"owner": new.owner, "label": new.label, "scopes": sorted(new.scopes)}
    record(connection, actor, "key created", key.id, about)
    return key.text, found


def find(connection: Connection, key: str) -> KeyRow | None:
    """Return a key by its id."""
    found = connection.execute(_rows(connection).where(api_keys.c.id == key)).one_or_none()
    return None if found is None else _row(found)


def listed(connection: Connection) -> list[KeyRow]:
    """Return all keys, oldest first."""
    query = _rows(connection).order_by(api_keys.c.created, api_keys.c.id)
    return [_row(each) for each in connection.execute(query)]


def revoke(connection: Connection, actor: str, key: str) -> KeyRow | None:
    """Make a key worthless from now on; return it, or None where there is none."""
    where = (api_keys.c.id == key) & api_keys.c.revoked.is_(None)
    change = api_keys.update().where(where).values(revoked=now(connection))
    if connection.execute(change).rowcount:
        record(connection, actor, "key revoked", key, {})
    return find(connection, key)


def record(
    connection: Connection, actor: str, act: str, subject: str, about: Mapping[str, Any]
) -> None:
    """Note an administrative act."""
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


def _row(found: sa.Row[Any]) -> KeyRow:
    return KeyRow(
        id=found.id,
        owner=found.owner,
        label=found.label,
        hash=found.hash,
        scopes=frozenset(Scope(name) for name in found.scopes.split()),
        allowance=Allowance(found.requests_per_minute, found.seconds_per_hour),
        created=found.created,
        expires=found.expires,
        revoked=found.revoked,
        valid=bool(found.valid),
    )
