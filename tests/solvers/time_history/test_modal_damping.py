"""Damping in modal coordinates, its errors, and what is left out of it."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import beams as finite_elements
from tests.solvers import beams
from vibroimpact_solvers import spectrum
from vibroimpact_solvers.model import SymmetricMatrix
from vibroimpact_solvers.time_history import modal_damping

EPS = 2.0**-52


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("elements", [40, 150])
def test_proportional_damping_of_a_beam_is_known_to_a_rounding(elements: int) -> None:
    """C = 2^-15 K exactly. Sums over C in doubles are off by 1e-6 and more in the lowest mode."""
    M, K = finite_elements.matrices(elements)
    beam = beams.system(M, K, 2.0**-15 * K)
    natural = spectrum.spectrum(beam)
    assert beam.C is not None
    damped = modal_damping.of_exact_modes(beam.M, beam.C, natural.modes, natural.eigenvalues)
    assert damped.matrix is not None
    own = damped.matrix.diagonal()
    off = np.abs(own - 2.0**-15 * natural.eigenvalues)
    known = EPS * own + 2.0**-15 * (natural.errors if natural.errors is not None else 0.0)
    assert (off <= damped.errors + known).all()
    assert (damped.errors <= 4.0 * EPS * own).all()
    np.testing.assert_array_equal(damped.matrix, np.diag(own))
    assert damped.neglected < 1e-11
    rounded = modal_damping.of_rounded_modes(beam.C, natural.modes)
    assert rounded.errors[0] > 1e3 * damped.errors[0]


def test_couplings_that_are_left_out_are_errors() -> None:
    """Of two modes of frequencies 1 and 3 with a coupling d: d/(3 - 1) at most, back and forth."""
    coupling, eye = 1e-16, SymmetricMatrix.diagonal(np.ones(2))
    C = SymmetricMatrix.dense(np.array([[0.1, coupling], [coupling, 0.1]]))
    damped = modal_damping.of_exact_modes(eye, C, np.eye(2), np.array([1.0, 9.0]))
    assert damped.matrix is not None
    assert damped.matrix[0, 1] == 0.0
    assert 0.25 * coupling < damped.neglected < 4.0 * (coupling + EPS)


def test_couplings_of_equal_modes_count_with_the_time() -> None:
    coupling, eye = 1e-16, SymmetricMatrix.diagonal(np.ones(2))
    C = SymmetricMatrix.dense(np.array([[1e-3, coupling], [coupling, 1e-3]]))
    damped = modal_damping.of_exact_modes(eye, C, np.eye(2), np.array([4.0, 4.0]))
    assert damped.neglected < 1e-12  # what decays exchanges no more
    C = SymmetricMatrix.dense(np.array([[0.0, 1e-17], [1e-17, 0.0]]))
    exchanged = modal_damping.of_exact_modes(eye, C, np.eye(2), np.array([4.0, 4.0]))
    assert exchanged.matrix is not None
    assert (exchanged.errors >= 0.5e-17).all() or exchanged.matrix[0, 1] == 1e-17
