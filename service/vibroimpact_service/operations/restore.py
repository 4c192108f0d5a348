"""Restoring a backup: everything is verified before anything is written, records come last."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Engine

from vibroimpact_service.jobs import claims, data_folder
from vibroimpact_service.jobs.data_folder import DataInUseError
from vibroimpact_service.jobs.database import connect, failing
from vibroimpact_service.jobs.revisions import upgrade
from vibroimpact_service.jobs.tables import processes
from vibroimpact_service.jobs.time_limits import NAME, remove_limits
from vibroimpact_service.operations import manifest, migration, rows
from vibroimpact_service.operations.copying import Advance, copied, digests
from vibroimpact_service.operations.manifest import BackupInvalidError, Block, Manifest
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store


class TargetNotEmptyError(RuntimeError):
    """There are records already where a backup is to be restored."""


class Restored(NamedTuple):
    """What was restored.

    Parameters
    ----------
    manifest : Manifest
    new : int
        Blocks that the store did not hold.
    """

    manifest: Manifest
    new: int


def verify(folder: Path, begin: Callable[[int], Advance]) -> tuple[Manifest, list[Block]]:
    """Read all of a backup, and return its manifest and blocks.

    Parameters
    ----------
    folder : Path
    begin : callable
        As of `backup.write`.

    Raises
    ------
    BackupInvalidError
        Where it is unfinished, damaged, or made by a newer version.
    """
    content = manifest.read(folder)
    for name, revision in content.revisions.items():
        known = migration.TABLES[name].newest if name in migration.TABLES else ""
        if revision > known:
            raise BackupInvalidError(
                f"the backup was made by version {content.version}, which is newer: restore it "
                "with that version or a later one"
            )
    blocks = list(manifest.listed(folder, content))
    names = [(block.area, block.name) for block in blocks]
    there = digests(manifest.store(folder), names, begin(len(blocks)))
    damaged = [b for b, digest in zip(blocks, there, strict=True) if digest != b.sha256]
    if damaged:
        first = f"{damaged[0].area}/{damaged[0].name}"
        raise BackupInvalidError(
            f"{len(damaged)} of {len(blocks)} files are damaged or missing, the first: {first}"
        )
    return content, blocks


def restore(
    settings: Settings, folder: Path, begin: Callable[[int], Advance], *, replace: bool
) -> Restored:
    """Restore a backup into the database and the store of settings.

    Blocks that the store has are left there. All records appear at once.

    Parameters
    ----------
    settings : Settings
    folder : Path
    begin : callable
        As of `backup.write`; called twice.
    replace : bool
        Whether records that are there already are removed.

    Raises
    ------
    BackupInvalidError, TargetNotEmptyError, DataInUseError, RecordsUnavailableError,
    StoreUnavailableError, StoreFullError
    """
    content, blocks = verify(folder, begin)
    with _unused(settings):
        engine = connect(settings.database_url)
        try:
            with failing(), engine.begin() as connection:
                _check_target(connection, replace)
            names = [(block.area, block.name) for block in blocks]
            target = Store(settings.store_url)
            new = 0
            for block in copied(manifest.store(folder), target, names, begin(len(names))):
                if block.sha256 is None:
                    raise BackupInvalidError(f"{block.area}/{block.name} was damaged meanwhile")
                new += block.new
            _restore_records(engine, folder, content, replace)
        finally:
            engine.dispose()
    return Restored(content, new)


@contextmanager
def _unused(settings: Settings) -> Iterator[None]:
    """Keep services from starting on the data folder, where it holds the records."""
    if settings.database is not None:
        yield
        return
    with data_folder.lock(settings.data):
        yield


def _check_target(connection: Connection, replace: bool) -> None:
    if connection.dialect.name == "postgresql":
        remove_limits(connection)
        query = """
            SELECT count(*) FROM pg_stat_activity WHERE datname = current_database()
            AND application_name = :name AND pid <> pg_backend_pid()
        """
        if connection.execute(sa.text(query), {"name": NAME}).scalar_one():
            raise DataInUseError("a service runs on the database")
    if replace:
        return
    there = set(sa.inspect(connection).get_table_names())
    for name in rows.NAMES:
        some: sa.Select[Any] = sa.select(sa.literal(1)).select_from(sa.table(name)).limit(1)
        if name in there and connection.execute(some).first() is not None:
            raise TargetNotEmptyError("there are records already; --replace removes them")


def _restore_records(engine: Engine, folder: Path, content: Manifest, replace: bool) -> None:
    """Make the tables as they were, fill them and migrate them, in one transaction."""
    with failing(), engine.begin() as connection:
        _check_target(connection, replace)
        there = set(sa.inspect(connection).get_table_names())
        versions = [migrations.table for migrations in migration.TABLES.values()]
        for name in (*rows.NAMES, processes.name, *versions):
            if name in there:
                connection.execute(sa.schema.DropTable(sa.Table(name, sa.MetaData())))
        for name, revision in content.revisions.items():
            upgrade(connection, migration.TABLES[name], revision)
        counts = rows.read(connection, folder / content.records.name)
        if counts != content.rows:
            raise BackupInvalidError("the records of the backup are not complete")
        for name in content.revisions:
            upgrade(connection, migration.TABLES[name], "head")
        # The processes that ran them have nothing to do with this database.
        claims.release_all(connection)
