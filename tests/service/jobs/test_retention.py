"""What is thrown away and what stays, with real records and a real store."""

from __future__ import annotations

import os
import time
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa

from vibroimpact_service.jobs import claims, records
from vibroimpact_service.jobs.database import open_database
from vibroimpact_service.jobs.record_access import RecordAccess
from vibroimpact_service.jobs.records import NewJob
from vibroimpact_service.jobs.retention import Retention
from vibroimpact_service.jobs.tables import idempotency, jobs, pins, requests, webhooks
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import ContentStore, Store

DAY = 86400.0


@dataclass
class Place:
    """Records and a store, with the limits of some settings."""

    folder: Path
    access: RecordAccess

    def __post_init__(self) -> None:
        self.store = Store(str(self.folder / "store"))

    def clean(self, **limits: Any) -> None:
        settings = Settings(data=self.folder, **limits)
        Retention(settings, self.store, self.access).clean()

    def job(self, result: str, *, done: bool = True, block: bytes = b"asked") -> NewJob:
        new = NewJob(
            f"job_{uuid.uuid4().hex}",
            "ann",
            "squares",
            "re" * 32,
            result,
            0,
            5.0,
            done,
            block=block,
        )
        self.access.write_now(records.insert, new)
        return new

    def age(self, days: float, table: sa.Table, column: str) -> None:
        with self.access.database.begin() as connection:
            connection.execute(table.update().values({column: time.time() - days * DAY}))

    def request(self) -> bytes | None:
        return self.access.read_now(records.request, "re" * 32)


@pytest.fixture(params=["sqlite", "postgresql"])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Place]:
    url = f"sqlite:///{tmp_path / 'records.sqlite'}"
    if request.param == "postgresql":
        new: Callable[[], str] = request.getfixturevalue("postgresql")
        url = new()
    access = RecordAccess(open_database(url))
    yield Place(tmp_path, access)
    access.close()


def put(area: ContentStore, name: str, days: float, size: int = 1000) -> str:
    """Store a block of some age and return its name."""
    area.put(name, b"x" * (size - 32))
    (path,) = Path(area._root).glob(f"*/{name}")
    moment = time.time() - days * DAY
    os.utime(path, (moment, moment))
    return name


def names(area: ContentStore) -> set[str]:
    return {entry.name for entry in area.entries()}


def test_results_go_by_age_and_size_but_pinned_and_wanted_ones_stay(place: Place) -> None:
    store = place.store.results
    pinned, wanted, old, older, new = (
        put(store, name * 32, days)
        for name, days in (("aa", 500), ("bb", 500), ("cc", 20), ("dd", 30), ("ee", 1))
    )
    put(store, "ff" * 32, 400)
    with place.access.database.begin() as connection:
        connection.execute(pins.insert().values(owner="ann", result=pinned, created=1e9))
    place.job(wanted, done=False)
    place.clean()
    assert names(store) == {pinned, wanted, old, older, new}
    place.clean(max_store_bytes=4000)  # the oldest that may go makes room
    assert names(store) == {pinned, wanted, old, new}
    place.clean(max_store_bytes=0)
    assert names(store) == {pinned, wanted}
    with place.access.database.begin() as connection:
        connection.execute(pins.delete())
    place.clean(max_store_bytes=0)
    assert names(store) == {wanted}


def test_chunks_go_by_age_and_size(place: Place) -> None:
    store = place.store.chunks
    ages = {"aa": 40, "bb": 20, "cc": 10, "dd": 5}
    chunks = {name: put(store, name * 32, days) for name, days in ages.items()}
    place.clean()
    assert names(store) == {chunks[name] for name in ("bb", "cc", "dd")}
    store.touch(chunks["bb"])  # a job found it
    place.clean(max_chunks_bytes=2500)
    assert names(store) == {chunks[name] for name in ("bb", "dd")}
    place.clean(max_chunks_bytes=0)
    assert names(store) == set()


def test_chunks_of_jobs_under_way_stay(place: Place) -> None:
    store = place.store.chunks
    before, since = put(store, "aa" * 32, 2), put(store, "bb" * 32, 0)
    place.job("cc" * 32, done=False)
    (job,) = place.access.write_now(claims.claim, "me", "bulk", 1, 1.0)
    place.clean(max_chunks_bytes=0)
    assert names(store) == {since}
    assert before not in names(store)
    assert set(place.access.write_now(claims.succeed, "me", [job.id], False)) == {job.id}
    place.clean(max_chunks_bytes=0)
    assert names(store) == set()


def test_jobs_go_by_age_and_their_requests_with_them(place: Place) -> None:
    place.job("aa" * 32)
    place.age(100, jobs, "finished")
    unfinished = place.job("bb" * 32, done=False)
    recent = place.job("cc" * 32)
    place.age(1, requests, "created")
    place.clean()
    with place.access.database.connect() as connection:
        left = set(connection.execute(sa.select(jobs.c.id)).scalars())
    assert left == {unfinished.id, recent.id}
    assert place.request() == b"asked"  # they need it
    with place.access.database.begin() as connection:
        connection.execute(jobs.delete())
    place.clean()
    assert place.request() is None


def test_addresses_and_keys_go_with_their_jobs(place: Place) -> None:
    told = ("https://example.org/", "whsec_secret")
    old, recent = (
        NewJob(
            f"job_{uuid.uuid4().hex}", "ann", "squares", "re" * 32, result * 32, 0, 5.0, True,
            key=result, webhook=told, block=b"asked",
        )
        for result in ("aa", "bb")
    )  # fmt: skip
    place.access.write_now(records.insert, old)
    place.age(100, jobs, "finished")
    place.access.write_now(records.insert, recent)
    place.clean()
    with place.access.database.connect() as connection:
        for column in (webhooks.c.job, idempotency.c.job):
            assert list(connection.execute(sa.select(column)).scalars()) == [recent.id]


def test_a_request_that_is_asked_again_is_new_again(place: Place) -> None:
    place.job("aa" * 32)
    place.age(1, requests, "created")
    place.job("bb" * 32)
    with place.access.database.begin() as connection:
        connection.execute(jobs.delete())
    place.clean()
    assert place.request() == b"asked"
