"""Backups of a running service: first the records, in one transaction, then the store.

What the records refer to was stored before it was recorded, so that the store then holds it all.
Retention goes on meanwhile: what it removes, it would remove from a restored service as well.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Final, NamedTuple

from vibroimpact_service.jobs.database import connect, failing, reader
from vibroimpact_service.jobs.time_limits import remove_limits
from vibroimpact_service.operations import manifest, migration, rows
from vibroimpact_service.operations.copying import Advance, copied
from vibroimpact_service.operations.manifest import Block, Blocks, Manifest
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import HEAD, Store, private

_PROBES: Final = "probe_"
"""Names of blocks with which services try whether the store takes writes."""


class NoRecordsError(FileNotFoundError):
    """There are no records that could be backed up."""


class BackupBusyError(RuntimeError):
    """Another process writes to the same backup."""


class Written(NamedTuple):
    """A backup that was written.

    Parameters
    ----------
    manifest : Manifest
    new : int
        Blocks that an earlier backup in the same folder did not hold.
    gone : int
        Blocks that the store lost, or had damaged, before they were copied.
    """

    manifest: Manifest
    new: int
    gone: int


def write(settings: Settings, folder: Path, begin: Callable[[int], Advance]) -> Written:
    """Write a backup into a folder; what an earlier or interrupted one left there is used.

    Until the new one is finished, the folder holds the earlier one.

    Parameters
    ----------
    settings : Settings
    folder : Path
    begin : callable
        Called with the number of blocks; returns what is called as they are dealt with.

    Raises
    ------
    NoRecordsError, BackupBusyError, RecordsUnavailableError, StoreUnavailableError, StoreFullError
    """
    missing = migration.missing_file(settings.database_url)
    if missing is not None:
        raise NoRecordsError(f"there are no records: {missing} does not exist")
    private.folder(folder)
    try:
        lock = private.locked(folder / "lock")
    except BlockingIOError:
        raise BackupBusyError(f"another backup is being written to {folder}") from None
    with lock:
        began, mark = _now(), secrets.token_hex(8)
        records = folder / f"records-{mark}.jsonl.zst"
        revisions, counts = _write_records(settings, records)
        listing = folder / f"store-{mark}.jsonl.zst"
        source, target = Store(settings.store_url), manifest.store(folder)
        written = _write_blocks(source, target, listing, begin)
        new = Manifest(
            version=version("vibroimpact"),
            revisions=revisions,
            began=began,
            ended=_now(),
            records=manifest.described(records),
            listing=manifest.described(listing),
            rows=counts,
            blocks=written[0],
        )
        manifest.write(folder, new)
        _remove_others(folder, new)
    return Written(new, *written[1:])


def _write_records(settings: Settings, path: Path) -> tuple[dict[str, str], dict[str, int]]:
    """Write the rows as they are at one moment; return revisions and numbers of rows."""
    engine = connect(settings.database_url)
    options = {}
    if engine.dialect.name == "postgresql":
        options = {"isolation_level": "REPEATABLE READ", "postgresql_readonly": True}
    try:
        with failing(), reader(engine).connect().execution_options(**options) as connection:
            if engine.dialect.name == "postgresql":
                remove_limits(connection)  # tables can be large
            current = {n: m.current(connection) for n, m in migration.TABLES.items()}
            if current["jobs"] is None:
                raise NoRecordsError("there are no records in the database")
            counts = rows.write(connection, path)
    finally:
        engine.dispose()
    return {name: each for name, each in current.items() if each is not None}, counts


def _write_blocks(
    source: Store, target: Store, listing: Path, begin: Callable[[int], Advance]
) -> tuple[dict[str, Blocks], int, int]:
    """Copy the store and list it; return sizes, and how many blocks were new and were gone."""
    entries = {
        (area, entry.name): entry.size
        for area, content in source.areas.items()
        for entry in content.entries()
        if not entry.name.startswith(_PROBES)
    }
    blocks, new, gone = [], 0, 0
    sizes = {area: [0, 0] for area in source.areas}
    for block in copied(source, target, entries, begin(len(entries))):
        if block.sha256 is None:
            gone += 1
            continue
        new += block.new
        blocks.append(Block(block.area, block.name, block.sha256))
        sizes[block.area][0] += 1
        sizes[block.area][1] += (target.areas[block.area].size(block.name) or 0) + HEAD
    manifest.write_listing(listing, blocks)
    return {area: Blocks(count=n, size=size) for area, (n, size) in sizes.items()}, new, gone


def _remove_others(folder: Path, current: Manifest) -> None:
    """Remove what belongs to earlier or interrupted backups alone."""
    for path in [*folder.glob("records-*"), *folder.glob("store-*")]:
        if path.name not in (current.records.name, current.listing.name):
            path.unlink()
    kept = {(block.area, block.name) for block in manifest.listed(folder, current)}
    for area, content in manifest.store(folder).areas.items():
        for entry in content.entries():
            if (area, entry.name) not in kept:
                content.remove(entry.name)
        content.remove_leftovers(float("inf"))


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
