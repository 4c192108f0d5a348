"""Drives one job from its claim to its end: cut, compute what is missing, put together."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

import structlog

from vibroimpact_service.jobs import bundles, calls, lease
from vibroimpact_service.jobs.database import RecordsUnavailableError
from vibroimpact_service.jobs.engine import BULK, FAST, Call, Engine, EngineUnavailableError
from vibroimpact_service.jobs.records import JobRow
from vibroimpact_service.jobs.shares import Shares
from vibroimpact_service.jobs.work import Chunk, ChunkMissingError, Work, WorkerLostError
from vibroimpact_service.jobs.writer import Operation, Writer
from vibroimpact_service.store import Store, StoreFullError

log = structlog.get_logger("vibroimpact.jobs")

_PROGRESS_SECONDS: Final = 0.2
_LOOK_SECONDS: Final = 0.25  # how soon a drive notices that it must stop while nothing ends
_FAST_SECONDS: Final = 1.0  # planned work below it goes through the fast lane
_MEASURE_SECONDS: Final = 0.25
"""How often a sweep asks how long a bundle took: fetching that costs as much as all else of it."""
_FEW_CHUNKS: Final = 32
"""Chunks that are put together in the time of a quick job: a small job does not wait twice more."""
_UNMEASURED: Final = 8
"""Chunks of a bundle, at most, while only the plan tells how long they take."""
_JOINS: Final = 3
ALONE_TRIES: Final = 2
_RETRY_SECONDS: Final = 0.5
_LONGEST_DELAY: Final = 15.0


class LeaseLostError(RuntimeError):
    """The job was ended by somebody, or is driven by somebody else now."""


class ClosingError(RuntimeError):
    """The process stops; another one goes on with the job."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What all drives of a process share.

    Parameters
    ----------
    me : str
        Under which leases are held.
    tell : callable
        ``(jobs)``: these changed.
    supply : callable
        ``(request)``: sees to it that workers find what is asked.
    """

    me: str
    writer: Writer
    engine: Engine
    shares: Shares
    store: Store
    work: Work
    tell: Callable[[Collection[str]], None]
    supply: Callable[[str], None]


class Driver:
    """What drives of every sort have in common: stopping, and durable reports."""

    def __init__(self, held: Sequence[JobRow], around: Surroundings) -> None:
        self.held = {job.id: job for job in held}
        self.around = around
        self._ours = set(self.held)
        self._lost = threading.Event()
        self._closing = threading.Event()

    @property
    def seconds(self) -> float:
        """Planned work."""
        return sum(job.seconds for job in self.held.values())

    def lose(self, job: str) -> None:
        """Say that the lease of a job is lost: nothing written about it would count."""
        self._ours.discard(job)
        if not self._ours:
            self._lost.set()
            self.poke()

    def close(self) -> None:
        """Say that the process stops."""
        self._closing.set()
        self.poke()

    def poke(self) -> None:
        """Let it look around."""

    def check(self) -> None:
        """Raise where it must stop."""
        if self._lost.is_set():
            raise LeaseLostError
        if self._closing.is_set():
            raise ClosingError

    def write(self, operation: Operation) -> Any:
        """Do something to the records, however long they cannot be reached.

        Meanwhile the lease may run out and another replica take over, which the operation
        will find out: it is fenced.
        """
        while True:
            try:
                return self.around.writer.submit(operation).result()
            except (RecordsUnavailableError, StoreFullError):
                self.check()
                time.sleep(_RETRY_SECONDS)

    def supply(self, job: JobRow) -> None:
        """See to it that workers find what a job asks, however long the records are away."""
        while True:
            try:
                return self.around.supply(job.request)
            except RecordsUnavailableError:
                self.check()
                time.sleep(_RETRY_SECONDS)

    @contextmanager
    def quarantine(self) -> Iterator[None]:
        """Wait until no other suspect is computed, and see to it that none is."""
        lock = self.around.engine.quarantine
        while not lock.acquire(timeout=_LOOK_SECONDS):
            self.check()
        try:
            yield
        finally:
            lock.release()

    def put_back(
        self, held: Collection[str], seconds: float = 0.0, note: str | None = None
    ) -> None:
        """Queue jobs again."""
        back = self.write(lease.put_back(self.around.me, held, seconds, note))
        self.around.tell(back)


class Drive(Driver):
    """The run of one job, in a thread of its own."""

    def __init__(self, job: JobRow, around: Surroundings) -> None:
        super().__init__([job], around)
        self.job = job
        self._names = (around.store.url, job.kind, job.request, job.result)
        self._lane = FAST if job.seconds < _FAST_SECONDS else BULK
        self._ended: queue.SimpleQueue[Call | None] = queue.SimpleQueue()
        self._reported: Future[bool] | None = None
        self._reported_at = 0.0
        self._calls = 0
        self._kept = 0

    def poke(self) -> None:
        """Let it look around."""
        self._ended.put(None)

    def run(self) -> None:
        """Drive the job to an end, or give it back."""
        try:
            self._drive()
        except LeaseLostError:
            log.info("job no longer ours", job=self.job.id)
        except (ClosingError, EngineUnavailableError):
            self._give_up(lambda: self.put_back(self.held))
        except calls.PASSING as error:
            delay = min(_LONGEST_DELAY, 0.5 * 2.0 ** min(self.job.attempts, 10))
            note = str(error.strerror or error)
            log.warning("job delayed", job=self.job.id, reason=note)
            self._give_up(lambda: self.put_back(self.held, delay, note))
        except Exception as error:
            log.info("job failed", job=self.job.id, error=type(error).__name__)
            problem = self.around.work.explain(error)
            self._give_up(lambda: self._end(lease.fail(self.around.me, self.job.id, problem)))

    def _give_up(self, report: Callable[[], None]) -> None:
        try:
            report()
        except (LeaseLostError, ClosingError):
            log.info("job left to its lease", job=self.job.id)

    def _drive(self) -> None:
        reused = self.around.store.results.sound(self.job.result)
        if not reused:
            self._report(phase="planning", wait=False)
            self.supply(self.job)
            for attempt in range(_JOINS):
                # It was planned once already, for whoever submitted it, and that did not take long.
                chunks, missing = self._whole(FAST, calls.cut)
                if attempt == 0:
                    self._kept = len(chunks) - len(missing)
                self._compute(chunks, missing)
                try:
                    few = len(chunks) <= _FEW_CHUNKS
                    self._whole(FAST if few else self._lane, calls.join, chunks)
                    break
                except ChunkMissingError:
                    if attempt == _JOINS - 1:
                        raise
        self._end(lease.succeed(self.around.me, [self.job.id], reused))

    def _compute(self, chunks: Sequence[Chunk], missing: list[int]) -> None:
        if missing:
            _Sweep(self, chunks, missing).run()
        self._report(phase="joining", done=len(chunks), total=len(chunks), wait=False)

    def _end(self, operation: Operation) -> None:
        ended = self.write(operation)
        self.around.tell(ended)
        if self.job.id not in ended:
            raise LeaseLostError

    def submit(self, lane: str, priority: int, function: Callable[..., Any], *args: Any) -> Call:
        """Give a call to the workers; it comes to `next_ended` when it ended."""
        self._calls += 1
        # A key of an earlier attempt must not come back: Dask would take the call that was
        # given up for this one.
        key = f"{self.job.id}-{self.job.attempts}-{self._calls}"
        engine, work = self.around.engine, self.around.work
        return engine.submit(key, lane, priority, self._ended.put, function, work, *args)

    def next_ended(self) -> list[Call]:
        """Return calls that ended, after waiting a moment for the first."""
        found = []
        try:
            found.append(self._ended.get(timeout=_LOOK_SECONDS))
            while True:
                found.append(self._ended.get_nowait())
        except queue.Empty:
            return [call for call in found if call is not None]

    def _whole(self, lane: str, function: Callable[..., Any], *args: Any) -> Any:
        """Call a function for the whole job and return its value."""
        call = self.submit(lane, 0, function, self._names, *args)
        error = self._outcome(call)
        if isinstance(error, WorkerLostError):
            return self.alone(function, *args)
        if error is not None:
            raise error
        return self.around.engine.values([call])[0]

    def alone(self, function: Callable[..., Any], *args: Any) -> Any:
        """Repeat a call that was there when workers died, with no other suspect beside it.

        Dask blames whatever a dead worker held. Alone, only the guilty call fails again; twice,
        because a neighbour that is no suspect yet can be the one that kills.
        """
        with self.quarantine():
            for _ in range(ALONE_TRIES):
                call = self.submit(BULK, 0, function, self._names, *args)
                error = self._outcome(call)
                if not isinstance(error, WorkerLostError):
                    break
        if error is not None:
            raise error
        return self.around.engine.values([call])[0]

    def _outcome(self, call: Call) -> BaseException | None:
        try:
            while call not in self.next_ended():
                self.check()
        except BaseException:
            self.around.engine.forget([call])
            raise
        return self.around.engine.error(call)

    def progress(self, done: int, total: int) -> None:
        """Report how many chunks are there, now and then."""
        if time.monotonic() - self._reported_at > _PROGRESS_SECONDS:
            self._report(phase="computing", done=done, total=total, kept=self._kept, wait=False)

    @property
    def names(self) -> calls.Names:
        """Store, kind, request and result of the job."""
        return self._names

    @property
    def lane(self) -> str:
        """The lane of its chunks."""
        return self._lane

    def _report(self, *, wait: bool, **values: Any) -> None:
        """Record what the job does; the outcome is looked at when the next report is due."""
        self.check()
        self._reported_at = time.monotonic()
        last = self._reported
        if last is not None:
            if not last.done():
                return
            if last.exception() is None and not last.result():
                raise LeaseLostError
        operation = lease.report(self.around.me, self.job.id, **values)
        self._reported = self.around.writer.submit(operation)
        self._reported.add_done_callback(lambda _: self.around.tell([self.job.id]))


class _Sweep:
    """The computation of the missing chunks of a job, in bundles of about the same time."""

    def __init__(self, drive: Drive, chunks: Sequence[Chunk], missing: list[int]) -> None:
        self._drive, self._around = drive, drive.around
        self._waiting = missing[::-1]
        self._chained = any(chunk.chained for chunk in chunks)
        self._total = len(chunks)
        self._done = self._total - len(missing)
        self._flying: dict[str, tuple[Call, list[int]]] = {}
        self._suspects: list[int] = []
        planned = [chunks[i].seconds for i in missing if chunks[i].seconds > 0]
        # Before the first bundle came back, the plan is all that is known.
        self._seconds = sum(planned) / len(planned) if planned else bundles.SECONDS
        self._measured_at: float | None = None

    def run(self) -> None:
        """Compute them all."""
        owner, shares = self._drive.job.owner, self._around.shares
        shares.enter(owner, self._drive.poke)
        try:
            while self._waiting or self._flying:
                self._drive.check()
                self._send(owner)
                self._receive(self._drive.next_ended())
                self._drive.progress(self._done, self._total)
        finally:
            self._around.engine.forget([call for call, _ in self._flying.values()])
            for _ in self._flying:
                shares.give(owner)
            shares.leave(owner, self._drive.poke)
        for index in self._suspects:
            self._drive.alone(calls.compute, [index])
            self._done += 1
            self._drive.progress(self._done, self._total)

    def _send(self, owner: str) -> None:
        while self._waiting and not (self._chained and self._flying):
            before = self._around.shares.take(owner)
            if before is None:
                return
            size = self._bundle()
            bundle = [self._waiting.pop() for _ in range(size)]
            try:
                # The first bundle of a user goes before the second one of any other.
                call = self._drive.submit(
                    self._drive.lane, -before, calls.compute, self._drive.names, bundle
                )
            except BaseException:
                self._around.shares.give(owner)
                raise
            self._flying[call.key] = (call, bundle)

    def _bundle(self) -> int:
        """Return how many chunks the next call computes."""
        waiting = len(self._waiting)
        if self._chained:
            size = min(waiting, bundles.chunks(bundles.SECONDS, self._seconds))
        else:
            size = bundles.size(waiting, self._seconds, self._around.engine.slots)
        return size if self._measured_at is not None else min(size, _UNMEASURED)

    def _receive(self, ended: Sequence[Call]) -> None:
        well = []
        for call in ended:
            if call.key not in self._flying:
                continue
            _, bundle = self._flying[call.key]
            error = self._around.engine.error(call)
            if error is None:
                well.append((call, bundle))
                continue
            del self._flying[call.key]
            self._around.shares.give(self._drive.job.owner)
            if not isinstance(error, WorkerLostError):
                raise error
            self._suspects += bundle
            if self._chained:  # the others need these
                self._suspects += self._waiting[::-1]
                self._waiting.clear()
        for call, bundle in well:
            del self._flying[call.key]
            self._around.shares.give(self._drive.job.owner)
            self._done += len(bundle)
        if well:
            self._measure(*well[-1])
        for call, _ in well:
            call.future.release()

    def _measure(self, call: Call, bundle: list[int]) -> None:
        """Learn from a bundle, now and then, how long a chunk takes."""
        now = time.monotonic()
        if self._measured_at is not None and now - self._measured_at < _MEASURE_SECONDS:
            return
        try:
            (spent,) = self._around.engine.values([call])
        except EngineUnavailableError:
            return  # its worker is gone; what it computed is stored
        one = max(spent / len(bundle), 1e-5)
        self._seconds = one if self._measured_at is None else 0.5 * (self._seconds + one)
        self._measured_at = now
