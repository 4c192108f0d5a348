"""Complex modes against eigenvalues in extended precision."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
import scipy.optimize

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.errors import PlanError
from vibroimpact_solvers.time_history.complex_modes import ComplexModes, complex_modes


def first_order(natural: Floats, damping: Floats) -> tuple[Floats, Floats]:
    """Return the first-order matrix of modal equations and its scales."""
    n = natural.size
    square = natural**2
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(square), -damping]])
    return A, np.concatenate([natural, np.ones(n)])


def exact(A: Floats) -> list[mp.mpc]:
    with mp.workdps(60):
        return list(mp.eig(mp.matrix(A.tolist()), left=False, right=False))


def nearest(modes: ComplexModes, true: list[mp.mpc]) -> Floats:
    """Return the errors of the rates."""
    with mp.workdps(60):
        return np.array(
            [
                float(min(abs(value - mp.mpc(complex(rate))) for value in true))
                for rate in modes.rates
            ]
        )


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("stiff", [0.0, 5.0])
def test_rates_lie_within_their_errors(seed: int, stiff: float) -> None:
    """Light to heavy damping; with stiff modes, whose roundings are no errors of the soft ones."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 9))
    natural = np.sort(10.0 ** (stiff * rng.random(n)) * (1.0 + rng.random(n)))
    spread = rng.standard_normal((n, n)) * np.sqrt(natural)[:, np.newaxis]
    damping = 10.0 ** rng.uniform(-3.0, 0.5) * (spread @ spread.T / n)
    A, root = first_order(natural, damping)
    modes = complex_modes(A, root, np.zeros(A.shape))
    off = nearest(modes, exact(A))
    assert (off <= modes.errors + 2.0 * EPS * np.abs(modes.rates)).all()
    residual = A @ modes.vectors - modes.vectors * modes.rates
    lengths = np.linalg.norm(root[:, np.newaxis] * modes.vectors, axis=0)
    residual = np.linalg.norm(root[:, np.newaxis] * residual, axis=0) / lengths
    assert (residual <= 100.0 * EPS * np.abs(modes.rates).max() * (1.0 + modes.condition)).all()


def test_rates_of_soft_modes_beside_stiff_ones() -> None:
    """LAPACK's alone are off by roundings of the largest rate, a million times as much."""
    natural = np.array([1.0, 3.0, 1e6, 2e6])
    damping = 0.02 * np.sqrt(np.outer(natural, natural)) * (0.3 + 0.7 * np.eye(4))
    A, root = first_order(natural, damping)
    modes = complex_modes(A, root, np.zeros(A.shape))
    true = exact(A)
    soft = np.abs(modes.rates) < 10.0
    off = nearest(modes, true)[soft]
    assert (off <= modes.errors[soft] + 2.0 * EPS * np.abs(modes.rates[soft])).all()
    assert modes.errors[soft].max() < 1e-13


def test_errors_of_the_matrix_are_errors_of_the_rates() -> None:
    A, root = first_order(np.array([1.0, 2.0]), np.array([[0.02, 0.01], [0.01, 0.04]]))
    doubt = np.zeros(A.shape)
    doubt[2, 0], doubt[3, 3] = 1e-9, 1e-8
    modes = complex_modes(A, root, doubt)
    off = nearest(modes, exact(A + doubt))
    assert (off <= 1.001 * modes.errors).all()
    assert modes.errors.max() < 1e-8


def test_near_modes_that_are_not_alike_stay_modes() -> None:
    damping = np.array([[0.02, 1e-6], [1e-6, 0.02]])
    near = complex_modes(*first_order(np.array([1.0, 1.001]), damping), np.zeros((4, 4)))
    assert near.chains == []
    assert near.condition < 1.02


def test_modes_that_are_alike_are_a_chain() -> None:
    """Near the exceptional point of two oscillators, whose two rates and vectors are one."""

    def matrix(g: float, d: float) -> Floats:
        K = np.array([[1.0, 0.05], [0.05, 1.0 + d]])
        return np.block([[np.zeros((2, 2)), np.eye(2)], [-K, -np.diag([2.0 * g, 0.0])]])

    def apart(p: Floats) -> list[float]:
        rates = np.linalg.eigvals(matrix(*p))
        one, other = rates[rates.imag > 0.0]
        square = complex(one - other) ** 2
        return [square.real, square.imag]

    g, d = scipy.optimize.root(apart, [0.05, -0.0025], tol=1e-14).x
    modes = complex_modes(matrix(g, d), np.ones(4), np.zeros((4, 4)))
    ((i, k, kappa),) = modes.chains
    two = modes.oscillating[[i, k]]
    A, Q = matrix(g, d), modes.vectors[:, two]
    block = np.array([[modes.rates[two[0]], kappa], [0.0, modes.rates[two[1]]]])
    np.testing.assert_allclose(A @ Q, Q @ block, atol=1e-14)
    assert modes.condition < 10.0


def test_three_modes_that_are_alike_are_refused() -> None:
    """One damper between three equal oscillators in a row: a block of three."""
    J = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-np.eye(3) + J, -0.1 * np.eye(3)]])
    with pytest.raises(PlanError, match="almost equal"):
        complex_modes(A, np.ones(6), np.zeros((6, 6)))


def test_real_modes_are_of_one_size() -> None:
    """A free body slides: its position, and its velocity that drag takes, differ in nothing."""
    A = np.zeros((4, 4))
    A[:2, 2:] = np.eye(2)
    A[2:, 2:] = -np.array([[0.3, 0.1], [0.1, 0.2]])
    modes = complex_modes(A, np.array([1e-4, 1e-4, 1.0, 1.0]), np.zeros((4, 4)))
    np.testing.assert_allclose(np.linalg.norm(modes.vectors[:, modes.real], axis=0), 1.0)
