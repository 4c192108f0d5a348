"""Answers over HTTP: stored results and new ones, few clients and many, and a cold start.

Everything runs on this machine, the load included: its cores are shared.
"""

from __future__ import annotations

import itertools
import tempfile
import time
from collections.abc import Iterator
from typing import Any, Final

from benchmarks.service import load
from benchmarks.service.load import Load
from benchmarks.service.requests import COMPUTE, UNIQUE, Request, modes
from benchmarks.service.server import Server, running
from benchmarks.tables import Figure, Plot, Table, Trend, figures

_SECONDS: Final = 5.0
"""How long a load lasts."""
_OUTPUTS: Final = ("impulse", "exists", "reason")
SHARED: Final = (
    "on the clock: clients, service and its workers share the cores with one another, and with "
    "whatever else the machine does"
)


def answers() -> Table:
    """Ask for stored results and for new computations."""
    with running() as server:
        numbers = [*_cached(server), *_computed(server)]
    note = "32 connections; the load generator shares the cores with the service."
    return figures("Answers over HTTP", numbers, note, {"": SHARED})


def _cached(server: Server) -> Iterator[Figure]:
    """Measure cached results and 304."""
    for num in (100, 1000):
        answer = server.stored(modes(0.6, num, outputs=_OUTPUTS))
        path, size = answer.headers["content-location"], round(len(answer.content) / 1000)
        yield from _rated(server, f"cached result, {size} kB", Request("GET", path), 1500.0)
    known = {"If-None-Match": answer.headers["etag"]}
    yield from _rated(server, "304 by If-None-Match", Request("GET", path, "", known), 2500.0)


def _rated(server: Server, what: str, request: Request, least: float) -> Iterator[Figure]:
    """Yield answers a second to 32 clients, and what the processor time of the service allows."""
    before = server.processor()
    outcome = load.run(Load(server.url, (request,), 32, _SECONDS)).proper()
    each = (server.processor() - before) / outcome.answers
    yield Figure(f"{what} [1/s]", outcome.answers / outcome.seconds)
    yield Figure(f"{what}, a core for the service alone [1/s]", 1.0 / each, least, True)


def _computed(server: Server) -> Iterator[Figure]:
    """Measure new computations, asked for one after the other."""
    new = Request.post(COMPUTE, modes(UNIQUE, 1000, outputs=_OUTPUTS))
    outcome = load.run(Load(server.url, (new,), 1, _SECONDS)).proper()
    yield Figure("impact modes, N = 13, 1000 frequencies, p50 [ms]", 1e3 * outcome.p50, 6.0)
    yield Figure("the same, p99 [ms]", 1e3 * outcome.p99)


def clients() -> Table:
    """Ask with more and more clients at once: stored results, new small ones, plans."""
    rows: list[tuple[Any, ...]] = []
    with running() as server:
        stored = server.stored(modes(0.5)).headers["content-location"]
        kinds = {
            "a stored result": Request("GET", stored),
            "a new result, inline": Request.post(COMPUTE, modes()),
            "a plan": Request.post("/v1/plan/impact-modes", modes()),
        }
        first = 1
        for (what, request), count in itertools.product(kinds.items(), (1, 2, 4, 8, 16, 32)):
            outcome = load.run(Load(server.url, (request,), count, 1.5, first)).proper()
            first += outcome.sent
            rate = outcome.answers / outcome.seconds
            latency = 1e3 * outcome.p50, 1e3 * outcome.p99
            rows.append((what, count, rate, *latency, server.memory()))
    rate_of, p50, memory = "answers [1/s]", "p50 [ms]", "memory of the server [MB]"
    return Table(
        "The service against clients",
        ("request", "clients", rate_of, p50, "p99 [ms]", memory),
        rows,
        "Clients are connections of one process on the same cores. Chain of 13 masses, JSON. "
        "Expected: more clients do not lower the throughput, and each waits no longer than its "
        "turn.",
        plots=tuple(Plot("clients", y, by="request") for y in (rate_of, p50)),
        trends=(
            Trend("clients", rate_of, -0.1, by="request", at_least=True),
            Trend("clients", p50, 1.15, by="request"),
        ),
    )


def starts() -> Table:
    """Start the service on an empty folder: ready, its first results, its memory.

    Once as after an installation, when its kernels were never compiled, and once with the
    kernels on disk.
    """
    rows: list[tuple[Any, ...]] = []
    with tempfile.TemporaryDirectory() as empty:
        for title in ("compiled", "from disk"):
            times = [time.perf_counter()]
            with running(environment={"NUMBA_CACHE_DIR": empty}) as server:
                times.append(time.perf_counter())
                for start in (0.51, 0.52):
                    server.stored(modes(start))
                    times.append(time.perf_counter())
                server.done(server.job(modes(0.53)))
                times.append(time.perf_counter())
                spent = [b - a for a, b in itertools.pairwise(times)]
                rows.append((title, *spent, len(server.processes()), server.memory_of_all()))
    return Table(
        "The service from a cold start",
        (
            "kernels",
            "ready after [s]",
            "first result [s]",
            "next result [s]",
            "first job [s]",
            "processes",
            "memory of all [MB]",
        ),
        rows,
        "One worker, SQLite, a folder. Memory is that of pages, shared ones by their share.",
    )
