"""What all runs of claimed jobs have in common: stopping, calls of workers, durable records."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, TypeVar

import structlog
from opentelemetry.trace import Span

from vibroimpact_service.jobs import attempts, claims, records, traces, worker
from vibroimpact_service.jobs.accounts import Accounts
from vibroimpact_service.jobs.database import RecordsUnavailableError
from vibroimpact_service.jobs.engine import BULK, Call, Engine, EngineUnavailableError
from vibroimpact_service.jobs.fair_share import FairShare
from vibroimpact_service.jobs.metrics import JobMetrics
from vibroimpact_service.jobs.record_access import RecordAccess
from vibroimpact_service.jobs.tables import JobRow
from vibroimpact_service.jobs.work import TRANSIENT_ERRORS, Work, WorkerLostError
from vibroimpact_service.store import Store, StoreFullError

Value = TypeVar("Value")
Changed = TypeVar("Changed", bound=Collection[str])

log = structlog.get_logger("vibroimpact.jobs")

_STOP_SECONDS: Final = 0.25  # how soon a run notices that it must stop while no call ends
_RETRY_SECONDS: Final = 0.5
_WORKERS_SECONDS: Final = 10.0  # in which workers that died are replaced
_MAX_DELAY: Final = 15.0
MAX_DEATH_DELAY: Final = 2.0
"""Longest pause after deaths of workers that are not the job's fault."""
_ATTEMPTS_ALONE: Final = 5  # calls beside it that were not suspected so far can end each
SUSPECT_ERRORS: Final = (WorkerLostError, MemoryError)
"""Failures that another call in the same worker process may have brought about."""


def suspect(error: BaseException | None) -> bool:
    """Whether another call in the same worker process may have brought an error about."""
    return isinstance(error, SUSPECT_ERRORS) and not getattr(error, "guilty", False)


class ClaimLostError(RuntimeError):
    """The job was ended, or its claim expired and another process has it now."""


class ClosingError(RuntimeError):
    """The process stops; another one continues the job."""


@dataclass(frozen=True, slots=True)
class RunContext:
    """What all runs of a process share.

    Parameters
    ----------
    claim_owner : str
        Name of the process in the claims.
    records : RecordAccess
    engine : Engine
    fair_share : FairShare
    store : Store
    work : Work
    notify : callable
        ``(jobs) -> None``: announces that these jobs changed.
    max_chunks_bytes : int
        Total size of the chunks of a job above which it is given up.
    metrics : JobMetrics
    accounts : Accounts
    """

    claim_owner: str
    records: RecordAccess
    engine: Engine
    fair_share: FairShare
    store: Store
    work: Work
    notify: Callable[[Collection[str]], None]
    max_chunks_bytes: int
    metrics: JobMetrics
    accounts: Accounts


