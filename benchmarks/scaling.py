"""How costs grow: with the size of the structure, the frequencies and the threads; cold starts."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.cases import chain, grid, random_structure, uneven_chain
from benchmarks.harness import Work, measure
from benchmarks.impact_modes import solve
from benchmarks.tables import Plot, Table
from benchmarks.time_histories import from_mode, ours
from vibroimpact_solvers import spectrum
from vibroimpact_solvers.spectrum import methods

_MICRO = 1e6


def size() -> Table:
    """Grow the structure; the natural modes are known beforehand."""
    rows: list[tuple[Any, ...]] = []
    for n in (10, 30, 100, 300, 1000, 3000):
        system, points = chain(n), max(200, 100_000 // n)
        Omega = grid(0.2, 3.0, points)
        for outputs in (("impulse",), ("impulse", "exists"), ("energy",)):
            work = partial(solve, system, Omega, frozenset(outputs))
            each = measure(rounds=3, work=work)["work"].processor / points * _MICRO
            rows.append((", ".join(outputs), n, points, each, each / n * 1e3))
    return Table(
        "Cost against the number of masses",
        ("outputs", "N", "frequencies", "time [µs/frequency]", "time [ns/mode/frequency]"),
        rows,
        "Chain with one constraint, time of the processor.",
        plots=(Plot("N", "time [µs/frequency]", by="outputs"),),
    )


def modes() -> Table:
    """Find all natural modes by the method that the structure allows."""
    rows: list[tuple[Any, ...]] = []
    for n in (100, 300, 1000):
        for title, make in (("tridiagonal", uneven_chain), ("full", random_structure)):
            system = make(n, 7)
            method = spectrum.choose(system)

            def work(system: Any = system) -> None:
                methods._compute(system, spectrum.choose(system))

            found = measure(rounds=3, work=work)["work"].processor
            rows.append((title, n, method.value, found))
    return Table(
        "Natural modes",
        ("structure", "N", "method", "time [s]"),
        rows,
        "Once for each structure; kept by content.",
        plots=(Plot("N", "time [s]", by="structure"),),
    )


def frequencies() -> Table:
    """Ask for more frequencies: what is paid once, and what each costs."""
    rows: list[tuple[Any, ...]] = []
    system = chain(100)
    for points in (1, 10, 100, 1000, 10_000, 100_000, 1_000_000):
        work = partial(solve, system, grid(0.2, 3.0, points))
        found = measure(rounds=3, work=work)["work"]
        rows.append(("impulse", points, found.processor * 1e3, found.processor / points * _MICRO))
    return Table(
        "Cost against the number of frequencies, N = 100",
        ("outputs", "frequencies", "time [ms]", "time [µs/frequency]"),
        rows,
        plots=(Plot("frequencies", "time [ms]", by="outputs"),),
    )


def threads() -> Table:
    """Use one core, then all: kernels release the GIL and take their share of frequencies."""
    if not hasattr(os, "sched_setaffinity"):
        return Table("Threads", ("cores",), [], "Processes cannot be bound to cores here.")
    everywhere = os.sched_getaffinity(0)
    system, Omega = chain(1000), grid(0.2, 3.0, 20_000)
    few = grid(0.2, 3.0, 2000)
    cases: dict[str, Work] = {
        "impulse, 20 000 frequencies": partial(solve, system, Omega),
        "energy, 2000 frequencies": partial(solve, system, few, frozenset({"energy"})),
    }
    rows: list[tuple[Any, ...]] = []
    for title, work in cases.items():
        alone = None
        for count in range(1, len(everywhere) + 1):
            os.sched_setaffinity(0, sorted(everywhere)[:count])
            try:
                found = min(_clock(work) for _ in range(7))
            finally:
                os.sched_setaffinity(0, everywhere)
            alone = alone or found
            rows.append((title, count, found, alone / found))
    return Table(
        "Threads, chain of 1000 masses",
        ("work", "cores", "clock [s]", "speed-up"),
        rows,
        "Least time on the clock of seven; neighbours of the benchmark share the cores.",
    )


def _clock(work: Work) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def impacts() -> Table:
    """Follow longer and longer elastic motions: time and memory for each impact."""
    rows: list[tuple[Any, ...]] = []
    for n, dof in ((1, 0), (13, 5), (100, 49)):
        top = spectrum.spectrum(chain(n)).largest_frequency
        for count in (10, 100, 1000, 10_000):
            if n * count > 200_000:
                continue
            system, scene, _ = from_mode(n, dof, 1.5 * 2.0 / np.pi * top, count // 2)
            found = measure(rounds=3, sample=0.0, work=partial(ours, system, scene))["work"]
            seen = max(1, len(ours(system, scene).times))
            each = found.processor / seen * _MICRO
            rows.append((f"N = {n}", seen, found.processor * 1e3, each))
    return Table(
        "Cost against the number of impacts",
        ("structure", "impacts", "time [ms]", "time [µs/impact]"),
        rows,
        "Elastic chain from an impact mode, state at the end and all impacts; planning included.",
        plots=(Plot("impacts", "time [ms]", by="structure"),),
    )


_PEAK: Final = """
import sys
from benchmarks.impact_modes import solve
from benchmarks.cases import chain, grid
solve(chain(13), grid(0.2, 3.0, 100), frozenset({"impulse"}))
def most():
    # What getrusage says begins with the largest memory of the process that started this one.
    lines = open("/proc/self/status").read().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))
