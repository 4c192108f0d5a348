"""The revisions of the records of an installation, and their migration without a service."""

from __future__ import annotations

from pathlib import Path
from typing import Final, NamedTuple

from sqlalchemy.engine import Engine, make_url

from vibroimpact_service.access import records as access_records
from vibroimpact_service.jobs.database import connect, failing, open_database, reader
from vibroimpact_service.jobs.revisions import JOBS, Migrations
from vibroimpact_service.settings import Settings

TABLES: Final = {"jobs": JOBS, "keys": access_records.MIGRATIONS}
"""What the tables hold -> their migrations."""


class Revision(NamedTuple):
    """The revision of some tables.

    Parameters
    ----------
    tables : str
        One of `TABLES`.
    current : str or None
        Absent: there are no such tables yet.
    newest : str
        The newest one that this version knows.
    """

    tables: str
    current: str | None
    newest: str


def missing_file(url: str) -> Path | None:
    """Return the file of an SQLite database that does not exist, which opening it would make."""
    address = make_url(url)
    if address.get_backend_name() != "sqlite" or address.database in (None, "", ":memory:"):
        return None
    file = Path(str(address.database))
    return None if file.exists() else file


def revisions(engine: Engine) -> list[Revision]:
    """Return the revisions of a database."""
    with failing(), reader(engine).connect() as connection:
        return [_revision(name, each, each.current(connection)) for name, each in TABLES.items()]


def of_settings(settings: Settings) -> list[Revision]:
    """Return the revisions of the records of an installation, and change nothing.

    Raises
    ------
    RecordsUnavailableError
        Where the database cannot be reached.
    """
    if missing_file(settings.database_url) is not None:
        return [_revision(name, each, None) for name, each in TABLES.items()]
    engine = connect(settings.database_url)
    try:
        return revisions(engine)
    finally:
        engine.dispose()


def migrate(settings: Settings) -> list[Revision]:
    """Bring the records to the newest revision; return what they had before.

    Raises
    ------
    RecordsUnavailableError, RecordsNewerError
        Where the database cannot be reached, or a newer version has migrated it.
    """
    before = of_settings(settings)
    for migrations in TABLES.values():
        open_database(settings.database_url, migrations).dispose()
    return before


def _revision(name: str, migrations: Migrations, current: str | None) -> Revision:
    return Revision(name, current, migrations.newest)
