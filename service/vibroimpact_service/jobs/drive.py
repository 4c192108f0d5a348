"""Drives one job from its claim to its end: cut, compute what is missing, put together."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from typing import Any

import structlog

from vibroimpact_service.jobs import ledger
from vibroimpact_service.jobs.engine import Engine, EngineUnavailableError, WorkerLostError
from vibroimpact_service.jobs.records import JobRow
from vibroimpact_service.jobs.work import Work
from vibroimpact_service.jobs.writer import Writer
from vibroimpact_service.store import Store

log = structlog.get_logger("vibroimpact.jobs")

_IN_FLIGHT = 8  # bundles of one job given to the engine at a time
_PROGRESS_SECONDS = 0.2
_LOOK_SECONDS = 0.25  # how soon a cancelled job notices while nothing ends
_FAST_SECONDS = 1.0  # planned work below it goes through the fast lane


class LeaseLostError(RuntimeError):
    """Someone else drives the job now."""


class StoppedError(RuntimeError):
    """The job was cancelled, or the process is closing."""


class Drive:
    """The run of one job, in a thread of its own."""

    def __init__(
        self, job: JobRow, me: str, writer: Writer, engine: Engine, store: Store, work: Work,
        changed: Callable[[str], None],
    ) -> None:  # fmt: skip
        self.job = job
        self._me, self._writer, self._engine = me, writer, engine
        self._store, self._work, self._changed = store, work, changed
        self.lost = threading.Event()
        self.cancelled = threading.Event()
        self.closing = threading.Event()
        self._reported = 0.0

    def run(self) -> None:
        """Drive the job to an end, or give it back."""
        job = self.job
        try:
            reused = self._store.results.has(job.result)
            if not reused:
                self._compute()
            self._update(state="succeeded", phase="done", done=1, total=1, reused=reused)
        except LeaseLostError:
            log.warning("lease lost", job=job.id)
        except StoppedError:
            if self.cancelled.is_set():
                self._finish(state="cancelled", phase="done")
            else:
                self._finish(state="queued", phase="waiting")
        except EngineUnavailableError:
            self._finish(state="queued", phase="waiting")
        except Exception as error:
            log.info("job failed", job=job.id, error=type(error).__name__)
            problem = self._work.explain(error)
            self._finish(state="failed", phase="done", error=problem)

    def _compute(self) -> None:
        job, url = self.job, self._store.url
        self._update(phase="planning")
        names = self._work.split(url, job.kind, job.request, job.result)
        missing = [i for i, name in enumerate(names) if not self._store.chunks.has(name)]
        if missing:
            self._chunks(missing, len(names))
        self._update(phase="joining", done=len(names), total=len(names))
        self._work.join(url, job.kind, job.request, job.result, names)
        for name in names:
            self._store.chunks.remove(name)

    def _chunks(self, missing: list[int], total: int) -> None:
        """Compute the missing chunks, a bounded number of bundles at a time."""
        job = self.job
        lane = "fast" if job.seconds < _FAST_SECONDS else "bulk"
        waiting = list(reversed(missing))
        flying: dict[str, Any] = {}
        ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
        suspects: list[int] = []
        done = total - len(missing)
        try:
            while waiting or flying:
                self._check()
                while waiting and len(flying) < _IN_FLIGHT:
                    index = waiting.pop()
                    # A key of an earlier attempt must not come back: Dask would take the
                    # cancelled call for this one.
                    key = f"{job.id}-{job.attempts}-{index}"
                    arguments = (self._store.url, job.kind, job.request, job.result, [index])
                    flying[key] = self._engine.submit(
                        key, lane, job.priority, ended.put, self._work.solve, *arguments
                    )
                for future in _drain(ended):
                    del flying[future.key]
                    error = self._engine.outcome(future)
                    future.release()
                    if isinstance(error, WorkerLostError):
                        suspects.append(int(future.key.rsplit("-", 1)[1]))
                    elif error is not None:
                        raise error
                    else:
                        done += 1
                self._progress(done, total)
        finally:
            self._engine.forget(list(flying.values()))
        for index in suspects:
            self._alone(index)
            done += 1
            self._progress(done, total)

    def _alone(self, index: int) -> None:
        """Compute a chunk that was there when workers died, with no other suspect beside it.

        Dask blames whatever a dead worker held. Alone, only the guilty chunk fails again.
        """
        job = self.job
        ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
        while not self._engine.quarantine.acquire(timeout=_LOOK_SECONDS):
            self._check()
        try:
            key = f"{job.id}-{job.attempts}-alone-{index}"
            arguments = (self._store.url, job.kind, job.request, job.result, [index])
            future = self._engine.submit(
                key, "bulk", job.priority, ended.put, self._work.solve, *arguments
            )
            try:
                while not _drain(ended):
                    self._check()
                error = self._engine.outcome(future)
            finally:
                self._engine.forget([future])
        finally:
            self._engine.quarantine.release()
        if error is not None:
            raise error

    def _progress(self, done: int, total: int) -> None:
        if time.monotonic() - self._reported > _PROGRESS_SECONDS:
            self._reported = time.monotonic()
            self._update(phase="computing", done=done, total=total)

    def _check(self) -> None:
        if self.lost.is_set():
            raise LeaseLostError
        if self.cancelled.is_set() or self.closing.is_set():
            raise StoppedError

    def _update(self, **values: Any) -> None:
        self._check()
        self._write(**values)

    def _finish(self, **values: Any) -> None:
        try:
            self._write(**values)
        except LeaseLostError:
            log.warning("lease lost at the end", job=self.job.id)

    def _write(self, **values: Any) -> None:
        mine = self._writer.submit(ledger.update(self._me, self.job.id, **values)).result()
        if not mine:
            raise LeaseLostError
        self._changed(self.job.id)


def _drain(ended: queue.SimpleQueue[Any]) -> list[Any]:
    """Return what ended, waiting a moment for the first."""
    found: list[Any] = []
    try:
        found.append(ended.get(timeout=_LOOK_SECONDS))
        while True:
            found.append(ended.get_nowait())
    except queue.Empty:
        return found
