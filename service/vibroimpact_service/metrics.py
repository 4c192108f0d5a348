"""The service's metrics, in the format of Prometheus."""

from __future__ import annotations

import asyncio
import math
from collections import Counter as Count
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from typing import Final, NamedTuple

from prometheus_client import (
    CollectorRegistry,
    Counter,
    Gauge,
    Histogram,
    Info,
    ProcessCollector,
    disable_created_metrics,
    generate_latest,
)
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_1_0_0

disable_created_metrics()  # type: ignore[no-untyped-call]

MEDIA_TYPE: Final = CONTENT_TYPE_PLAIN_1_0_0

_SAMPLE_SECONDS: Final = 0.02
"""Interval at which the lag of the event loop is measured."""
_IDLE_SECONDS: Final = 0.25
"""Interval of the same while there are no requests, when nothing blocks the loop."""
OWNERS: Final = 20
"""Owners whose unfinished jobs are told each; those of all others are added up."""
OTHERS: Final = "(others)"
STATES: Final = ("queued", "held", "running")
_FAST: Final = (
    0.001,
    0.0025,
    0.005,
    0.01,
    0.025,
    0.05,
    0.075,
    0.1,
    0.25,
    0.5,
    1.0,
    2.5,
    10.0,
    30.0,
)


class Present(NamedTuple):
    """What is true at the moment of all that is only known when it is asked for.

    Parameters
    ----------
    checks : mapping
        Part of the service -> ``"ok"``, or what is wrong with it.
    workers : int
    kernels : mapping
        Kind of computation -> ``"warm"``, or what else its kernels are.
    backlog : sequence of tuple, optional
        Kind, owner, one of `STATES`, the number of such jobs, and seconds since the first of them
        was submitted; absent where it is not known.
    room : tuple of int, optional
        Free bytes of the disk of the store, and all.
    expiry : mapping
        Certificate -> when it expires, seconds since 1970.
    """

    checks: Mapping[str, str]
    workers: int
    kernels: Mapping[str, str]
    backlog: Sequence[tuple[str, str, str, int, float]] | None
    room: tuple[int, int] | None
    expiry: Mapping[str, float]


