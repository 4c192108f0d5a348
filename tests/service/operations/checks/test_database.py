"""Databases that do not answer, take no writes, have another revision or another clock."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psycopg
import pytest
import sqlalchemy as sa

from vibroimpact_service.jobs.database import connect
from vibroimpact_service.jobs.revisions import JOBS, upgrade
from vibroimpact_service.operations import migration
from vibroimpact_service.operations.checks.check import Check
from vibroimpact_service.operations.checks.database import database

DATABASES = ["sqlite", "postgresql"]


def outcomes(url: str, **options: Any) -> dict[str, Check]:
    checks = database(url, **options)
    assert len({check.name for check in checks}) == len(checks)
    assert all((check.advice == "") is (check.state == "ok") for check in checks)
    return {check.name: check for check in checks}


@pytest.mark.parametrize("kind", DATABASES)
def test_a_sound_one_stays_as_it_is(make: Callable[..., Any], kind: str) -> None:
    place = make(kind)
    place.fill()
    before = place.rows()
    checks = outcomes(place.settings.database_url)
    assert {check.state for check in checks.values()} == {"ok"}
    server = {"PostgreSQL"} if kind == "postgresql" else set()
    assert set(checks) == {"database", "clock", "records of jobs", "records of keys"} | server
    assert "takes a write in" in checks["database"].seen
    assert place.rows() == before
    engine = connect(place.settings.database_url)
    with engine.connect() as connection:
        names = connection.execute(sa.text("SELECT name FROM processes")).scalars().all()
    engine.dispose()
    assert names == ["process"]


def test_one_that_does_not_exist_is_not_made(tmp_path: Path) -> None:
    checks = outcomes(f"sqlite:///{tmp_path / 'x' / 'records.sqlite'}")
    assert [check.state for check in checks.values()] == ["ok"]
    assert list(tmp_path.iterdir()) == []


def test_a_server_that_is_stopped(killable_postgresql: Any) -> None:
    url = killable_postgresql.new().replace("test@", "test:secret@")
    assert outcomes(url)["database"].state == "ok"
    killable_postgresql.kill()
    checks = outcomes(url)
    assert [check.state for check in checks.values()] == ["failed"]
    assert "Connection refused" in checks["database"].seen
    assert "secret" not in checks["database"].seen


def test_an_address_that_is_none() -> None:
    check = outcomes("nothing://x/y")["database"]
    assert check.state == "failed"
    assert check.advice == "correct VIBROIMPACT_DATABASE"


def test_a_file_that_is_no_database(tmp_path: Path) -> None:
    file = tmp_path / "records.sqlite"
    file.write_bytes(os.urandom(10_000))
    assert outcomes(f"sqlite:///{file}")["database"].state == "failed"


def test_a_server_that_takes_no_writes(postgresql: Callable[[], str]) -> None:
    url = postgresql()
    for each in migration.TABLES.values():
        engine = connect(url)
        with engine.begin() as connection:
            upgrade(connection, each, "head")
        engine.dispose()
    with psycopg.connect(url, autocommit=True) as server:
        name = url.rsplit("/", 1)[1]
        server.execute(f"ALTER DATABASE {name} SET default_transaction_read_only = on")
    check = outcomes(url)["database"]
    assert check.state == "failed"
    assert "takes no writes: cannot execute INSERT in a read-only transaction" in check.seen


def test_a_database_that_another_process_locks(make: Callable[..., Any]) -> None:
    """What SQLite says after its ten seconds of waiting."""
    url = make("sqlite").settings.database_url
    engine = connect(url)
    with engine.begin() as connection:
        upgrade(connection, JOBS, "head")
    with engine.begin():
        check = outcomes(url)["database"]
    engine.dispose()
    assert check.state == "failed"
    assert "database is locked" in check.seen


@pytest.mark.parametrize("kind", DATABASES)
@pytest.mark.parametrize(("revision", "expected"), [("9999", "failed"), ("0002", "warning")])
def test_another_revision(
    make: Callable[..., Any], kind: str, revision: str, expected: str
) -> None:
    url = make(kind).settings.database_url
    engine = connect(url)
    with engine.begin() as connection:
        upgrade(connection, JOBS, "0002")
        connection.execute(sa.text(f"UPDATE alembic_version SET version_num = '{revision}'"))
    engine.dispose()
    check = outcomes(url)["records of jobs"]
    assert (check.state, check.seen.split(",")[0]) == (expected, f"revision {revision}")


@pytest.mark.parametrize(
    ("seconds", "expected"), [(90.0, "failed"), (-90.0, "failed"), (20.0, "warning"), (1.0, "ok")]
)
def test_a_clock_that_is_wrong(
    make: Callable[..., Any], postgresql: Callable[[], str], seconds: float, expected: str
) -> None:
    check = outcomes(postgresql(), clock=lambda: time.time() + seconds)["clock"]
    assert check.state == expected
    if expected != "ok":
        assert f"{abs(seconds):.1f} s {'behind' if seconds > 0 else 'ahead'}" in check.seen


def test_an_old_server(postgresql: Callable[[], str]) -> None:
    check = outcomes(postgresql(), tested=99)["PostgreSQL"]
    assert (check.state, check.advice) == ("warning", "the service is tested with 99 and later")
