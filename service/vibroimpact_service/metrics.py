"""The service's own figures, in the format of Prometheus."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from typing import Final

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_1_0_0

MEDIA_TYPE: Final = CONTENT_TYPE_PLAIN_1_0_0

_LOOK_SECONDS: Final = 0.02
_IDLE_SECONDS: Final = 0.25
"""How often the event loop is looked at while nobody asks anything: nothing blocks it then."""
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
    """What is counted and timed in one application."""

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
            "vibroimpact_results", "Computations asked for, by how they were answered.",
            ("kind", "cache"), registry=self._registry,
        )  # fmt: skip
        self._solves = Histogram(
            "vibroimpact_solve_seconds", "Time of computations that were done at once.",
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
            "vibroimpact_worker_slots", "Calls that the workers compute at once.",
            registry=self._registry,
        )  # fmt: skip
        self._ready = Gauge(
            "vibroimpact_ready", "Whether work can be taken.", registry=self._registry
        )

    async def watch_loop(self) -> None:
        """Measure for ever how late the event loop wakes: it is late by what blocked it."""
        clock = asyncio.get_running_loop().time
        seen = -1
        while True:
            pause = _IDLE_SECONDS if seen == self._answered else _LOOK_SECONDS
            seen = self._answered
            due = clock() + pause
            await asyncio.sleep(pause)
            self._lag.observe(max(0.0, clock() - due))

    def answered(self, method: str, route: str, status: int, seconds: float) -> None:
        """Count an answer."""
        self._answered += 1
        key = method, route, status
        found = self._series.get(key)
        if found is None:
            count = self._requests.labels(method, route, str(status))
            found = self._series[key] = count, self._seconds.labels(method, route)
        found[0].inc()
        found[1].observe(seconds)

    def result(self, kind: str, cache: str) -> None:
        """Count a computation: ``hit``, ``miss``, ``collapsed`` or ``job``."""
        self._results.labels(kind, cache).inc()

    def solved(self, kind: str, methods: Sequence[str], seconds: float, planned: float) -> None:
        """Time a computation that was done at once."""
        self._solves.labels(kind, "+".join(dict.fromkeys(methods))).observe(seconds)
        self._planned.labels(kind).inc(planned)

    def text(self, jobs: Mapping[str, int], workers: int, ready: bool) -> bytes:
        """Return all figures, with those that hold now."""
        for state, count in jobs.items():
            self._jobs.labels(state).set(count)
        self._workers.set(workers)
        self._ready.set(ready)
        return generate_latest(self._registry)
