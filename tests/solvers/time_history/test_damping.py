"""Damping that couples little, or rigid-body modes, against exponentials of matrices."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest

from vibroimpact_solvers import time_history as th
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

EPS = 2.0**-52


def free_motion(
    M: np.ndarray, K: np.ndarray, C: np.ndarray, force: np.ndarray, v: np.ndarray, t: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return x and v of a motion from x = 0, in 60 digits; the force is one more state, 1."""
    n = len(M)
    with mp.workdps(60):
        inverse = mp.matrix(M) ** -1
        A = mp.zeros(2 * n + 1)
        A[:n, n : 2 * n] = mp.eye(n)
        A[n : 2 * n, :n] = -inverse * mp.matrix(K)
        A[n : 2 * n, n : 2 * n] = -inverse * mp.matrix(C)
        A[n : 2 * n, 2 * n] = inverse * mp.matrix(force)
        z = mp.matrix([0] * n + [mp.mpf(a) for a in v] + [1])
        power = 0
        while mp.mnorm(A, 1) * t / 2**power > 1:
            power += 1
        step, term = mp.eye(2 * n + 1), mp.eye(2 * n + 1)
        for k in range(1, 60):
            term = term * A * (mp.mpf(t) / 2**power) / k
            step += term
        for _ in range(power):
            step = step * step
        z = step * z
        return np.array([float(a) for a in z[:n]]), np.array([float(a) for a in z[n : 2 * n]])


def check(
    M: np.ndarray, K: np.ndarray, C: np.ndarray, force: np.ndarray, v: np.ndarray, t: float
) -> th.Result:
    stop = Constraint((0,), (1.0,), None, 1e6)
    matrices = [SymmetricMatrix.dense(A) for A in (M, K)]
    system = System(*matrices, (stop,), C=SymmetricMatrix.dense(C), force=force)
    state = th.State(np.zeros(len(M)), v)
    problem = th.Problem(
        system, state, t, t=np.array([t]), outputs=frozenset({"x", "v"}), tolerance=1e-6
    )
    result = th.solve(problem, th.plan(problem))
    assert result.x is not None
    assert result.v is not None
    x, w = free_motion(M, K, C, force, v, t)
    error = max(np.abs(result.x[0] - x).max(), np.abs(result.v[0] - w).max())
    size = max(np.abs(x).max(), np.abs(w).max(), np.abs(v).max())
    # The error is relative to the largest state, in the norm of the energy.
    assert error <= 4.0 * EPS * result.error_condition * size
    assert result.error_predictable_until == t
    return result


def test_weak_coupling_beside_strong_damping_acts() -> None:
    """Couplings of 1e-8 are all the damping that two of the masses have; the third has 1e6."""
    C = np.array([[1e6, 0.0, 0.0], [0.0, 1e-8, 1e-8], [0.0, 1e-8, 1e-8]])
    v = np.array([0.0, 1.0, 0.0])
    result = check(np.eye(3), np.diag([1.0, 4.0, 9.0]), C, np.zeros(3), v, 1e6)
    assert result.x is not None
    assert abs(result.x[0, 2]) > 1e-10


def test_a_load_drives_a_rigid_body_that_damping_couples() -> None:
    K = np.array([[1.0, -1.0], [-1.0, 1.0]])
    C = np.array([[0.3, -0.1], [-0.1, 0.2]])
    check(np.eye(2), K, C, np.array([1.0, 0.0]), np.zeros(2), 20.0)


@pytest.mark.parametrize("n", [2, 4])
def test_damping_does_not_act_on_a_body_that_moves_as_a_whole(n: int) -> None:
    """C proportional to K of a free chain: rounding of the rigid body's damping is no damping."""
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    K[0, 0] = K[-1, -1] = 1.0
    rng = np.random.default_rng(n)
    check(1.3 * np.eye(n), K, 0.1 * K, rng.normal(size=n), rng.normal(size=n), 30.0)


def test_two_rigid_bodies_one_of_which_is_damped() -> None:
    K, C = np.zeros((3, 3)), np.zeros((3, 3))
    K[2, 2], C[:2, :2] = 2.0, [[0.5, 0.5], [0.5, 0.5]]
    C[2, 0] = C[0, 2] = 0.1
    C[2, 1] = C[1, 2] = 0.1
    C[2, 2] = 0.3
    M = np.array([[1.0, 0.2, 0.0], [0.2, 1.0, 0.1], [0.0, 0.1, 2.0]])
    check(M, K, C, np.array([1.0, 0.2, 0.5]), np.array([0.1, -0.3, 0.2]), 10.0)


def test_overdamped_modes_last() -> None:
    """Of rates 1e6 and 1e-6 neither is lost, however long the motion."""
    M, K, C = (np.array([[a]]) for a in (1.0, 1.0, 1e6))
    check(M, K, C, np.zeros(1), np.array([1.0]), 1e6)


@pytest.mark.parametrize(
    ("M", "K", "C"),
    [
        ([[1.3]], [[0.9]], [[0.01]]),
        ([[1.0, -0.04], [-0.04, 0.4]], [[1.0, 0.4], [0.4, 0.4]], [[0.9, 0.0], [0.0, 0.3]]),
        ([[1.0, 0.0], [0.0, 1.3]], [[2.0, -1.0], [-1.0, 2.0]], [[0.02, -0.01], [-0.01, 0.02]]),
    ],
)
def test_errors_are_not_those_of_the_end_where_everything_has_decayed(
    M: list[list[float]], K: list[list[float]], C: list[list[float]]
) -> None:
    n = len(M)
    matrices = [SymmetricMatrix.dense(A) for A in (M, K, C)]
    system = System(*matrices[:2], (Constraint.at(0, 100.0),), C=matrices[2])
    conditions = []
    for t_end in (0.2, 5.0, 50.0, 500.0, 5000.0):
        problem = th.Problem(system, th.State(np.full(n, 0.3), np.ones(n)), t_end)
        conditions.append(th.solve(problem, th.plan(problem)).error_condition)
    largest = np.maximum.accumulate(conditions)
    assert (conditions >= 0.5 * largest).all()
