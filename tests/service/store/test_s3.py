"""The store in buckets: a real server that speaks S3, as a process of its own."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import fsspec
import pytest

from vibroimpact_service.documents import digest, requests
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.results import encode
from vibroimpact_service.store import Store, StoreUnavailableError
from vibroimpact_service.store.faults import Outage
from vibroimpact_service.use_case import chunks as job_chunks

NAME = "ab" * 32


@pytest.fixture
def url(s3: Callable[[], str]) -> str:
    return s3()


def test_blocks_come_back(url: str) -> None:
    store, other = Store(url).results, Store(url).results
    assert store.get(NAME) is None
    assert not store.has(NAME)
    store.put(NAME, b"block")
    assert other.has(NAME)
    assert other.get(NAME) == b"block"
    assert other.readable(NAME)
    assert store.sound([NAME, "cd" * 32]) == {NAME}
    (entry,) = store.entries()
    assert (entry.name, entry.size) == (NAME, 32 + 5)
    assert abs(entry.modified - time.time()) < 60
    other.remove(NAME)
    other.remove(NAME)
    assert store.get(NAME) is None
    assert list(store.entries()) == []


def test_a_damaged_block_is_removed(url: str) -> None:
    store = Store(url).results
    store.put(NAME, b"block")
    files = fsspec.filesystem("s3")
    (path,) = files.find(url)
    content = bytearray(files.cat_file(path))
    content[-1] ^= 1
    files.pipe_file(path, bytes(content))
    assert not store.readable(NAME)
    assert not store.has(NAME)


def test_a_job_from_its_request_to_its_result(url: str, request_body: dict[str, Any]) -> None:
    kind = KINDS["impact-modes"]
    store = Store(url)
    request = kind.request.model_validate(request_body)
    block = requests.stored_form("ann", digest.canonical(request))
    name = digest.content(block)
    store.requests.put(name, block)
    chunks = job_chunks.split(url, kind.name, name, NAME)
    job_chunks.solve(url, kind.name, name, NAME, range(len(chunks)))
    assert store.chunks.sound([chunk.name for chunk in chunks]) == {c.name for c in chunks}
    job_chunks.join(url, kind.name, name, NAME, chunks)
    content = encode.unpack(store.results.get(NAME) or b"")
    assert content.arrays["impulse"].shape == (5, 1)


def test_a_server_that_is_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, url: str) -> None:
    store = Store(url).results
    missing = Store("s3://no-such-bucket/x").results
    with pytest.raises(StoreUnavailableError):
        missing.put(NAME, b"block")
    assert missing.get(NAME) is None
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{nobody.getsockname()[1]}")
        fsspec.filesystem("s3").clear_instance_cache()
        gone = Store("s3://bucket/x").results
        for action in (
            lambda: gone.put(NAME, b"block"),
            lambda: gone.get(NAME),
            lambda: gone.has(NAME),
            lambda: gone.remove(NAME),
            lambda: list(gone.entries()),
        ):
            with pytest.raises(StoreUnavailableError) as raised:
                action()
            # A worker that has such an error follows its causes, and would never come to an end.
            assert len(set(causes(raised.value))) == len(causes(raised.value)) < 20
    fsspec.filesystem("s3").clear_instance_cache()
    store.put(NAME, b"block")


def causes(error: BaseException) -> list[int]:
    """Return the identities of an error and its causes, 20 at most."""
    chain: list[int] = []
    cause: BaseException | None = error
    while cause is not None and len(chain) < 20:
        chain.append(id(cause))
        cause = cause.__cause__
    return chain


@pytest.fixture
def silent(monkeypatch: pytest.MonkeyPatch, s3: Any) -> Iterator[None]:
    """Let the server of the store be one that says nothing, as one that is cut off."""
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen(0)
        # Its queue of one connection is full.
        with socket.create_connection(listening.getsockname()):
            url = f"http://127.0.0.1:{listening.getsockname()[1]}"
            monkeypatch.setenv("AWS_ENDPOINT_URL", url)
            fsspec.filesystem("s3").clear_instance_cache()
            yield
    fsspec.filesystem("s3").clear_instance_cache()


def seconds_of(action: Callable[[], object]) -> float:
    """Return how long it takes to learn that the store cannot be reached."""
    started = time.monotonic()
    with pytest.raises(StoreUnavailableError):
        action()
    return time.monotonic() - started


@pytest.mark.usefixtures("silent")
def test_a_request_to_a_silent_server_is_given_up() -> None:
    """In time for the job to go elsewhere; later ones of a worker take as long.

    By default it would take minutes: attempts of a minute each.
    """
    blocks = Store("s3://bucket/x").chunks
    assert 2.0 < seconds_of(lambda: blocks.get(NAME)) < 60.0
    assert 2.0 < seconds_of(lambda: blocks.get(NAME)) < 60.0


@pytest.mark.usefixtures("silent")
def test_not_everybody_waits_for_a_silent_server() -> None:
    """Of the requests of a service one at a time does; others can go to another replica."""
    store = Store("s3://bucket/x", patient=False)
    seconds_of(lambda: store.chunks.get(NAME))
    with ThreadPoolExecutor(1) as pool:
        trial = pool.submit(seconds_of, lambda: store.results.get(NAME))
        while not store._outage._silence._next_trial:
            assert not trial.done()
            time.sleep(0.01)
        with pytest.raises(StoreUnavailableError):
            store.requests.put(NAME, b"block")
        assert not trial.done()  # nor has this one waited for the server
        assert trial.result() > 2.0


def test_a_silent_server_that_speaks_again() -> None:
    outage = Outage(patient=False)

    def ask(error: type[OSError] | None, seconds: float = 0.0) -> None:
        with outage.requests():
            time.sleep(seconds)
            if error is not None:
                raise error

    with pytest.raises(StoreUnavailableError):
        ask(TimeoutError, 2.1)
    with outage.requests(), pytest.raises(StoreUnavailableError):
        ask(None)  # beside the one that tries it
    with outage.requests():
        ask(None)  # as the other one was answered


def test_a_long_trial_keeps_others_waiting_for_some_seconds_only(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It may be the transfer of much from a server that has long been back."""
    monkeypatch.setattr("vibroimpact_service.store.faults._TRIAL_SECONDS", 0.2)
    monkeypatch.setattr("vibroimpact_service.store.faults._LONG_SECONDS", 0.0)
    outage = Outage(patient=False)

    def fail() -> None:
        with outage.requests():
            time.sleep(0.01)
            raise TimeoutError

    with pytest.raises(StoreUnavailableError):
        fail()
    assert outage.known
    with outage.requests():
        time.sleep(0.3)
        with outage.requests():
            assert outage.known
        assert not outage.known


def test_a_trial_that_fails_after_another_was_answered_says_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("vibroimpact_service.store.faults._LONG_SECONDS", 0.0)
    outage = Outage(patient=False)

    def fail_late() -> None:
        with outage.requests():
            with outage.requests():
                time.sleep(0.01)
            raise TimeoutError

    with pytest.raises(StoreUnavailableError):
        fail_late()
    assert not outage.known
