"""How fast the service is, measured with wrk from outside on a service of its own.

It needs wrk (Debian: ``apt install wrk``). Everything runs on this machine, load generator
included: its cores are shared.
"""

from __future__ import annotations

import dataclasses
import functools
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from typing import Annotated, Any, Final

import numpy as np

from benchmarks.bare import FRAMEWORK, SERVER
from benchmarks.server import Bare, Server, running
from benchmarks.tables import Figure, Table, figures
from vibroimpact_schema.requests import ImpactModesRequest
from vibroimpact_schema.sweeps import SweepRequest
from vibroimpact_schema.systems import SystemReference
from vibroimpact_service import decode, digest, encode, tasks
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.store import Store
from vibroimpact_solvers import cost, impact_modes, sweep
from vibroimpact_solvers.arrays import Quantity

SECONDS: Final = 5
_CROWD: Final = 20
"""Seconds that wrk asks."""
HDF5 = "application/x-hdf5"
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
MIX = """
local number = 0
local thread_number = 0
function setup(thread) thread:set("id", thread_number); thread_number = thread_number + 1 end
function init() math.randomseed(id + 1); statuses = {} end
function request()
  number = number + 1
  local turn = number % 10
  if turn < 5 then return wrk.format("GET", "%RESULT%") end
  if turn < 8 then return wrk.format("GET", "%RESULT%", {["If-None-Match"] = '%ETAG%'}) end
  local stop = 2 + math.random()
  local body = '{"system":{"preset":"chain","n":13,"constraints":[{"dof":5,"gap":0.2}]},' ..
    '"frequency":{"start":0.6,"stop":' .. stop .. ',"num":100}}'
  local path = turn == 8 and "/v1/compute/impact-modes" or "/v1/plan/impact-modes"
  return wrk.format("POST", path, {["Content-Type"] = "application/json"}, body)
end
function response(status) statuses[status] = (statuses[status] or 0) + 1 end
local threads = {}
local inner = setup
function setup(thread) table.insert(threads, thread); inner(thread) end
function done()
  local all = {}
  for _, thread in ipairs(threads) do
    for status, count in pairs(thread:get("statuses")) do
      all[status] = (all[status] or 0) + count
    end
  end
  for status, count in pairs(all) do io.write("status " .. status .. " " .. count .. "\\n") end
end
"""


SWEEP: Final[dict[str, Any]] = {
    "kind": "time-history",
    "base": {
        "system": {
            "preset": "oscillator",
            "Omega0": 1.0,
            "zeta": 0.02,
            "constraints": [{"dof": 0, "gap": 1.0, "restitution": 0.8}],
        },
        "initial": {"x": [0.0], "v": [2.0]},
        "t_end": 20.0,
        "t": {"num": 50},
        "outputs": ["x", "v", "impacts"],
    },
    "axes": [
        {
            "path": f"system.constraints.0.{name}",
            "name": name,
            "values": [first + 1e-3 * i for i in range(8)],
        }
        for name, first in (("gap", 0.5), ("restitution", 0.7))
    ],
}


class Control:
    """An idle process beside the service: how late it wakes is the machine's doing alone."""

    CODE = (
        "import time\n"
        "while True:\n"
        "    due = time.monotonic() + 0.02\n"
        "    time.sleep(0.02)\n"
        "    late = time.monotonic() - due\n"
        "    if late > 0.05: print(late, flush=True)\n"
    )

    def start(self) -> None:
        """Begin to count."""
        command = [sys.executable, "-c", self.CODE]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)

    def stop(self) -> None:
        """Count how often it woke more than 50 ms late."""
        self._process.terminate()
        words, _ = self._process.communicate()
        self.late = len(words.splitlines())


def wrk(
    url: str, length: int, connections: int, *more: str, threads: int = 1
) -> tuple[float, dict[str, int], str]:
    """Return requests per second, counts of statuses where a script counts, and all words."""
    command = [
        "wrk",
        f"-t{threads}",
        f"-c{connections}",
        f"-d{length}s",
        "--timeout",
        "30s",
        "--latency",
        *more,
        url,
    ]
    words = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    (rate,) = re.findall(r"Requests/sec:\s+([\d.]+)", words)
    counts = {status: int(count) for status, count in re.findall(r"status (\d+) (\d+)", words)}
    if "Non-2xx" in words and not counts:
        print(words)
    return float(rate), counts, words


