"""Impact modes: time of one impulse parameter, large structures, run time against error."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import mpmath
import numpy as np

from benchmarks.cases import GAP, chain, grid, net, random_structure, struck, uneven_chain
from benchmarks.harness import Work, measure, ratio, worst
from benchmarks.tables import Goal, Plot, Table
from vibroimpact_solvers import impact_modes, spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.impact_modes import Problem, Result, partial_plan
from vibroimpact_solvers.impact_modes.direct import DirectFamily
from vibroimpact_solvers.kernels import response
from vibroimpact_solvers.model import System
from vibroimpact_solvers.plan import Plan

IMPULSE: Final = frozenset({"impulse"})
_GOALS = {13: 0.2, 100: 0.4, 1000: 5.0}
_POINTS = {13: 20_000, 100: 10_000, 1000: 2000}
_MICRO = 1e6


def solve(system: System, Omega: Floats, outputs: frozenset[str] = IMPULSE) -> Result:
    """Plan and solve, as the service does."""
    problem = Problem(system, Omega * (2.0 / np.pi), outputs=outputs, Omega=Omega)
    return impact_modes.solve(problem, impact_modes.plan(problem))


def impulses(system: System, Omega: Floats) -> Floats:
    """Return the impulses at the first constraint."""
    found = solve(system, Omega).impulse
    assert found is not None
    return found[:, 0]


def _numbers(n: int) -> tuple[Floats, Floats]:
    """Return natural frequencies and squared weights of the chain, silent modes left out."""
    system = chain(n)
    natural = spectrum.spectrum(system)
    weights = natural.along(system.constraints)[0] ** 2
    heard = weights > 0.0
    return natural.roots[heard], weights[heard]


def plain(roots: Floats, weights: Floats, omega: Floats) -> Floats:
    """Eq. 10.53 as one would write it with numpy, all frequencies at once."""
    gamma = roots / omega[:, np.newaxis]
    return np.asarray(GAP * omega**2 / np.sum(weights * np.tan(gamma) / gamma, axis=1))


def plain_one_by_one(roots: Floats, weights: Floats, omega: Floats) -> Floats:
    """Eq. 10.53 as one would write it with numpy, for one frequency after the other."""
    p = np.empty(omega.size)
    for f, w in enumerate(omega):
        gamma = roots / w
        p[f] = GAP * w**2 / np.sum(weights * np.tan(gamma) / gamma)
    return p


def impulse_per_frequency() -> Table:
    """One impulse p(omega) of the chain struck at one mass, on one core.

    "solve" is all that a caller of the solvers waits for, planning and error statement
    included; "kernel" the compiled sum with its condition number. The floor is what the
    tangents alone cost: as many of them by numpy, whose loop is Intel's vector library.
    """
    rows = []
    for n, goal in _GOALS.items():
        system, (roots, weights) = chain(n), _numbers(n)
        Omega = grid(0.2, 3.0, _POINTS[n])
        omega = Omega * (2.0 / np.pi)
        nothing = np.zeros(roots.size), np.zeros(omega.size)
        found = measure(
            solve=partial(solve, system, Omega),
            kernel=partial(response.response_one, roots, nothing[0], weights, omega, nothing[1]),
        )
        kernel, whole = (
            found["kernel"].processor / Omega.size,
            found["solve"].processor / Omega.size,
        )
        floor = _vector_tangent(roots.size)
        rows.append(
            (n, roots.size, kernel * _MICRO, whole * _MICRO, goal, floor * _MICRO, kernel / floor)
        )
    return Table(
        "One impulse p(ω), one constraint, one core",
        (
            "N",
            "modes heard",
            "kernel [µs]",
            "solve [µs]",
            "goal [µs]",
            "floor [µs]",
            "kernel / floor",
        ),
        rows,
        "Time of the processor. Goals: 0.2, 0.4 and 5 µs; the floor: tangents alone.",
        Goal("solve [µs]", "goal [µs]"),
    )


def _vector_tangent(count: int) -> float:
    """Return the time of so many tangents in a loop over numbers in the nearest cache."""
    x = np.linspace(0.1, 20.0, 1024)
    out = np.empty_like(x)
    found = measure(tangent=lambda: np.tan(x, out=out))
    return found["tangent"].processor / x.size * count


def against_numpy() -> Table:
    """Compare the same impulses by numpy, side by side in one run."""
    rows = []
    for n in _GOALS:
        system, (roots, weights) = chain(n), _numbers(n)
        Omega = grid(0.2, 3.0, _POINTS[n])
        omega = Omega * (2.0 / np.pi)
        found = measure(
            ours=partial(solve, system, Omega),
            plain=partial(plain, roots, weights, omega),
            single=partial(plain_one_by_one, roots, weights, omega),
        )
        goal = 5.0 if n == 100 else None
        for name, title in (("plain", "whole arrays"), ("single", "one by one")):
            times = ratio(found[name], found["ours"])
            each = found[name].processor / Omega.size * _MICRO
            rows.append(
                (n, title, each, found["ours"].processor / Omega.size * _MICRO, times, goal)
            )
    return Table(
        "Against the plain sum in numpy",
        ("N", "numpy", "numpy [µs]", "Vibroimpact [µs]", "times faster", "goal"),
        rows,
        "Per frequency. Both get the natural modes for nothing; ours states its error besides.",
        Goal("times faster", "goal", at_least=True),
    )


def large() -> Table:
    """Large structures and long grids: what the planner makes of them."""
    rows: list[tuple[Any, ...]] = []

    def add(problem: str, outputs: str, goal: float | None, work: Work, rounds: int = 5) -> None:
        found = measure(rounds=rounds, work=work)["work"]
        rows.append((problem, outputs, found.wall, found.processor, goal))

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
    """Find members of square nets by few natural modes, and by factors at each frequency.

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
        expected, _ = direct.members(few.frequencies)
        by_solves = (time.process_time() - started) / few.omega.size
        by_cells = _planned(few, partial_plan(problem))
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


