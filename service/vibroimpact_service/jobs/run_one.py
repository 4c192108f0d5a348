"""The run of one job: split it, compute the chunks that are missing, join them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from typing import Any, Final

from opentelemetry.trace import Span

from vibroimpact_service.jobs import claims, traces, worker
from vibroimpact_service.jobs.engine import BULK, FAST, Call, EngineUnavailableError
from vibroimpact_service.jobs.run import (
    MAX_DEATH_DELAY,
    ClaimLostError,
    Run,
    RunContext,
    suspect,
)
from vibroimpact_service.jobs.tables import JobRow
from vibroimpact_service.jobs.work import Chunk, ChunkMissingError, WorkerLostError
from vibroimpact_solvers.meter import LimitPassedError

_PROGRESS_SECONDS: Final = 0.2
"""Interval at which the progress of a run that has just begun is recorded."""
_PROGRESS_PART: Final = 0.02
"""Interval of a run that takes longer, as a part of its time so far: each record is a transaction,
and a query and a message for everybody who follows the job."""
_MAX_PROGRESS_SECONDS: Final = 2.0
_FAST_SECONDS: Final = 1.0
"""Planned work below which the chunks of a job are computed in the fast queue."""
_FEW_CHUNKS: Final = 32
"""Chunks that are joined as quickly as a quick job, and therefore in the fast queue."""
_MEASURE_SECONDS: Final = 0.25
"""Interval at which the duration of a batch is fetched: that costs as much as all else of it."""
_FIRST_DELAY: Final = 0.05
"""Pause after the death of a worker that is not the job's fault; it grows from one to the next."""
_UNMEASURED: Final = 8
"""Largest batch while only the plan tells how long a chunk takes."""
BATCH_SECONDS: Final = 0.2
"""Duration of a batch with few workers."""
MAX_BATCH_RATE: Final = 100.0
"""Batches submitted per second, at most, for all workers together."""
_MAX_BATCH: Final = 5000
_LAST_BATCH: Final = 0.25
"""Lower limit of the last batches of a job, as a fraction of the duration for many workers."""


class JobRun(Run):
    """The run of one job; see the module."""

    def __init__(self, job: JobRow, context: RunContext) -> None:
        super().__init__([job], context)
        self.job = job
        self.queue_name = FAST if job.seconds < _FAST_SECONDS else BULK
        self._reported: Future[bool] | None = None
        self._reported_at = 0.0
        self._told: dict[str, Any] = {}
        self._kept = 0

    def _run(self) -> None:
        reused = self.context.store.results.readable(self.job.result)
        if not reused:
            self._report(phase="planning")
            self.ensure_request(self.job)
            for attempt in range(worker.JOINS):
                # The fast queue: it was planned when it was submitted, which took no long time.
                chunks, missing = self._call(FAST, worker.split)
                if attempt == 0:
                    self._kept = len(chunks) - len(missing)
                _ChunkBatches(self, chunks, missing).compute()
                self._report(phase="joining", done=len(chunks), total=len(chunks))
                few = len(chunks) <= _FEW_CHUNKS
                with suppress(ChunkMissingError):
                    self._call(FAST if few else self.queue_name, worker.join, chunks)
                    break
            else:
                raise worker.DAMAGED
        self.succeed([self.job.id], reused=reused)

    def _call(self, queue_name: str, function: Callable[..., Any], *args: Any) -> Any:
        """Call a function for the job and return its value."""
        arguments = self.arguments(self.job)
        call, error = self.call(queue_name, function, arguments, *args)
        if suspect(error):
            call, error = self.repeat_alone(function, arguments, *args)
        if error is not None:
            raise error
        return self.context.engine.values([call])[0]

    def progress(self, done: int, total: int) -> None:
        """Report how many chunks are stored, at intervals, where there are more than before."""
        now = time.monotonic()
        values = {"phase": "computing", "done": done, "total": total, "kept": self._kept}
        if values != self._told and now - self._reported_at > progress_seconds(now - self._began):
            self._report(**values)

    def _report(self, **values: Any) -> None:
        """Record the progress; its outcome is checked when the next report is due."""
        self.check()
        self._reported_at = time.monotonic()
        last = self._reported
        if last is not None:
            if not last.done():
                return
            if last.exception() is None and not last.result():
                raise ClaimLostError
        self._told = values
        claim_owner, records = self.context.claim_owner, self.context.records
        self._reported = records.submit(claims.report, claim_owner, self.job.id, values)
        self._reported.add_done_callback(lambda _: self.context.notify([self.job.id]))


