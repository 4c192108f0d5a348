"""Stores that take no writes, cannot be reached, or have no room."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from vibroimpact_service.operations.checks.storage import store
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import ContentStore, Store


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    Store(str(tmp_path / "store")).results.put("ab" * 32, b"x" * 1000)
    return tmp_path


def blocks(settings: Settings) -> list[str]:
    return [entry.name for entry in Store(settings.store_url).results.entries()]


def test_a_sound_one_stays_as_it_is(folder: Path) -> None:
    settings = Settings(data=folder, max_store_bytes=10_000)
    assert [(c.name, c.state) for c in store(settings)] == [("store", "ok"), ("room", "ok")]
    assert blocks(settings) == ["ab" * 32]


def test_one_that_does_not_exist_is_not_made(tmp_path: Path) -> None:
    assert [check.state for check in store(Settings(data=tmp_path))] == ["ok"]
    assert list(tmp_path.iterdir()) == []


def test_one_that_takes_no_writes() -> None:
    (check,) = store(Settings(store="/proc/vibroimpact"))  # nobody can make a folder there
    assert (check.name, check.state) == ("store", "failed")


def test_one_that_does_not_give_back_what_it_takes(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put = ContentStore.put

    def damaged(self: ContentStore, name: str, data: bytes) -> None:
        put(self, name, data)
        (path,) = Path(folder, "store", "results").glob(f"*/{name}")
        path.write_bytes(path.read_bytes()[:-1])

    monkeypatch.setattr(ContentStore, "put", damaged)
    settings = Settings(data=folder)
    (check,) = store(settings)
    assert check.state == "failed"
    assert "does not give back" in check.seen
    assert blocks(settings) == ["ab" * 32]


def test_room(folder: Path) -> None:
    limited = store(Settings(data=folder, max_store_bytes=2**60))[1]
    assert limited.state == "warning"
    assert "MAX_STORE_BYTES" in limited.advice
    small = store(Settings(data=folder, max_result_bytes=2**60))[1]
    assert small.state == "warning"
    assert "one result" in small.advice


def test_buckets(s3: Callable[[], str]) -> None:
    settings = Settings(store=s3())
    assert [(c.name, c.state) for c in store(settings)] == [("store", "ok")]
    assert blocks(settings) == []
    (check,) = store(Settings(store="s3://no-such-bucket/x"))
    assert (check.state, check.seen) == ("failed", "s3://no-such-bucket/x: there is no such store")
    (check,) = store(Settings(store="nothing://x"))
    assert (check.state, check.advice) == ("failed", "correct VIBROIMPACT_STORE")
