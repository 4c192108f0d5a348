"""Processor time of requests, each computed in a process of its own, on one core.

A process is forked for each request from one that has loaded all kernels: nothing that was computed
before is known to it. What takes longer than allowed is ended by the operating system.
"""

from __future__ import annotations

import gc
import json
import os
import resource
import signal
import tempfile
from typing import Any, Final, NamedTuple

from benchmarks.prices.requests import Case, case
from vibroimpact_schema import examples
from vibroimpact_service.documents import decode, parse, planning
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.store import Store
from vibroimpact_solvers import meter, spectrum
from vibroimpact_solvers.model import System

_SHORT: Final = 0.3
"""Seconds up to which a request is computed three times: the first touches new memory."""


class Measured(NamedTuple):
    """A request and what it took, seconds; `measured` is inf where it was ended."""

    name: str
    seed: int
    about: str
    estimate: float
    measured: float
    planning: float
    steps: list[dict[str, Any]]
    n: int


def prepare() -> None:
    """Load the libraries and all kernels, by an example of each kind."""
    for kind in KINDS.values():
        for example in examples.requests(kind.name).values():
            _seconds(Case(kind.name, "", example["request"]), 1)


def one(name: str, seed: int, longest: float) -> Measured | None:
    """Measure a request, which may take `longest` seconds.

    None where it is refused, such as one without any solution.
    """
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        try:
            _measure(name, seed, longest, writer)
        finally:
            os._exit(0)
    os.close(writer)
    with os.fdopen(reader) as answers:
        lines = answers.read().splitlines()
    os.waitpid(child, 0)
    if not lines:
        return None
    about, estimate, planning_seconds, steps, n = json.loads(lines[0])
    measured = json.loads(lines[1]) if len(lines) > 1 else float("inf")
    if measured is None:
        return None
    return Measured(name, seed, about, estimate, measured, planning_seconds, steps, n)


def _measure(name: str, seed: int, longest: float, writer: int) -> None:
    """Write the plan, and then the time, or null where it is refused."""
    drawn = case(name, seed)
    signal.signal(signal.SIGXCPU, signal.SIG_DFL)
    used = resource.getrusage(resource.RUSAGE_SELF)
    limit = int(used.ru_utime + used.ru_stime + longest + 1.0)
    began = meter.processor_time()
    own = planned(drawn)
    planning_seconds = meter.processor_time() - began
    n = own.problem.system.n
    steps = planning.steps(own.plan)["steps"]
    first = [drawn.about, own.seconds, planning_seconds, steps, n]
    os.write(writer, (json.dumps(first) + "\n").encode())
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
    try:
        seconds: float | None = _seconds(drawn, 3)
    except Exception:
        seconds = None
    os.write(writer, (json.dumps(seconds) + "\n").encode())


def planned(drawn: Case) -> planning.Planned:
    """Plan a request as the first of its process."""
    spectrum.CACHE.clear()
    decode.KNOWN.clear()
    kind = KINDS[drawn.kind]
    document: Any = parse.document(kind.request, drawn.document)
    with tempfile.TemporaryDirectory() as folder:
        return planning.plan(Store(folder), kind, document)


def _seconds(drawn: Case, times: int) -> float:
    """Return the processor time of the solution, the least of some attempts at a quick one."""
    best = float("inf")
    for _ in range(times):
        own = planned(drawn)
        gc.disable()
        began = meter.processor_time()
        own.kind.solver.solve(own.problem, own.plan)
        best = min(best, meter.processor_time() - began)
        if best > _SHORT:
            break
    return best


def spectrum_seconds(of: System) -> float:
    """Return the processor time of the natural modes of a structure, the least of three."""
    best = float("inf")
    for _ in range(3):
        spectrum.CACHE.clear()
        began = meter.processor_time()
        spectrum.spectrum(of)
        best = min(best, meter.processor_time() - began)
        if best > _SHORT:
            break
    return best