class _ChunkBatches:
    """Sends chunks to the workers, as many batches at a time as the user's share allows.

    Parameters
    ----------
    run : JobRun
    chunks : sequence of Chunk
        All chunks of the job.
    missing : list of int
        Indices of those that are to be computed.
    """

    def __init__(self, run: JobRun, chunks: Sequence[Chunk], missing: list[int]) -> None:
        self._run, self._engine = run, run.context.engine
        self._share, self._owner = run.context.fair_share, run.job.owner
        self._names = [chunk.name for chunk in chunks]
        self._planned = [chunk.seconds for chunk in chunks]
        self._size = self._size_of(set(range(len(chunks))) - set(missing))
        self._waiting = missing[::-1]
        self._chained = any(chunk.chained for chunk in chunks)
        self._total = len(chunks)
        self._done = self._total - len(missing)
        self._running: dict[str, tuple[Call, list[int], Span]] = {}
        self._suspects: list[int] = []
        self._delay = _FIRST_DELAY
        planned = [chunks[i].seconds for i in missing if chunks[i].seconds > 0]
        # Until the first batch is measured, the plan is all that is known.
        self._seconds = sum(planned) / len(planned) if planned else BATCH_SECONDS
        self._measured_at: float | None = None

    def compute(self) -> None:
        """Compute them all."""
        self._count([])  # what is kept may be too much already
        self._share.join(self._owner, self._run.wake)
        try:
            while self._waiting or self._running:
                self._run.check()
                self._send()
                self._receive(self._run.ended_calls())
                self._run.progress(self._done, self._total)
        finally:
            self._engine.cancel([call for call, _, _ in self._running.values()])
            for _, _, span in self._running.values():
                traces.end(span)
                self._share.release(self._owner)
            self._share.leave(self._owner, self._run.wake)
        for index in self._suspects:
            arguments = self._run.arguments(self._run.job)
            _, error = self._run.repeat_alone(worker.compute, arguments, [index])
            if error is not None:
                raise self._explained(error)
            self._count([index])
            self._run.progress(self._done, self._total)

    def _send(self) -> None:
        while self._waiting and not (self._chained and self._running):
            earlier = self._share.acquire(self._owner)
            if earlier is None:
                return
            batch = [self._waiting.pop() for _ in range(self._batch_size())]
            arguments = self._run.arguments(self._run.job)
            try:
                # The first batch of a user precedes the second batch of any other user.
                call = self._run.submit(
                    self._run.queue_name, -earlier, worker.compute, arguments, batch
                )
            except BaseException:
                self._share.release(self._owner)
                raise
            span = traces.batch(self._run.spans[self._run.job.id], len(batch))
            self._running[call.key] = (call, batch, span)

    def _batch_size(self) -> int:
        """Return how many chunks the next batch has."""
        waiting = len(self._waiting)
        if self._chained:
            size = min(waiting, chunks_in(BATCH_SECONDS, self._seconds))
        else:
            size = batch_size(waiting, self._seconds, self._engine.workers)
        return size if self._measured_at is not None else min(size, _UNMEASURED)

    def _receive(self, ended: Sequence[Call]) -> None:
        succeeded = []
        for call in ended:
            if call.key not in self._running:
                continue
            _, batch, span = self._running.pop(call.key)
            self._share.release(self._owner)
            error = self._engine.error(call)
            traces.end(span, error)
            if error is None:
                self._count(batch)
                succeeded.append((call, batch))
            elif self._run.lost(error):
                self._waiting += batch[::-1]
                self._run.pause(self._delay)
                self._delay = min(MAX_DEATH_DELAY, 2.0 * self._delay)
            elif suspect(error):
                self._suspects += batch
                if self._chained:  # the others need these
                    self._suspects += self._waiting[::-1]
                    self._waiting.clear()
            else:
                raise self._explained(error)
        if succeeded:
            self._measure(*succeeded[-1])
        for call, _ in succeeded:
            call.release()

    def _size_of(self, indices: Iterable[int]) -> int:
        names = [self._names[index] for index in indices]
        return self._run.context.store.chunks.size_of_all(names)

    def _count(self, batch: list[int]) -> None:
        """Count chunks that were stored.

        Raises
        ------
        LimitPassedError
            Where all of them are larger than those of a job may be.
        """
        self._done += len(batch)
        self._size += self._size_of(batch)
        most = self._run.context.max_chunks_bytes
        worker.check_size(self._size, most, self._done, self._total)

    def _kept(self) -> str:
        return f"{self._done} of {self._total} pieces are kept."

    def _explained(self, error: BaseException) -> BaseException:
        """Return the error of a chunk that failed alone, as the limit that it passed if it did."""
        if isinstance(error, MemoryError):
            return LimitPassedError(f"A piece needs more memory than a worker has: {self._kept()}")
        if isinstance(error, WorkerLostError) and "SIGXCPU" in error.why:
            what = "A piece took so much processor time that its worker was ended"
            return LimitPassedError(f"{what}: {self._kept()}")
        return error

    def _measure(self, call: Call, batch: list[int]) -> None:
        """Learn from a batch, at intervals, how long a chunk takes."""
        now = time.monotonic()
        if self._measured_at is not None and now - self._measured_at < _MEASURE_SECONDS:
            return
        try:
            (spent,) = self._engine.values([call])
        except EngineUnavailableError:
            return  # its worker is gone; the chunks that it computed are stored
        planned = sum(self._planned[index] for index in batch)
        self._run.context.metrics.chunks(self._run.job.kind, len(batch), planned, spent)
        each = max(spent / len(batch), 1e-5)
        self._seconds = each if self._measured_at is None else 0.5 * (self._seconds + each)
        self._measured_at = now


