"""What runs in a worker process: its preparation, and calls that split, compute and join jobs."""

from __future__ import annotations

import errno
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import pairwise
from typing import Any, Final

from distributed import WorkerPlugin

from vibroimpact_service.jobs.deaths import TOPIC
from vibroimpact_service.jobs.process_limits import call_ended, limit_call, limit_memory
from vibroimpact_service.jobs.work import TRANSIENT_ERRORS, Chunk, ChunkMissingError, Work
from vibroimpact_service.store import Store, StoreUnavailableError
from vibroimpact_solvers import meter
from vibroimpact_solvers.meter import LimitPassedError, StoppedError, StopSignal
from vibroimpact_solvers.plan import Tick

JobArguments = tuple[str, str, str, str]
"""Store URL, kind, request and result: the first arguments of all functions of `Work`."""

JOINS: Final = 3
"""How often the chunks that cannot be read are computed again before the job has to wait."""
DAMAGED: Final = StoreUnavailableError(errno.EIO, "the store damages chunks of the job")
USE: Final = "vibroimpact-use"
"""Topic of the events ``{"call": key, "used": [processor time of each job of the call]}``."""
_running: Final[dict[str, float]] = {}
"""Keys of the calls that threads of this process execute, and the time that each may take."""
_tell: Final[list[Callable[[str, dict[str, Any]], None]]] = []
"""How the services learn what a call used, and which call a worker is ended for."""
_cancelled: Final[set[str]] = set()
"""Keys of those among them that the scheduler does not want any more."""


class ServicePlugin(WorkerPlugin):  # type: ignore[misc]
    """Prepares each worker, and takes note when the scheduler cancels a call that it executes.

    Parameters
    ----------
    prepare : callable
        Called once in every worker as it starts, in a thread of its own.
    """

    name = "vibroimpact"
    idempotent = True  # services that share a scheduler register it once

    def __init__(self, prepare: Callable[[], None]) -> None:
        self._prepare = prepare

    def setup(self, worker: Any) -> None:
        """Limit the memory of the worker, and begin to prepare it."""
        limit_memory(worker.memory_manager.memory_limit)

        def tell(topic: str, event: dict[str, Any]) -> None:
            worker.loop.add_callback(worker.log_event, topic, {"worker": worker.address} | event)

        _tell[:] = [tell]
        threading.Thread(target=self._prepare, name="prepare", daemon=True).start()

    def transition(self, key: Any, start: str, finish: str, **_: Any) -> None:
        """Take note of a new state of a call."""
        # What counts is that a call was taken away, not that it was never seen to be assigned:
        # a worker may execute calls of a scheduler that restarted before it has this plugin.
        if finish == "executing":
            _cancelled.discard(key)
        elif start == "executing" and key in _running:
            _cancelled.add(key)


def execute(function: Callable[..., Any], key: str, counted: bool, *args: Any) -> Any:
    """Call a function in a worker, with a `StopSignal` for a cancelled call as last argument.

    Where it is counted, the services are told what it used, however it ends.
    """
    _running[key], began = 0.0, meter.processor_time()

    def limit(seconds: float) -> None:
        _running[key] = seconds
        limit_call(key, seconds, _end)

    try:
        signal = StopSignal(cancelled=lambda: key in _cancelled, enforce=limit)
        return function(*args, signal)
    finally:
        call_ended()
        _running.pop(key, None)
        _cancelled.discard(key)
        if counted:
            ends = [*signal.shares, meter.processor_time()]
            used = [end - start for start, end in pairwise([began, *ends])]
            _told(USE, {"call": key, "used": used})


def _end(key: str) -> None:
    """Tell the services that this worker is ended for a call, which has used what it may."""
    _told(TOPIC, {"slow": key})
    _told(USE, {"call": key, "used": [_running.get(key, 0.0)]})


def _told(topic: str, event: dict[str, Any]) -> None:
    for tell in _tell:
        tell(topic, event)


def running_calls() -> list[str]:
    """Return the keys of the calls that threads of this worker execute, cancelled ones included."""
    return list(_running)


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


def split(work: Work, job: JobArguments, _tick: Tick) -> tuple[list[Chunk], list[int]]:
    """Return the chunks of a job, and the indices of those that are not stored yet."""
    chunks = list(work.split(*job))
    store = Store(job[0]).chunks
    stored = store.sound([chunk.name for chunk in chunks])
    for name in stored:
        store.touch(name)  # retention removes the chunks that were not used for longest
    return chunks, [i for i, chunk in enumerate(chunks) if chunk.name not in stored]


def compute(work: Work, job: JobArguments, indices: Sequence[int], tick: Tick) -> float:
    """Compute some chunks; return the seconds it took."""
    started = time.perf_counter()
    work.solve(*job, indices, tick)
    return time.perf_counter() - started


def join(work: Work, job: JobArguments, chunks: Sequence[Chunk], _tick: Tick) -> None:
    """Assemble the result of a job; remove the chunks that no other job can use."""
    work.join(*job, chunks)
    store = Store(job[0])
    for chunk in chunks:
        if not chunk.lasting:
            store.chunks.remove(chunk.name)


def check_size(size: int, most: int, done: int, total: int) -> None:
    """Check the size of the chunks of a job, of which some are done.

    Raises
    ------
    LimitPassedError
        Where they are larger than those of a job may be.
    """
    if size > most:
        what = f"Its pieces take {size:.3g} bytes, more than those of a job may"
        raise LimitPassedError(f"{what}: {done} of {total} pieces are kept.")


def _complete(work: Work, job: JobArguments, max_chunks_bytes: int, tick: Tick) -> None:
    for _ in range(JOINS):
        chunks, missing = split(work, job, tick)
        if missing:
            work.solve(*job, missing, tick)
        size = Store(job[0]).chunks.size_of_all([chunk.name for chunk in chunks])
        check_size(size, max_chunks_bytes, len(chunks), len(chunks))
        with suppress(ChunkMissingError):
            join(work, job, chunks, tick)
            return
    raise DAMAGED


def complete(work: Work, jobs: Sequence[JobArguments], max_chunks_bytes: int, tick: Tick) -> None:
    """Compute several jobs, each from splitting to joining.

    Those whose chunks are larger in all than the given size are given up.

    Raises
    ------
    PartlyDoneError
        Where not all of them succeeded. An exception travels with the message that the call
        ended, while a returned value would have to be fetched.
    """
    failed: dict[int, dict[str, Any]] = {}
    delayed: dict[int, str] = {}
    for position, job in enumerate(jobs):
        try:
            _complete(work, job, max_chunks_bytes, tick)
        except (StoppedError, MemoryError):
            raise  # the memory can have been another call's
        except TRANSIENT_ERRORS as error:
            delayed[position] = str(error.strerror or error)
        except Exception as error:
            failed[position] = work.explain(error)
        if isinstance(tick, StopSignal):
            tick.end_share()
    if failed or delayed:
        raise PartlyDoneError(failed, delayed)
