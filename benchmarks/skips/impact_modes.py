"""Impact modes and existence bands: what their plans leave out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Final

import numpy as np

from benchmarks.cases import GAP, chain, grid, net, random_structure
from benchmarks.skips.natural import STIFFNESS
from benchmarks.skips.scene import Scene, forget_modes, solve
from vibroimpact_solvers import existence_bands, impact_modes, presets, spectrum, time_history
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.existence_bands.search import SearchedBands, poles_of
from vibroimpact_solvers.impact_modes import OUTPUTS, Problem
from vibroimpact_solvers.impact_modes.direct import DirectFamily
from vibroimpact_solvers.impact_modes.family import Family
from vibroimpact_solvers.impact_modes.modal import ModalFamily
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

GRID: Final = grid(0.2, 3.0, 400)
_TIMES: Final = np.linspace(-1.0, 1.0, 33)
_ALL: Final = frozenset(OUTPUTS)


def scene(
    name: str,
    system: Callable[[], System],
    requested: str,
    without: Callable[[System], object],
    *states: str,
    Omega: Floats = GRID,
    **more: Any,
) -> Scene:
    """Return a scene of impact modes of which one output is requested."""
    return Scene(
        name,
        impact_modes,
        lambda: problem(system(), requested, Omega, **more),
        lambda: without(system()),
        states,
    )


def problem(system: System, requested: str, Omega: Floats = GRID, **more: Any) -> Problem:
    """Return a problem of which one output is requested."""
    return Problem(system, Omega * 2.0 / np.pi, outputs=frozenset({requested}), Omega=Omega, **more)


def modal(of: Problem, family: Family | None = None) -> ModalFamily:
    """Return the solutions of a problem by all its natural modes."""
    return ModalFamily(of, family or Family.of(of), spectrum.spectrum(of.system))


def scenes() -> Iterator[Scene]:
    """Yield scenes of impact modes."""
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
        lambda system: solve(impact_modes, problem(system, "waveform", tau=_TIMES)),
        tau=_TIMES,
        dofs=np.array([37]),
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
        "one of two constraints struck",
        two_constraints,
        "impulse",
        lambda system: solve(impact_modes, problem(system, "impulse")),
        "impulses at constraints 1",
        active=(0,),
    )
    yield scene(
        "a structure with damping",
        _damped,
        "impulse",
        _modal_damping,
        "damping and restitution",
    )
    yield scene(
        "no derivatives of impact modes requested, N=13",
        few,
        "impulse",
        lambda system: solve(impact_modes, problem(system, "impulse", parameters=(STIFFNESS,))),
        "derivatives",
    )
    yield scene(
        "derivatives of impulses, but not of stability, N=13",
        few,
        "stability",
        _stability_beside,
        "derivatives of stability",
        parameters=(STIFFNESS,),
    )
    dense = random_structure(100, 5)
    yield scene("the same structure requested again", lambda: dense, "impulse", _again)
    yield from _bands()


def _stability_beside(system: System) -> object:
    """Compute the stability of the structure, and of two with other stiffnesses."""
    for factor in (-1e-6, 1e-6):
        K = system.K.plus(factor, system.K)
        solve(impact_modes, problem(System(system.M, K, system.constraints), "stability"))
    return solve(impact_modes, problem(system, "stability", parameters=(STIFFNESS,)))


def _everything(system: System) -> object:
    # The multipliers of a hundred masses take longer than everything else together.
    outputs = _ALL if system.n < 100 else _ALL - {"stability"}
    return solve(
        impact_modes,
        Problem(system, GRID * 2.0 / np.pi, outputs=outputs, tau=_TIMES, Omega=GRID),
    )


def _close(system: System) -> Floats:
    """Return frequencies that are close to one another."""
    return spectrum.largest_frequency(system) * np.linspace(0.3, 0.3001, 250)


def _by_factors(system: System) -> None:
    """Factorize at each harmonic of each frequency."""
    at = problem(system, "impulse", _close(system))
    DirectFamily(at, spectrum.largest_frequency(system)).solutions(at.frequencies)


def _by_modes(system: System) -> None:
    at = problem(system, "impulse", _close(system)[:1])
    modal(at).solutions(at.frequencies, with_motion=False)


def two_constraints() -> System:
    """Return a chain of 13 masses with two constraints."""
    return presets.chain(13, [Constraint.at(5, GAP), Constraint.at(9, 2.0 * GAP)])


def _damped() -> System:
    whole = chain(13)
    C = SymmetricMatrix.bands({0: np.full(13, 0.02), 1: np.full(12, -0.01)})
    return System(whole.M, whole.K, whole.constraints, C=C)


def _modal_damping(system: System) -> object:
    """Find the damping of the modes too, as a motion from an initial state does."""
    result = solve(impact_modes, problem(system, "impulse"))
    state = time_history.State(np.zeros(system.n), np.zeros(system.n))
    motion = time_history.Problem(system, state, 1.0)
    time_history.prepare(motion, time_history.plan(motion))
    return result


def _again(system: System) -> object:
    """Find the natural modes once more: they were known."""
    solve(impact_modes, problem(system, "impulse"))
    forget_modes()
    return solve(impact_modes, problem(system, "impulse"))


def bands_problem(system: Callable[[], System], **more: Any) -> existence_bands.Problem:
    """Return the problem of existence bands of a structure."""
    return existence_bands.Problem(system(), 1.7, 2.3, **more)


def bands_requested(name: str, requested: str) -> Scene:
    """Return a scene of existence bands of which one output is requested."""
    of = partial(bands_problem, partial(chain, 13))
    others = frozenset(existence_bands.OUTPUTS)
    return Scene(
        name,
        existence_bands,
        partial(of, outputs=frozenset({requested})),
        lambda: solve(existence_bands, of(outputs=others)),
        tuple(sorted(others - {requested})),
    )


def _bands() -> Iterator[Scene]:
    """Yield scenes of existence bands."""
    yield Scene(
        "bands that are proved, N=13",
        existence_bands,
        partial(bands_problem, partial(chain, 13)),
        _by_grid,
        ("a grid of frequencies",),
    )
    yield Scene(
        "bands of one of two constraints struck",
        existence_bands,
        partial(bands_problem, two_constraints, active=(0,)),
        lambda: solve(existence_bands, bands_problem(two_constraints)),
        ("impulses at constraints 1",),
    )
    yield bands_requested("only bands requested", "bands")


def _by_grid() -> None:
    """Evaluate solutions between all poles and bisect between those that differ."""
    of = bands_problem(partial(chain, 13))
    SearchedBands(of, poles_of(of, spectrum.spectrum(of.system))).find(None)
