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
import time
from collections.abc import Iterable, Iterator
from typing import Any, Final, NamedTuple

from benchmarks.prices.requests import Case, case
from vibroimpact_schema import examples
from vibroimpact_service.documents import decode, parse, planning
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.store import Store
from vibroimpact_solvers import spectrum

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
    os.environ["OMP_NUM_THREADS"] = "1"
    for kind in KINDS.values():
        for example in examples.requests(kind.name).values():
            _seconds(Case(kind.name, "", example["request"]), 1)


def each(names: Iterable[str], seeds: Iterable[int], longest: float) -> Iterator[Measured]:
    """Measure the requests of these names and seeds; each may take `longest` seconds.

    Requests that are refused, such as those without any solution, are left out.
    """
    seeds = list(seeds)
    for name in names:
        for seed in seeds:
            one = _forked(name, seed, longest)
            if one is not None:
                yield one


def _forked(name: str, seed: int, longest: float) -> Measured | None:
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
    planned, planning_seconds = _planned(drawn)
    n = planned.problem.system.n
    steps = planning.steps(planned.plan)["steps"]
    first = [drawn.about, planned.seconds, planning_seconds, steps, n]
    os.write(writer, (json.dumps(first) + "\n").encode())
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
    try:
        seconds: float | None = _seconds(drawn, 3)
    except Exception:
        seconds = None
    os.write(writer, (json.dumps(seconds) + "\n").encode())


def _planned(drawn: Case) -> tuple[planning.Planned, float]:
    spectrum.CACHE.clear()
    decode._known_system.cache_clear()
    kind = KINDS[drawn.kind]
    document: Any = parse.document(kind.request, drawn.document)
    with tempfile.TemporaryDirectory() as folder:
        began = time.thread_time()
        planned = planning.plan(Store(folder), kind, document)
        return planned, time.thread_time() - began


def _seconds(drawn: Case, times: int) -> float:
    """Return the processor time of the solution, the least of some attempts at a quick one."""
    best = float("inf")
    for _ in range(times):
        planned, _ = _planned(drawn)
        gc.disable()
        began = time.thread_time()
        planned.kind.solver.solve(planned.problem, planned.plan)
        best = min(best, time.thread_time() - began)
        if best > _SHORT:
            break
    return best
