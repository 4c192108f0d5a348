"""Answers over HTTP: cached and new ones, clients at once, a large result, estimates of plans.

Everything runs on this machine, the load included: its cores are shared.
"""

from __future__ import annotations

import functools
import itertools
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Any, Final

import numpy as np

from benchmarks.service import load
from benchmarks.service.bare import FRAMEWORK, SERVER
from benchmarks.service.load import Load
from benchmarks.service.requests import COMPUTE, UNIQUE, Request, modes
from benchmarks.service.server import Bare, Server, running
from benchmarks.tables import Figure, Plot, Table, Trend, figures
from vibroimpact_schema.requests import ImpactModesRequest
from vibroimpact_schema.sweeps import SweepRequest
from vibroimpact_schema.systems import SystemReference
from vibroimpact_service.documents import decode, digest, planning
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.results import encode
from vibroimpact_service.store import Store
from vibroimpact_solvers import cost, impact_modes, sweep
from vibroimpact_solvers.arrays import Quantity

_SECONDS: Final = 5.0
"""How long a load lasts."""
_MANY: Final = 200
_OUTPUTS: Final = ("impulse", "exists", "reason")
_P50: Final = "impact modes, N = 13, 1000 frequencies, p50 [ms]"
_BEYOND: Final = "p50 beyond the library [ms]"
_ALONE: Final = "a core for the service alone [1/s]"
_LATE: Final = "event loop over 50 ms late"
_SHARED: Final = (
    "on the clock: clients, service and its workers share the cores with one another, and with "
    "whatever else the machine does"
)
_PLANNED: Final = (
    "requests of a millisecond take twice as long where others keep the machine busy, and "
    "impulses of two hundred masses a quarter of what is planned, as their kernel does several "
    "operations at once: jobs are cut into pieces by the same prices"
)


def answers() -> Table:
    """Ask for stored results and for new computations."""
    with running() as server:
        numbers = [*_cached(server), *_bare(), *_computed(server)]
    value = {each.name: each.value for each in numbers}
    least, framework = (
        1e6 / value[f"{what}, 14 kB, {_ALONE}"] for what in ("bare uvicorn", "bare FastAPI route")
    )
    reasons = dict.fromkeys((_P50, _BEYOND), _SHARED) | {
        name: f"of {1e6 / value[name]:.0f} µs of an answer, {least:.0f} are uvicorn's, which "
        f"measured at the same time would take {framework:.0f} with a bare route of the framework: "
        "on a quieter machine all of them become shorter"
        for name in value
        if name.endswith(_ALONE) and not name.startswith("bare")
    }
    note = (
        "32 connections; the load shares the cores with the service. Bare: the same server, "
        "without and with the framework, answering with bytes that it holds, without callers, "
        "limits, conditions, figures, security fields and log."
    )
    return figures("Answers over HTTP", numbers, note, reasons)


def _cached(server: Server) -> Iterator[Figure]:
    """Measure cached results and 304."""
    for num in (100, 1000):
        answer = server.stored(modes(0.6, num, outputs=_OUTPUTS))
        path, size = answer.headers["content-location"], round(len(answer.body) / 1000)
        yield from _rated(server, f"cached result, {size} kB", Request("GET", path), 1500.0)
    known = {"If-None-Match": answer.headers["etag"]}
    yield from _rated(server, "304 by If-None-Match", Request("GET", path, "", known), 2500.0)


def _rated(
    server: Server | Bare, what: str, request: Request, least: float | None
) -> Iterator[Figure]:
    """Yield answers a second to 32 clients, and what the processor time of the service allows."""
    before = server.processor()
    outcome = load.run(Load(server.url, (request,), 32, _SECONDS)).proper(200, 304)
    each = (server.processor() - before) / outcome.answers
    yield Figure(f"{what} [1/s]", outcome.answers / outcome.seconds)
    yield Figure(f"{what}, {_ALONE}", 1.0 / each, least, True)


def _bare() -> Iterator[Figure]:
    """Measure what server and framework alone take to answer with as many bytes."""
    for kind, what in ((SERVER, "bare uvicorn, 14 kB"), (FRAMEWORK, "bare FastAPI route, 14 kB")):
        with Bare(kind, 14_000) as other:
            yield from _rated(other, what, Request("GET", "/anything"), None)