def _zones(roots: Floats) -> dict[str, Floats]:
    """Return frequencies at which errors are of different kinds."""
    random = np.random.default_rng(3)
    return {
        "among the natural frequencies": random.uniform(0.2, 3.0, 60),
        "1e-9 beside a natural frequency": np.repeat(roots, 5) * (1.0 + 1e-9),
        "far below": random.uniform(1e-4, 1e-3, 60),
    }


def work_precision() -> Table:
    """Run time against error for impulses of the chain of 13 masses.

    The reference is eq. 10.53 with 60 digits, from the same double-precision Omega. The
    chain is exact: its natural frequencies are known to any number of digits.
    """
    rows: list[tuple[Any, ...]] = []
    system, n = chain(13), 13
    roots, weights = _numbers(n)
    methods: dict[str, Callable[[Floats], Any]] = {
        "plain sum, numpy": lambda Omega: plain(roots, weights, Omega * (2.0 / np.pi)),
        "Vibroimpact": lambda Omega: impulses(system, Omega),
        "mpmath, 15 digits": lambda Omega: extended(n, Omega, 15),
        "mpmath, 30 digits": lambda Omega: extended(n, Omega, 30),
    }
    for zone, Omega in _zones(roots).items():
        exact = extended(n, Omega, 60)
        many = np.tile(Omega, 200)
        for name, method in methods.items():
            slow = name.startswith("mpmath")
            error = _relative(method(Omega), exact)
            timed = measure(rounds=3, method=partial(method, Omega if slow else many))["method"]
            each = timed.processor / (Omega.size if slow else many.size) * _MICRO
            rows.append((zone, name, each, float(np.median(error)), float(error.max())))
    return Table(
        "Run time against error: impulses, chain of 13 masses",
        ("Ω", "method", "time [µs]", "median error", "largest error"),
        rows,
        "Time of the processor per frequency; errors are relative.",
        plots=(Plot("time [µs]", "largest error", by="method", panel="Ω"),),
    )


def extended(n: int, Omega: Floats, digits: int) -> list[Any]:
    """Return the impulses of the chain by eq. 10.53 and 10.63 with so many digits."""
    with mpmath.workdps(digits):
        place, size = struck(n) + 1, mpmath.mpf(n + 1)
        modes = [
            (2 * mpmath.sin(j * mpmath.pi / (2 * size)), mpmath.sin(place * j * mpmath.pi / size))
            for j in range(1, n + 1)
        ]
        found = []
        for value in Omega:
            omega = 2 * mpmath.mpf(float(value)) / mpmath.pi
            total = mpmath.mpf(0)
            for root, entry in modes:
                gamma = root / omega
                total += 2 / size * entry**2 * mpmath.tan(gamma) / gamma
            found.append(mpmath.mpf(GAP) * omega**2 / total)
        return found


def _relative(found: Any, exact: list[Any]) -> Floats:
    with mpmath.workdps(60):
        errors = [float(abs(mpmath.mpf(a) - b) / abs(b)) for a, b in zip(found, exact, strict=True)]
    # A result may agree to the last bit; a logarithmic plot wants a number.
    return np.maximum(np.array(errors, dtype=np.float64), 1e-18)


def localized_shapes() -> Table:
    """Displacements of localized modes entry by entry, the smallest 1e-18 of the largest.

    Against a solution of the boundary value problem by mpmath with 60 digits.
    """
    rows: list[tuple[Any, ...]] = []
    system, n = chain(13), 13
    natural = spectrum.spectrum(system)
    E, place = natural.modes, struck(n)
    for multiple in (0.7, 1.01, 1.5, 5.0, 25.0):
        Omega = np.array([multiple * natural.largest_frequency])
        exact = _extended_shape(n, float(Omega[0]))
        gamma = natural.roots / (Omega * (2.0 / np.pi))
        x = (E * E[place] * np.tan(gamma) / gamma).sum(axis=1)
        plain_error = _relative(x * GAP / x[place], exact)
        shape = solve(system, Omega, frozenset({"shape"})).shape
        assert shape is not None
        error = _relative(shape[0], exact)
        smallest = float(min(abs(x) for x in exact) / GAP)
        rows.append(("Vibroimpact", multiple, smallest, float(error.max()), 1e-12))
        rows.append(("plain sum, numpy", multiple, smallest, float(plain_error.max()), None))
    rows.sort(key=lambda row: row[0])
    return Table(
        "Entries of localized shapes",
        ("method", "Ω/Ω_N", "smallest entry", "error", "goal"),
        rows,
        "Largest relative error of any of the 13 displacements.",
        Goal("error", "goal"),
        (Plot("smallest entry", "error", by="method"),),
    )


def _extended_shape(n: int, Omega: float) -> list[Any]:
    with mpmath.workdps(60):
        size, place = mpmath.mpf(n + 1), struck(n) + 1
        omega = 2 * mpmath.mpf(Omega) / mpmath.pi
        x = [mpmath.mpf(0)] * n
        for j in range(1, n + 1):
            gamma = 2 * mpmath.sin(j * mpmath.pi / (2 * size)) / omega
            weight = mpmath.sin(place * j * mpmath.pi / size) * mpmath.tan(gamma) / gamma
            for i in range(n):
                x[i] += mpmath.sin((i + 1) * j * mpmath.pi / size) * weight
        return [mpmath.mpf(GAP) * value / x[place - 1] for value in x]


TABLES: Final = (
    impulse_per_frequency,
    against_numpy,
    large,
    partial_spectrum,
    work_precision,
    localized_shapes,
)
