"""Backups: the same in another place, continued, refused where they are not whole."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa

from tests.service.operations.conftest import Installation
from vibroimpact_service.jobs import data_folder, sealing
from vibroimpact_service.jobs.data_folder import DataInUseError
from vibroimpact_service.jobs.database import connect, open_database
from vibroimpact_service.jobs.revisions import JOBS, upgrade
from vibroimpact_service.jobs.tables import jobs
from vibroimpact_service.operations import backup, manifest, migration, restore
from vibroimpact_service.operations.backup import BackupBusyError, NoRecordsError
from vibroimpact_service.operations.manifest import BackupInvalidError
from vibroimpact_service.operations.restore import TargetNotEmptyError
from vibroimpact_service.store import ContentStore, private

Make = Callable[..., Installation]
DATABASES = ["sqlite", "postgresql"]
CLAIM = (jobs.c.claim_owner, jobs.c.claim_until, jobs.c.waiting_note)
INTERRUPTED = ("state", "phase", "version", *(column.name for column in CLAIM))


def silent(_: int) -> Callable[[int], None]:
    return lambda _: None


def write(place: Installation, folder: Path) -> backup.Written:
    return backup.write(place.settings, folder, silent)


def put_back(place: Installation, folder: Path, replace: bool = False) -> restore.Restored:
    return restore.restore(place.settings, folder, silent, replace=replace)


def comparable(place: Installation) -> dict[str, Any]:
    """Return all rows; of jobs that were running, without what a restart changes."""
    content: dict[str, Any] = place.rows()
    engine = connect(place.settings.database_url)
    columns = [column["name"] for column in sa.inspect(engine).get_columns("jobs")]
    engine.dispose()
    recorded = [dict(zip(columns, row, strict=True)) for row in content["jobs"]]
    for job in recorded:
        if job["state"] in ("queued", "running"):
            for column in INTERRUPTED:
                del job[column]
    attempts = [row[:4] for row in content["attempts"]]
    return content | {"jobs": recorded, "attempts": attempts}


@pytest.mark.parametrize("target", DATABASES)
@pytest.mark.parametrize("source", DATABASES)
def test_all_is_the_same_in_another_place(
    make: Make, tmp_path: Path, source: str, target: str
) -> None:
    before, after = make(source), make(target)
    before.fill()
    written = write(before, tmp_path / "backup")
    content = put_back(after, tmp_path / "backup").manifest
    assert content == written.manifest
    assert content.rows["jobs"] == 6
    assert all(content.rows.values()), content.rows
    assert content.count == len(before.blocks()) == 12
    assert comparable(after) == comparable(before)
    assert after.blocks() == before.blocks()
    assert None not in after.blocks().values()
    states = [row[6] for row in after.rows()["jobs"]]
    assert states.count("queued") == 2  # also the one that was running
    after.fill(0)  # new rows get numbers of their own
    assert len({row[0] for row in after.rows()["jobs"]}) == 7
    for path in (tmp_path / "backup").rglob("*"):
        assert path.stat().st_mode & 0o077 == 0


@pytest.mark.needs("PostgreSQL")
def test_errors_of_jobs_keep_their_form(make: Make, tmp_path: Path) -> None:
    before, after = make("sqlite"), make("postgresql")
    before.fill()
    write(before, tmp_path / "backup")
    put_back(after, tmp_path / "backup")
    engine = connect(after.settings.database_url)
    with engine.connect() as connection:
        query = "SELECT error->>'detail' FROM jobs WHERE error IS NOT NULL"
        assert connection.execute(sa.text(query)).scalars().all() == ["ünder"]
    engine.dispose()


@pytest.mark.needs("PostgreSQL")
def test_records_of_an_earlier_revision_are_restored_as_of_today(
    make: Make, tmp_path: Path
) -> None:
    before, after = make("sqlite"), make("postgresql")
    engine = connect(before.settings.database_url)
    with engine.begin() as connection:
        upgrade(connection, JOBS, "0002")
        texts = dict.fromkeys(("owner", "kind", "request", "result", "phase"), "x")
        numbers = dict.fromkeys(("priority", "seconds", "done", "total", "kept", "created"), 1)
        job = {"id": "job_1", "state": "running", "queue": "bulk", "reused": True, "version": 1}
        connection.execute(jobs.insert().values(**texts, **numbers, **job, attempts=1))
    engine.dispose()
    written = write(before, tmp_path / "backup")
    assert written.manifest.revisions == {"jobs": "0002"}
    assert "attempts" not in written.manifest.rows
    put_back(after, tmp_path / "backup")
    (job,) = after.rows()["jobs"]
    assert (job[1], job[6]) == ("job_1", "queued")
    assert migration.of_settings(after.settings)[0].current == JOBS.newest


def test_what_is_there_is_not_copied_again(make: Make, tmp_path: Path) -> None:
    place, folder = make("sqlite"), tmp_path / "backup"
    place.fill(3)
    first = write(place, folder)
    assert first.new == first.manifest.count
    damaged, lost, gone = sorted(e.name for e in manifest.store(folder).results.entries())
    (path,) = (folder / "store").glob(f"results/*/{damaged}")
    path.write_bytes(path.read_bytes()[:-1])
    manifest.store(folder).results.remove(lost)
    place.store.results.remove(gone)
    place.fill(0)
    place.store.results.put("ab" * 32, b"new")
    second = write(place, folder)
    assert second.new == 3
    assert second.manifest.rows["jobs"] == 5
    files = sorted(path.name for path in folder.iterdir())
    present = {"lock", "manifest.json", "store"}
    assert set(files) - present == {second.manifest.records.name, second.manifest.listing.name}
    assert {e.name for e in manifest.store(folder).results.entries()} == {damaged, lost, "ab" * 32}
    assert restore.verify(folder, silent)[0] == second.manifest


def test_blocks_that_vanish_or_are_damaged_are_left_out(
    make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = make("sqlite")
    place.fill(3)
    damaged, gone, _ = sorted(entry.name for entry in place.store.results.entries())
    path = place.store.results.file(damaged)
    assert path is not None
    path.write_bytes(path.read_bytes()[:-1])
    copy = ContentStore.copy

    def after_retention(self: ContentStore, name: str, target: ContentStore) -> bytes | None:
        if name == gone:
            self.remove(name)
        return copy(self, name, target)

    monkeypatch.setattr(ContentStore, "copy", after_retention)
    written = write(place, tmp_path / "backup")
    assert written.gone == 2
    assert written.manifest.blocks["results"].count == 1
    restore.verify(tmp_path / "backup", silent)


def damage(folder: Path, what: str) -> None:
    """Damage a backup."""
    content = manifest.read(folder)
    block = next(path for path in (folder / "store" / "results").glob("*/*"))
    file = {
        "records": folder / content.records.name,
        "listing": folder / content.listing.name,
        "manifest": folder / manifest.FILE,
        "block": block,
    }[what.removesuffix(" missing")]
    if what.endswith("missing"):
        file.unlink()
    else:
        data = bytearray(file.read_bytes())
        data[len(data) // 2] ^= 1
        file.write_bytes(data)


@pytest.mark.parametrize("missing", ["", " missing"])
@pytest.mark.parametrize("what", ["records", "listing", "manifest", "block"])
def test_a_damaged_backup_is_refused(make: Make, tmp_path: Path, what: str, missing: str) -> None:
    before, after = make("sqlite"), make("sqlite")
    before.fill()
    write(before, tmp_path / "backup")
    damage(tmp_path / "backup", what + missing)
    with pytest.raises(BackupInvalidError):
        put_back(after, tmp_path / "backup")
    assert not after.settings.data.exists()


def test_a_block_of_another_name_is_refused(make: Make, tmp_path: Path) -> None:
    place, folder = make("sqlite"), tmp_path / "backup"
    place.fill()
    write(place, folder)
    one, other = list((folder / "store" / "results").glob("*/*"))[:2]
    shutil.copy(one, other)
    with pytest.raises(BackupInvalidError, match="1 of 12 files are damaged"):
        restore.verify(folder, silent)


@pytest.mark.parametrize("changed", [{"revisions": {"jobs": "9999"}}, {"format": 2}])
def test_a_backup_of_a_newer_version_is_refused(
    make: Make, tmp_path: Path, changed: dict[str, Any]
) -> None:
    place, folder = make("sqlite"), tmp_path / "backup"
    place.fill()
    write(place, folder)
    content = json.loads((folder / manifest.FILE).read_text())
    (folder / manifest.FILE).write_text(json.dumps(content | changed))
    with pytest.raises(BackupInvalidError, match="version"):
        restore.verify(folder, silent)


@pytest.mark.parametrize("database", DATABASES)
def test_records_are_replaced_only_on_request(make: Make, tmp_path: Path, database: str) -> None:
    before, after = make("sqlite"), make(database)
    before.fill()
    after.fill(2)
    kept = after.rows()
    write(before, tmp_path / "backup")
    with pytest.raises(TargetNotEmptyError):
        put_back(after, tmp_path / "backup")
    assert after.rows() == kept
    put_back(after, tmp_path / "backup", replace=True)
    assert comparable(after) == comparable(before)


@pytest.mark.needs("PostgreSQL")
def test_records_stay_where_a_restoration_fails(
    make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for database in DATABASES:
        before, after = make("sqlite"), make(database)
        before.fill()
        after.fill(2)
        kept = after.rows()
        folder = tmp_path / database
        write(before, folder)
        with monkeypatch.context() as patch:
            patch.setattr("vibroimpact_service.jobs.claims.release_all", lambda _: 1 / 0)
            with pytest.raises(ZeroDivisionError):
                put_back(after, folder, replace=True)
        assert after.rows() == kept


@pytest.mark.needs("PostgreSQL")
def test_nothing_is_restored_below_a_service(make: Make, tmp_path: Path) -> None:
    before, after, server = make("sqlite"), make("sqlite"), make("postgresql")
    before.fill()
    write(before, tmp_path / "backup")
    with data_folder.lock(after.settings.data), pytest.raises(DataInUseError):
        put_back(after, tmp_path / "backup")
    database = open_database(server.settings.database_url)
    with pytest.raises(DataInUseError):
        put_back(server, tmp_path / "backup")
    database.dispose()
    put_back(server, tmp_path / "backup")


def test_one_backup_at_a_time_in_a_folder(make: Make, tmp_path: Path) -> None:
    place, folder = make("sqlite"), tmp_path / "backup"
    place.fill()
    folder.mkdir()
    with private.locked(folder / "lock"), pytest.raises(BackupBusyError):
        write(place, folder)
    write(place, folder)


@pytest.mark.parametrize("database", DATABASES)
def test_without_records_there_is_no_backup(make: Make, tmp_path: Path, database: str) -> None:
    place = make(database)
    with pytest.raises(NoRecordsError):
        write(place, tmp_path / "backup")
    assert not place.settings.data.exists()
    with pytest.raises(BackupInvalidError, match="no finished backup"):
        restore.verify(tmp_path / "backup", silent)


def test_the_key_of_webhooks_is_not_part_of_it(make: Make, tmp_path: Path) -> None:
    before, after = make("sqlite"), make("sqlite")
    before.fill()
    sealing.of_settings(before.settings)
    key = (before.settings.data / "webhook.key").read_bytes()
    write(before, tmp_path / "backup")
    assert not any(key in p.read_bytes() for p in (tmp_path / "backup").rglob("*") if p.is_file())
    put_back(after, tmp_path / "backup")
    assert not (after.settings.data / "webhook.key").exists()


def test_a_store_in_a_bucket(s3: Callable[[], str], make: Make, tmp_path: Path) -> None:
    before, after = make("sqlite", store=s3()), make("sqlite", store=s3())
    before.fill()
    before.store.results.put("cd" * 32, os.urandom(3_000_000))
    assert write(before, tmp_path / "backup").manifest.count == 13
    assert write(before, tmp_path / "backup").new == 0
    assert put_back(after, tmp_path / "backup").new == 13
    assert after.blocks() == before.blocks()
    again = make("sqlite", store=after.settings.store)
    assert put_back(again, tmp_path / "backup").new == 0
