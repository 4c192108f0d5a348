"""The collection of garbage waits for large bodies, and comes back whatever happens."""

from __future__ import annotations

import asyncio
import gc
import threading
from pathlib import Path

import pytest

from vibroimpact_service.documents import parse
from vibroimpact_service.settings import Settings
from vibroimpact_service.use_case.threads import Threads


def test_nothing_is_collected_while_one_of_several_waits() -> None:
    seen = []
    with parse.uncollected():
        with parse.uncollected():
            seen.append(gc.isenabled())
        seen.append(gc.isenabled())
    assert seen == [False, False]
    assert gc.isenabled()


def test_threads_share_a_pause() -> None:
    both, left = threading.Barrier(2, timeout=60), threading.Event()
    seen = []

    def wait() -> None:
        with parse.uncollected():
            both.wait()
            left.wait(60)
            seen.append(gc.isenabled())

    other = threading.Thread(target=wait)
    other.start()
    with parse.uncollected():
        both.wait()
    seen.append(gc.isenabled())  # the other one has not left
    left.set()
    other.join()
    assert seen == [False, False]
    assert gc.isenabled()


def test_an_error_ends_the_pause() -> None:
    with pytest.raises(ValueError, match="so"), parse.uncollected():
        raise ValueError("so")
    assert gc.isenabled()


def test_who_has_switched_collection_off_finds_it_off() -> None:
    gc.disable()
    try:
        with parse.uncollected():
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()


def test_bodies_without_end_do_not_hold_it_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parse, "_LONGEST_PAUSE", 0.0)
    first, second = parse.uncollected(), parse.uncollected()
    with first:
        second.__enter__()  # as another thread would
    assert gc.isenabled()
    second.__exit__(None, None, None)
    assert gc.isenabled()


def test_large_bodies_are_parsed_without_looking_for_garbage(tmp_path: Path) -> None:
    """Counted, as the time depends on the machine: none of the oldest generation."""
    body = b"[" + b",".join([b"[0.5]"] * 400_000) + b"]"
    threads = Threads(Settings(data=tmp_path), lambda _outcome: None)

    async def scenario() -> int:
        return len(await threads.parse(body, lambda: parse.json(body)))

    gc.collect()
    before = gc.get_stats()[2]["collections"]
    try:
        assert asyncio.run(scenario()) == 400_000
    finally:
        threads.close()
    # Those on both sides of the pause may come to it.
    assert gc.get_stats()[2]["collections"] - before <= 1
    assert gc.isenabled()
