"""Migrations: without a service, by several processes at once, and only ever adding."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import sqlalchemy as sa
from typer.testing import CliRunner

from vibroimpact_service.cli import app
from vibroimpact_service.jobs.database import connect
from vibroimpact_service.jobs.revisions import JOBS, Migrations, upgrade
from vibroimpact_service.operations import migration

DATABASES = ["sqlite", "postgresql"]
STEPS = [file for each in migration.TABLES.values() for file in each.versions.glob("v[0-9]*.py")]


def run(*arguments: Any) -> Any:
    return CliRunner().invoke(app, [str(each) for each in arguments])


@pytest.mark.parametrize("database", DATABASES)
def test_records_come_to_the_newest_revision(
    make: Callable[..., Any], database: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = make(database).settings
    if settings.database:
        monkeypatch.setenv("VIBROIMPACT_DATABASE", settings.database)
    newest = {name: each.newest for name, each in migration.TABLES.items()}
    engine = connect(settings.database_url)
    with engine.begin() as connection:
        upgrade(connection, JOBS, "0002")
    engine.dispose()
    asked = run("migrate", "--check", "--data", settings.data)
    assert asked.exit_code == 1
    assert f"jobs: revision 0002 → {newest['jobs']}\n" in asked.output
    assert f"keys: revision none → {newest['keys']}\n" in asked.output
    done = run("migrate", "--data", settings.data)
    assert (done.exit_code, done.output) == (0, asked.output)
    assert {n: current for n, current, _ in migration.of_settings(settings)} == newest
    asked = run("migrate", "--check", "--data", settings.data)
    assert asked.exit_code == 0
    assert asked.output.count("is the newest") == 2


def test_the_check_makes_nothing(make: Callable[..., Any]) -> None:
    settings = make("sqlite").settings
    assert run("migrate", "--check", "--data", settings.data).exit_code == 1
    assert not settings.data.exists()


@pytest.mark.parametrize("database", DATABASES)
def test_several_processes_migrate_at_once(make: Callable[..., Any], database: str) -> None:
    settings = make(database).settings
    code = (
        "import sys; from vibroimpact_service.operations import migration;"
        "from vibroimpact_service.settings import Settings;"
        "migration.migrate(Settings(data=sys.argv[1], database=sys.argv[2]))"
    )
    command = [sys.executable, "-c", code, str(settings.data), settings.database_url]
    processes = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for _ in range(4)]
    errors = [process.communicate(timeout=120)[1] for process in processes]
    assert [p.returncode for p in processes] == [0] * 4, errors
    assert all(current == newest for _, current, newest in migration.of_settings(settings))


@pytest.mark.parametrize("database", DATABASES)
def test_records_of_a_newer_version_are_left_alone(
    make: Callable[..., Any], database: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = make(database).settings
    if settings.database:
        monkeypatch.setenv("VIBROIMPACT_DATABASE", settings.database)
    migration.migrate(settings)
    engine = connect(settings.database_url)
    with engine.begin() as connection:
        connection.execute(sa.text("UPDATE alembic_version SET version_num = '9999'"))
    engine.dispose()
    done = run("migrate", "--data", settings.data)
    assert done.exit_code == 1
    assert "a newer version has migrated the records: revision 9999" in done.output
    assert migration.of_settings(settings)[0].current == "9999"


def test_a_database_that_does_not_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VIBROIMPACT_DATABASE", "postgresql://ann:secret@127.0.0.1:1/x")
    for arguments in (["migrate"], ["migrate", "--check"], ["keys", "list"]):
        command = [sys.executable, "-m", "vibroimpact.cli", *arguments]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
        assert done.returncode == 3
        assert "the database cannot be reached" in done.stderr
        assert "secret" not in done.stderr
        assert "Traceback" not in done.stderr


class Operations:
    """Notes what a migration does."""

    def __init__(self) -> None:
        self.done: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = []

    def __getattr__(self, name: str) -> Callable[..., None]:
        return lambda *args, **options: self.done.append((name, args, options))


def narrowing(module: ModuleType) -> list[str]:
    """Return what a migration does beside adding."""
    operations = Operations()
    module.op = operations  # type: ignore[attr-defined]
    module.upgrade()
    assert operations.done
    new = {args[0] for name, args, _ in operations.done if name == "create_table"}
    faults = []
    for name, args, options in operations.done:
        if name == "add_column":
            column: sa.Column[Any] = args[1]
            if not column.nullable and column.server_default is None:
                faults.append(f"column {column.name} must be given by those who do not know it")
        elif name == "create_index":
            if options.get("unique") and args[1] not in new:
                faults.append(f"index {args[0]} refuses rows of earlier versions")
        elif name != "create_table":
            faults.append(name)
    return faults


def loaded(file: Path) -> ModuleType:
    specification = importlib.util.spec_from_file_location(f"migration_{file.stem}", file)
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.mark.parametrize("file", STEPS, ids=lambda file: f"{file.parent.parent.name}-{file.stem}")
def test_migrations_only_add(file: Path) -> None:
    module = loaded(file)
    assert narrowing(module) == []
    assert module.revision == file.name[1:5]


@pytest.mark.parametrize(
    "statement",
    [
        "op.drop_column('jobs', 'note')",
        "op.alter_column('jobs', 'note', type_=sa.String(10))",
        "op.execute('DELETE FROM jobs')",
        "op.add_column('jobs', sa.Column('x', sa.Integer, nullable=False))",
        "op.create_index('x', 'jobs', ['owner'], unique=True)",
        "op.batch_alter_table('jobs')",
    ],
)
def test_what_takes_away_is_noticed(tmp_path: Path, statement: str) -> None:
    file = tmp_path / "v0001_x.py"
    file.write_text(
        f"import sqlalchemy as sa\nfrom alembic import op\ndef upgrade():\n    {statement}\n"
    )
    assert len(narrowing(loaded(file))) == 1


def test_all_migrations_are_read() -> None:
    service = Path(migration.__file__).parents[1]
    assert sorted(STEPS) == sorted(service.glob("**/migrations/**/v[0-9]*.py"))
    assert Migrations(JOBS.versions, "x").newest == max(f.name[1:5] for f in STEPS)
