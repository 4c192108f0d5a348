"""Products with matrices of a structure in twice the working precision, with bounds of errors."""

from __future__ import annotations

from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels import doubled
from vibroimpact_solvers.matrices import Form, SymmetricMatrix

_ROWS: Final = 256  # degrees of freedom at a time, of matrices that are mostly zeros
_NONE: Final = np.zeros((0, 0))


def product(A: SymmetricMatrix, x: Floats) -> tuple[Floats, Floats, Floats]:
    """Return a product with some columns in two parts, and bounds of its errors."""
    if A.form is Form.DENSE:
        high, low = doubled.product(A.data, _NONE, x, _NONE, False)
        return high, low, doubled.roundings(A.n) * (np.abs(A.data) @ np.abs(x))
    matrix = A.to_sparse()
    high, low = np.empty((2, *x.shape))
    for rows in (slice(at, at + _ROWS) for at in range(0, A.n, _ROWS)):
        part = matrix[rows]
        columns, places = np.unique(part.indices, return_inverse=True)
        dense = np.zeros((part.shape[0], columns.size))
        dense[np.repeat(np.arange(part.shape[0]), np.diff(part.indptr)), places] = part.data
        high[rows], low[rows] = doubled.product(dense, _NONE, x[columns], _NONE, False)
    terms = int(np.diff(matrix.indptr).max(initial=0))
    return high, low, doubled.roundings(terms) * np.asarray(abs(matrix) @ np.abs(x))


def along(x: Floats, high: Floats, low: Floats) -> tuple[Floats, Floats]:
    """Return the products of columns with others one by one, in two parts, (column,)."""
    whole = doubled.product(x.T, _NONE, high, low, False)
    return whole[0].diagonal().copy(), whole[1].diagonal().copy()