def swept(stop: float, num: int = 1000) -> dict[str, Any]:
    """Return the request of the figures: 13 masses, one limiter, 1000 frequencies."""
    return {
        "system": {"preset": "chain", "n": 13, "constraints": [{"dof": 5, "gap": 0.2}]},
        "frequency": {"start": 0.6, "stop": stop, "num": num},
        "outputs": ["impulse", "exists", "reason"],
    }


def problem_of(request: ImpactModesRequest) -> impact_modes.Problem:
    """Return the solver's problem of a request."""
    assert not isinstance(request.system, SystemReference)
    return decode.impact_modes(request, decode.system(request.system))


def lag(server: Server) -> dict[float, float]:
    """Return how often the event loop woke later than each bound, in seconds."""
    text = server.ask("GET", "/metrics").body.decode()
    found = re.findall(r'event_loop_lag_seconds_bucket{le="([^"]+)"} (\S+)', text)
    below = {float(bound): float(count) for bound, count in found}
    return {bound: below[float("inf")] - count for bound, count in below.items()}


def cached(server: Server, length: int) -> Iterator[Figure]:
    """Measure cached results and 304."""
    # Where kernels must be compiled first, the first one becomes a job.
    while server.ask("POST", "/v1/compute/impact-modes", swept(2.4, 100)).status == 202:
        time.sleep(0.5)
    for num in (100, 1000):
        answer = server.asked("POST", "/v1/compute/impact-modes", swept(2.4, num))
        where, tag = answer.headers["content-location"], answer.headers["etag"]
        size = round(len(answer.body) / 1000)
        yield from rated(server, f"cached result, {size} kB", where, length, 1500.0)
    yield from rated(
        server, "304 by If-None-Match", where, length, 2500.0, "-H", f"If-None-Match: {tag}"
    )


def rated(
    server: Server | Bare, what: str, where: str, length: int, least: float | None, *more: str
) -> Iterator[Figure]:
    """Yield the rate of an address, and what the processor time of the service allows."""
    began = server.processor()
    rate, _, _ = wrk(server.url + where, length, 32, *more)
    each = (server.processor() - began) / (rate * length)
    yield Figure(f"{what} [1/s]", rate)
    yield Figure(f"{what}, {_ALONE}", 1.0 / each, least, True)


def bare(length: int) -> Iterator[Figure]:
    """Measure what server and framework alone take to answer with as many bytes."""
    for kind, what in (
        (SERVER, "bare uvicorn, 14 kB"),
        (FRAMEWORK, "bare FastAPI route, 14 kB"),
    ):
        with Bare(kind, 14_000) as other:
            yield from rated(other, what, "/found", length, None)


def modes(server: Server, count: int = 200) -> Iterator[Figure]:
    """Measure computations that nobody asked for before, and the bare library beside them."""
    times, bare = [], []
    spent = library_spent = 0.0
    for number in range(count):
        body = swept(2.4 + 1e-6 * number)
        request = ImpactModesRequest.model_validate(body)
        problem = problem_of(request)
        began, clock = time.perf_counter(), time.process_time()
        impact_modes.solve(problem, impact_modes.plan(problem))
        bare.append(time.perf_counter() - began)
        library_spent += (time.process_time() - clock) * (number >= 20)
        if number == 20:
            spent = server.processor()
        began = time.perf_counter()
        server.asked("POST", "/v1/compute/impact-modes", body)
        times.append(time.perf_counter() - began)
    own = (server.processor() - spent - library_spent) / (count - 20)
    p50, p99 = np.percentile(times[20:], [50, 99]) * 1e3
    library = statistics.median(bare[20:]) * 1e3
    yield Figure(_P50, float(p50), 6.0)
    yield Figure("the same, p99 [ms]", float(p99))
    yield Figure(_BEYOND, float(p50) - library, 3.0)
    yield Figure("processor beyond the library [ms]", 1e3 * own)


