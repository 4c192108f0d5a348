"""Resonances with the limited coordinate fixed, against closed forms and a dense elimination."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
import scipy.linalg

from tests.solvers.structures import chain, random_system
from vibroimpact_solvers import resonances
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System


def solved(system: System, constraint: int = 0, odd_max: int = 1) -> resonances.Result:
    problem = resonances.Problem(system, constraint, odd_max)
    return resonances.solve(problem, resonances.plan(problem))


def test_the_chain_falls_into_two_chains() -> None:
    # eq. 10.70-10.72: parts of a - 1 and N - a masses between fixed ends.
    result = solved(chain(13, 5))
    left, right = (2 * np.sin(np.arange(1, m + 1) * np.pi / (2 * (m + 1))) for m in (5, 7))
    np.testing.assert_allclose(result.natural[result.part == 0], left, rtol=4e-15)
    np.testing.assert_allclose(result.natural[result.part == 1], right, rtol=4e-15)


def test_odd_fractions_are_listed() -> None:
    result = solved(chain(3, 1), odd_max=5)
    np.testing.assert_allclose(result.Omega * result.harmonic, result.natural, rtol=1e-15)
    assert set(result.harmonic) == {1, 3, 5}
    assert (np.diff(result.Omega) >= 0).all()


def test_any_direction_may_be_fixed() -> None:
    system = random_system(3, 6, [Constraint((1, 4), (1.0, -2.0), 0.1, 0.1)])
    w = system.directions((0,))
    Z = scipy.linalg.null_space(w)
    M, K = system.M.to_dense(), system.K.to_dense()
    expected = np.sqrt(scipy.linalg.eigvalsh(Z.T @ K @ Z, Z.T @ M @ Z))
    np.testing.assert_allclose(np.sort(solved(system).natural), expected, rtol=1e-12)


def test_modes_that_the_fixed_coordinate_does_not_excite_are_left_out() -> None:
    K = np.array([[2.0, -1.0, -1.0], [-1.0, 3.0, 0.0], [-1.0, 0.0, 3.0]])
    uncoupled = scipy.linalg.block_diag(K, [[5.0]])
    system = System(
        SymmetricMatrix.diagonal(np.ones(4)),
        SymmetricMatrix.dense(uncoupled),
        (Constraint.at(0, 1.0),),
    )
    # Both branches resonate at sqrt(3); the fourth mass hangs on nothing.
    np.testing.assert_allclose(solved(system).natural, np.sqrt([3.0, 3.0]), rtol=1e-15)


def test_a_single_mass_has_none() -> None:
    system = System(
        SymmetricMatrix.diagonal([1.0]), SymmetricMatrix.diagonal([1.0]), (Constraint.at(0, 1.0),)
    )
    assert solved(system).Omega.size == 0


@pytest.mark.parametrize(
    ("more", "pointer"),
    [({"constraint": 1}, ("constraint",)), ({"odd_max": 0}, ("odd_max",))],
)
def test_faults_are_named(more: dict[str, int], pointer: tuple[str, ...]) -> None:
    with pytest.raises(ModelError) as caught:
        resonances.Problem(chain(), **more)
    assert caught.value.pointer == pointer


@pytest.mark.parametrize("seed", range(4))
def test_natural_frequencies_are_within_their_errors(seed: int) -> None:
    """Graded stiffnesses: a rounding of the largest eigenvalue would be the smallest one."""
    rng = np.random.default_rng(seed)
    n = 4
    A = rng.normal(size=(n, n)) * np.geomspace(1.0, 1e-5, n)[:, np.newaxis]
    K, M = A @ A.T, np.eye(n)
    K = 0.5 * (K + K.T)
    system = System(SymmetricMatrix.dense(M), SymmetricMatrix.dense(K), (Constraint.at(0, 1.0),))
    result = solved(system)
    with mp.workdps(60):
        values = mp.eigsy(mp.matrix(K[1:, 1:].tolist()), eigvals_only=True)
        exact = sorted(mp.sqrt(value) for value in values)
    assert result.error_statement.startswith("certified")
    assert result.natural.size == n - 1
    pairs = zip(np.sort(result.natural), exact, result.error_relative, strict=True)
    for value, true, error in pairs:
        assert abs(mp.mpf(value) / true - 1) <= error < 1e-11
