"""Periodic motions of driven structures: cost of a response, of branches, and against shooting."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np
import scipy.linalg

from benchmarks import beams
from benchmarks.harness import measure, ratio
from benchmarks.peers.integrators import Solver, heyoka_events
from benchmarks.peers.scene import Outcome, Scene
from benchmarks.tables import Goal, Table
from vibroimpact_solvers import attractors, branches, periodic_motions, spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.periodic_motions import Force, Problem, closed_form
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.solutions import Cells
from vibroimpact_solvers.time_history import Harmonic

_MICRO: Final = 1e6
_BLOCK = 500  # frequencies that are solved at once
_START = 1e-3  # relative distance from which shooting begins
_ITERATIONS = 12


def damped_chain(n: int, gap: float = 0.5, lower: float | None = None) -> System:
    """Return a chain with damping ratios up to 2 % and a stop beside its middle mass, k = 0.8."""
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    stop = Constraint((n // 2,), (1.0,), lower, gap, 0.8)
    C = SymmetricMatrix.dense(0.02 * K)
    one = SymmetricMatrix.diagonal(np.ones(n))
    return System(one, SymmetricMatrix.dense(K), (stop,), C=C)


def _response(n: int, points: int, output: str) -> Problem:
    load = (Force((0,), (1.0,), 1.0),)
    Omega = np.linspace(0.1, 1.9, points)
    return Problem(damped_chain(n), Omega, load, outputs=frozenset({output}))


def _solve(problem: Problem) -> periodic_motions.Result:
    return periodic_motions.solve(problem, periodic_motions.plan(problem))


def _formula(problem: Problem, driven: Driven) -> None:
    """Compute phases and impulses alone; the modes are known."""
    for start in range(0, problem.Omega.size, _BLOCK):
        piece = problem.slice(start, start + _BLOCK)
        closed_form.solutions(driven, Cells.of(driven, piece), piece.impacts[0])


def responses() -> Table:
    """Compute all motions with one impact per period over the frequency of the drive."""
    rows: list[tuple[Any, ...]] = []
    for n in (1, 10, 100):
        problem = _response(n, 5000, "exists")
        driven = Driven.of(problem, spectrum.choose(problem.system))
        work = partial(_formula, problem, driven)
        each = measure(rounds=3, work=work)["work"].processor / problem.Omega.size * _MICRO
        rows.append(("phases and impulses, modes known", n, problem.Omega.size, each, 1 + 0.05 * n))
    goals = {"exists": 100.0, "stability": 500.0}
    what = {"exists": "and existence", "stability": "and the largest multiplier"}
    for output, title in what.items():
        for n in (1, 10, 100):
            problem = _response(n, 2000 if output == "exists" else 200, output)
            solved = partial(_solve, problem)
            each = measure(rounds=3, work=solved)["work"].processor / problem.Omega.size * _MICRO
            goal = goals[output] if n == 100 else None
            rows.append((title, n, problem.Omega.size, each, goal))
    return Table(
        "Response with one impact per period",
        ("computed", "N", "frequencies", "time [µs/frequency]", "goal"),
        rows,
        "Damped chain with one stop, up to two motions at each frequency and that without "
        "impacts; errors included; time of the processor.",
        Goal("time [µs/frequency]", "goal"),
        reasons={
            "": "errors of all numbers are computed with them; all but the responses of the modes, "
            "of which both are sums, is computed by numpy",
            "and the largest multiplier, N 100": "all 2N multipliers are approximated, in 2N² "
            "steps, as those of a lightly damped structure lie close to one circle",
        },
    )


_BEFORE: Final = {"one mass": 5.6, "beam, N=50": 27.0, "beam, N=100": 130.0}
"""Seconds of the same by 0.2.0, beside the same other work; N=100: ten times five frequencies."""
_DEFAULTS = frozenset({"exists", "extremes", "energy", "multipliers"})


def driven_beam(elements: int) -> Problem:
    """Return a cantilever with stops at its tip, driven there at 50 frequencies.

    Its damping is Rayleigh's, 2 % of the critical one at the first natural frequency.
    """
    M, K = beams.matrices(elements)
    first = math.sqrt(float(scipy.linalg.eigh(K, M, eigvals_only=True, subset_by_index=[0, 0])[0]))
    b = 1e-3 / first
    C = SymmetricMatrix.dense(2.0 * first * (0.02 - 0.5 * b * first) * M + b * K)
    tip = len(M) - 2
    stop = Constraint((tip,), (1.0,), 0.01, 0.01, 0.8)
    system = System(SymmetricMatrix.dense(M), SymmetricMatrix.dense(K), (stop,), C=C)
    load = (Force((tip,), (1.0,), 3.0),)
    return Problem(system, first * np.linspace(0.5, 2.0, 50), load, outputs=_DEFAULTS)


def defaults() -> Table:
    """Compute driven responses with all that is computed by default, for one mass and for beams."""
    rows: list[tuple[Any, ...]] = []
    mass = replace(_response(1, 1000, "exists"), outputs=_DEFAULTS)
    cases: dict[str, tuple[Problem, float | None]] = {"one mass": (mass, 0.15)}
    for elements, goal in ((25, None), (50, 0.3), (150, 2.0)):
        cases[f"beam, N={2 * elements}"] = driven_beam(elements), goal
    for name, (problem, goal) in cases.items():
        motions = _solve(problem).solution_impacts.size
        existence = replace(problem, outputs=frozenset({"exists"}))
        parts = [
            measure(rounds=3, sample=0.0, work=partial(_solve, one))["work"].processor
            for one in (existence, problem)
        ]
        rows.append((name, problem.Omega.size, motions, *parts, goal, _BEFORE.get(name)))
    return Table(
        "Driven responses by default",
        (
            "structure", "frequencies", "motions", "existence [s]", "default outputs [s]", "goal",
            "0.2.0 [s]",
        ),
        rows,
        "Existence, extremes and mean squares of all displacements, work, losses and energy, and "
        "all multipliers, with their errors; time of the processor, natural modes included. Beams "
        "of Euler-Bernoulli elements with Rayleigh damping, 2 % at the first natural frequency, "
        "whose frequencies differ by up to 1e6.",
        Goal("default outputs [s]", "goal"),
        reasons={
            "": "most are integrals and extremes, at 6,000 nodes of each motion with impacts; "
            "measured beside other work"
        },
    )  # fmt: skip


_BRANCHES_BEFORE: Final = {"beam, N=50": 6.2}
"""Seconds of processor time by the sources 5e4a12f, which needed nine evaluations for a point."""


def default_branches() -> Table:
    """Follow branches of motions with one impact over the frequency, with all default outputs."""
    rows: list[tuple[Any, ...]] = []
    for elements, goal in ((5, None), (25, 3.0)):
        driven, name = driven_beam(elements), f"beam, N={2 * elements}"
        first = float(driven.Omega[0]) / 0.5

        def at(Omega: float, driven: Problem = driven) -> Problem:
            return driven.at(np.array([Omega]))

        problem = branches.Problem(at, 0.7 * first, 1.3 * first, driven.system, frequency=True)
        plan = branches.plan(problem)
        points = int((branches.solve(problem, plan).solution_impacts > 0).sum())
        work = partial(branches.solve, problem, plan)
        seconds = measure(rounds=1, sample=0.0, work=work)["work"].processor
        rows.append(
            (name, points, seconds, seconds / points * 1e3, goal, _BRANCHES_BEFORE.get(name))
        )
    return Table(
        "Branches by default",
        ("structure", "points", "time [s]", "time [ms/point]", "goal", "before [s]"),
        rows,
        "Branches over the frequencies 0.7 to 1.3 times the first natural one, with existence, "
        "extremes and mean squares of all displacements, work, losses and energy, and all "
        "multipliers of each point; time of the processor. Beams as above.",
        Goal("time [s]", "goal"),
        reasons={
            "": "most are integrals and extremes, at 6,000 nodes of each motion; measured beside "
            "other work"
        },
    )


_ATTRACTORS_BEFORE: Final = {"beam, N=50": 19.9}
"""Seconds of processor time by the same sources, which followed each motion for 600 periods."""


def default_attractors() -> Table:
    """Observe what four motions settle on, with default settings and outputs."""
    rows: list[tuple[Any, ...]] = []
    for elements, goal in ((5, None), (25, 3.0)):
        driven, name = driven_beam(elements), f"beam, N={2 * elements}"
        stop = Constraint(driven.load[0].dofs, (1.0,), None, 0.01, 0.7)
        system = replace(driven.system, constraints=(stop,))
        Omega = driven.Omega[:1] * 2.2  # 1.1 times the first natural frequency
        v = 0.1 * np.random.default_rng(0).standard_normal((4, system.n))
        problem = attractors.Problem(system, Omega, np.zeros(v.shape), v, driven.load)
        plan = attractors.plan(problem)
        result = attractors.solve(problem, plan)
        work = partial(attractors.solve, problem, plan)
        seconds = measure(rounds=1, sample=0.0, work=work)["work"].processor
        rests = bool(result.attractor_rests.all())
        impacts = float(result.attractor_impact_rate[0])
        rows.append((name, rests, impacts, seconds, goal, _ATTRACTORS_BEFORE.get(name)))
    return Table(
        "Attractors by default",
        ("structure", "rests", "impacts a period", "time [s]", "goal", "before [s]"),
        rows,
        "Four random initial states, 200 periods of the drive that are left out and at most 400 "
        "that are looked at; time of the processor in all threads. Beams as above, with one stop "
        "and k = 0.7, driven at 1.1 times the first natural frequency.",
        Goal("time [s]", "goal"),
        reasons={
            "": "the beam rests at its stop three times a period, which is worked out in Python "
            "between calls of the compiled loop, in 1 ms each; the loop needs 200 expansions of 50 "
            "modes for each of these times; measured beside other work"
        },
    )


def following() -> Table:
    """Follow symmetric motions over the frequency, with stability and special points."""
    rows: list[tuple[Any, ...]] = []
    for n in (1, 10, 100):
        top = 2.0 * math.sin(0.5 * math.pi * n / (n + 1))
        problem = _branch(damped_chain(n, lower=0.5), n // 2, 1.03 * top, 1.3 * top)
        plan = branches.plan(problem)
        points = int((branches.solve(problem, plan).solution_impacts > 0).sum())
        work = partial(branches.solve, problem, plan)
        each = measure(rounds=3, sample=0.0, work=work)["work"].processor / points * 1e3
        rows.append((n, points, each, 1.0 if n == 100 else None))
    return Table(
        "Branches",
        ("N", "points", "time [ms/point]", "goal"),
        rows,
        "Pseudo-arclength from all solutions at nine frequencies, both directions; tests for "
        "special points at every point; time of the processor.",
        Goal("time [ms/point]", "goal"),
        reasons={
            "": "a third are the multipliers, all 2N of which are approximated for the largest; "
            "the rest are six evaluations of the equations and Newton's steps, a tenth of a "
            "millisecond each whatever N is up to 100"
        },
    )


def _branch(system: System, dof: int, start: float, stop: float) -> branches.Problem:
    first = Problem(
        system, np.array([start]), (Force((dof,), (1.0,), 6.0),),
        sequence=periodic_motions.SYMMETRIC, outputs=frozenset({"exists", "stability"}),
    )  # fmt: skip

    def at(Omega: float) -> Problem:
        return replace(first, Omega=np.array([Omega]))

    return branches.Problem(at, start, stop, system, frequency=True)


def shooting() -> Table:
    """Find one periodic motion of a driven chain of 13 masses, by shooting with heyoka as well."""
    import heyoka

    system, drive, Omega = damped_chain(13), Force((6,), (1.0,), 1.0), 0.75
    h = 1e-4
    known = Problem(
        system, np.array([Omega]), (drive,), tau=np.array([1.0 - h, 0.0, h]),
        outputs=frozenset({"exists", "waveform"}),
    )  # fmt: skip
    result = _solve(known)
    assert result.solution_exists is not None
    assert result.waveform is not None
    (row,) = np.flatnonzero(result.solution_exists & (result.solution_impacts > 0))
    (impact,) = np.flatnonzero(result.impact_solution == row)
    T, phase = 2.0 * math.pi / Omega, float(result.impact_phase[impact])
    before, x, after = result.waveform[row]
    state = np.concatenate([x, (after - before) / (2.0 * h * T)])
    away = np.random.default_rng(0).uniform(-1.0, 1.0, state.size)
    start = state + _START * np.abs(state).max() * away
    scene = Scene(system, start, T, (Harmonic(6, 1.0, Omega),))
    exists = frozenset({"exists"})
    single = Problem(system, np.array([Omega]), (drive,), outputs=exists)
    grid = replace(single, Omega=np.linspace(0.7, 0.8, 2000))
    rows: list[tuple[Any, ...]] = []
    for tolerance in (1e-9, 1e-12, 2.0**-52):
        heyoka.llvm_state.clear_memcache()
        used = time.process_time()
        solver = heyoka_events(scene)
        outcome, runs = _shot(solver, scene, tolerance)
        first = time.process_time() - used
        shot = partial(_shot, solver, scene, tolerance)
        off = abs(outcome.times[0] * Omega - phase) / (2.0 * math.pi)
        timed = measure(
            rounds=3, shooting=shot, one=partial(_solve, single), grid=partial(_solve, grid)
        )
        many = ratio(timed["shooting"], timed["grid"]) * grid.Omega.size
        per, one = timed["grid"].processor / grid.Omega.size, timed["one"].processor
        seconds = timed["shooting"].processor
        times = (1e3 * each for each in (first, seconds, one, per))
        rows.append((tolerance, runs, off, *times, first / one, many, 1000.0))
    stated = float(result.error_phase[impact]) / (2.0 * math.pi)
    return Table(
        "One periodic motion of 13 masses against shooting",
        (
            "tolerance of heyoka", "periods integrated", "difference of the impact [T]",
            "shooting, with compiling [ms]", "shooting, compiled [ms]",
            "closed form, one frequency [ms]", "closed form, one of 2000 [ms]",
            "times faster, one from nothing", "times faster, one of 2000, compiled", "goal",
        ),
        rows,
        "Chain with one stop, driven at Omega = 0.75, one impact per period. Shooting: Newton's "
        "method on the state at phase 0 from a start 1e-3 off, with one matrix of differences, "
        "for one motion; heyoka compiles the structure and the frequency. The closed form finds "
        "all motions, decides which exist and states errors; that of the impact's time, in "
        f"periods, is {stated:.1e}.",
        Goal("times faster, one of 2000, compiled", "goal", at_least=True),
        reasons={
            "": "heyoka, compiled for the structure, integrates a period in 30 µs, and shooting "
            "needs 33 of them; existence and errors are most of what the closed form takes"
        },
    )  # fmt: skip


def _shot(solver: Solver, scene: Scene, tolerance: float) -> tuple[Outcome, int]:
    """Return the last period of shooting, and how many were integrated."""

    def period(state: Floats) -> Outcome:
        return solver(replace(scene, state=state), tolerance)

    state, size = scene.state, float(np.abs(scene.state).max())
    outcome, runs = period(state), 1
    h, residual = 1e-7 * size, outcome.state - state
    slopes = np.empty((state.size, state.size))
    for k in range(state.size):
        beside = state.copy()
        beside[k] += h
        slopes[:, k] = (period(beside).state - outcome.state) / h
        runs += 1
    inverse = np.linalg.inv(slopes - np.eye(state.size))
    for _ in range(_ITERATIONS):
        before = float(np.abs(residual).max())
        state = state - inverse @ residual
        outcome, runs = period(state), runs + 1
        residual = outcome.state - state
        if float(np.abs(residual).max()) > 0.3 * before:
            break
    return outcome, runs
