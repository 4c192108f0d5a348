"""The database of job records: opening, clock, and translation of its errors."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import sqlalchemy as sa
from sqlalchemy.engine import URL, Connection, Engine, make_url
from sqlalchemy.exc import DBAPIError, InterfaceError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError

from vibroimpact_service.jobs.revisions import JOBS, Migrations, migrate
from vibroimpact_service.jobs.time_limits import NAME, SERVER_LIMITS, limit_time
from vibroimpact_service.store import StoreFullError, private

_READ_ONLY: Final = "25006"
"""SQLSTATE of a server that takes no writes, as a standby or during a failover."""
_TCP_LIMITS: Final = {
    "connect_timeout": 5,
    "keepalives_idle": 5,
    "keepalives_interval": 2,
    "keepalives_count": 3,
    "tcp_user_timeout": 10_000,
}


class RecordsUnavailableError(ConnectionError):
    """The database cannot be reached at the moment."""


def open_database(url: str, migrations: Migrations = JOBS) -> Engine:
    """Open the database and apply those migrations that it lacks.

    Parameters
    ----------
    url : str
    migrations : Migrations
        Those of some tables; absent: of the tables of jobs.

    Raises
    ------
    RecordsNewerError
        Where a newer version has migrated it.
    """
    engine = connect(url)
    try:
        with failing():
            migrate(engine, migrations)
    except BaseException:
        engine.dispose()
        raise
    return engine


def connect(url: str) -> Engine:
    """Open the database as it is."""
    address = make_url(url)
    if address.get_backend_name() == "sqlite":
        return _open_sqlite(address)
    return _open_server(address)


def _open_sqlite(address: URL) -> Engine:
    if address.database:
        file = Path(address.database)
        private.folder(file.parent)
        file.touch(0o600)  # SQLite gives its other files the permissions of this one
    engine = sa.create_engine(address)

    @sa.event.listens_for(engine, "connect")
    def prepare(connection: Any, _record: Any) -> None:
        # The driver must not begin transactions by itself: `begin` below does that.
        connection.isolation_level = None
        for pragma in ("journal_mode=WAL", "synchronous=FULL", "busy_timeout=10000"):
            connection.execute(f"PRAGMA {pragma}").close()

    @sa.event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:
        # A transaction that reads first and writes later would fail, not wait, when another
        # one wrote in between.
        reading = connection.get_execution_options().get("reading")
        connection.exec_driver_sql("BEGIN" if reading else "BEGIN IMMEDIATE")

    return engine


def _open_server(address: URL) -> Engine:
    if address.drivername in ("postgresql", "postgres"):
        address = address.set(drivername="postgresql+psycopg")
    given = address.query.get("options", "")
    options = f"{given} {SERVER_LIMITS}" if isinstance(given, str) else SERVER_LIMITS
    engine = sa.create_engine(
        address,
        pool_size=8,
        pool_timeout=10,
        connect_args={"application_name": NAME, "options": options, **_TCP_LIMITS},
    )
    limit_time(engine)

    @sa.event.listens_for(engine, "handle_error")
    def handle(context: sa.engine.ExceptionContext) -> None:
        # After a failover, all connections lead to the server that takes no writes any more.
        if getattr(context.original_exception, "sqlstate", None) == _READ_ONLY:
            context.is_disconnect = True

    return engine


def reader(engine: Engine) -> Engine:
    """Return the same database for transactions that only read."""
    return engine.execution_options(reading=True)


def now(connection: Connection) -> sa.ColumnElement[float]:
    """Return the clock of the database as an expression; clocks of machines are never compared."""
    if connection.dialect.name == "sqlite":
        return sa.literal_column("((julianday('now') - 2440587.5) * 86400.0)", sa.Float)
    return sa.literal_column("extract(epoch from clock_timestamp())::float8", sa.Float)


@contextmanager
def failing() -> Iterator[None]:
    """Translate the errors of a database that cannot work at the moment.

    Raises
    ------
    RecordsUnavailableError
        Where it cannot be reached.
    StoreFullError
        Where it has no room.
    """
    try:
        yield
    except PoolTimeoutError as error:
        raise RecordsUnavailableError("all connections to the database are busy") from error
    except DBAPIError as error:
        if _full(error):
            raise StoreFullError(errno.ENOSPC, "the database has no room") from error
        if error.connection_invalidated or isinstance(error, OperationalError | InterfaceError):
            raise RecordsUnavailableError("the database cannot be reached") from error
        raise


def _full(error: DBAPIError) -> bool:
    return "disk is full" in str(error.orig) or getattr(error.orig, "sqlstate", None) == "53100"
