"""Jobs of many chunks that only keep a core busy: what remains is the cost of the queue."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Sequence
from typing import Any

from vibroimpact_service.jobs.work import Chunk, Tick, Work
from vibroimpact_service.store import Store


def _content(url: str, request: str) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(Store(url).requests.get(request) or b"{}")
    return content


def split(url: str, kind: str, request: str, result: str) -> Sequence[Chunk]:
    """Return as many chunks as the request says."""
    content = _content(url, request)
    names = (hashlib.sha256(f"{result}{i}".encode()).hexdigest() for i in range(content["chunks"]))
    return [Chunk(name, content["seconds"]) for name in names]


def solve(
    url: str, kind: str, request: str, result: str, indices: Sequence[int], tick: Tick | None
) -> None:
    """Keep a core busy for each chunk."""
    content, store = _content(url, request), Store(url)
    for index in indices:
        end = time.thread_time() + content["seconds"]
        while time.thread_time() < end:
            if tick is not None:
                tick(0, 1)
        name = hashlib.sha256(f"{result}{index}".encode()).hexdigest()
        store.chunks.put(name, b"done")


def join(url: str, kind: str, request: str, result: str, chunks: Sequence[Chunk]) -> None:
    """Store a result."""
    Store(url).results.put(result, str(len(chunks)).encode())


def explain(error: BaseException) -> dict[str, Any]:
    """Return what went wrong."""
    return {"detail": repr(error)}


def nothing(tick: Tick) -> None:
    """Do nothing: what remains of a call is the way to a worker and back."""


WORK = Work(split, solve, join, explain, modules=(__name__,))
