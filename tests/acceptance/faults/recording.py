"""The computations of the service, slowed down, with notes of each chunk that begins or is stored.

The file is named by RECORD; each line is ``begun|stored result index pid time``. While there is a
file of the name RECORD_FAIL, chunks have an error.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

from vibroimpact_service.store import Store
from vibroimpact_service.use_case import chunks
from vibroimpact_solvers.plan import Tick

if "STORE_FAILS" in os.environ:
    import failing  # noqa: F401

# Small pieces, so that a job of a few seconds has many.
chunks.CHUNK_SECONDS = 0.01  # type: ignore[misc]

FAIL = os.environ.get("RECORD_FAIL", "")
SLEEP = float(os.environ.get("RECORD_SLEEP", "0.1"))


def solve(
    store_url: str,
    kind: str,
    request: str,
    result: str,
    indices: Sequence[int],
    tick: Tick | None = None,
) -> None:
    """Compute chunks one by one and note each as it begins."""
    pieces = chunks.split(store_url, kind, request, result)
    there = Store(store_url).chunks.sound([pieces[index].name for index in indices])
    for index in indices:
        if pieces[index].name in there:
            continue  # as the functions of the service do
        if Path(FAIL).is_file():
            raise RuntimeError("an error that nobody expects")
        _note("begun", result, index)
        end = time.monotonic() + SLEEP
        while time.monotonic() < end:
            time.sleep(0.01)
            if tick is not None:
                tick(0, 1)
        chunks.solve(store_url, kind, request, result, [index], tick)
        _note("stored", result, index)


def _note(what: str, result: str, index: int) -> None:
    line = f"{what} {result} {index} {os.getpid()} {time.time()}\n"
    os.write(_opened(), line.encode())


@cache
def _opened() -> int:
    """Return the file of the notes; it stays open for processes that can open no more files."""
    return os.open(os.environ["RECORD"], os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)


WORK = replace(chunks.WORK, solve=solve, modules=(*chunks.WORK.modules, __name__))
