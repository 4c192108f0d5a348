"""Multipliers that cannot be told are not told."""

from __future__ import annotations

import numpy as np

from vibroimpact_solvers.kernels.floquet import Cells, Room, zeros


def approximated(trace: list[float], determinant: list[float], coupling: float) -> np.ndarray:
    """Return the zeros of one solution with one impact."""
    modes = len(trace)
    terms = np.zeros((1, 2, 2, 2, modes))
    terms[0, 0, 0] = coupling
    cells = Cells(
        np.array([trace]), np.array([determinant]), terms, np.zeros((1, 2, 2, modes)),
        np.zeros((1, 1)), np.ones((1, modes)), np.zeros((1, modes)),
    )  # fmt: skip
    square = [np.empty((2, 2), dtype=np.complex128) for _ in range(3)]
    sums = [np.empty(modes) for _ in range(4)]
    room = Room(*sums, *square, np.empty((2, 2)), np.empty(2 * modes), np.empty(2 * modes))
    values = np.empty((1, 2 * modes), dtype=np.complex128)
    zeros(cells, values, room)
    return values[0]


def test_zeros_of_a_polynomial_of_degree_four() -> None:
    """``p q - (c z + c) (p + q)`` of two quadratic factors p and q."""
    trace, determinant, c = [0.4, -1.1], [0.9, 0.8], 0.3
    p, q = (np.array([1.0, -t, d]) for t, d in zip(trace, determinant, strict=True))
    expected = np.roots(np.polysub(np.polymul(p, q), np.polymul([c, c], np.polyadd(p, q))))
    values = approximated(trace, determinant, c)
    apart = np.abs(values[:, np.newaxis] - expected)
    assert (apart.min(axis=0) < 1e-12).all()
    assert (apart.min(axis=1) < 1e-12).all()


def test_conjugate_starts_become_real_zeros() -> None:
    trace, determinant, c = [1.9], [0.99], 1.5
    expected = np.roots(np.polysub([1.0, -1.9, 0.99], [c, c]))
    assert np.isreal(expected).all()
    values = approximated(trace, determinant, c)
    np.testing.assert_allclose(np.sort(values.real), np.sort(expected.real), rtol=1e-12)
    np.testing.assert_allclose(values.imag, 0.0, atol=1e-12)


def test_approximations_that_do_not_come_to_rest_are_nan() -> None:
    assert np.isnan(approximated([0.4, -1.1], [0.9, 0.8], np.nan)).all()
