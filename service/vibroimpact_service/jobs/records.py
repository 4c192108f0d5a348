"""The tables of jobs: their columns, how they are opened and brought up to date."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import sqlalchemy as sa
from alembic import command
from alembic.config import Config
from sqlalchemy.engine import Connection, Engine, make_url

metadata = sa.MetaData()

jobs = sa.Table(
    "jobs",
    metadata,
    sa.Column("seq", sa.BigInteger().with_variant(sa.Integer(), "sqlite"), primary_key=True),
    sa.Column("id", sa.String(40)),
    sa.Column("owner", sa.String(80)),
    sa.Column("kind", sa.String(40)),
    sa.Column("request", sa.String(64)),
    sa.Column("result", sa.String(64)),
    sa.Column("state", sa.String(12)),
    sa.Column("phase", sa.String(40)),
    sa.Column("priority", sa.Integer),
    sa.Column("seconds", sa.Float),
    sa.Column("done", sa.Integer),
    sa.Column("total", sa.Integer),
    sa.Column("attempts", sa.Integer),
    sa.Column("reused", sa.Boolean),
    sa.Column("cancel_asked", sa.Boolean),
    sa.Column("created", sa.Float),
    sa.Column("started", sa.Float),
    sa.Column("finished", sa.Float),
    sa.Column("lease_owner", sa.String(64)),
    sa.Column("lease_until", sa.Float),
    sa.Column("version", sa.Integer),
    sa.Column("error", sa.JSON),
)

idempotency = sa.Table(
    "idempotency",
    metadata,
    sa.Column("owner", sa.String(80), primary_key=True),
    sa.Column("key", sa.String(255), primary_key=True),
    sa.Column("fingerprint", sa.String(64)),
    sa.Column("job", sa.String(40)),
    sa.Column("created", sa.Float),
)

FINAL: Final = ("succeeded", "failed", "cancelled")


@dataclass(frozen=True, slots=True)
class JobRow:
    """One row of the table of jobs; times are seconds since 1970 by the database's clock."""

    seq: int
    id: str
    owner: str
    kind: str
    request: str
    result: str
    state: str
    phase: str
    priority: int
    seconds: float
    done: int
    total: int
    attempts: int
    reused: bool
    cancel_asked: bool
    created: float
    started: float | None
    finished: float | None
    lease_owner: str | None
    lease_until: float | None
    version: int
    error: dict[str, Any] | None

    @property
    def final(self) -> bool:
        """Whether the state will not change any more."""
        return self.state in FINAL


def row(found: sa.Row[Any]) -> JobRow:
    """Return a selected row of `jobs` as a value."""
    values = dict(found._mapping)
    if isinstance(values["error"], str):
        values["error"] = json.loads(values["error"])
    return JobRow(**values)


def open_database(url: str) -> Engine:
    """Open the database and bring its tables up to date."""
    address = make_url(url)
    if address.get_backend_name() == "sqlite" and address.database:
        Path(address.database).parent.mkdir(parents=True, exist_ok=True)
    engine = sa.create_engine(address, pool_pre_ping=True)
    if engine.dialect.name == "sqlite":
        sa.event.listen(engine, "connect", _prepare_sqlite)
    migrate(engine)
    return engine


def migrate(engine: Engine) -> None:
    """Apply the migrations that the database lacks."""
    config = Config()
    config.set_main_option("script_location", str(Path(__file__).with_name("migrations")))
    config.set_main_option("path_separator", "os")
    with engine.begin() as connection:
        if engine.dialect.name == "postgresql":
            # Replicas that start together must not migrate together.
            connection.execute(sa.text("SELECT pg_advisory_xact_lock(7309453)"))
        config.attributes["connection"] = connection
        command.upgrade(config, "head")


def _prepare_sqlite(connection: Any, _record: Any) -> None:
    cursor = connection.cursor()
    for pragma in ("journal_mode=WAL", "synchronous=FULL", "busy_timeout=10000"):
        cursor.execute(f"PRAGMA {pragma}")
    cursor.close()


def now(connection: Connection) -> sa.ColumnElement[float]:
    """Return the database's clock as an expression: leases compare no two machines' clocks."""
    if connection.dialect.name == "sqlite":
        return sa.literal_column("((julianday('now') - 2440587.5) * 86400.0)", sa.Float)
    return sa.literal_column("extract(epoch from clock_timestamp())::float8", sa.Float)
