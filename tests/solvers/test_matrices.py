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
