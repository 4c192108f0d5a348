"""Representations are made once, checked when read, and the latest ones are held."""

from __future__ import annotations

import hashlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from vibroimpact_schema.requests import ImpactModesRequest
from vibroimpact_service.documents import digest, planning
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.results import encode, representations
from vibroimpact_service.results.encoders import ENCODERS, HDF5, JSON
from vibroimpact_service.results.representations import RecentRepresentations, Representation, load
from vibroimpact_service.store import Store, StoreFullError
from vibroimpact_service.use_case import computation

NAME = "ab" * 32


@pytest.fixture
def stored(store: Store, request_body: dict[str, Any]) -> Store:
    kind = KINDS["impact-modes"]
    request = ImpactModesRequest.model_validate(request_body)
    computation.put(
        store,
        computation.compute(planning.plan(store, kind, request), NAME, digest.canonical(request)),
        durable=False,
    )
    return store


def damage(store: Store, name: str) -> None:
    (path,) = Path(store.url).glob(f"results/*/{name}")
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(bytes(data))


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("media_type", [JSON, HDF5])
def test_a_result_is_answered_where_there_is_no_room_for_its_representation(
    stored: Store, media_type: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise StoreFullError(28, "the store is full")

    with monkeypatch.context() as patched:
        patched.setattr(stored.results, "put", full)
        first = load(stored, NAME, media_type)
    again = load(stored, NAME, media_type)
    assert first is not None
    assert again is not None
    assert (first.data, first.etag) == (again.data, again.etag)


@pytest.mark.parametrize("media_type", [JSON, HDF5])
def test_a_representation_is_the_same_ever_after(stored: Store, media_type: str) -> None:
    first = load(stored, NAME, media_type)
    assert first is not None
    assert first.sha256 == hashlib.sha256(first.data).hexdigest()
    stored.results.remove(NAME)  # it is not made again
    assert load(stored, NAME, media_type) == first


def test_files_that_are_made_at_the_same_time_are_the_same(stored: Store) -> None:
    content = encode.unpack(stored.results.get(NAME) or b"")
    with ThreadPoolExecutor(4) as threads:
        made = threads.map(lambda _: representations.of_content(content, HDF5).data, range(40))
    assert len(set(made)) == 1


def test_an_unknown_result_has_none(store: Store) -> None:
    assert load(store, NAME, JSON) is None


@pytest.mark.parametrize("media_type", [JSON, HDF5])
def test_a_damaged_representation_is_made_again(stored: Store, media_type: str) -> None:
    first = load(stored, NAME, media_type)
    damage(stored, f"{NAME}.{ENCODERS[media_type].suffix}")
    assert load(stored, NAME, media_type) == first


def test_a_damaged_result_is_unknown_and_so_computed_again(stored: Store) -> None:
    damage(stored, NAME)
    assert load(stored, NAME, JSON) is None
    assert not stored.results.has(NAME)


def representation(size: int) -> Representation:
    return Representation(JSON, bytes(size), "00")


def test_the_shelf_drops_what_was_not_wanted_longest() -> None:
    shelf = RecentRepresentations(1000)
    for name in "abcdefgh":
        shelf.put(name, representation(120))
    assert shelf.get("a", JSON) is not None
    shelf.put("i", representation(120))
    assert shelf.get("a", JSON) is not None
    assert shelf.get("b", JSON) is None
    assert shelf.get("a", HDF5) is None


def test_the_shelf_does_not_hold_what_would_push_out_all_else() -> None:
    shelf = RecentRepresentations(1000)
    shelf.put("a", representation(126))
    assert shelf.get("a", JSON) is None


def test_putting_twice_counts_once() -> None:
    shelf = RecentRepresentations(1000)
    for _ in range(100):
        shelf.put("a", representation(100))
    shelf.put("b", representation(100))
    assert shelf.get("a", JSON) is not None