class Run:
    """The run of claimed jobs, in a thread of its own, from their claim to their end.

    Subclasses compute the jobs in `_run`.
    """

    def __init__(self, claimed: Sequence[JobRow], context: RunContext) -> None:
        self.jobs = {job.id: job for job in claimed}
        self.called = claimed
        """The jobs of the next call, in the order in which it takes them."""
        self.context = context
        self._held = set(self.jobs)
        self._reason: ClaimLostError | ClosingError | None = None
        self._ended: queue.SimpleQueue[Call | None] = queue.SimpleQueue()
        self._calls = 0
        self._began = time.monotonic()
        self._lost: set[str] = set()
        self.spans: dict[str, Span] = {}

    def claim_lost(self, job: str) -> None:
        """Take note that the claim of a job is lost; the run stops once all are."""
        self._held.discard(job)
        if not self._held:
            self._reason = ClaimLostError()
            self.wake()

    def close(self) -> None:
        """Stop the run, because the process stops."""
        self._reason = self._reason or ClosingError()
        self.wake()

    def wake(self) -> None:
        """End the wait for a call, so that the run sees what changed."""
        self._ended.put(None)

    def run(self) -> None:
        """Bring the jobs to their end, or put them back into the queue."""
        self.context.accounts.begin(self.jobs.values())
        try:
            with traces.attempts(self.jobs.values()) as self.spans:
                self._run_to_end()
        finally:
            self.context.accounts.left(self.jobs.values())

    def _run_to_end(self) -> None:
        try:
            self._run()
        except ClaimLostError:
            log.info("claim lost", jobs=list(self.jobs))
            self.context.metrics.attempts_ended("claim_lost", len(self.jobs))
        except (ClosingError, EngineUnavailableError) as error:
            cause = "stopped" if isinstance(error, ClosingError) else "no_workers"
            self._finally(lambda: self.put_back(self.jobs, cause))
        except TRANSIENT_ERRORS as error:
            note = str(error.strerror or error)
            log.warning("jobs delayed", jobs=list(self.jobs), reason=note)
            self._finally(lambda: self.put_back(self.jobs, "delayed", note))
        except Exception as error:
            log.info("job failed", jobs=list(self.jobs), error=type(error).__name__)
            problem = self.context.work.explain(error)
            self._finally(lambda: self.fail(self.jobs, problem))

    def _run(self) -> None:
        raise NotImplementedError

    def _finally(self, record: Callable[[], None]) -> None:
        try:
            record()
        except (ClaimLostError, ClosingError):
            log.info("jobs left until their claims expire", jobs=list(self.jobs))

    def check(self) -> None:
        """Raise where the run must stop."""
        if self._reason is not None:
            raise self._reason

    def _used(self) -> Callable[[Sequence[float]], None] | None:
        """Return what is told the use of the next call, None where nobody is charged for it."""
        if all(job.account is None for job in self.called):
            return None
        return partial(self.context.accounts.used, self.called)

    def arguments(self, job: JobRow) -> worker.JobArguments:
        """Return the arguments of a job for the functions of `Work`."""
        return self.context.store.url, job.kind, job.request, job.result

    def submit(
        self, queue_name: str, priority: int, function: Callable[..., Any], *args: Any
    ) -> Call:
        """Send a call to the workers; `ended_calls` returns it when it has ended.

        Where all have just died it waits for those that replace them.

        Raises
        ------
        EngineUnavailableError
            Where there are none for longer than that.
        """
        patience = time.monotonic() + _WORKERS_SECONDS
        while not self.context.engine.ready and time.monotonic() < patience:
            self.pause(_STOP_SECONDS)
        self._calls += 1
        first = next(iter(self.jobs.values()))
        # A key of an earlier attempt must not come back: Dask would take the call that was
        # cancelled for this one.
        key = f"{first.id}-{first.attempts}-{self._calls}"
        engine, work = self.context.engine, self.context.work
        ended, used = self._ended.put, self._used()
        return engine.submit(key, queue_name, priority, ended, function, work, *args, used=used)

    def ended_calls(self) -> list[Call]:
        """Wait for a call to end, for a short time, and return those that have."""
        ended: list[Call | None] = []
        try:
            ended.append(self._ended.get(timeout=_STOP_SECONDS))
            while True:
                ended.append(self._ended.get_nowait())
        except queue.Empty:
            return [call for call in ended if call is not None]

    def outcome(self, call: Call) -> BaseException | None:
        """Wait until a call has ended; return why it failed, or None."""
        try:
            while call not in self.ended_calls():
                self.check()
        except BaseException:
            self.context.engine.cancel([call])
            raise
        return self.context.engine.error(call)

    def repeat_alone(
        self, function: Callable[..., Any], *args: Any
    ) -> tuple[Call, BaseException | None]:
        """Repeat a call that failed with its worker, with no other such call beside it.

        All calls that a worker held are suspected of its death, or of having used its memory.
        Alone, only the guilty call fails again; twice for the same reason, because a call beside
        it that was not suspected so far can be the guilty one.
        """
        isolation = self.context.engine.isolation
        while not isolation.acquire(timeout=_STOP_SECONDS):
            self.check()
        try:
            reasons: set[str] = set()
            for _ in range(_ATTEMPTS_ALONE):
                call, error = self.call(BULK, function, *args)
                if not suspect(error):
                    break
                reason = error.why if isinstance(error, WorkerLostError) else "memory"
                if reason in reasons:
                    break
                reasons.add(reason)
        finally:
            isolation.release()
        return call, error

    def call(
        self, queue_name: str, function: Callable[..., Any], *args: Any
    ) -> tuple[Call, BaseException | None]:
        """Return a call that has ended, and why it failed.

        It is repeated as long as workers die for reasons that are not its own.
        """
        delay = _RETRY_SECONDS
        while True:
            call = self.submit(queue_name, 0, function, *args)
            error = self.outcome(call)
            if not self.lost(error):
                return call, error
            self.pause(delay)
            delay = min(MAX_DEATH_DELAY, 2.0 * delay)

    def lost(self, error: BaseException | None) -> bool:
        """Whether a call has lost its worker by no fault of its own; deaths are recorded."""
        if not isinstance(error, WorkerLostError):
            return False
        if error.worker not in self._lost:  # it may have held several calls
            self._lost.add(error.worker)
            log.info("worker lost", worker=error.worker, reason=error.why)
            seconds = time.monotonic() - self._began
            lost, records = attempts.lost, self.context.records
            records.submit(lost, list(self.jobs), error.worker, seconds, error.why)
            self.context.metrics.attempts_ended("worker_lost", len(self.jobs))
        return not error.own

    def pause(self, seconds: float) -> None:
        """Wait for some time, or until the run must stop."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.check()
            time.sleep(min(_STOP_SECONDS, seconds))

    def write(self, operation: Callable[..., Changed], *args: Any) -> Changed:
        """Perform an operation of `claims`, however long the records are unavailable.

        Meanwhile the claim may expire and another replica may take the job over. The operation
        is fenced and then changes nothing.

        Returns
        -------
        collection of str
            The jobs that it changed.
        """
        claim_owner, write = self.context.claim_owner, self.context.records.write_now
        changed = self._until_available(lambda: write(operation, claim_owner, *args))
        self.context.notify(changed)
        return changed

    def ensure_request(self, job: JobRow) -> None:
        """Store the request of a job for the workers, where it is only in the records.

        Raises
        ------
        LookupError
            Where it is nowhere: the store has lost it, and it was too large for the records.
        OSError
            Where the store cannot be reached: another replica may reach it.
        """
        requests, name = self.context.store.requests, job.request
        if requests.readable(name):
            return
        read = self.context.records.read_now
        block = self._until_available(lambda: read(records.request, name))
        if block is None:
            raise LookupError("the request of the job is gone")
        requests.put(name, block, durable=False)

    def _until_available(self, action: Callable[[], Value]) -> Value:
        while True:
            try:
                return action()
            except (RecordsUnavailableError, StoreFullError):
                self.check()
                time.sleep(_RETRY_SECONDS)

    def succeed(self, jobs: Collection[str], *, reused: bool) -> None:
        """Record that jobs succeeded."""
        self._count(jobs, self.write(claims.succeed, jobs, reused), "succeeded")

    def fail(self, jobs: Collection[str], problem: dict[str, Any]) -> None:
        """Record that jobs failed."""
        for job in jobs:
            traces.fail(self.spans[job], str(problem.get("code", "")))
            self._count([job], self.write(claims.fail, job, problem), "failed")

    def _count(self, jobs: Collection[str], ended: Mapping[str, JobRow], cause: str) -> None:
        """Count jobs that ended, and attempts at jobs that somebody else ended meanwhile."""
        lost = sorted(set(jobs) - ended.keys())
        if lost:
            log.info("claim lost", jobs=lost)
        self.context.metrics.finished(ended.values())
        self.context.accounts.ended(ended.values())
        self.context.metrics.attempts_ended(cause, len(jobs) - len(lost))
        self.context.metrics.attempts_ended("claim_lost", len(lost))

    def put_back(self, jobs: Collection[str], cause: str, note: str | None = None) -> None:
        """Queue jobs again; after a growing delay where there is a note why.

        `cause` is that by which the ends of the attempts are counted.
        """
        attempts = max(self.jobs[job].attempts for job in jobs)
        delay = 0.0 if note is None else min(_MAX_DELAY, 0.5 * 2.0 ** min(attempts, 10))
        queued = self.write(claims.put_back, jobs, delay, note)
        self.context.metrics.attempts_ended(cause, len(queued))
