"""Scenes of skips that only the solvers' own parts show: what plans leave out inside."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Final
from unittest import mock

import numpy as np

from benchmarks import skips
from benchmarks.cases import GAP, chain, grid, random_structure
from benchmarks.error_against_time.slow_flows import motions
from benchmarks.skips.impact_modes import (
    GRID,
    bands_problem,
    bands_requested,
    modal,
    problem,
    scene,
)
from benchmarks.skips.motions import pushed, slow_flow_scenes
from benchmarks.skips.scene import Scene, solve
from tests.benchmarks.skips.free_motions import watching_all
from vibroimpact_solvers import (
    existence_bands,
    impact_modes,
    presets,
    resonances,
    spectrum,
    stability,
    time_history,
)
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.existence_bands import search
from vibroimpact_solvers.existence_bands.certified import CertifiedBands
from vibroimpact_solvers.impact_modes.family import Family, Kind
from vibroimpact_solvers.impact_modes.family_solver import FamilySolver
from vibroimpact_solvers.impact_modes.modal import ModalFamily
from vibroimpact_solvers.kernels import bands
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.slow_flow import MODELS, Initial
from vibroimpact_solvers.spectrum import Spectrum
from vibroimpact_solvers.time_history import Problem as Motion

_BELOW: Final = grid(0.2, 1.98, 300)
_ABOVE: Final = grid(2.01, 3.0, 300)
_MAX: Final = 9
_POINTS: Final = 33  # at which growth is looked at in a band


def scenes() -> Iterator[Scene]:
    """Yield these scenes and those of the benchmark."""
    yield from skips.scenes()
    yield from _of_impact_modes()
    yield from _of_bands()
    yield from _of_resonances()
    yield from _of_walls()
    yield from _of_slow_flows()


def _of_impact_modes() -> Iterator[Scene]:
    few = partial(chain, 13)
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
        "equal gaps and no load",
        few,
        "impulse",
        _both_parities,
        "symmetric component of the motion",
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


def _all_rows(system: System) -> object:
    at = problem(system, "impulse", GRID)
    result = solve(impact_modes, at)
    spectrum.spectrum(system).rows(np.arange(system.n))
    return result


def _all_modes(system: System) -> None:
    """Sum over all modes, those with a node at the constraint included."""
    natural = spectrum.spectrum(system)

    def rows(dofs: np.ndarray) -> Floats:
        exact = natural.rows(dofs)
        return np.where(exact == 0.0, 1e-100, exact)

    at = problem(system, "impulse", GRID)
    family = ModalFamily(at, Family.of(at), Spectrum(natural.roots, rows, natural.n))
    family.solutions(at.frequencies, with_motion=False)


def _both_parities(system: System) -> None:
    """Solve for the sum and for the difference of the impulses at both walls."""
    at = problem(system, "impulse", GRID)
    modal(at, Family(Kind.SEPARATE, (0,), (0,), 1)).solutions(at.frequencies, with_motion=False)


def _all_path_checks(system: System, Omega: Floats) -> None:
    """Follow the motion of every solution along every limit."""
    at = problem(system, "exists", Omega)
    family = modal(at)
    impulses, motion = family.solutions(at.frequencies, with_motion=True)
    family.check_path(motion, np.minimum(impulses.error, 1.0), at)


def _coupled() -> System:
    M = SymmetricMatrix.dense([[2.0, 0.5], [0.5, 1.0]])
    K = SymmetricMatrix.dense([[2.0, -1.0], [-1.0, 2.0]])
    return System(M, K, (Constraint.at(0, 1.0), Constraint.at(1, 1.0)))


def _all_maps(system: System) -> None:
    """Find the map of half a period of every solution, admissible or not."""
    Omega = _BELOW if system.n == 13 else GRID
    at = problem(system, "stability", Omega)
    family = modal(at)
    impulses, motion = family.solutions(at.frequencies, with_motion=True)
    orbits = family.orbits(
        motion, at.frequencies, impulses.plus, impulses.minus, np.zeros(Omega.size)
    )
    with mock.patch.object(stability, "commutes", return_value=True):
        stability.growth(orbits)


def _of_bands() -> Iterator[Scene]:
    yield Scene(
        "bands that are searched, N=13",
        existence_bands,
        partial(bands_problem, _uneven),
        _with_shapes,
        ("shapes, energies and amplitudes",),
    )
    yield Scene(
        "bands above the spectrum, N=13",
        existence_bands,
        lambda: existence_bands.Problem(chain(13), 2.0, 3.0),
        _proved_above,
        ("the proof above the spectrum",),
    )
    yield Scene(
        "bands without stiffness",
        existence_bands,
        lambda: existence_bands.Problem(_stiffless(), 1.0, 2.0),
        _searched_all,
        ("other frequencies",),
    )
    yield Scene(
        "stability of bands that depends on the order of impacts",
        existence_bands,
        partial(bands_problem, _coupled, outputs=frozenset({"bands", "stability"})),
        _all_maps_in_bands,
        ("stability",),
    )
    yield bands_requested("only their stability requested", "stability")


def _stiffless() -> System:
    stops = (Constraint.at(0, 1.0), Constraint.at(1, 0.5))
    masses, none = SymmetricMatrix.diagonal([1.0, 2.0]), SymmetricMatrix.diagonal([0.0, 0.0])
    return System(masses, none, stops)


def _searched_all() -> object:
    """Search for the bands all the same."""
    of = existence_bands.Problem(_stiffless(), 1.0, 2.0)
    return search.SearchedBands(of, np.empty(0)).find(None)


def _uneven() -> System:
    return presets.chain(13, [Constraint((5,), (1.0,), GAP, 1.1 * GAP)])


def _with_shapes() -> object:
    """Find shape, energy and amplitudes of all solutions that are evaluated."""
    outputs = frozenset({"reason", "shape", "energy", "harmonics"})
    with mock.patch.object(search, "_OUTPUTS", outputs):
        return solve(existence_bands, bands_problem(_uneven))


def _proved_above() -> object:
    """Prove by boxes that solutions above the spectrum are admissible."""
    of = existence_bands.Problem(chain(13), 2.0, 3.0)
    certified = CertifiedBands(of, spectrum.spectrum(of.system))
    bands.survey(certified.margin, certified.q_start, certified.q_stop, of.edge_width, 1_000_000)
    return solve(existence_bands, of)


def _all_maps_in_bands() -> object:
    """Look at the growth in the bands all the same."""
    of = bands_problem(_coupled, outputs=frozenset({"bands", "stability"}))
    result = existence_bands.solve(of, existence_bands.plan(of))
    assert result.band_start is not None
    assert result.band_stop is not None
    for start, stop in zip(result.band_start, result.band_stop, strict=True):
        Omega = np.linspace(start, stop, _POINTS + 2)[1:-1]
        solutions = of.impact_modes_at(Omega, frozenset({"stability"}))
        family = FamilySolver(solutions, impact_modes.plan(solutions)).evaluator
        assert isinstance(family, ModalFamily)
        impulses, motion = family.solutions(solutions.frequencies, with_motion=True)
        errors = np.zeros(Omega.size)
        orbits = family.orbits(motion, solutions.frequencies, impulses.plus, impulses.minus, errors)
        with mock.patch.object(stability, "commutes", return_value=True):
            stability.growth(orbits)
    return result


def _of_resonances() -> Iterator[Scene]:
    yield Scene(
        "odd harmonics alone, N=13",
        resonances,
        lambda: resonances.Problem(chain(13), odd_max=_MAX),
        lambda: _all_harmonics(chain(13)),
        ("even harmonics",),
    )
    yield Scene(
        "a structure of which half is not joined to the constraint, N=26",
        resonances,
        lambda: resonances.Problem(_apart(), odd_max=_MAX),
        lambda: _all_modes_when_fixed(_apart()),
        ("modes that the fixed coordinate does not excite",),
    )


def _solved(of: resonances.Problem) -> resonances.Result:
    return resonances.solve(of, resonances.plan(of))


def _all_harmonics(system: System) -> resonances.Result:
    """Divide by even numbers too."""
    result = _solved(resonances.Problem(system, odd_max=_MAX))
    assert result.harmonic is not None
    assert result.part is not None
    first, every = result.harmonic == 1, np.arange(1, _MAX + 1)
    natural = result.natural[first]
    return replace(
        result,
        Omega=(natural[:, np.newaxis] / every).ravel(),
        harmonic=np.tile(every, natural.size),
        part=np.repeat(result.part[first], every.size),
        natural=np.repeat(natural, every.size),
        error_natural=np.repeat(result.error_natural[first], every.size),
        error_relative=np.repeat(result.error_relative[first], every.size),
        error_Omega=np.repeat(result.error_Omega[first], every.size),
    )


def _apart() -> System:
    """Return two chains that nothing joins; the first one has a limiter."""
    springs = np.full(25, -1.0)
    springs[12] = 0.0
    K = SymmetricMatrix.bands({0: np.full(26, 2.0), 1: springs})
    return System(SymmetricMatrix.diagonal(np.ones(26)), K, (Constraint.at(5, GAP),))


def _all_modes_when_fixed(system: System) -> resonances.Result:
    """Find all natural modes of the constrained structure."""
    free = np.delete(np.arange(system.n), 5)
    K = SymmetricMatrix.leanest(system.K.to_sparse()[free][:, free].tocsr())
    spectrum.spectrum(System(SymmetricMatrix.diagonal(np.ones(free.size)), K, ()))
    return _solved(resonances.Problem(system, odd_max=_MAX))


def _of_walls() -> Iterator[Scene]:
    for name, motion, states in (
        ("a constraint that the energy does not reach, N=13", _one_far, "constraint 1"),
        ("thirteen constraints, few of them in reach", _many, "walls that are out of reach"),
        (
            "a motion that has no impact any more, N=13",
            _calm,
            "the search after the last possible impact",
        ),
    ):
        yield Scene(name, time_history, motion, partial(_watching, motion), (states,))


def _watching(motion: Callable[[], Motion]) -> object:
    with watching_all():
        return solve(time_history, motion())


def _one_far() -> Motion:
    constraints = [Constraint.at(5, GAP), Constraint.at(9, 10.0)]
    return pushed(partial(presets.chain, 13, constraints))


def _many() -> Motion:
    """Return a motion whose walls are the farther the farther they are from the push."""
    constraints = [Constraint.at(dof, GAP * (1.0 + dof)) for dof in range(13)]
    return pushed(partial(presets.chain, 13, constraints))


def _calm() -> Motion:
    """Return a motion that is too slow for an impact: what is left after the last one."""
    return pushed(partial(chain, 13), speed=0.1)


def _of_slow_flows() -> Iterator[Scene]:
    """Yield each variant of each model."""
    elastic = presets.oscillator([Constraint.at(0, 1.0)], 1.0)
    models = [*motions(), ("oscillator", elastic, Initial(gamma=0.5), 40.0)]
    shown = {one.name for one in skips.scenes()}
    for motion in models:
        for variant in MODELS[motion[0]].VARIANTS:
            of_variant = slow_flow_scenes(variant, *motion)
            yield from (one for one in of_variant if one.name not in shown)
