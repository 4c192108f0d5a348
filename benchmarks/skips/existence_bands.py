"""Existence bands: what their plans leave out."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any, Final
from unittest import mock

import numpy as np

from benchmarks.cases import GAP, chain
from benchmarks.skips.scene import Scene, solve
from vibroimpact_solvers import existence_bands, presets, spectrum, stability
from vibroimpact_solvers import impact_modes as modes
from vibroimpact_solvers.existence_bands import OUTPUTS, Problem, search
from vibroimpact_solvers.existence_bands.certified import CertifiedBands
from vibroimpact_solvers.existence_bands.search import SearchedBands, poles_of
from vibroimpact_solvers.impact_modes.family_solver import FamilySolver
from vibroimpact_solvers.impact_modes.modal import ModalFamily
from vibroimpact_solvers.kernels import bands
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

_RANGE: Final = (1.7, 2.3)
_POINTS: Final = 33  # at which growth is looked at in a band


def scenes() -> Iterator[Scene]:
    """Yield scenes of existence bands."""
    yield Scene(
        "bands that are searched, N=13",
        existence_bands,
        partial(_problem, _uneven),
        _with_shapes,
        ("shapes, energies and amplitudes",),
    )
    yield Scene(
        "bands that are proved, N=13",
        existence_bands,
        partial(_problem, partial(chain, 13)),
        _by_grid,
        ("a grid of frequencies",),
    )
    yield Scene(
        "bands above the spectrum, N=13",
        existence_bands,
        lambda: Problem(chain(13), 2.0, 3.0),
        _proved_above,
        ("the proof above the spectrum",),
    )
    yield Scene(
        "bands of one of two constraints struck",
        existence_bands,
        partial(_problem, _two, active=(0,)),
        lambda: solve(existence_bands, _problem(_two)),
        ("impulses at constraints 1",),
    )
    yield Scene(
        "stability of bands that depends on the order of impacts",
        existence_bands,
        partial(_problem, _coupled, outputs=frozenset({"bands", "stability"})),
        _all_maps,
        ("stability",),
    )
    for requested in ("bands", "stability"):
        yield Scene(
            f"only {requested} requested"
            if requested == "bands"
            else "only their stability requested",
            existence_bands,
            partial(_problem, partial(chain, 13), outputs=frozenset({requested})),
            partial(_everything, partial(chain, 13)),
            tuple(name for name in OUTPUTS if name != requested),
        )


def _problem(system: Any, **more: Any) -> Problem:
    return Problem(system(), *_RANGE, **more)


def _everything(system: Any) -> object:
    return solve(existence_bands, _problem(system, outputs=frozenset(OUTPUTS)))


def _uneven() -> System:
    return presets.chain(13, [Constraint((5,), (1.0,), GAP, 1.1 * GAP)])


def _two() -> System:
    return presets.chain(13, [Constraint.at(5, GAP), Constraint.at(9, 2.0 * GAP)])


def _coupled() -> System:
    M = SymmetricMatrix.dense([[2.0, 0.5], [0.5, 1.0]])
    K = SymmetricMatrix.dense([[2.0, -1.0], [-1.0, 2.0]])
    return System(M, K, (Constraint.at(0, 1.0), Constraint.at(1, 1.0)))


def _with_shapes() -> object:
    """Find shape, energy and amplitudes of all solutions that are evaluated."""
    outputs = frozenset({"reason", "shape", "energy", "harmonics"})
    with mock.patch.object(search, "_OUTPUTS", outputs):
        return solve(existence_bands, _problem(_uneven))


def _by_grid() -> None:
    """Evaluate solutions between all poles and bisect between those that differ."""
    problem = _problem(partial(chain, 13))
    poles = poles_of(problem, spectrum.spectrum(problem.system))
    SearchedBands(problem, poles).find(None)


def _proved_above() -> object:
    """Prove by boxes that solutions above the spectrum are admissible."""
    problem = Problem(chain(13), 2.0, 3.0)
    certified = CertifiedBands(problem, spectrum.spectrum(problem.system))
    bands.survey(
        certified.roots,
        certified.alpha,
        certified.beta,
        certified.rigid_alpha,
        certified.rigid_beta,
        certified.struck,
        certified.q_start,
        certified.q_stop,
        problem.resolution,
        1_000_000,
    )
    return solve(existence_bands, problem)


def _all_maps() -> object:
    """Look at the growth in the bands all the same."""
    problem = _problem(_coupled, outputs=frozenset({"bands", "stability"}))
    result = existence_bands.solve(problem, existence_bands.plan(problem))
    assert result.band_start is not None
    assert result.band_stop is not None
    for start, stop in zip(result.band_start, result.band_stop, strict=True):
        Omega = np.linspace(start, stop, _POINTS + 2)[1:-1]
        solutions = problem.impact_modes_at(Omega, frozenset({"stability"}))
        family = FamilySolver(solutions, modes.plan(solutions)).evaluator
        assert isinstance(family, ModalFamily)
        _, motion = family.solutions(solutions.frequencies, with_motion=True)
        orbits = family.orbits(motion, np.zeros(Omega.size))
        for f in range(Omega.size):
            stability.PeriodMap(orbits, f, np.maximum(np.abs(orbits.roots), orbits.omega[f]))
    return result