def _computed(server: Server, count: int = 200, warm: int = 20) -> Iterator[Figure]:
    """Measure new computations, and the library alone beside them."""
    times, library = [], []
    own = 0.0
    for number in range(count):
        content = modes(0.6 + 1e-6 * number, 1000, outputs=_OUTPUTS)
        problem = _problem(content)
        began = time.perf_counter(), time.process_time(), server.processor()
        impact_modes.solve(problem, impact_modes.plan(problem))
        library.append(time.perf_counter() - began[0])
        spent = time.process_time() - began[1]
        sent = time.perf_counter()
        server.answered("POST", COMPUTE, content)
        times.append(time.perf_counter() - sent)
        own += (server.processor() - began[2] - spent) * (number >= warm)
    p50, p99 = 1e3 * np.percentile(times[warm:], [50, 99])
    yield Figure(_P50, float(p50), 6.0)
    yield Figure("the same, p99 [ms]", float(p99))
    yield Figure(_BEYOND, float(p50) - 1e3 * statistics.median(library[warm:]), 3.0)
    yield Figure("processor beyond the library [ms]", 1e3 * own / (count - warm))


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
            outcome = load.run(Load(server.url, (request,), count, 1.5, first)).proper(200)
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
        plots=tuple(Plot("clients", y, by="request") for y in (rate_of, p50, memory)),
        trends=(
            Trend("clients", rate_of, -0.1, by="request", at_least=True),
            Trend("clients", p50, 1.15, by="request"),
            Trend("clients", memory, 0.05, by="request"),
        ),
    )


def concurrent_clients() -> Table:
    """Let 200 clients ask for results, plans and new computations at once."""
    with running() as server:
        headers = server.stored(modes(0.6, 100)).headers
        path, tag = headers["content-location"], {"If-None-Match": headers["etag"]}
        known, new = Request("GET", path), modes(UNIQUE, 100)
        requests = (
            *[known] * 5,
            *[Request("GET", path, "", tag)] * 3,
            Request.post(COMPUTE, new),
            Request.post("/v1/plan/impact-modes", new),
        )
        with _late(server) as late:
            outcome = load.run(Load(server.url, requests, _MANY, 4.0 * _SECONDS))
        memory = server.memory()
    numbers = [
        Figure("answers [1/s]", outcome.answers / outcome.seconds),
        Figure("p99 [ms]", 1e3 * outcome.p99),
        Figure("errors other than 429", outcome.bad(200, 304, 429), 0.0),
        *late,
        Figure("memory of the server [MB]", memory, 600.0),
    ]
    note = f"For {4.0 * _SECONDS:g} s. The event loop is sampled every 20 ms."
    return figures("Two hundred clients", numbers, note, {_LATE: _SHARED})


_IDLE_PROCESS: Final = (
    "import time\n"
    "while True:\n"
    "    due = time.monotonic() + 0.02\n"
    "    time.sleep(0.02)\n"
    "    late = time.monotonic() - due\n"
    "    if late > 0.05: print(late, flush=True)\n"
)


@contextmanager
def _late(server: Server) -> Iterator[list[Figure]]:
    """Count how often the event loop wakes more than 50 ms late; filled in at the end.

    An idle process beside the service is late as often as the machine has no core for it: the
    event loop may be as often.
    """

    def lag() -> float:
        text = server.ask("GET", "/metrics").body.decode()
        below = dict(re.findall(r'event_loop_lag_seconds_bucket{le="([^"]+)"} (\S+)', text))
        return float(below["+Inf"]) - float(below["0.05"])

    before, numbers = lag(), list[Figure]()
    command = [sys.executable, "-c", _IDLE_PROCESS]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as idle:
        try:
            yield numbers
        finally:
            idle.terminate()
            machine = len(idle.communicate()[0].splitlines())
    numbers.append(Figure(_LATE, lag() - before, machine))
    numbers.append(Figure("idle process over 50 ms late", machine))


_LARGE: Final = 2**28


@dataclass(frozen=True)
class Stored:
    """A result with one array."""

    shape: Annotated[Any, Quantity(("frequency", "dof"), "length", "shape")]