def plans() -> Iterator[Figure]:
    """Compare planned seconds with the processor time of the library, over a mix of requests."""
    ratios = []
    for n in (3, 13, 60, 200):
        for num in (100, 2000, 20_000):
            for outputs in (["impulse"], ["impulse", "exists", "reason"], ["impulse", "shape"]):
                if n * num <= 400_000:
                    ratios.append(ratio(n, num, outputs))
    within = sum(1 / 3 <= ratio <= 3 for ratio in ratios) / len(ratios)
    low, middle, high = map(float, np.percentile(ratios, [5, 50, 95]))
    yield Figure(f"planned time within 3x of {len(ratios)} [%]", 100 * within, 90.0, True)
    yield Figure("planned over measured, 5 % below", low)
    yield Figure("planned over measured, median", middle)
    yield Figure("planned over measured, 95 % below", high)
    yield Figure("planned over measured, a sweep of 64 time histories", ratio_of_sweep())


def ratio(n: int, num: int, outputs: list[str]) -> float:
    """Return planned over measured time of a request; the first runs only warm up."""
    spent = []
    for turn in range(4):
        body = {
            "system": {
                "M": {"scalar": 1.0, "n": n},
                "K": {"bands": {"0": [2.0] * n, "1": [-1.0] * (n - 1)}},
                "constraints": [{"dof": n // 2, "gap": 0.2 + 1e-6 * turn}],
            },
            "frequency": {"start": 0.6, "stop": 2.4, "num": num},
            "outputs": outputs,
        }
        request = ImpactModesRequest.model_validate(body)
        problem = problem_of(request)
        plan = impact_modes.plan(problem)
        began = time.process_time()
        encode.freeze(impact_modes.solve(problem, plan), {})
        spent.append(time.process_time() - began)
    return cost.seconds(plan) / min(spent[1:])


def ratio_of_sweep() -> float:
    """Return planned over measured time of a sweep of short time histories."""
    request = SweepRequest.model_validate(SWEEP)
    with tempfile.TemporaryDirectory() as folder:
        _, problem, plan = tasks.assign(Store(folder), KINDS["sweep"], request)
        spent = []
        for _ in range(4):
            began = time.process_time()
            sweep.solve(problem, plan)
            spent.append(time.process_time() - began)
    return cost.seconds(plan) / min(spent[1:])


def clients(server: Server, length: int) -> Iterator[Figure]:
    """Measure 200 clients at once: half results, 304, plans and fresh computations."""
    headers = server.asked("POST", "/v1/compute/impact-modes", swept(2.4, 100)).headers
    script = MIX.replace("%RESULT%", headers["content-location"]).replace("%ETAG%", headers["etag"])
    before = lag(server)
    control = Control()
    with tempfile.NamedTemporaryFile("w", suffix=".lua") as file:
        file.write(script)
        file.flush()
        control.start()
        try:
            rate, counts, words = wrk(server.url, length, 200, "-s", file.name, threads=2)
        finally:
            control.stop()
    after = lag(server)
    bad = sum(count for status, count in counts.items() if status not in ("200", "304", "429"))
    bad += sum(int(n) for n in re.findall(r"(?:connect|read|write|timeout) (\d+)", words))
    (p99,) = re.findall(r"99%\s+([\d.]+)(us|ms|s|m)\b", words)
    late = after[0.05] - before[0.05]
    yield Figure("answers [1/s]", rate)
    yield Figure("p99 [ms]", float(p99[0]) * {"us": 1e-3, "ms": 1.0, "s": 1e3, "m": 6e4}[p99[1]])
    yield Figure("errors other than 429", bad, 0.0)
    # An idle process wakes late where the machine has no core for it.
    yield Figure(_LATE, late, control.late)
    yield Figure("idle process over 50 ms late", control.late)
    yield Figure("memory of the server [MB]", server.memory(), 600.0)


def stream(server: Server) -> Iterator[Figure]:
    """Measure a large HDF5 result: made from the stored arrays, then sent."""
    name = digest.name("local", "benchmark", "", b"big")
    values = np.random.default_rng(7).standard_normal((_LARGE // 8000, 1000))
    body = stored(values)
    Store(str(server.data / "store")).results.put(name, body)
    size = len(body)
    del values, body
    base, peak, done = server.memory(), [0.0], threading.Event()

    def look() -> None:
        while not done.wait(0.02):
            peak[0] = max(peak[0], server.memory())

    before = lag(server)
    watcher = threading.Thread(target=look)
    watcher.start()
    control = Control()
    control.start()
    try:
        for turn in ("first, made and sent", "again, sent"):
            began = time.perf_counter()
            received = _received(server, name)
            yield Figure(f"{turn} [MB/s]", received / (time.perf_counter() - began) / 1e6)
    finally:
        done.set()
        watcher.join()
        control.stop()
    late = lag(server)[0.05] - before[0.05]
    yield Figure("memory of the server beside what it had, at most [MB]", peak[0] - base, 64.0)
    yield Figure(_LATE, late, control.late)
    yield Figure("idle process over 50 ms late", control.late)
    assert received > 0.8 * size


def _received(server: Server, name: str) -> int:
    connection = server.connection()
    connection.request("GET", f"/v1/results/{name}", headers={"Accept": HDF5})
    answer = connection.getresponse()
    assert answer.status == 200, answer.read()[:500]
    return sum(len(piece) for piece in iter(functools.partial(answer.read, 2**20), b""))


_LARGE: Final = 2**28


@dataclasses.dataclass(frozen=True)
class Stored:
    """A result with one array."""

    shape: Annotated[Any, Quantity(("frequency", "dof"), "length", "shape")]


def stored(values: np.ndarray[Any, Any]) -> bytes:
    """Return the bundle of a result with one array."""
    head = {
        "kind": "benchmark", "digest": "", "request": "{}", "plan": {}, "units": None,
        "provenance": {"created": "", "solver_version": ""},
    }  # fmt: skip
    return encode.freeze(Stored(values), head)


def _need_wrk() -> None:
    if shutil.which("wrk") is None:
        raise RuntimeError("wrk is needed: apt install wrk")


def answers() -> Table:
    """Ask for stored results and for computations that nobody asked for before."""
    _need_wrk()
    with running() as server:
        found = [*cached(server, SECONDS), *bare(SECONDS), *modes(server)]
    note = (
        "32 connections; the load generator shares the cores with the service. Bare: the same "
        "server, without and with the framework, answering with bytes that it holds, without "
        "callers, limits, conditions, figures, security fields and log."
    )
    figure = {each.name: each.value for each in found}
    least, framework = (
        1e6 / figure[f"{what}, 14 kB, {_ALONE}"] for what in ("bare uvicorn", "bare FastAPI route")
    )
    reasons = dict.fromkeys((_P50, _BEYOND), _SHARED) | {
        f"{what}, {_ALONE}": f"of {1e6 / figure[f'{what}, {_ALONE}']:.0f} µs of an answer, "
        f"{least:.0f} are uvicorn's, which measured at the same time would take {framework:.0f} "
        "with a bare route of the framework: on a quieter machine all of them become shorter"
        for what in ("cached result, 14 kB", "cached result, 128 kB", "304 by If-None-Match")
        if f"{what}, {_ALONE}" in figure
    }
    return figures("Answers over HTTP", found, note, reasons)


def crowd() -> Table:
    """Let 200 clients ask for results, plans and fresh computations at once."""
    _need_wrk()
    with running() as server:
        found = list(clients(server, _CROWD))
    note = f"For {_CROWD} s. The event loop is sampled every 20 ms."
    return figures("Two hundred clients", found, note, {_LATE: _SHARED})


def large_results() -> Table:
    """Send a large HDF5 result, which is made from the stored arrays at first."""
    with running() as server:
        found = list(stream(server))
    return figures(f"A result of {_LARGE // 2**20} MB", found, "", {_LATE: _SHARED})


def estimates() -> Table:
    """Compare planned seconds with the processor time of the library, over a mix of requests."""
    note = "Plans speak of one core of a machine of 2024."
    return figures("Estimates of plans", plans(), note, {"": _PLANNED})


TABLES: Final = (answers, crowd, large_results, estimates)
