"""Refined natural modes against eigenpairs of 60 digits, and the errors that are stated."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mpmath
import numpy as np
import pytest
import scipy.linalg

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.spectrum.refinement import Stiffness, refine

rng = np.random.default_rng(7)


def random(n: int, lowest: float) -> np.ndarray:
    A = rng.normal(size=(n, n))
    return A @ A.T / n + lowest * np.eye(n)


def graded(n: int, spread: float) -> np.ndarray:
    Q, _ = np.linalg.qr(rng.normal(size=(n, n)))
    K = Q @ np.diag(spread ** np.linspace(0.0, 1.0, n)) @ Q.T
    return 0.5 * (K + K.T)


RING = 2.0 * np.eye(6) - np.roll(np.eye(6), 1, 0) - np.roll(np.eye(6), -1, 0)
TWO_SCALES = np.array([[5060000.0, -86, -1.7e7], [-86, 0.0332, 2700], [-1.7e7, 2700, 3.37e8]])
CASES = {
    "mirror": (np.array([[2.0, -1, 0], [-1, 2, -1], [0, -1, 2]]), np.eye(3)),
    "graded": (TWO_SCALES, np.diag([100.0, 1e4, 10.0])),
    "free": (np.array([[1.0, -1, 0], [-1, 2, -1], [0, -1, 1]]), np.eye(3)),
    "equal": (np.eye(4), np.eye(4)),
    "still": (np.zeros((2, 2)), np.eye(2)),
    "ring": (RING, np.eye(6)),
    "close": (np.diag([1.0, 1.0 + 1e-13, 1.0 + 3e-13, 2.0]), np.eye(4)),
    "wide": (graded(6, 1e14), np.eye(6)),
    "full mass": (random(9, 0.1), random(9, 0.01)),
}


@pytest.fixture(autouse=True)
def digits() -> Iterator[None]:
    """Extended precision, whatever precision other tests left behind."""
    with mpmath.workdps(60):
        yield


def exact(K: np.ndarray, M: np.ndarray) -> tuple[mpmath.matrix, mpmath.matrix]:
    """Eigenvalues, ascending, and modes."""
    inverse = mpmath.cholesky(mpmath.matrix(M.tolist())) ** -1
    values, vectors = mpmath.eigsy(inverse * mpmath.matrix(K.tolist()) * inverse.T)
    return values, inverse.T * vectors


def check_errors(refined: Any, K: np.ndarray, M: np.ndarray, rounding: float = 0.0) -> None:
    """Compare refined modes and their errors, which are small, with those of 60 digits.

    Entries of modes may have `rounding`, relative, that their angles do not count; those without
    have low parts.
    """
    values, modes = exact(K, M)
    mass, sizes = mpmath.matrix(M.tolist()), mpmath.matrix(np.abs(M).tolist())
    order = np.argsort(refined.eigenvalues, kind="stable")
    scale = max(abs(float(v)) for v in values)
    for place, j in enumerate(order):
        value = mpmath.mpf(refined.eigenvalues[j]) + mpmath.mpf(refined.eigenvalues_low[j])
        assert abs(value - values[place]) <= refined.errors[j] <= 1e-26 * max(scale, 1.0)
        gaps = [abs(v - values[place]) for k, v in enumerate(values) if k != place]
        if min(gaps) < 1e-12 * scale or scale == 0.0:
            continue  # the mode is not unique
        mode = mpmath.matrix([mpmath.mpf(entry) for entry in refined.modes[:, j].tolist()])
        rounded = mpmath.matrix([rounding * abs(entry) for entry in refined.modes[:, j].tolist()])
        if not rounding:
            mode += mpmath.matrix([mpmath.mpf(low) for low in refined.modes_low[:, j].tolist()])
        other = modes[:, place]
        apart = mode - other * mpmath.sign((mode.T * mass * other)[0])
        length = mpmath.sqrt((rounded.T * sizes * rounded)[0])
        assert mpmath.sqrt((apart.T * mass * apart)[0]) <= refined.angles[j] + length
        assert refined.angles[j] <= 1e-9


@pytest.mark.parametrize("name", CASES)
def test_errors_are_bounds_and_small(name: str) -> None:
    K, M = CASES[name]
    check_errors(refine(M, Stiffness(K), scipy.linalg.eigh(K, M)[1]), K, M)


def test_soft_modes_of_graded_structures_stay() -> None:
    # 0.1.0 set an eigenvalue of 1e-6 beside 3e7 to zero.
    K, M = CASES["graded"]
    natural = spectrum.spectrum(System(SymmetricMatrix.dense(M), SymmetricMatrix.dense(K), ()))
    assert natural.roots[0] == pytest.approx(float(mpmath.sqrt(exact(K, M)[0][0])), rel=1e-15)


def test_rigid_body_modes_are_exactly_still() -> None:
    K, M = CASES["free"]
    natural = spectrum.spectrum(System(SymmetricMatrix.dense(M), SymmetricMatrix.dense(K), ()))
    assert natural.roots[0] == 0.0
    assert natural.errors is not None
    assert 0.0 < natural.errors[0] < 1e-14


def test_nodes_are_found_in_symmetric_structures() -> None:
    # 0.1.0 gave the silent mode a participation of 1e-16.
    K, M = CASES["mirror"]
    system = System(SymmetricMatrix.dense(M), SymmetricMatrix.dense(K), ())
    natural = spectrum.spectrum(system)
    rows, errors = natural.participations([Constraint.at(1, 1.0)])
    assert rows[0, 1] == 0.0
    assert 0.0 < errors[0, 1] < 1e-26