before = most()
solve(chain(int(sys.argv[1])), grid(0.2, 3.0, int(sys.argv[2])), frozenset(sys.argv[3].split()))
print(before, most())
"""


def memory() -> Table:
    """Measure the largest memory of processes that solve one problem each."""
    rows: list[tuple[Any, ...]] = []
    if not Path("/proc/self/status").exists():
        return Table("Memory", ("N",), [], "The system does not tell the memory of a process.")
    for n, points, outputs in (
        (13, 1000, "impulse"),
        (13, 1_000_000, "impulse"),
        (100, 100_000, "impulse exists"),
        (1000, 2000, "impulse exists energy"),
        (3000, 1000, "impulse energy"),
    ):
        done = subprocess.run(
            [sys.executable, "-c", _PEAK, str(n), str(points), outputs],
            capture_output=True,
            text=True,
            check=True,
            cwd=Path(__file__).parent.parent,
        )
        before, peak = (int(number) / 1024.0 for number in done.stdout.split())
        rows.append((n, points, outputs, before, peak - before))
    return Table(
        "Memory",
        ("N", "frequencies", "outputs", "libraries [MB]", "beside them at most [MB]"),
        rows,
        "Chain with one constraint; the result included.",
    )


_FIRST: Final = """
import time
start = time.perf_counter()
from benchmarks.impact_modes import solve
from benchmarks.cases import chain, grid
loaded = time.perf_counter()
solve(chain(13), grid(0.2, 3.0, 100), frozenset({"impulse", "exists"}))
done = time.perf_counter()
solve(chain(13), grid(0.3, 3.0, 100), frozenset({"impulse", "exists"}))
print(loaded - start, done - loaded, time.perf_counter() - done)
"""


def cold_starts() -> Table:
    """Start a new process: import, first result, and the second one."""
    rows: list[tuple[Any, ...]] = []
    with tempfile.TemporaryDirectory() as empty:
        for title in ("kernels compiled", "kernels from disk"):
            environment = {**os.environ, "NUMBA_CACHE_DIR": empty}
            done = subprocess.run(
                [sys.executable, "-c", _FIRST],
                capture_output=True,
                text=True,
                check=True,
                env=environment,
                cwd=Path(__file__).parent.parent,
            )
            rows.append((title, *map(float, done.stdout.split())))
    return Table(
        "Cold starts",
        ("process", "import [s]", "first result [s]", "second result [s]"),
        rows,
        "Impulses and existence at 100 frequencies, chain of 13 masses; the kernels are compiled "
        "once in the life of an installation.",
    )


TABLES: Final = (size, modes, frequencies, impacts, threads, memory, cold_starts)
