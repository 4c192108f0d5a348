"""Factorizations of real symmetric matrices: each returns the function that solves with them.

Examples
--------
>>> import numpy as np
>>> from vibroimpact_solvers import factors
>>> solve = factors.banded(np.array([[2.0, 2.0], [-1.0, 0.0]]))  # [[2, -1], [-1, 2]]
>>> solve(np.array([0.0, 3.0])).round(12)
array([1., 2.])
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg
from scipy.linalg import lapack

from vibroimpact_solvers.arrays import Floats

Solve = Callable[[Floats], Floats]
"""Returns the solution for right-hand sides of shape (n,) or (n, columns)."""


def diagonal(entries: Floats) -> Solve:
    """Factorize a diagonal matrix, entries of shape (n,)."""
    if not entries.all():
        raise scipy.linalg.LinAlgError("a diagonal entry is zero")
    return lambda b: np.asarray((b.T / entries).T)


def banded(diagonals: Floats) -> Solve:
    """Factorize a banded matrix: the main diagonal and those below it, shape (bands, n)."""
    width, n = diagonals.shape[0] - 1, diagonals.shape[1]
    # Rows of LAPACK's band storage: `width` for fill-in, the upper, main and lower diagonals.
    bands = np.zeros((3 * width + 1, n), order="F")
    for k, band in enumerate(diagonals):
        bands[2 * width + k, : n - k] = band[: n - k]
        bands[2 * width - k, k:] = band[: n - k]
    factors, rows, info = lapack.dgbtrf(bands, width, width, overwrite_ab=1)
    if info > 0:
        raise scipy.linalg.LinAlgError("the matrix is singular")

    def solve(b: Floats) -> Floats:
        x, _ = lapack.dgbtrs(factors, width, width, b.reshape(n, -1), rows)
        return np.asarray(x).reshape(b.shape)

    return solve


def dense(matrix: Floats) -> Solve:
    """Factorize a full matrix, shape (n, n)."""
    factors, rows, info = lapack.dgetrf(matrix)
    if info > 0:
        raise scipy.linalg.LinAlgError("the matrix is singular")

    def solve(b: Floats) -> Floats:
        x, _ = lapack.dgetrs(factors, rows, b)
        return np.asarray(x)

    return solve


def sparse(matrix: scipy.sparse.csr_array) -> Solve:
    """Factorize a sparse matrix."""
    factors = _lu(matrix)
    return lambda b: np.asarray(factors.solve(b))


def definite_sparse(matrix: scipy.sparse.csr_array) -> Solve:
    """Factorize a sparse matrix that is positive definite: no rows are exchanged."""
    factors = symmetric(matrix)
    return lambda b: np.asarray(factors.solve(b))


def symmetric(matrix: scipy.sparse.csr_array) -> scipy.sparse.linalg.SuperLU:
    """Return sparse factors L and U = D L^T with the same order of rows and columns.

    As many diagonal entries of U are negative as eigenvalues of the matrix are.

    Raises
    ------
    scipy.linalg.LinAlgError
        If the factors without row exchanges do not exist.
    """
    options = {"SymmetricMode": True}
    factors = _lu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    if not np.array_equal(factors.perm_r, factors.perm_c):
        raise scipy.linalg.LinAlgError("rows were exchanged")
    return factors


def _lu(matrix: scipy.sparse.csr_array, **options: Any) -> scipy.sparse.linalg.SuperLU:
    try:
        return scipy.sparse.linalg.splu(matrix.tocsc(), **options)
    except RuntimeError as error:
        raise scipy.linalg.LinAlgError(str(error)) from None
