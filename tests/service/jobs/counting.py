"""A small honest work for the queue: sums of squares of consecutive integers, by chunks.

A request is the canonical JSON of {"n", "chunk", "sleep", "burn", "poison", "signal", "hungry",
"pad", "fail", "chained"}; chained chunks refuse to be computed before the one in front of them is
there, a hungry one needs more memory than there is, and each has so many digits as its pad says.
"""

from __future__ import annotations

import hashlib
import json
import signal
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vibroimpact_service.jobs.work import Chunk, ChunkMissingError, Work
from vibroimpact_service.store import Store
from vibroimpact_solvers.plan import Tick


class WrongRequestError(ValueError):
    """The request cannot be computed."""


def _request(url: str, request: str) -> dict[str, Any]:
    data = Store(url).requests.get(request)
    assert data is not None
    return dict(json.loads(data))


def split(url: str, kind: str, request: str, result: str) -> Sequence[Chunk]:
    asked = _request(url, request)
    if asked.get("fail"):
        raise WrongRequestError(asked["fail"])
    count = -(-asked["n"] // asked["chunk"])
    names = [hashlib.sha256(f"{result} {i} {count}".encode()).hexdigest() for i in range(count)]
    return [Chunk(name, chained=bool(asked.get("chained"))) for name in names]


def solve(
    url: str, kind: str, request: str, result: str, indices: Sequence[int], tick: Tick | None
) -> None:
    asked, chunks = _request(url, request), split(url, kind, request, result)
    for index in indices:
        if asked.get("log"):
            with Path(asked["log"]).open("a") as log:
                log.write(f"{index}\n")
        time.sleep(asked.get("sleep", 0.0))
        began = time.thread_time()
        while time.thread_time() < began + asked.get("burn", 0.0):
            if tick is not None:
                tick(0, 1)
        if asked.get("chained") and index and not Store(url).chunks.has(chunks[index - 1].name):
            raise WrongRequestError(f"chunk {index} before chunk {index - 1}")
        if asked.get("poison") == index:
            # With os.kill another thread may get it, and this one goes on for a moment.
            signal.raise_signal(signal.Signals[asked.get("signal", "SIGSEGV")])
        if asked.get("hungry") == index:
            bytearray(2**40)
        start = index * asked["chunk"]
        numbers = range(start, min(start + asked["chunk"], asked["n"]))
        data = str(sum(i * i for i in numbers)).zfill(asked.get("pad", 0)).encode()
        Store(url).chunks.put(chunks[index].name, data, durable=False)


def join(url: str, kind: str, request: str, result: str, chunks: Sequence[Chunk]) -> None:
    store = Store(url)
    total = 0
    for chunk in chunks:
        data = store.chunks.get(chunk.name)
        if data is None:
            raise ChunkMissingError(chunk.name)
        total += int(data)
    store.results.put(result, str(total).encode())


def explain(error: BaseException) -> dict[str, Any]:
    return {"code": type(error).__name__, "detail": str(error)}


WORK = Work(split, solve, join, explain)