def large_results() -> Table:
    """Send a large HDF5 result, which is made from the stored arrays at first."""
    values = np.random.default_rng(7).standard_normal((_LARGE // 8000, 1000))
    head = {
        "kind": "benchmark", "digest": "", "request": "{}", "plan": {}, "units": None,
        "provenance": {"created": "", "solver_version": ""},
    }  # fmt: skip
    name = digest.name("local", "benchmark", "", b"big")
    numbers: list[Figure] = []
    with running() as server:
        body = encode.pack(encode.describe(Stored(values), head))
        Store(str(server.data / "store")).results.put(name, body)
        base, peak, done = server.memory(), [0.0], threading.Event()

        def look() -> None:
            while not done.wait(0.02):
                peak[0] = max(peak[0], server.memory())

        watcher = threading.Thread(target=look)
        watcher.start()
        try:
            with _late(server) as late:
                for turn in ("first, made and sent", "again, sent"):
                    began = time.perf_counter()
                    received = _received(server, name)
                    rate = received / (time.perf_counter() - began) / 1e6
                    numbers.append(Figure(f"{turn} [MB/s]", rate))
        finally:
            done.set()
            watcher.join()
        assert received > 0.8 * len(body)
    more = "memory of the server beside what it had, at most [MB]"
    numbers += [Figure(more, peak[0] - base, 64.0), *late]
    return figures(f"A result of {_LARGE // 2**20} MB", numbers, "", {_LATE: _SHARED})


def _received(server: Server, name: str) -> int:
    connection = server.connection()
    connection.request("GET", f"/v1/results/{name}", headers={"Accept": "application/x-hdf5"})
    answer = connection.getresponse()
    assert answer.status == 200, answer.read()[:500]
    return sum(len(piece) for piece in iter(functools.partial(answer.read, 2**20), b""))


def estimates() -> Table:
    """Compare planned seconds with the processor time of the library, over a mix of requests."""
    ratios = [
        _planned(n, num, outputs)
        for n in (3, 13, 60, 200)
        for num in (100, 2000, 20_000)
        for outputs in (["impulse"], ["impulse", "exists", "reason"], ["impulse", "shape"])
        if n * num <= 400_000
    ]
    within = sum(1 / 3 <= ratio <= 3 for ratio in ratios) / len(ratios)
    low, middle, high = map(float, np.percentile(ratios, [5, 50, 95]))
    numbers = [
        Figure(f"planned time within 3x of {len(ratios)} [%]", 100 * within, 90.0, True),
        Figure("planned over measured, 5 % below", low),
        Figure("planned over measured, median", middle),
        Figure("planned over measured, 95 % below", high),
        Figure("planned over measured, a sweep of 64 time histories", _planned_sweep()),
    ]
    note = "Plans speak of one core of a machine of 2024."
    return figures("Estimates of plans", numbers, note, {"": _PLANNED})


def _planned(n: int, num: int, outputs: list[str]) -> float:
    """Return planned over measured time of a request; the first runs only warm up."""
    spent = []
    for turn in range(4):
        system = {
            "M": {"scalar": 1.0, "n": n},
            "K": {"bands": {"0": [2.0] * n, "1": [-1.0] * (n - 1)}},
            "constraints": [{"dof": n // 2, "gap": 0.2 + 1e-6 * turn}],
        }
        frequency = {"start": 0.6, "stop": 2.4, "num": num}
        problem = _problem({"system": system, "frequency": frequency, "outputs": outputs})
        plan = impact_modes.plan(problem)
        began = time.process_time()
        encode.pack(encode.describe(impact_modes.solve(problem, plan), {}))
        spent.append(time.process_time() - began)
    return cost.seconds(plan) / min(spent[1:])


def _problem(content: dict[str, Any]) -> impact_modes.Problem:
    """Return the solver's problem of a request."""
    request = ImpactModesRequest.model_validate(content)
    assert not isinstance(request.system, SystemReference)
    return decode.impact_modes(request, decode.system(request.system))


def _planned_sweep() -> float:
    """Return planned over measured time of a sweep of short time histories."""
    wall = {"dof": 0, "gap": 1.0, "restitution": 0.8}
    base = {
        "system": {"preset": "oscillator", "Omega0": 1.0, "zeta": 0.02, "constraints": [wall]},
        "initial": {"x": [0.0], "v": [2.0]},
        "t_end": 20.0,
        "t": {"num": 50},
        "outputs": ["x", "v", "impacts"],
    }
    axes = [
        {
            "path": f"system.constraints.0.{name}",
            "name": name,
            "values": [first + 1e-3 * i for i in range(8)],
        }
        for name, first in (("gap", 0.5), ("restitution", 0.7))
    ]
    content = {"kind": "time-history", "base": base, "axes": axes}
    request = SweepRequest.model_validate(content)
    with tempfile.TemporaryDirectory() as folder:
        _, problem, plan, _ = planning.plan(Store(folder), KINDS["sweep"], request)
        spent = []
        for _ in range(4):
            began = time.process_time()
            sweep.solve(problem, plan)
            spent.append(time.process_time() - began)
    return cost.seconds(plan) / min(spent[1:])
