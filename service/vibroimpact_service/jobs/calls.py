"""What is called in the workers: a job cut, a bundle of chunks, the join, several quick jobs."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from vibroimpact_service.jobs.work import Chunk, StoppedError, Tick, Work
from vibroimpact_service.store import Store, StoreFullError, StoreUnavailableError

Names = tuple[str, str, str, str]
"""Store, kind, request and result of a job."""

PASSING = (StoreFullError, StoreUnavailableError)
"""What can go wrong with a job through no fault of its own: it is tried again later."""


class PartlyDoneError(Exception):
    """Some of several jobs did not succeed.

    Parameters
    ----------
    failed : dict
        Position -> problem document.
    delayed : dict
        Position -> why it must be tried again later.
    """

    def __init__(self, failed: dict[int, dict[str, Any]], delayed: dict[int, str]) -> None:
        super().__init__(failed, delayed)
        self.failed, self.delayed = failed, delayed


def cut(work: Work, names: Names, _tick: Tick) -> tuple[list[Chunk], list[int]]:
    """Return the chunks of a job, and which of them are not there yet."""
    chunks = list(work.split(*names))
    store = Store(names[0]).chunks
    there = store.present([chunk.name for chunk in chunks])
    for name in there:
        store.touch(name)  # those that nobody uses are removed first
    return chunks, [i for i, chunk in enumerate(chunks) if chunk.name not in there]


def compute(work: Work, names: Names, indices: Sequence[int], tick: Tick) -> float:
    """Compute some chunks; return the seconds it took."""
    started = time.perf_counter()
    work.solve(*names, indices, tick)
    return time.perf_counter() - started


def join(work: Work, names: Names, chunks: Sequence[Chunk], _tick: Tick) -> None:
    """Put a job together; remove the chunks that are of no use to others."""
    work.join(*names, chunks)
    store = Store(names[0])
    for chunk in chunks:
        if not chunk.lasting:
            store.chunks.remove(chunk.name)


def whole(work: Work, jobs: Sequence[Names], tick: Tick) -> None:
    """Compute several jobs, each from its beginning to its end.

    Raises
    ------
    PartlyDoneError
        Where not all of them succeeded. It travels with the message that the call ended,
        while a returned value would have to be fetched.
    """
    failed: dict[int, dict[str, Any]] = {}
    delayed: dict[int, str] = {}
    for position, names in enumerate(jobs):
        try:
            chunks, missing = cut(work, names, tick)
            if missing:
                work.solve(*names, missing, tick)
            join(work, names, chunks, tick)
        except StoppedError:
            raise
        except PASSING as error:
            delayed[position] = str(error.strerror or error)
        except Exception as error:
            failed[position] = work.explain(error)
    if failed or delayed:
        raise PartlyDoneError(failed, delayed)