def progress_seconds(elapsed: float) -> float:
    """Return the interval at which the progress of a run is recorded after so many seconds."""
    return min(_MAX_PROGRESS_SECONDS, max(_PROGRESS_SECONDS, _PROGRESS_PART * elapsed))


def batch_seconds(workers: int) -> float:
    """Return the duration of a batch where so many are computed at once."""
    return max(BATCH_SECONDS, workers / MAX_BATCH_RATE)


def chunks_in(duration: float, each: float) -> int:
    """Return how many chunks of `each` seconds take that long; at least one."""
    return min(_MAX_BATCH, max(1, int(duration / each)))


def batch_size(waiting: int, each: float, workers: int) -> int:
    """Return how many chunks the next batch of a job has: 0.2 s of them, more for many workers.

    One process submits all batches, and each takes it a few milliseconds. With batches of a fixed
    duration the rate of submission would grow with the number of workers until they wait for it.
    The duration therefore grows with the number of workers instead, and the rate stays below
    `MAX_BATCH_RATE`. A user who waits for a share of many workers does not wait longer for it: as
    many batches end per second as before.

    Parameters
    ----------
    waiting : int
        Chunks that are left, at least one.
    each : float
        Seconds that one takes.
    workers : int
        Batches that are computed at once.
    """
    most = chunks_in(batch_seconds(workers), each)
    # The last batches are smaller, so that all workers end at about the same time, but not so
    # small that submitting them takes longer than what they save.
    share = math.ceil(waiting / (2 * max(1, workers)))
    least = chunks_in(_LAST_BATCH * workers / MAX_BATCH_RATE, each)
    return min(waiting, most, max(share, least))
