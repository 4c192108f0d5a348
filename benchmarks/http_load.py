"""How fast the service is, measured with wrk from outside on a service of its own.

It needs wrk (Debian: ``apt install wrk``). Everything runs on this machine, load generator
included: its cores are shared.
"""

from __future__ import annotations

import dataclasses
import functools
import http.client
import json
import os
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, Final
from urllib.parse import urlsplit

import numpy as np

from benchmarks.tables import Table
from vibroimpact_schema.requests import ImpactModesRequest
from vibroimpact_schema.systems import SystemReference
from vibroimpact_service import decode, digest, encode
from vibroimpact_service.store import Store
from vibroimpact_solvers import cost, impact_modes
from vibroimpact_solvers.arrays import Quantity

SECONDS: Final = 10
HDF5 = "application/x-hdf5"
JSON = {"Content-Type": "application/json"}
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


class Service:
    """A service in a process of its own."""

    def __init__(self, data: Path) -> None:
        command = [sys.executable, "-m", "vibroimpact_service", "--port", "0", "--data", str(data)]
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "VIBROIMPACT_WORKERS": "1"}
        self.log = (data / "stderr.txt").open("wb")
        self.process = subprocess.Popen(
            command, env=environment, stdout=subprocess.DEVNULL, stderr=self.log
        )
        note = data / "service.json"
        while not note.exists():
            if self.process.poll() is not None:
                sys.exit((data / "stderr.txt").read_text())
            time.sleep(0.05)
        self.url = json.loads(note.read_text())["url"]
        self.http = http.client.HTTPConnection(urlsplit(self.url).netloc, timeout=600)
        while self.ask("GET", "/v1/health/ready")[0] != 200:
            time.sleep(0.1)

    def ask(
        self, method: str, path: str, body: Any = None, headers: dict[str, str] | None = None
    ) -> tuple[int, dict[str, str], bytes]:
        """Return status, headers and body of an answer."""
        data = None if body is None else json.dumps(body)
        try:
            self.http.request(method, path, data, {**JSON, **(headers or {})})
            answer = self.http.getresponse()
        except http.client.RemoteDisconnected:  # it was idle for too long
            self.http.close()
            return self.ask(method, path, body, headers)
        found = {name.lower(): value for name, value in answer.getheaders()}
        return answer.status, found, answer.read()

    def memory(self, field: str = "VmRSS") -> float:
        """Return mebibytes of the process that serves."""
        text = Path(f"/proc/{self.process.pid}/status").read_text()
        (value,) = re.findall(rf"^{field}:\s+(\d+) kB", text, re.M)
        return int(value) / 1024

    def cpu(self) -> float:
        """Return the seconds of processor time that the serving process has spent."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def lag(self) -> dict[float, float]:
        """Return how often the event loop woke later than each bound, in seconds."""
        text = self.ask("GET", "/metrics")[2].decode()
        found = re.findall(r'event_loop_lag_seconds_bucket{le="([^"]+)"} (\S+)', text)
        below = {float(bound): float(count) for bound, count in found}
        return {bound: below[float("inf")] - count for bound, count in below.items()}

    def stop(self) -> None:
        """Stop it."""
        self.http.close()
        self.process.terminate()
        self.process.wait(30)
        self.log.close()


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
    url: str, seconds: int, connections: int, *more: str, threads: int = 1
) -> tuple[float, dict[str, int], str]:
    """Return requests per second, counts of statuses where a script counts, and all words."""
    command = [
        "wrk",
        f"-t{threads}",
        f"-c{connections}",
        f"-d{seconds}s",
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


def cached(service: Service, seconds: int) -> Iterator[tuple[str, str, str]]:
    """Measure cached results and 304."""
    for num in (100, 1000):
        _, headers, body = service.ask("POST", "/v1/compute/impact-modes", swept(2.4, num))
        where, tag = headers["content-location"], headers["etag"]
        yield f"cached result by digest, {len(body)} bytes", rated(service, where, seconds), "1500"
    text = rated(service, where, seconds, "-H", f"If-None-Match: {tag}")
    yield "304 by If-None-Match", text, "2500"


def rated(service: Service, where: str, seconds: int, *more: str) -> str:
    """Return the rate of an address; on an idle machine, what the processor time allows."""
    began = service.cpu()
    rate, _, _ = wrk(service.url + where, seconds, 32, *more)
    each = (service.cpu() - began) / (rate * seconds)
    return f"{rate:.0f} req/s ({1e6 * each:.0f} us of CPU: {1 / each:.0f}/s per core)"


def modes(service: Service, count: int = 300) -> Iterator[tuple[str, str, str]]:
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
            spent = service.cpu()
        began = time.perf_counter()
        status, _, _ = service.ask("POST", "/v1/compute/impact-modes", body)
        times.append(time.perf_counter() - began)
        assert status == 200
    own = (service.cpu() - spent - library_spent) / (count - 20)
    p50, p99 = np.percentile(times[20:], [50, 99]) * 1e3
    library = statistics.median(bare[20:]) * 1e3
    yield "impact-modes N=13 x 1000, p50", f"{p50:.2f} ms (p99 {p99:.1f})", "<= 6 ms"
    yield (
        "  of which beyond the library",
        f"{p50 - library:.2f} ms ({1e3 * own:.2f} ms of CPU)",
        "<= 3 ms",
    )


def plans() -> Iterator[tuple[str, str, str]]:
    """Compare planned seconds with the processor time of the library, over a mix of requests."""
    ratios = []
    for n in (3, 13, 60, 200):
        for num in (100, 2000, 20_000):
            for outputs in (["impulse"], ["impulse", "exists", "reason"], ["impulse", "shape"]):
                if n * num <= 400_000:
                    ratios.append(ratio(n, num, outputs))
    within = sum(1 / 3 <= ratio <= 3 for ratio in ratios) / len(ratios)
    low, middle, high = np.percentile(ratios, [5, 50, 95])
    text = f"{100 * within:.0f} % (5, 50, 95 %: {low:.2f}, {middle:.2f}, {high:.2f})"
    yield f"planned over measured time within 3x, of {len(ratios)}", text, ">= 90 %"


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


def clients(service: Service, seconds: int) -> Iterator[tuple[str, str, str]]:
    """Measure 200 clients at once: half results, 304, plans and fresh computations."""
    _, headers, _ = service.ask("POST", "/v1/compute/impact-modes", swept(2.4, 100))
    script = MIX.replace("%RESULT%", headers["content-location"]).replace("%ETAG%", headers["etag"])
    before = service.lag()
    with tempfile.NamedTemporaryFile("w", suffix=".lua") as file:
        file.write(script)
        file.flush()
        control = Control()
        control.start()
        rate, counts, words = wrk(service.url, seconds, 200, "-s", file.name, threads=2)
        control.stop()
    after = service.lag()
    bad: dict[str, Any] = {s: n for s, n in counts.items() if s not in ("200", "304", "429")}
    bad |= dict(re.findall(r"(connect|read|write|timeout) ([1-9]\d*)", words))
    (p99,) = re.findall(r"99%\s+(\S+)", words)
    yield f"200 clients for {seconds} s", f"{rate:.0f} req/s (p99 {p99})", ""
    yield "  errors other than 429", str(bad or 0), "0"
    late = {bound: after[bound] - before[bound] for bound in (0.025, 0.05, 0.1)}
    text = ", ".join(f"{n:.0f} > {1e3 * b:.0f} ms" for b, n in late.items())
    text += f" (idle process: {control.late} > 50)"
    yield "  event loop late (samples every 20 ms)", text, "0 > 50 ms"
    yield "  memory of the server", f"{service.memory():.0f} MiB", ""


def stream(service: Service, data: Path) -> Iterator[tuple[str, str, str]]:
    """Measure an HDF5 result of one gibibyte: made from the stored arrays, then sent."""
    rows = 2**27 // 1000
    name = digest.name("local", "benchmark", "", b"big")
    values = np.random.default_rng(7).standard_normal((rows, 1000))
    body, headers = stored(values), {"Accept": HDF5}
    Store(str(data / "store")).results.put(name, body)
    size = len(body)
    del values, body
    base, peak, done = service.memory(), [0.0], threading.Event()

    def look() -> None:
        while not done.wait(0.02):
            peak[0] = max(peak[0], service.memory())

    before = service.lag()
    watcher = threading.Thread(target=look)
    watcher.start()
    control = Control()
    control.start()
    began = time.perf_counter()
    for turn in ("first, made and sent", "again, sent"):
        turn_began = time.perf_counter()
        service.http.request("GET", f"/v1/results/{name}", headers=headers)
        answer = service.http.getresponse()
        assert answer.status == 200, answer.read()[:500]
        received = sum(len(piece) for piece in iter(functools.partial(answer.read, 2**20), b""))
        spent = time.perf_counter() - turn_began
        yield f"1 GiB HDF5, {turn}", f"{spent:.1f} s ({received / spent / 2**20:.0f} MiB/s)", ""
    done.set()
    watcher.join()
    control.stop()
    after = service.lag()
    late = after[0.05] - before[0.05]
    yield "  memory of the server at most", f"{peak[0]:.0f} MiB (before: {base:.0f})", "< 300 MiB"
    total = time.perf_counter() - began
    yield (
        "  event loop late",
        f"{late:.0f} > 50 ms in {total:.0f} s (idle process: {control.late})",
        "0",
    )
    assert received > 0.8 * size


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


@contextmanager
def _running() -> Iterator[tuple[Service, Path]]:
    if shutil.which("wrk") is None:
        raise RuntimeError("wrk is needed: apt install wrk")
    with tempfile.TemporaryDirectory() as folder:
        service = Service(Path(folder))
        try:
            yield service, Path(folder)
        finally:
            service.stop()


def _table(title: str, rows: Iterable[tuple[str, str, str]]) -> Table:
    return Table(title, ("figure", "measured", "aim"), list(rows))


def answers() -> Table:
    """Ask for stored results and for computations that nobody asked for before."""
    with _running() as (service, _):
        return _table("Answers over HTTP", chain(cached(service, SECONDS), modes(service)))


def crowd() -> Table:
    """Let 200 clients ask for results, plans and fresh computations at once for a minute."""
    with _running() as (service, _):
        return _table("Two hundred clients", clients(service, 60))


def large_results() -> Table:
    """Send an HDF5 result of one gibibyte."""
    with _running() as (service, folder):
        return _table("A result of one gibibyte", stream(service, folder))


def estimates() -> Table:
    """Compare planned seconds with the processor time of the library, over a mix of requests."""
    return _table("Estimates of plans", plans())


TABLES: Final = (answers, crowd, large_results, estimates)
