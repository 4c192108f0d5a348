"""What plans leave out: counters with and without it, and the time saved."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np

from benchmarks.cases import GAP, chain, grid, net, random_structure
from benchmarks.counters import counting, forget_modes
from benchmarks.impact_modes import solve
from benchmarks.tables import Table
from vibroimpact_solvers import impact_modes, presets, slow_flow, spectrum
from vibroimpact_solvers.impact_modes import Problem
from vibroimpact_solvers.impact_modes.direct import DirectFamily
from vibroimpact_solvers.impact_modes.family import Family
from vibroimpact_solvers.impact_modes.modal import ModalFamily
from vibroimpact_solvers.impact_modes.problem import OUTPUTS
from vibroimpact_solvers.impact_modes.solving import EXCESS, Members, solve_alike
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.spectrum import Spectrum

EVERYTHING: Final = frozenset(OUTPUTS) - {"stability"}
_TIMES = np.linspace(-1.0, 1.0, 33)


@dataclass(frozen=True, slots=True)
class Scene:
    """One thing that is asked, as the plan does it and without what the plan skips."""

    name: str
    planned: Callable[[], object]
    without: Callable[[], object]


def scenes() -> tuple[Scene, ...]:
    """Return the scenes whose counters are shown and tested."""
    Omega = grid(0.2, 3.0, 400)
    few, hundred = chain(13), chain(100)
    node = presets.chain(13, [Constraint.at(6, GAP)])
    dense = random_structure(100, 5)
    return (
        Scene(
            "only impulses asked, N=100",
            partial(solve, hundred, Omega, frozenset({"impulse"})),
            partial(_everything, hundred, Omega),
        ),
        Scene(
            "one of 100 degrees of freedom asked",
            partial(_shapes, hundred, Omega, np.array([37])),
            partial(_shapes, hundred, Omega, None),
        ),
        Scene(
            "modes with a node at the constraint, N=13 struck in the middle",
            partial(solve, node, Omega, frozenset({"impulse"})),
            partial(_all_modes, node, Omega),
        ),
        Scene(
            "existence where the impulse is positive and Ω below Ω_N",
            partial(solve, few, Omega, frozenset({"exists"})),
            partial(_all_walks, few, Omega),
        ),
        Scene(
            "the same structure asked ten times",
            partial(_ten_times, dense, Omega[:40], False),
            partial(_ten_times, dense, Omega[:40], True),
        ),
        Scene(
            "fifty gaps of two coupled constraints",
            partial(_gaps, Omega, True),
            partial(_gaps, Omega, False),
        ),
        Scene(
            "a hundred frequencies of a sparse structure, N=400",
            partial(_sparse, True),
            partial(_sparse, False),
        ),
        Scene(
            "a slow flow whose error is not asked",
            partial(_flow, frozenset({"x"})),
            partial(_flow, frozenset({"x", "error"})),
        ),
    )


def _everything(system: System, Omega: Any) -> None:
    problem = Problem(system, Omega * 2.0 / np.pi, outputs=EVERYTHING, tau=_TIMES, Omega=Omega)
    impact_modes.solve(problem, impact_modes.plan(problem))


def _shapes(system: System, Omega: Any, dofs: Any) -> None:
    outputs = frozenset({"waveform"})
    omega = Omega * 2.0 / np.pi
    problem = Problem(system, omega, outputs=outputs, tau=_TIMES, Omega=Omega, dofs=dofs)
    impact_modes.solve(problem, impact_modes.plan(problem))


def _all_modes(system: System, Omega: Any) -> None:
    """Sum over all modes, those that the constraint does not hear included."""
    natural = spectrum.spectrum(system)

    def heard(dofs: Any) -> Any:
        rows = natural.rows(dofs)
        return np.where(rows == 0.0, 1e-100, rows)

    loud = Spectrum(natural.roots, heard, natural.n)
    problem = Problem(system, Omega * 2.0 / np.pi, outputs=frozenset({"impulse"}), Omega=Omega)
    family = ModalFamily(problem, Family.of(problem), loud)
    family.members(problem.frequencies, with_motion=False)


def _all_walks(system: System, Omega: Any) -> None:
    """Follow the motion of every member along every limit."""
    problem = Problem(system, Omega * 2.0 / np.pi, outputs=frozenset({"exists"}), Omega=Omega)
    family = ModalFamily(problem, Family.of(problem), spectrum.spectrum(system))
    impulses, motion = family.members(problem.frequencies, with_motion=True)
    family.check(motion, np.minimum(impulses.error, 1.0), problem, EXCESS)


def _ten_times(system: System, Omega: Any, forget: bool) -> None:
    for _ in range(10):
        if forget:
            forget_modes()
        solve(system, Omega, frozenset({"impulse"}))


def _gaps(Omega: Any, together: bool) -> None:
    problems = []
    for gap in np.linspace(0.1, 0.3, 50):
        system = presets.chain(100, [Constraint.at(37, gap), Constraint.at(61, 2.0 * gap)])
        omega = Omega * 2.0 / np.pi
        problems.append(Problem(system, omega, outputs=frozenset({"impulse"}), Omega=Omega))
    if together:
        plans = [impact_modes.plan(problem) for problem in problems]
        members = [Members(one, plan) for one, plan in zip(problems, plans, strict=True)]
        solve_alike(problems, members)
        return
    for problem in problems:
        impact_modes.solve(problem, impact_modes.plan(problem))


def _sparse(few: bool) -> None:
    """Find members by the modes around harmonics, or by factors at each harmonic."""
    system = net(20)
    bound = spectrum.largest_frequency(system)
    Omega = bound * np.linspace(0.3, 0.3001, 100)
    problem = Problem(system, Omega * 2.0 / np.pi, outputs=frozenset({"impulse"}), Omega=Omega)
    if few:
        impact_modes.solve(problem, impact_modes.partial_plan(problem))
    else:
        DirectFamily(problem, bound).members(problem.frequencies)


def _flow(outputs: frozenset[str]) -> None:
    system = presets.oscillator([Constraint.at(0, 1.0, 0.95)], 1.0)
    t, initial = np.linspace(0.0, 20.0, 1000), slow_flow.Initial(omega=5.0)
    problem = slow_flow.Problem(system, "restitution", "corrected", initial, t, outputs)
    slow_flow.solve(problem, slow_flow.plan(problem))


def counted(work: Callable[[], object]) -> tuple[Counter[str], float]:
    """Return what some work computes, and its time."""
    work()
    start = time.process_time()
    with counting() as counts:
        work()
    return counts, time.process_time() - start


def counters() -> Table:
    """Count what is computed as planned, and for the same answer without the plan's skips.

    Counted are natural modes found, responses of one mode at one frequency, walks of one member
    along one limit, and displacements of one degree of freedom at one time.
    """
    rows: list[tuple[Any, ...]] = []
    for scene in scenes():
        planned, quick = counted(scene.planned)
        without, slow = counted(scene.without)
        for what in sorted(without | planned):
            rows.append((scene.name, what, planned[what], without[what], quick * 1e3, slow * 1e3))
    return Table(
        "What plans skip",
        ("scene", "counted", "planned", "without skips", "planned [ms]", "without [ms]"),
        rows,
        "Time of the processor; natural modes forgotten before each.",
    )


TABLES: Final = (counters,)
