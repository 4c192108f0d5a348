"""Impact modes: what their plans leave out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Final

import numpy as np

from benchmarks.cases import GAP, chain, grid, net, random_structure
from benchmarks.counters import forget_modes
from benchmarks.skips.scene import Scene, solve
from vibroimpact_solvers import impact_modes, presets, spectrum, stability
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.impact_modes import OUTPUTS, Problem
from vibroimpact_solvers.impact_modes.direct import DirectFamily
from vibroimpact_solvers.impact_modes.family import Family, Kind
from vibroimpact_solvers.impact_modes.family_solver import PENETRATION_TOLERANCE
from vibroimpact_solvers.impact_modes.modal import ModalFamily
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.spectrum import Spectrum
from vibroimpact_solvers.time_history import Problem as Motion
from vibroimpact_solvers.time_history import State, prepare
from vibroimpact_solvers.time_history import plan as plan_of_motion

_TIMES: Final = np.linspace(-1.0, 1.0, 33)
_GRID: Final = grid(0.2, 3.0, 400)
_BELOW: Final = grid(0.2, 1.98, 300)
_ABOVE: Final = grid(2.01, 3.0, 300)
_ALL: Final = frozenset(OUTPUTS)


def scenes() -> Iterator[Scene]:
    """Yield scenes of impact modes."""

    def scene(
        name: str,
        system: Callable[[], System],
        requested: str,
        without: Callable[[System], object],
        *states: str,
        Omega: Floats = _GRID,
        **more: Any,
    ) -> Scene:
        return Scene(
            name,
            impact_modes,
            lambda: _problem(system(), requested, Omega, **more),
            lambda: without(system()),
            states,
        )

    few, hundred = partial(chain, 13), partial(chain, 100)
    yield scene(
        "only impulses requested, N=100",
        hundred,
        "impulse",
        _everything,
        *sorted(_ALL - {"impulse", "reason", "stability"}),
    )
    yield scene(
        "only existence requested, N=13", few, "exists", _everything, "impulse", "stability"
    )
    yield scene(
        "one of 100 degrees of freedom requested",
        hundred,
        "waveform",
        lambda system: solve(impact_modes, _problem(system, "waveform", _GRID, tau=_TIMES)),
        tau=_TIMES,
        dofs=np.array([37]),
    )
    yield scene(
        "rows of modes at the constraint alone, full M and K, N=100",
        partial(random_structure, 100, 5),
        "impulse",
        _all_rows,
        "99 of 100 rows of the modal matrix in the impulses",
    )
    yield scene(
        "modes with a node at the constraint, N=13 struck in the middle",
        partial(presets.chain, 13, [Constraint.at(6, GAP)]),
        "impulse",
        _all_modes,
        "modes 2, 4, 6, 8, 10, 12",
    )
    yield scene(
        "frequencies close together in a sparse structure, N=400",
        partial(net, 20),
        "impulse",
        _by_factors,
        "natural modes away from the harmonics",
        Omega=_close(net(20)),
    )
    yield scene(
        "one frequency of a sparse structure, N=400",
        partial(net, 20),
        "impulse",
        _by_modes,
        "natural modes",
        Omega=_close(net(20))[:1],
    )
    yield scene(
        "equal gaps and no load",
        few,
        "impulse",
        _both_parities,
        "symmetric component of the motion",
    )
    yield scene(
        "one of two constraints struck",
        _two,
        "impulse",
        lambda system: solve(impact_modes, _problem(system, "impulse", _GRID)),
        "impulses at constraints 1",
        active=(0,),
    )
    yield scene(
        "existence below Ω_N: impulses that are not positive",
        few,
        "exists",
        partial(_all_path_checks, Omega=_BELOW),
        "path check where an impulse is not positive",
        Omega=_BELOW,
    )
    yield scene(
        "existence above Ω_N",
        few,
        "exists",
        partial(_all_path_checks, Omega=_ABOVE),
        "path check above the spectrum",
        Omega=_ABOVE,
    )
    yield scene(
        "a structure with damping",
        _damped,
        "impulse",
        _modal_damping,
        "damping and restitution",
    )
    yield scene(
        "stability where the modes exist",
        few,
        "stability",
        _all_maps,
        "stability of phantoms",
        Omega=_BELOW,
    )
    yield scene(
        "stability that depends on the order of simultaneous impacts",
        _coupled,
        "stability",
        _all_maps,
        "stability",
    )
    dense = random_structure(100, 5)
    yield scene("the same structure requested again", lambda: dense, "impulse", _again)


def _problem(system: System, requested: str, Omega: Floats, **more: Any) -> Problem:
    return Problem(system, Omega * 2.0 / np.pi, outputs=frozenset({requested}), Omega=Omega, **more)


def _everything(system: System) -> object:
    # The multipliers of a hundred masses take longer than everything else together.
    outputs = _ALL if system.n < 100 else _ALL - {"stability"}
    problem = Problem(system, _GRID * 2.0 / np.pi, outputs=outputs, tau=_TIMES, Omega=_GRID)
    return solve(impact_modes, problem)


def _modal(problem: Problem, family: Family | None = None) -> ModalFamily:
    natural = spectrum.spectrum(problem.system)
    return ModalFamily(problem, family or Family.of(problem), natural)


def _all_rows(system: System) -> object:
    problem = _problem(system, "impulse", _GRID)
    result = solve(impact_modes, problem)
    spectrum.spectrum(system).rows(np.arange(system.n))
    return result


def _all_modes(system: System) -> None:
    """Sum over all modes, those with a node at the constraint included."""
    natural = spectrum.spectrum(system)

    def rows(dofs: Any) -> Any:
        exact = natural.rows(dofs)
        return np.where(exact == 0.0, 1e-100, exact)

    problem = _problem(system, "impulse", _GRID)
    family = ModalFamily(problem, Family.of(problem), Spectrum(natural.roots, rows, natural.n))
    family.solutions(problem.frequencies, with_motion=False)


def _close(system: System) -> Floats:
    """Return frequencies that are close to one another."""
    return spectrum.largest_frequency(system) * np.linspace(0.3, 0.3001, 250)


def _by_factors(system: System) -> None:
    """Factorize at each harmonic of each frequency."""
    problem = _problem(system, "impulse", _close(system))
    DirectFamily(problem, spectrum.largest_frequency(system)).solutions(problem.frequencies)


def _by_modes(system: System) -> None:
    problem = _problem(system, "impulse", _close(system)[:1])
    _modal(problem).solutions(problem.frequencies, with_motion=False)


def _both_parities(system: System) -> None:
    """Solve for the sum and for the difference of the impulses at both walls."""
    problem = _problem(system, "impulse", _GRID)
    _modal(problem, Family(Kind.SEPARATE, (0,), (0,), 1)).solutions(
        problem.frequencies, with_motion=False
    )


def _all_path_checks(system: System, Omega: Floats) -> None:
    """Follow the motion of every solution along every limit."""
    problem = _problem(system, "exists", Omega)
    family = _modal(problem)
    impulses, motion = family.solutions(problem.frequencies, with_motion=True)
    family.check(motion, np.minimum(impulses.error, 1.0), problem, PENETRATION_TOLERANCE)


def _two() -> System:
    return presets.chain(13, [Constraint.at(5, GAP), Constraint.at(9, 2.0 * GAP)])


def _damped() -> System:
    whole = chain(13)
    C = SymmetricMatrix.bands({0: np.full(13, 0.02), 1: np.full(12, -0.01)})
    return System(whole.M, whole.K, whole.constraints, C=C)


def _modal_damping(system: System) -> object:
    """Find the damping of the modes too, as a motion from an initial state does."""
    result = solve(impact_modes, _problem(system, "impulse", _GRID))
    motion = Motion(system, State(np.zeros(system.n), np.zeros(system.n)), 1.0)
    prepare(motion, plan_of_motion(motion))
    return result


def _coupled() -> System:
    M = SymmetricMatrix.dense([[2.0, 0.5], [0.5, 1.0]])
    K = SymmetricMatrix.dense([[2.0, -1.0], [-1.0, 2.0]])
    return System(M, K, (Constraint.at(0, 1.0), Constraint.at(1, 1.0)))


def _all_maps(system: System) -> None:
    """Find the map of half a period of every solution, admissible or not."""
    Omega = _BELOW if system.n == 13 else _GRID
    problem = _problem(system, "stability", Omega)
    family = _modal(problem)
    _, motion = family.solutions(problem.frequencies, with_motion=True)
    orbits = family.orbits(motion, np.zeros(Omega.size))
    for f in range(Omega.size):
        stability.PeriodMap(orbits, f, np.maximum(np.abs(orbits.roots), orbits.omega[f]))


def _again(system: System) -> object:
    """Find the natural modes once more: they were known."""
    solve(impact_modes, _problem(system, "impulse", _GRID))
    forget_modes()
    return solve(impact_modes, _problem(system, "impulse", _GRID))