class Metrics:
    """Counters and timings of one application.

    Parameters
    ----------
    of_queue : CollectorRegistry
        Metrics of its job queue, which are told together with these.

    Attributes
    ----------
    event_streams : Gauge
    """

    def __init__(self, of_queue: CollectorRegistry) -> None:
        self._answered = 0
        self._series: dict[tuple[str, str, int], tuple[Counter, Histogram]] = {}
        self._of_queue, self._registry = of_queue, CollectorRegistry()
        ProcessCollector(registry=self._registry)
        about = Info("vibroimpact_build", "Version of the service.", registry=self._registry)
        about.info({"version": version("vibroimpact")})
        self._requests = Counter(
            "vibroimpact_http_requests", "Answered requests.", ("method", "route", "status"),
            registry=self._registry,
        )  # fmt: skip
        self._seconds = Histogram(
            "vibroimpact_http_request_seconds", "Time from header to the end of the answer.",
            ("method", "route"), buckets=_FAST, registry=self._registry,
        )  # fmt: skip
        self._results = Counter(
            "vibroimpact_results", "Requested computations, by how they were answered.",
            ("kind", "cache"), registry=self._registry,
        )  # fmt: skip
        self._solves = Histogram(
            "vibroimpact_solve_seconds", "Time of computations that were answered directly.",
            ("kind", "method"), buckets=_FAST, registry=self._registry,
        )  # fmt: skip
        self._planned = Counter(
            "vibroimpact_planned_seconds", "Planned time of the same computations.", ("kind",),
            registry=self._registry,
        )  # fmt: skip
        self._lag = Histogram(
            "vibroimpact_event_loop_lag_seconds", "How late the event loop wakes.",
            buckets=_FAST, registry=self._registry,
        )  # fmt: skip
        self.event_streams = Gauge(
            "vibroimpact_event_streams", "Open event streams.", registry=self._registry
        )
        self._present()

    def _present(self) -> None:
        """Declare what is known only when it is asked for."""
        self._jobs = Gauge(
            "vibroimpact_jobs", "Unfinished jobs of all replicas, by kind and state: queued, held, "
            "running.", ("kind", "state"), registry=self._registry,
        )  # fmt: skip
        self._oldest = Gauge(
            "vibroimpact_queue_oldest_seconds",
            "Time since the submission of the oldest job that waits and is not held.",
            ("kind",), registry=self._registry,
        )  # fmt: skip
        self._owners = Gauge(
            "vibroimpact_owner_jobs",
            f"Unfinished jobs of the {OWNERS} owners with the most of them, and of all "
            f"others together, {OTHERS}.",
            ("owner",), registry=self._registry,
        )  # fmt: skip
        self._workers = Gauge(
            "vibroimpact_worker_slots", "Worker processes, each of which computes one batch of "
            "chunks and one quick call at the same time.", registry=self._registry,
        )  # fmt: skip
        self._ready = Gauge(
            "vibroimpact_ready", "Whether the service accepts work, as its readiness route says.",
            registry=self._registry,
        )  # fmt: skip
        self._checks = Gauge(
            "vibroimpact_check_ok", "Whether a part is ready: records and store take a write, "
            "there are workers, the service neither stops nor is overloaded.",
            ("part",), registry=self._registry,
        )  # fmt: skip
        self._free = Gauge(
            "vibroimpact_store_free_bytes", "Free room on the disk of a store that is a folder.",
            registry=self._registry,
        )  # fmt: skip
        self._total = Gauge(
            "vibroimpact_store_capacity_bytes", "All room on that disk.", registry=self._registry
        )
        self._expiry = Gauge(
            "vibroimpact_certificate_expiry_timestamp_seconds",
            "When a certificate for the workers expires, since 1970: ca, cert.",
            ("file",), registry=self._registry,
        )  # fmt: skip
        self._kernels = Gauge(
            "vibroimpact_kernels_warm", "Whether the kernels of a kind are compiled.", ("kind",),
            registry=self._registry,
        )  # fmt: skip

    async def watch_loop(self) -> None:
        """Measure continuously how late the event loop wakes, by what blocked it."""
        clock = asyncio.get_running_loop().time
        seen = -1
        while True:
            pause = _IDLE_SECONDS if seen == self._answered else _SAMPLE_SECONDS
            seen = self._answered
            due = clock() + pause
            await asyncio.sleep(pause)
            self._lag.observe(max(0.0, clock() - due))

    def answered(self, method: str, route: str, status: int, seconds: float) -> None:
        """Count an answer."""
        self._answered += 1
        key = method, route, status
        series = self._series.get(key)
        if series is None:
            count = self._requests.labels(method, route, str(status))
            series = self._series[key] = count, self._seconds.labels(method, route)
        series[0].inc()
        series[1].observe(seconds)

    def result(self, kind: str, cache: str) -> None:
        """Count a computation: ``hit``, ``miss``, ``collapsed`` or ``job``."""
        self._results.labels(kind, cache).inc()

    def solved(self, kind: str, methods: Sequence[str], seconds: float, planned: float) -> None:
        """Record the time of a computation that was answered directly."""
        self._solves.labels(kind, "+".join(dict.fromkeys(methods))).observe(seconds)
        self._planned.labels(kind).inc(planned)

    def text(self, present: Present) -> bytes:
        """Return all metrics."""
        self._ready.set(all(state == "ok" for state in present.checks.values()))
        self._checks.clear()
        for part, state in present.checks.items():
            self._checks.labels(part).set(state == "ok")
        self._workers.set(present.workers)
        for kind, state in present.kernels.items():
            self._kernels.labels(kind).set(state == "warm")
        for file, seconds in present.expiry.items():
            self._expiry.labels(file).set(seconds)
        free, total = (math.nan, math.nan) if present.room is None else present.room
        self._free.set(free)
        self._total.set(total)
        self._count(present.backlog, present.kernels)
        return generate_latest(self._of_queue) + generate_latest(self._registry)

    def _count(
        self, backlog: Sequence[tuple[str, str, str, int, float]] | None, kinds: Iterable[str]
    ) -> None:
        """Set what is told of unfinished jobs; where they could not be counted, it is nothing."""
        for gauge in (self._jobs, self._oldest, self._owners):
            gauge.clear()
        if backlog is None:
            return
        jobs = {(kind, state): 0 for kind in kinds for state in STATES}
        oldest = dict.fromkeys(kinds, 0.0)
        owners: Count[str] = Count()
        for kind, owner, state, count, seconds in backlog:
            jobs[kind, state] = jobs.get((kind, state), 0) + count
            owners[owner] += count
            if state == "queued":
                oldest[kind] = max(oldest.get(kind, 0.0), seconds)
        for (kind, state), count in jobs.items():
            self._jobs.labels(kind, state).set(count)
        for kind, seconds in oldest.items():
            self._oldest.labels(kind).set(seconds)
        most = owners.most_common(OWNERS)
        for owner, count in [*most, (OTHERS, owners.total() - sum(n for _, n in most))]:
            self._owners.labels(owner).set(count)
