"""The service's metrics, in the format of Prometheus."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from typing import Final

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_1_0_0

MEDIA_TYPE: Final = CONTENT_TYPE_PLAIN_1_0_0

_SAMPLE_SECONDS: Final = 0.02
"""Interval at which the lag of the event loop is measured."""
_IDLE_SECONDS: Final = 0.25
"""Interval of the same while there are no requests, when nothing blocks the loop."""
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


class Metrics:
    """Counters and timings of one application."""

    def __init__(self) -> None:
        self._answered = 0
        self._series: dict[tuple[str, str, int], tuple[Counter, Histogram]] = {}
        self._registry = CollectorRegistry()
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
        self._jobs = Gauge(
            "vibroimpact_jobs", "Unfinished jobs.", ("state",), registry=self._registry
        )
        self._workers = Gauge(
            "vibroimpact_worker_slots", "Calls that the workers compute at the same time.",
            registry=self._registry,
        )  # fmt: skip
        self._ready = Gauge(
            "vibroimpact_ready", "Whether the service accepts work.", registry=self._registry
        )
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

    def text(
        self, jobs: Mapping[str, int], workers: int, ready: bool, kernels: Mapping[str, str]
    ) -> bytes:
        """Return all metrics, with the present state of jobs, workers and kernels."""
        for state, count in jobs.items():
            self._jobs.labels(state).set(count)
        self._workers.set(workers)
        self._ready.set(ready)
        for kind, state in kernels.items():
            self._kernels.labels(kind).set(state == "warm")
        return generate_latest(self._registry)
