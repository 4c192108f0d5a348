"""The run of one job: split it, compute the chunks that are missing, join them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Any, Final

from vibroimpact_service.jobs import batch_size, claims, worker_calls
from vibroimpact_service.jobs.engine import BULK, FAST, Call, EngineUnavailableError
from vibroimpact_service.jobs.run import ClaimLostError, Run, RunContext
from vibroimpact_service.jobs.tables import JobRow
from vibroimpact_service.jobs.work import Chunk, ChunkMissingError, WorkerLostError

_PROGRESS_SECONDS: Final = 0.2
_FAST_SECONDS: Final = 1.0
"""Planned work below which the chunks of a job are computed in the fast queue."""
_FEW_CHUNKS: Final = 32
"""Chunks that are joined as quickly as a quick job, and therefore in the fast queue."""
_JOINS: Final = 3
_MEASURE_SECONDS: Final = 0.25
"""Interval at which the duration of a batch is fetched: that costs as much as all else of it."""
_UNMEASURED: Final = 8
"""Largest batch while only the plan tells how long a chunk takes."""


class JobRun(Run):
    """The run of one job; see the module."""

    def __init__(self, job: JobRow, context: RunContext) -> None:
        super().__init__([job], context)
        self.job = job
        self.queue_name = FAST if job.seconds < _FAST_SECONDS else BULK
        self._reported: Future[bool] | None = None
        self._reported_at = 0.0
        self._kept = 0

    def _run(self) -> None:
        reused = self.context.store.results.readable(self.job.result)
        if not reused:
            self._report(phase="planning")
            self.ensure_request(self.job)
            for attempt in range(_JOINS):
                # The fast queue: it was planned when it was submitted, which took no long time.
                chunks, missing = self._call(FAST, worker_calls.split)
                if attempt == 0:
                    self._kept = len(chunks) - len(missing)
                if missing:
                    _ChunkBatches(self, chunks, missing).compute()
                self._report(phase="joining", done=len(chunks), total=len(chunks))
                try:
                    few = len(chunks) <= _FEW_CHUNKS
                    self._call(FAST if few else self.queue_name, worker_calls.join, chunks)
                    break
                except ChunkMissingError:
                    if attempt == _JOINS - 1:
                        raise
        self.succeed([self.job.id], reused=reused)

    def _call(self, queue_name: str, function: Callable[..., Any], *args: Any) -> Any:
        """Call a function for the job and return its value."""
        arguments = self.arguments(self.job)
        call = self.submit(queue_name, 0, function, arguments, *args)
        error = self.outcome(call)
        if isinstance(error, WorkerLostError):
            call, error = self.repeat_alone(function, arguments, *args)
        if error is not None:
            raise error
        return self.context.engine.values([call])[0]

    def progress(self, done: int, total: int) -> None:
        """Report how many chunks are stored, at intervals."""
        if time.monotonic() - self._reported_at > _PROGRESS_SECONDS:
            self._report(phase="computing", done=done, total=total, kept=self._kept)

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
        self._waiting = missing[::-1]
        self._chained = any(chunk.chained for chunk in chunks)
        self._total = len(chunks)
        self._done = self._total - len(missing)
        self._running: dict[str, tuple[Call, list[int]]] = {}
        self._suspects: list[int] = []
        planned = [chunks[i].seconds for i in missing if chunks[i].seconds > 0]
        # Until the first batch is measured, the plan is all that is known.
        self._seconds = sum(planned) / len(planned) if planned else batch_size.SECONDS
        self._measured_at: float | None = None

    def compute(self) -> None:
        """Compute them all."""
        self._share.join(self._owner, self._run.wake)
        try:
            while self._waiting or self._running:
                self._run.check()
                self._send()
                self._receive(self._run.ended_calls())
                self._run.progress(self._done, self._total)
        finally:
            self._engine.cancel([call for call, _ in self._running.values()])
            for _ in self._running:
                self._share.release(self._owner)
            self._share.leave(self._owner, self._run.wake)
        for index in self._suspects:
            arguments = self._run.arguments(self._run.job)
            _, error = self._run.repeat_alone(worker_calls.compute, arguments, [index])
            if error is not None:
                raise error
            self._done += 1
            self._run.progress(self._done, self._total)

    def _send(self) -> None:
        while self._waiting and not (self._chained and self._running):
            earlier = self._share.acquire(self._owner)
            if earlier is None:
                return
            batch = [self._waiting.pop() for _ in range(self._size())]
            arguments = self._run.arguments(self._run.job)
            try:
                # The first batch of a user precedes the second batch of any other user.
                call = self._run.submit(
                    self._run.queue_name, -earlier, worker_calls.compute, arguments, batch
                )
            except BaseException:
                self._share.release(self._owner)
                raise
            self._running[call.key] = (call, batch)

    def _size(self) -> int:
        """Return how many chunks the next batch has."""
        waiting = len(self._waiting)
        if self._chained:
            size = min(waiting, batch_size.chunks(batch_size.SECONDS, self._seconds))
        else:
            size = batch_size.size(waiting, self._seconds, self._engine.workers)
        return size if self._measured_at is not None else min(size, _UNMEASURED)

    def _receive(self, ended: Sequence[Call]) -> None:
        succeeded = []
        for call in ended:
            if call.key not in self._running:
                continue
            _, batch = self._running.pop(call.key)
            self._share.release(self._owner)
            error = self._engine.error(call)
            if error is None:
                self._done += len(batch)
                succeeded.append((call, batch))
            elif isinstance(error, WorkerLostError):
                self._suspects += batch
                if self._chained:  # the others need these
                    self._suspects += self._waiting[::-1]
                    self._waiting.clear()
            else:
                raise error
        if succeeded:
            self._measure(*succeeded[-1])
        for call, _ in succeeded:
            call.release()

    def _measure(self, call: Call, batch: list[int]) -> None:
        """Learn from a batch, at intervals, how long a chunk takes."""
        now = time.monotonic()
        if self._measured_at is not None and now - self._measured_at < _MEASURE_SECONDS:
            return
        try:
            (spent,) = self._engine.values([call])
        except EngineUnavailableError:
            return  # its worker is gone; the chunks that it computed are stored
        each = max(spent / len(batch), 1e-5)
        self._seconds = each if self._measured_at is None else 0.5 * (self._seconds + each)
        self._measured_at = now
