"""Matrices in each of their forms against numpy."""

from __future__ import annotations

import numpy as np
import pytest

from vibroimpact_solvers.matrices import SymmetricMatrix

N = 40


def matrices() -> dict[str, SymmetricMatrix]:
    rng = np.random.default_rng(1)
    full = rng.normal(size=(N, N))
    row, col = rng.integers(0, N, (2, 60))
    entries = rng.normal(size=60)
    both = np.concatenate([row, col]), np.concatenate([col, row])
    return {
        "diagonal": SymmetricMatrix.diagonal(rng.normal(size=N)),
        "banded": SymmetricMatrix.bands({k: rng.normal(size=N - k) for k in range(3)}),
        "dense": SymmetricMatrix.dense(full + full.T),
        "sparse": SymmetricMatrix.sparse((N, N), *both, np.concatenate([entries, entries])),
    }


@pytest.mark.parametrize("name", matrices())
def test_rows_and_columns_are_scaled(name: str) -> None:
    matrix, by = matrices()[name], np.exp2(np.arange(N) % 7 - 3.0)
    scaled = matrix.scaled(by)
    assert scaled.form == matrix.form
    np.testing.assert_array_equal(scaled.to_dense(), np.diag(by) @ matrix.to_dense() @ np.diag(by))


def definite() -> dict[str, SymmetricMatrix]:
    """Matrices of each form whose diagonals outweigh the rest."""
    most = {name: np.abs(matrix.to_dense()).sum(axis=1) for name, matrix in matrices().items()}
    return {
        name: SymmetricMatrix.diagonal(1.0 + most[name]).plus(1.0, matrix)
        for name, matrix in matrices().items()
    }


@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize("columns", [(), (3,)])
@pytest.mark.parametrize("name", definite())
def test_matrices_are_solved_with(name: str, columns: tuple[int, ...], *, known: bool) -> None:
    matrix = definite()[name]
    b = np.random.default_rng(2).normal(size=(N, *columns))
    x = matrix.factorize(definite=known)(b)
    assert x.shape == b.shape
    np.testing.assert_allclose(matrix.to_dense() @ x, b, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("name", definite())
def test_what_is_not_definite_is_refused(name: str) -> None:
    matrix = definite()[name]
    assert matrix.is_positive_definite()
    less = matrix.plus(-2.0 * matrix.main_diagonal[0], SymmetricMatrix.diagonal(np.eye(N)[0]))
    assert np.linalg.eigvalsh(less.to_dense())[0] < 0.0
    assert not less.is_positive_definite()
