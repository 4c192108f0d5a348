"""The store in buckets: a real server that speaks S3, as a process of its own."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fsspec
import pytest

from vibroimpact_service import chunks as job_chunks
from vibroimpact_service.documents import digest, requests
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.results import encode
from vibroimpact_service.store import Store, StoreUnavailableError

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
        monkeypatch.setenv("AWS_MAX_ATTEMPTS", "1")  # else botocore asks five times, with pauses
        fsspec.filesystem("s3").clear_instance_cache()
        gone = Store("s3://bucket/x").results
        with pytest.raises(StoreUnavailableError):
            gone.put(NAME, b"block")
        with pytest.raises(StoreUnavailableError):
            gone.get(NAME)
    fsspec.filesystem("s3").clear_instance_cache()
    store.put(NAME, b"block")
