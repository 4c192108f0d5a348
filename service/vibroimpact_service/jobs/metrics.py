"""Metrics of the job queue: jobs, chunks, attempts, workers, records, store, webhooks."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram

from vibroimpact_service.jobs.tables import JobRow

_JOB: Final = (0.01, 0.1, 0.5, 1.0, 5.0, 30.0, 120.0, 600.0, 3600.0, 14_400.0, 86_400.0)
_CHUNK: Final = (0.001, 0.01, 0.05, 0.1, 0.2, 0.5, 1.0, 5.0, 30.0, 120.0, 600.0)
_TRANSACTION: Final = (0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.5, 1.0, 3.0, 10.0)

CAUSES: Final = (
    *("succeeded", "failed", "delayed", "no_workers", "worker_lost"),
    *("claim_lost", "claim_expired", "stopped"),
)
"""Why attempts at jobs end."""
DEATHS: Final = ("stopped", "killed", "fault", "silent")
"""What becomes of worker processes."""
OUTCOMES: Final = ("delivered", "failed", "given_up", "refused", "unsigned")
"""What becomes of messages to webhooks."""
OPERATIONS: Final = ("read", "write")
"""Transactions of the records."""


class JobMetrics:
    """Counters and timings of one job queue, in a registry of their own.

    Series of which the labels are known exist from the start: an increase from nothing to 1
    would not count as one.
    """

    def __init__(self) -> None:
        self.registry = registry = CollectorRegistry()
        self._finished = Counter(
            "vibroimpact_jobs_finished",
            "Jobs that ended, by kind and final state; those that failed also by the code of the "
            "problem. Each is counted by the replica that ended it.",
            ("kind", "state", "code"), registry=registry,
        )  # fmt: skip
        self._duration = Histogram(
            "vibroimpact_job_duration_seconds",
            "Time from the first claim of a job to its end.",
            ("kind", "state"), buckets=_JOB, registry=registry,
        )  # fmt: skip
        self._wait = Histogram(
            "vibroimpact_job_wait_seconds", "Time from the submission of a job to its first claim.",
            ("kind",), buckets=_JOB, registry=registry,
        )  # fmt: skip
        self._chunk = Histogram(
            "vibroimpact_chunk_seconds",
            "Mean time of a chunk in a batch, of those batches whose time is fetched from their "
            "worker: one in 0.25 s for each job.",
            ("kind",), buckets=_CHUNK, registry=registry,
        )  # fmt: skip
        self._chunks_planned = Counter(
            "vibroimpact_chunks_planned_seconds", "Planned time of the same batches.", ("kind",),
            registry=registry,
        )  # fmt: skip
        self._chunks_used = Counter(
            "vibroimpact_chunks_used_seconds", "Time that the same batches took.", ("kind",),
            registry=registry,
        )  # fmt: skip
        self._attempts = Counter(
            "vibroimpact_attempts_ended",
            "Attempts at jobs, or at parts of them, that ended, by cause.",
            ("cause",), registry=registry,
        )  # fmt: skip
        self._deaths = Counter(
            "vibroimpact_worker_deaths",
            "Worker processes that ended: stopped by the service, killed from outside, by a fault "
            "or the memory of their own work, or given up because their machine was silent.",
            ("cause",), registry=registry,
        )  # fmt: skip
        self._transactions = Histogram(
            "vibroimpact_records_transaction_seconds",
            "Time of the transactions on the records, failed ones included.",
            ("operation",), buckets=_TRANSACTION, registry=registry,
        )  # fmt: skip
        self._store_bytes = Gauge(
            "vibroimpact_store_bytes", "Size of the blocks in an area of the store, as retention "
            "found it last.", ("area",), registry=registry,
        )  # fmt: skip
        self._webhooks = Counter(
            "vibroimpact_webhook_deliveries", "Attempts to deliver messages, by outcome.",
            ("outcome",), registry=registry,
        )  # fmt: skip
        for metric, values in (
            (self._attempts, CAUSES),
            (self._deaths, DEATHS),
            (self._transactions, OPERATIONS),
            (self._webhooks, OUTCOMES),
        ):
            for value in values:
                metric.labels(value)

    def expect(self, kinds: Iterable[str], codes: Iterable[str]) -> None:
        """Begin to count jobs of some kinds, and those that fail with some codes."""
        for kind in kinds:
            for state in ("succeeded", "cancelled"):
                self._finished.labels(kind, state, "")
            for code in codes:
                self._finished.labels(kind, "failed", code)

    def finished(self, ended: Iterable[JobRow]) -> None:
        """Count jobs that ended, after that was committed."""
        for job in ended:
            code = str((job.error or {}).get("code", ""))
            self._finished.labels(job.kind, job.state, code).inc()
            # One that was computed while it was submitted has the same time for all.
            if job.started is not None and job.finished is not None and job.started < job.finished:
                self._duration.labels(job.kind, job.state).observe(job.finished - job.started)
                self._wait.labels(job.kind).observe(max(0.0, job.started - job.created))

    def chunks(self, kind: str, count: int, planned: float, used: float) -> None:
        """Record the time of a batch of chunks, in seconds."""
        self._chunk.labels(kind).observe(used / count)
        self._chunks_planned.labels(kind).inc(planned)
        self._chunks_used.labels(kind).inc(used)

    def attempts_ended(self, cause: str, count: int = 1) -> None:
        """Count attempts that ended, by one of `CAUSES`."""
        self._attempts.labels(cause).inc(count)

    def worker_died(self, cause: str) -> None:
        """Count the end of a worker process, by one of `DEATHS`."""
        self._deaths.labels(cause).inc()

    def transaction(self, operation: str, seconds: float) -> None:
        """Record the time of a transaction, one of `OPERATIONS`."""
        self._transactions.labels(operation).observe(seconds)

    def store_size(self, area: str, size: int) -> None:
        """Record the size of an area of the store in bytes."""
        self._store_bytes.labels(area).set(size)

    def webhook(self, outcome: str) -> None:
        """Count an attempt to deliver a message, by one of `OUTCOMES`."""
        self._webhooks.labels(outcome).inc()
