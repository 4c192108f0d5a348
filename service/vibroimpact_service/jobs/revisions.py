"""The revisions of tables: which one a database has, and the migrations to the newest.

Migrations only add: tables, indices, columns that may be empty. Replicas of an earlier version then
work on while a newer one migrates.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final, NamedTuple

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Engine

from vibroimpact_service.jobs.time_limits import remove_limits

_FOLDER: Final = Path(__file__).with_name("migrations")


class RecordsNewerError(RuntimeError):
    """A newer version of the service has migrated the records."""


class Migrations(NamedTuple):
    """The migrations of some tables.

    Parameters
    ----------
    versions : Path
        Their folder.
    table : str
        Table that records the last one. Tables with migrations of their own have one of their own.
    """

    versions: Path
    table: str

    @property
    def newest(self) -> str:
        """The newest revision that this version of the service knows."""
        return max(self.versions.glob("v[0-9]*.py")).name[1:5]

    def current(self, connection: Connection) -> str | None:
        """Return the revision of a database, or None where it has none of the tables."""
        if not sa.inspect(connection).has_table(self.table):
            return None
        query: sa.Select[Any] = sa.select(sa.column("version_num")).select_from(
            sa.table(self.table)
        )
        return connection.execute(query).scalar_one_or_none()


JOBS: Final = Migrations(_FOLDER / "versions", "alembic_version")
"""Those of the tables of jobs."""


def migrate(engine: Engine, migrations: Migrations) -> None:
    """Bring tables to the newest revision; processes that do so at the same time wait.

    Raises
    ------
    RecordsNewerError
        Where they have a newer one than this version knows.
    """
    with engine.connect() as connection:
        current = migrations.current(connection)
    if current == migrations.newest:
        return
    if current is not None and current > migrations.newest:
        raise RecordsNewerError(
            f"a newer version has migrated the records: revision {current}, "
            f"this version knows {migrations.newest}"
        )
    with engine.begin() as connection:
        upgrade(connection, migrations, "head")


def upgrade(connection: Connection, migrations: Migrations, revision: str) -> None:
    """Apply the migrations up to a revision, in the transaction of a connection."""
    # Importing Alembic takes a good part of a second, and it is hardly ever needed.
    from alembic import command
    from alembic.config import Config

    config = Config()
    config.set_main_option("script_location", str(_FOLDER))
    config.set_main_option("version_locations", str(migrations.versions))
    config.set_main_option("path_separator", "newline")
    if connection.dialect.name == "postgresql":
        remove_limits(connection)  # tables can be large
        # Replicas that start together must not migrate together.
        connection.execute(sa.text("SELECT pg_advisory_xact_lock(7309453)"))
    config.attributes["connection"] = connection
    config.attributes["table"] = migrations.table
    command.upgrade(config, revision)
