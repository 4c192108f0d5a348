"""Large problems: structures of many masses, and long grids of frequencies."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import numpy as np

from benchmarks.cases import chain, grid, net, random_structure, solve, uneven_chain
from benchmarks.harness import Work, measure, worst
from benchmarks.tables import Goal, Table
from vibroimpact_solvers import impact_modes, spectrum
from vibroimpact_solvers.impact_modes import Problem, Result, partial_modes_plan
from vibroimpact_solvers.impact_modes.direct import DirectFamily
from vibroimpact_solvers.plan import Plan


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


def partial_spectrum() -> Table:
    """Find impact modes of square nets by few natural modes, and by factors at each frequency.

    Frequencies from 0.3 to 0.301 of the bound of the spectrum: two harmonics each.
    """
    rows: list[tuple[Any, ...]] = []
    for side, points in ((40, 300), (70, 300), (100, 300)):
        system = net(side)
        bound = spectrum.largest_frequency(system)
        Omega = bound * np.linspace(0.3, 0.301, points)
        problem = Problem(system, Omega * 2.0 / np.pi, outputs=frozenset({"impulse"}), Omega=Omega)
        few = problem.slice(0, 6)
        spectrum.CACHE.clear()
        started = time.process_time()
        _planned(problem)
        cold = time.process_time() - started
        warm = measure(rounds=3, sample=0.0, work=partial(_planned, problem))["work"].processor
        direct = DirectFamily(few, bound)  # keeps its waves: timed once
        started = time.process_time()
        expected, _ = direct.solutions(few.frequencies)
        by_solves = (time.process_time() - started) / few.omega.size
        by_cells = _planned(few, partial_modes_plan(problem))
        assert by_cells.impulse is not None
        off = worst((by_cells.impulse / expected.plus - 1.0).ravel())
        stated = float(np.max(by_cells.impulse_error))
        rows.append((side * side, points, cold, warm / points * 1e3, by_solves * 1e3, off, stated))
    return Table(
        "Large sparse structures by few natural modes",
        (
            "N",
            "frequencies",
            "first time [s]",
            "then [ms/frequency]",
            "by factors [ms/frequency]",
            "difference",
            "error stated",
        ),
        rows,
        "Time of the processor. The first time finds modes and series of the cells, which later "
        "requests share.",
    )


def _planned(problem: Problem, plan: Plan | None = None) -> Result:
    return impact_modes.solve(problem, plan or impact_modes.plan(problem))
