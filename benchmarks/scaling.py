"""How costs grow with size, frequencies, impacts and threads; large structures."""

from __future__ import annotations

import os
import time
from functools import partial
from typing import Any

import numpy as np

from benchmarks.cases import chain, grid, random_structure, solve, uneven_chain
from benchmarks.harness import Work, measure
from benchmarks.peers import ours
from benchmarks.peers.cases import from_mode
from benchmarks.tables import Goal, Plot, Table, Trend
from vibroimpact_solvers import ensemble, spectrum
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
    rows.sort(key=lambda row: row[0])
    y = "time [µs/frequency]"
    return Table(
        "Cost against the number of masses",
        ("outputs", "N", "frequencies", y, "time [ns/mode/frequency]"),
        rows,
        "Chain with one constraint, time of the processor. Expected: linear in N from 100.",
        plots=(Plot("N", y, by="outputs"),),
        trends=(Trend("N", y, 1.15, by="outputs", since=100.0),),
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

            seconds = measure(rounds=3, work=work)["work"].processor
            rows.append((title, n, method.value, seconds))
    return Table(
        "Natural modes",
        ("structure", "N", "method", "time [s]"),
        rows,
        "Once for each structure; kept by content. Expected: quadratic for tridiagonal matrices, "
        "cubic for full ones.",
        plots=(Plot("N", "time [s]", by="structure"),),
        trends=(
            Trend("N", "time [s]", 2.2, by="structure", only=("tridiagonal",)),
            Trend("N", "time [s]", 3.1, by="structure", only=("full",)),
        ),
    )


def frequencies() -> Table:
    """Ask for more frequencies: what is paid once, and what each costs."""
    rows: list[tuple[Any, ...]] = []
    system = chain(100)
    for points in (1, 10, 100, 1000, 10_000, 100_000, 1_000_000):
        work = partial(solve, system, grid(0.2, 3.0, points))
        timing = measure(rounds=3, work=work)["work"]
        rows.append(("impulse", points, timing.processor * 1e3, timing.processor / points * _MICRO))
    return Table(
        "Cost against the number of frequencies, N = 100",
        ("outputs", "frequencies", "time [ms]", "time [µs/frequency]"),
        rows,
        "Time of the processor. Expected: linear from 10 000 frequencies, before which planning "
        "is most of it.",
        plots=(Plot("frequencies", "time [ms]", by="outputs"),),
        trends=(Trend("frequencies", "time [ms]", 1.05, by="outputs", since=10_000.0),),
    )


def threads() -> Table:
    """Use one core, then all: kernels release the GIL and take their share of frequencies."""
    if not hasattr(os, "sched_setaffinity"):
        raise RuntimeError("processes cannot be bound to cores here")
    everywhere = os.sched_getaffinity(0)
    system, Omega = chain(1000), grid(0.2, 3.0, 20_000)
    few = grid(0.2, 3.0, 2000)
    cases: dict[str, Work] = {
        "impulse, 20 000 frequencies": partial(solve, system, Omega),
        "energy, 2000 frequencies": partial(solve, system, few, frozenset({"energy"})),
        "motions of 13 masses from 10 000 initial states": _ensemble(10_000),
    }
    rows: list[tuple[Any, ...]] = []
    for title, work in cases.items():
        alone = None
        for count in range(1, len(everywhere) + 1):
            os.sched_setaffinity(0, sorted(everywhere)[:count])
            try:
                seconds = min(_clock(work) for _ in range(7))
            finally:
                os.sched_setaffinity(0, everywhere)
            alone = alone or seconds
            rows.append(
                (
                    title,
                    count,
                    seconds,
                    alone / seconds,
                    _share(title) * count if count > 1 else None,
                )
            )
    return Table(
        "Threads, chains of 1000 and of 13 masses",
        ("work", "cores", "clock [s]", "speed-up", "goal"),
        rows,
        "Least time on the clock of seven; neighbours of the benchmark share the cores.",
        Goal("speed-up", "goal", at_least=True),
        reasons={
            "": "making the problem and its plan takes 2 ms on one core; motions are computed in "
            "blocks of 209 frequencies, one after the other; a block takes 1 ms, and threads begin "
            "at 4 ms"
        },
    )


def _share(title: str) -> float:
    """Return the speed-up for each core that a work should have."""
    return 0.9 if title.startswith("motions") else 0.8


def _ensemble(members: int) -> Work:
    """Return motions of a chain from random initial states, with 20 impacts and 4 outputs each."""
    random, system = np.random.default_rng(0), chain(13)
    x, v = 0.1 * random.uniform(-1.0, 1.0, (members, 13)), random.standard_normal((members, 13))
    t, outputs = np.linspace(0.0, 10.0, 4), frozenset({"impacts", "x", "v"})
    problem = ensemble.Problem(system, x, v, 10.0, t, outputs=outputs)
    return lambda: ensemble.solve(problem, ensemble.plan(problem))


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
            scene = from_mode(n, dof, 1.5 * 2.0 / np.pi * top, count // 2)
            timing = measure(rounds=3, sample=0.0, work=partial(ours.whole, scene))["work"]
            seen = max(1, len(ours.whole(scene).times))
            each = timing.processor / seen * _MICRO
            rows.append((f"N = {n}", seen, timing.processor * 1e3, each))
    return Table(
        "Cost against the number of impacts",
        ("structure", "impacts", "time [ms]", "time [µs/impact]"),
        rows,
        "Elastic chain from an impact mode, state at the end and all impacts; planning included. "
        "Expected: linear from 100 impacts.",
        plots=(Plot("impacts", "time [ms]", by="structure"),),
        trends=(Trend("impacts", "time [ms]", 1.1, by="structure", since=100.0),),
    )


def large() -> Table:
    """Large structures and long grids: what the planner makes of them."""
    rows: list[tuple[Any, ...]] = []

    def add(problem: str, outputs: str, goal: float | None, work: Work, rounds: int = 5) -> None:
        timing = measure(rounds=rounds, work=work)["work"]
        rows.append((problem, outputs, timing.wall, timing.processor, goal))

    bulk, dense, long = chain(100), random_structure(2000, 1), uneven_chain(100_000, 2)
    add("chain N=100, 10⁵ frequencies", "impulse", 0.1, partial(solve, bulk, grid(0.2, 3.0, 10**5)))
    start, used = time.perf_counter(), time.process_time()
    solve(dense, grid(0.5, 0.6, 2))
    once = time.perf_counter() - start, time.process_time() - used
    rows.append(("full M and K, N=2000: all natural modes", "", *once, None))
    add("… then 10³ frequencies", "impulse", 1.0, partial(solve, dense, grid(0.3, 4.0, 1000)))
    Omega, title = grid(2.6, 6.0, 20), "tridiagonal, N=10⁵, above Ω_N by the series"
    add(f"{title}: one frequency", "impulse", 1.0, partial(solve, long, Omega[:1]))
    add(f"{title}: 20 frequencies", "impulse", 1.0, partial(solve, long, Omega))
    exist = partial(solve, long, Omega, frozenset({"impulse", "exists"}))
    add(f"{title}: 20 frequencies", "impulse, existence", 1.0, exist, rounds=3)
    return Table(
        "Large structures",
        ("problem", "outputs", "clock [s]", "processor [s]", "goal [s]"),
        rows,
        "Medians; the natural modes are computed once and kept.",
        Goal("processor [s]", "goal [s]"),
    )
