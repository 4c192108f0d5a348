"""An installation with jobs of all states, whose records are in one database or the other."""

from __future__ import annotations

import hashlib
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa

from vibroimpact_schema.keys import KeyRequest
from vibroimpact_service.access import records as access_records
from vibroimpact_service.access import shared_results
from vibroimpact_service.jobs import claims, records
from vibroimpact_service.jobs.database import connect, open_database
from vibroimpact_service.jobs.records import NewJob
from vibroimpact_service.jobs.tables import pins
from vibroimpact_service.jobs.time_limits import remove_limits
from vibroimpact_service.operations import rows
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store


def name(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


@dataclass(frozen=True)
class Installation:
    """Records and a store."""

    settings: Settings

    @property
    def store(self) -> Store:
        return Store(self.settings.store_url)

    def fill(self, count: int = 5, kinds: str = "squares") -> None:
        """Record jobs, finished and not, with all that belongs to them."""
        database = open_database(self.settings.database_url)
        access_records.open_keys(self.settings.database_url).dispose()
        with database.begin() as connection:
            for number in range(count):
                done = number % 2 == 0
                new = NewJob(
                    f"job_{uuid.uuid4().hex}", "ann", kinds, name(f"request {number}"),
                    name(f"result {number}"), number, 0.1 + number / 3, done,
                    key=f"key {number}", webhook=("https://a.b/c", "whsec_c2VjcmV0"),
                    deadline=None if done else 3600.0, block=bytes(range(256)) + bytes([number]),
                )  # fmt: skip
                job = records.insert(connection, new)
                shared_results.share(connection, "ann", "ann", job.id, new.result, ["bob"])
                self.store.results.put(new.result, f"result {number}".encode() * 1000)
                self.store.chunks.put(name(f"chunk {number}"), bytes(number))
            claims.claim(connection, "process", "bulk", 1, 60.0)
            failed = records.insert(
                connection,
                NewJob(f"job_{uuid.uuid4().hex}", "bob", kinds, name("r"), name("s"), 0, 1.0, True),
            )
            error = {"title": "Too much", "detail": "ünder", "values": [1.5, None]}
            where = sa.text(f"id = '{failed.id}'")
            values = {"state": "failed", "error": error}
            connection.execute(records.jobs.update().where(where).values(**values))
            key = KeyRequest(owner="ann", label="laptop", scopes=["read"])
            access_records.create(connection, "test", key)
            records.seen(connection, "process")
            pin = {"owner": "ann", "result": uuid.uuid4().hex, "created": 1e9 / 3}
            connection.execute(pins.insert().values(**pin))
        self.store.requests.put(name("large"), b"large request")
        self.store.systems.put(f"sys_{name('system')}", b"{}")
        database.dispose()

    def rows(self) -> dict[str, list[tuple[Any, ...]]]:
        """Return all rows of all tables that a backup holds."""
        engine = connect(self.settings.database_url)
        with engine.connect() as connection:
            if engine.dialect.name != "sqlite":  # a busy machine may pause between two tables
                remove_limits(connection)
            there = sa.inspect(connection).get_table_names()
            content = {}
            for each in (n for n in rows.NAMES if n in there):
                table = sa.Table(each, sa.MetaData(), autoload_with=connection)
                query = sa.select(table).order_by(*table.primary_key.columns)
                content[each] = [tuple(row) for row in connection.execute(query)]
        engine.dispose()
        return content

    def blocks(self) -> dict[tuple[str, str], bytes | None]:
        """Return all blocks of the store."""
        return {
            (area, entry.name): content.get(entry.name)
            for area, content in self.store.areas.items()
            for entry in content.entries()
        }


@pytest.fixture
def make(tmp_path: Path, request: pytest.FixtureRequest) -> Callable[..., Installation]:
    """Return the function that makes an empty installation on one database or the other."""

    def installation(database: str, **settings: Any) -> Installation:
        if database == "postgresql":
            new: Callable[[], str] = request.getfixturevalue("postgresql")
            settings["database"] = new()
        return Installation(Settings(data=tmp_path / uuid.uuid4().hex, **settings))

    return installation
