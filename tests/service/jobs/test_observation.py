"""What is observed of a queue: its jobs on both databases, the disk, the certificates."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from cryptography import x509

from vibroimpact_service.jobs import certificates, claims, control, observation
from vibroimpact_service.jobs.database import open_database
from vibroimpact_service.jobs.observation import Observation, Observer
from vibroimpact_service.jobs.record_access import RecordAccess
from vibroimpact_service.jobs.records import NewJob, insert
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store


@pytest.fixture(params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'records.sqlite'}"
    new: Callable[[], str] = request.getfixturevalue("postgresql")
    return new()


def new(number: int, owner: str, kind: str) -> NewJob:
    name = f"{number:064}"
    return NewJob(f"job_{number:032}", owner, kind, name, name, 0, 5.0, False)


def test_unfinished_jobs_are_counted_by_kind_owner_and_state(url: str) -> None:
    engine = open_database(url)
    owners = {1: "ann", 2: "ann", 3: "ann", 4: "bob", 5: "bob"}
    with engine.begin() as connection:
        for number, owner in owners.items():
            insert(connection, new(number, owner, "sweep" if number < 5 else "ensemble"))
    time.sleep(0.3)
    with engine.begin() as connection:
        insert(connection, new(6, "ann", "sweep"))
        control.hold(connection, "ann", f"job_{2:032}")
        claims.cancel(connection, "ann", f"job_{3:032}")
        (claimed,) = claims.claim(connection, "me", "bulk", 1, 1.0)
        counted = observation.backlog(connection)
    states = {(each.kind, each.owner, each.state): each for each in counted}
    numbers = {key: each.jobs for key, each in states.items()}
    expected = {
        ("sweep", "ann", "queued"): 2, ("sweep", "ann", "held"): 1,
        ("sweep", "bob", "queued"): 1, ("ensemble", "bob", "queued"): 1,
    }  # fmt: skip
    expected[claimed.kind, claimed.owner, "queued"] -= 1
    expected[claimed.kind, claimed.owner, "running"] = 1
    assert numbers == {key: count for key, count in expected.items() if count}
    assert 0.3 <= states["sweep", "ann", "held"].oldest < 60.0
    engine.dispose()


def test_a_claim_that_had_expired_is_told(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    engine = open_database(url)
    monkeypatch.setattr(claims, "CLAIM_SECONDS", -1.0)
    with engine.begin() as connection:
        insert(connection, new(1, "ann", "sweep"))
        (first,) = claims.claim(connection, "frozen", "bulk", 1, 1.0)
    with engine.begin() as connection:
        (second,) = claims.claim(connection, "other", "bulk", 1, 1.0)
    assert (first.taken_over, second.taken_over) == (False, True)
    engine.dispose()


def test_what_cannot_be_looked_at_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ca, cert, key = certificates.write(tmp_path / "tls", days=30)
    settings = Settings(data=tmp_path, tls_ca=ca, tls_cert=cert, tls_key=key)
    store = Store(settings.store_url)
    clock = [1000.0]
    monkeypatch.setattr(observation.time, "monotonic", lambda: clock[0])

    async def scenario() -> None:
        access = RecordAccess(open_database(settings.database_url))
        observer = Observer(settings, access, store)
        first = await observer.state()
        assert first.backlog == []
        assert first.room is None  # there is no folder yet
        for name, path in (("ca", ca), ("cert", cert)):
            end = x509.load_pem_x509_certificate(path.read_bytes()).not_valid_after_utc
            assert first.expiry[name] == end.timestamp()
        assert await observer.state() is first

        store.results.put("a" * 64, b"1")
        cert.unlink()
        clock[0] += 6.0
        assert await observer.state() is first  # and another one is made meanwhile
        await asyncio.wait([observer._observing])
        second = await observer.state()
        assert second == Observation([], second.room, {})
        assert second.room is not None

        access.close()
        clock[0] += 100.0
        assert (await observer.state()).backlog is None
        observer.close()

    asyncio.run(scenario())


def test_the_room_of_the_disk(tmp_path: Path) -> None:
    store = Store(str(tmp_path))
    assert store.results.room() is None
    store.results.put("a" * 64, b"1")
    room = store.results.room()
    assert room is not None
    assert 0 < room.free < room.total
    assert Store("memory://somewhere").results.room() is None
