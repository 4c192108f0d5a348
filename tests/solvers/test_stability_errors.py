"""Radii of half-period maps and their errors against maps of many digits, without modes."""

from __future__ import annotations

import flint
import numpy as np
import pytest

from tests.reference import impact_modes as reference
from tests.solvers.structures import random_system, referenced
from vibroimpact_solvers import impact_modes as modes
from vibroimpact_solvers import spectrum
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System


def exact_radius(system: System, Omega: float) -> float:
    before = flint.ctx.prec
    try:
        return reference.solved(reference.Family(*referenced(system), (0,)), Omega).radius()
    finally:
        flint.ctx.prec = before


def compared(system: System, Omega: np.ndarray) -> list[tuple[float, float]]:
    """Return true and stated relative errors of the radii of the impact modes that exist."""
    outputs = frozenset({"stability", "exists"})
    problem = modes.Problem(system, Omega * (2 / np.pi), (0,), outputs, Omega=Omega)
    result = modes.solve(problem, modes.plan(problem))
    pairs = []
    for f in np.flatnonzero(result.exists & np.isfinite(result.stability)):
        true = result.stability[f] / exact_radius(system, float(Omega[f])) - 1.0
        pairs.append((abs(true), float(result.stability_error[f] / result.stability[f])))
    return pairs


@pytest.mark.parametrize("seed", range(4))
def test_radii_near_one_sided_grazing_are_within_their_errors(seed: int) -> None:
    """Just above a natural frequency the impacts are slow: p is small there."""
    system = random_system(seed, 2 + seed % 2, [Constraint((0,), (1.0,), None, 1.0)])
    highest = spectrum.spectrum(system).roots[-1]
    away = np.array([-1.0, 1.0])[:, np.newaxis] * 10.0 ** -np.arange(1.0, 11.0)
    pairs = compared(system, np.sort((highest * (1.0 + away)).ravel()))
    assert len(pairs) >= 5
    for true, stated in pairs:
        # Velocities that are differences of the two components would be wrong by up to 1e-6.
        assert true <= min(stated, 1e-13)


def test_radii_of_structures_with_fast_modes_are_within_their_errors() -> None:
    """The forces of fast modes lacked the rounding of their phases, here 2 pi 150 and more."""
    system = System(
        SymmetricMatrix.diagonal([0.2, 40.0]),
        SymmetricMatrix.dense([[3.0e5, -1.0], [-1.0, 0.5]]),
        (Constraint.at(1, 1.0),),
    )
    pairs = compared(system, np.linspace(0.9, 1.7, 25))
    assert len(pairs) >= 5
    for true, stated in pairs:
        assert true <= stated


def test_stable_motions_have_radius_one_exactly() -> None:
    """A multiplier next to the unit circle, alone there, is on it: its mirror image is itself."""
    system = random_system(2, 3, [Constraint.at(0, 1.0)])
    highest = float(spectrum.spectrum(system).roots[-1])
    Omega = np.linspace(2.0, 4.0, 401) * highest
    outputs = frozenset({"stability", "exists"})
    problem = modes.Problem(system, Omega * (2 / np.pi), (0,), outputs, Omega=Omega)
    result = modes.solve(problem, modes.plan(problem))
    stable = result.exists & (result.stability < 1.0 + 1e-9)
    assert stable.sum() >= 200
    assert (result.stability[stable] == 1.0).all()
    assert result.stability_error[stable].max() < 1e-14
    for f in np.flatnonzero(stable)[::80]:
        assert exact_radius(system, float(Omega[f])) == pytest.approx(1.0, abs=1e-20)


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("seed", range(6))
def test_radii_near_grazing_of_one_of_two_walls_are_within_their_errors(seed: int) -> None:
    """One of the impulses is a small difference of large numbers where it changes its sign."""
    system = random_system(seed, 2 + seed % 2, [Constraint((0,), (1.0,), 1.0, 1.4)])
    highest = float(spectrum.spectrum(system).roots[-1])

    def smaller(Omega: np.ndarray) -> np.ndarray:
        outputs = frozenset({"impulse"})
        problem = modes.Problem(system, Omega * (2 / np.pi), (0,), outputs, Omega=Omega)
        result = modes.solve(problem, modes.plan(problem))
        return np.minimum(result.impulse[:, 0], result.impulse_lower[:, 0])

    grid = np.linspace(0.5, 4.0, 4000) * highest
    positive = smaller(grid) > 0.0
    pairs = []
    for k in np.flatnonzero(positive[1:] != positive[:-1]):
        low, high = grid[k], grid[k + 1]
        for _ in range(60):
            middle = 0.5 * (low + high)
            is_like_low = (smaller(np.array([middle]))[0] > 0.0) == positive[k]
            low, high = (middle, high) if is_like_low else (low, middle)
        away = np.concatenate([-(10.0 ** -np.arange(4.0, 13.0)), 10.0 ** -np.arange(4.0, 13.0)])
        pairs += compared(system, np.sort(low * (1.0 + away)))
    assert len(pairs) >= 5
    for true, stated in pairs:
        assert true <= stated
