"""Multipliers of impact modes against known values and against free motions of neighbours."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

from tests.solvers.structures import chain, random_system
from vibroimpact_solvers import impact_modes as modes
from vibroimpact_solvers import presets, spectrum
from vibroimpact_solvers.model import Constraint, System

Omega_N = 2 * np.sin(13 * np.pi / 28)


def radius(system: System, omega: float, active: tuple[int, ...] = ()) -> float:
    problem = modes.Problem(system, np.array([omega]), active, frozenset({"stability", "exists"}))
    result = modes.solve(problem, modes.plan(problem))
    assert result.exists.all()
    return float(result.stability[0])


@pytest.mark.parametrize(
    ("ratio", "expected"),
    [(1.01, 28.4), (1.05, 7.66), (1.1, 4.24), (1.2, 1.96), (1.5, 1.0), (2.0, 1.0)],
)
def test_the_localized_mode_of_the_chain(ratio: float, expected: float) -> None:
    # Unstable just above grazing, stable further up.
    computed = radius(chain(), 2 / np.pi * ratio * Omega_N)
    assert computed == pytest.approx(expected, rel=3e-3 if expected > 1 else 1e-9)


def test_the_mode_above_the_fifth_frequency() -> None:
    assert radius(chain(), 2 / np.pi * 2 * np.sin(5 * np.pi / 28) + 0.02) == pytest.approx(
        1.988, abs=5e-4
    )


def impact(system: System, v: np.ndarray, index: int) -> np.ndarray:
    w = system.directions((index,))[0]
    mobile = np.linalg.solve(system.M.to_dense(), w)
    return v - 2.0 * mobile * (w @ v) / (w @ mobile)


def next_state(system: System, state: np.ndarray, duration: float) -> np.ndarray:
    """Fly to the upper wall near the given time, strike it, and mirror: the half-period map."""
    n = system.n
    M, K = system.M.to_dense(), system.K.to_dense()
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), np.zeros((n, n))]])
    w = system.directions((0,))[0]
    t = duration
    for _ in range(30):
        at = scipy.linalg.expm(A * t) @ state
        t -= (w @ at[:n] - system.constraints[0].upper) / (w @ at[n:])
    at = scipy.linalg.expm(A * t) @ state
    return -np.concatenate([at[:n], impact(system, at[n:], 0)])


@pytest.mark.parametrize("seed", range(6))
def test_multipliers_are_those_of_neighbouring_motions(seed: int) -> None:
    system = random_system(seed, 3, [Constraint.at(seed % 3, 1.0)])
    omega = 2 / np.pi * 1.15 * spectrum.largest_frequency(system)
    problem = modes.Problem(system, np.array([omega]), outputs=frozenset({"impulse", "shape"}))
    result = modes.solve(problem, modes.plan(problem))
    w = system.directions((0,))[0]
    velocity = np.linalg.solve(system.M.to_dense(), w) * result.impulse[0, 0] / omega
    state = np.concatenate([-result.shape[0], velocity])
    np.testing.assert_allclose(next_state(system, state, 2 / omega), state, atol=1e-10)
    # The map on the wall: deviations along it, by central differences.
    along = scipy.linalg.null_space(np.concatenate([w, np.zeros(3)])[None])
    h = 1e-6

    def ahead(deviation: np.ndarray) -> np.ndarray:
        return next_state(system, state + deviation, 2 / omega)

    J = np.column_stack([(ahead(h * d) - ahead(-h * d)) / (2 * h) for d in along.T])
    expected = np.abs(np.linalg.eigvals(along.T @ J)).max()
    # Differences of 1e-6 leave eight digits, of a nearly double eigenvalue four.
    assert radius(system, omega) == pytest.approx(expected, rel=2e-4)


def test_phantoms_have_no_stability() -> None:
    problem = modes.Problem(
        chain(), np.array([0.4, 2.0]), outputs=frozenset({"stability", "exists"})
    )
    result = modes.solve(problem, modes.plan(problem))
    assert (np.isnan(result.stability) == ~result.exists).all()


def test_coupled_impacts_struck_together_depend_on_their_order() -> None:
    M = np.array([[2.0, 0.5], [0.5, 1.0]])
    system = random_system(0, 2, [Constraint.at(0, 1.0), Constraint.at(1, 1.0)])
    coupled = System(type(system.M).dense(M), system.K, system.constraints)
    problem = modes.Problem(coupled, np.array([5.0]), outputs=frozenset({"stability"}))
    plan = modes.plan(problem)
    assert any("direction-dependent" in skip.why for skip in plan.skips)
    assert np.isnan(modes.solve(problem, plan).stability).all()


def test_impacts_at_separate_masses_commute() -> None:
    system = presets.chain(12, [Constraint.at(4, 0.2), Constraint.at(7, 0.2)])
    assert radius(system, 2 / np.pi * 3.5) == pytest.approx(1.0, abs=1e-6)
