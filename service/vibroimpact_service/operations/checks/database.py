"""Checks of the database of records."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Final

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Engine, make_url
from sqlalchemy.exc import DBAPIError

from vibroimpact_service.jobs import records
from vibroimpact_service.jobs.database import (
    RecordsUnavailableError,
    connect,
    failing,
    now,
    reader,
)
from vibroimpact_service.jobs.tables import processes
from vibroimpact_service.operations import migration
from vibroimpact_service.operations.checks.check import Check, failed, ok, warning
from vibroimpact_service.store import StoreFullError

TESTED: Final = 15
"""Oldest major version of PostgreSQL that the service is tested with."""
_SLOW_SECONDS: Final = 0.1
_DIFFERENT_SECONDS: Final = 5.0
_FAR_APART_SECONDS: Final = 60.0
"""Difference of the clocks that retention allows for."""


def database(url: str, clock: Callable[[], float] = time.time, tested: int = TESTED) -> list[Check]:
    """Check a database, and leave it as it is.

    Parameters
    ----------
    url : str
    clock : callable
        The clock of this machine.
    tested : int
        Oldest major version of PostgreSQL that raises no warning.
    """
    name, shown = "database", make_url(url).render_as_string(hide_password=True)
    missing = migration.missing_file(url)
    if missing is not None:
        return [ok(name, f"{missing} does not exist yet; the service makes it")]
    try:
        engine = connect(url)
    except (OSError, ImportError, sa.exc.ArgumentError) as error:
        return [failed(name, f"{shown}: {error}", "correct VIBROIMPACT_DATABASE")]
    try:
        states = migration.revisions(engine)
        checks = [_revision(state) for state in states if state.current or state.tables == "jobs"]
        with failing(), reader(engine).connect() as connection:
            checks += [_clock(connection, clock), *_version(connection, tested)]
            writable = sa.inspect(connection).has_table(processes.name)
        return [*([_writes(engine, shown)] if writable else [ok(name, shown)]), *checks]
    except (RecordsUnavailableError, DBAPIError) as error:
        reason = str(error.__cause__ or error).strip().splitlines()[0]
        return [failed(name, f"{shown}: {reason}", "make it reachable, or restore a backup")]
    finally:
        engine.dispose()


def _writes(engine: Engine, shown: str) -> Check:
    own = f"doctor-{os.getpid()}"
    began = time.perf_counter()
    try:
        with failing(), engine.begin() as connection:
            records.seen(connection, own)
            connection.execute(processes.delete().where(processes.c.name == own))
    except (RecordsUnavailableError, StoreFullError) as error:
        reason = str(getattr(error.__cause__, "orig", None) or error).strip().splitlines()[0]
        return failed(
            "database", f"{shown} takes no writes: {reason}", "free it for writing, and make room"
        )
    seconds = time.perf_counter() - began
    seen = f"{shown} takes a write in {1e3 * seconds:.1f} ms"
    if seconds > _SLOW_SECONDS:
        return warning("database", seen, "every job waits for it: place it nearer, or on SSDs")
    return ok("database", seen)


def _revision(state: migration.Revision) -> Check:
    name = f"records of {state.tables}"
    if state.current == state.newest:
        return ok(name, f"revision {state.current}")
    if state.current is not None and state.current > state.newest:
        return failed(
            name,
            f"revision {state.current}, this version knows {state.newest}",
            "a newer version has migrated them: install it, or restore a backup",
        )
    return warning(
        name,
        f"revision {state.current or 'none'}, the newest is {state.newest}",
        "run  vibroimpact migrate ; a service does it when it starts",
    )


def _clock(connection: Connection, clock: Callable[[], float]) -> Check:
    before = clock()
    there: float = connection.execute(sa.select(now(connection))).scalar_one()
    difference = there - 0.5 * (before + clock())
    seen = (
        f"that of the database is {abs(difference):.1f} s {'ahead' if difference > 0 else 'behind'}"
    )
    if abs(difference) > _FAR_APART_SECONDS:
        return failed("clock", seen, "synchronise the clocks of both machines (NTP)")
    if abs(difference) > _DIFFERENT_SECONDS:
        return warning("clock", seen, "synchronise the clocks of both machines (NTP)")
    return ok("clock", f"within {max(0.1, abs(difference)):.1f} s of that of the database")


def _version(connection: Connection, tested: int) -> list[Check]:
    if connection.dialect.name != "postgresql":
        return []
    version = connection.dialect.server_version_info or ()
    seen = ".".join(map(str, version))
    if int(version[0]) < tested:
        return [warning("PostgreSQL", seen, f"the service is tested with {tested} and later")]
    return [ok("PostgreSQL", seen)]
