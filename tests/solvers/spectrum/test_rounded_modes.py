"""Natural modes that are rounded to double precision: their errors against 60 digits."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
import scipy.linalg

from tests.solvers.spectrum.test_refinement import CASES, check_errors, digits, exact
from vibroimpact_solvers import spectrum
from vibroimpact_solvers.matrices import SymmetricMatrix
from vibroimpact_solvers.model import System
from vibroimpact_solvers.spectrum import refinement, rounded_modes
from vibroimpact_solvers.spectrum.inertia import least_eigenvalue

__all__ = ["digits"]  # the fixture of extended precision

UNIT = 2.0**-53


@pytest.mark.parametrize("name", CASES)
def test_errors_are_bounds_and_small(name: str) -> None:
    K, M = CASES[name]
    mass, stiffness = SymmetricMatrix.dense(M), SymmetricMatrix.dense(K)
    start = scipy.linalg.eigh(K, M)[1]
    refined = rounded_modes.refine(mass, stiffness, start, least_eigenvalue(mass))
    check_errors(refined, K, M, rounding=UNIT)


def test_modes_of_equal_frequencies_are_known_as_a_space() -> None:
    """Three pairs of equal eigenvalues 1, 2, 3 beside one of 1e8, turned into a full matrix."""
    rng = np.random.default_rng(2)
    turn, _ = np.linalg.qr(rng.normal(size=(7, 7)))
    K = turn @ np.diag([1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 1e8]) @ turn.T
    K, mass = 0.5 * (K + K.T), SymmetricMatrix.dense(np.eye(7))
    refined = rounded_modes.refine(
        mass, SymmetricMatrix.dense(K), scipy.linalg.eigh(K)[1], least_eigenvalue(mass)
    )
    values, _ = exact(K, np.eye(7))
    order = np.argsort(refined.eigenvalues, kind="stable")
    for place, j in enumerate(order):
        value = mpmath.mpf(refined.eigenvalues[j]) + mpmath.mpf(refined.eigenvalues_low[j])
        assert abs(value - values[place]) <= refined.errors[j] < 1e-14
    assert np.isfinite(refined.angles).all()


@pytest.mark.needs("compiled kernels")
def test_no_structure_is_too_large_for_proved_errors() -> None:
    """0.2.0 knew eigenvalues above 256 degrees of freedom to a rounding of the largest."""
    n = refinement.LARGEST + 4
    rng = np.random.default_rng(3)
    A = rng.normal(size=(n, n))
    K = SymmetricMatrix.dense(A @ A.T + np.diag(np.logspace(-3.0, 9.0, n)))
    natural = spectrum.spectrum(System(SymmetricMatrix.diagonal(np.linspace(1.0, 2.0, n)), K, ()))
    assert natural.proved
    assert natural.errors is not None
    assert natural.angles is not None
    assert (natural.errors / natural.eigenvalues).max() < 1e-14
    assert natural.angles.max() < 1e-12
