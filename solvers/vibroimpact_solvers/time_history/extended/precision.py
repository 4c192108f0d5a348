"""Extended precision: real and complex numbers of any number of digits, and eigenvalues.

Numbers are balls of FLINT: a number and a bound of its rounding.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Any, Final

import flint
import numpy as np

from vibroimpact_solvers import precision
from vibroimpact_solvers.arrays import Floats

Real = Any
"""A number of FLINT, `flint.arb`."""
Complex = Any
"""A complex number of FLINT, `flint.acb`."""
Row = list[Any]
Rows = list[list[Any]]

GUARD: Final = 12
"""Guard digits of the arithmetic."""


def working(digits: int) -> AbstractContextManager[None]:
    """Compute with a number of digits and the guard digits."""
    return precision.working(round((digits + GUARD + 1) * math.log2(10.0)))


def real(value: float) -> Real:
    """Return a number that is exactly a double."""
    return flint.arb(float(value))


def middle(value: Real) -> Real:
    """Return a number without the bound of its rounding.

    Bounds that are carried from impact to impact would grow as if every rounding was the worst
    possible, and be useless soon; the growth of errors is estimated otherwise (`deviations`).
    """
    return value.mid()


def dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    """Return the sum of products."""
    total = flint.arb(0)
    for x, y in zip(a, b, strict=True):
        total += x * y
    return total


def times(A: Rows, x: Sequence[Any]) -> Row:
    """Return the product of a matrix and a vector."""
    return [dot(row, x) for row in A]


def rows_of(matrix: Any) -> Rows:
    """Return the rows of a matrix of FLINT, without bounds."""
    return [[middle(value) for value in row] for row in matrix.tolist()]


def matrix(rows: Sequence[Sequence[Any]]) -> Any:
    """Return a matrix of FLINT."""
    return flint.arb_mat([list(row) for row in rows])


def exact(values: Floats) -> Any:
    """Return the matrix whose entries are exactly these doubles."""
    return flint.arb_mat([[real(value) for value in row] for row in values.tolist()])


def without_bounds(values: Any) -> Any:
    """Return a matrix of FLINT without bounds of roundings."""
    return matrix(rows_of(values))


def doubles(rows: Sequence[Sequence[Any]]) -> Floats:
    """Return the doubles nearest to numbers, shape (row, column)."""
    values = [[float(middle(value)) for value in row] for row in rows]
    return np.array(values, dtype=np.float64).reshape(len(rows), len(rows[0]) if rows else 0)


def lower(M: Any) -> Rows:
    """Return the Cholesky factor L of a positive definite matrix, M = L L^T."""
    n, entries = M.nrows(), M.tolist()
    L: Rows = [[flint.arb(0)] * n for _ in range(n)]
    for j in range(n):
        L[j][j] = middle((entries[j][j] - dot(L[j][:j], L[j][:j])).sqrt())
        for i in range(j + 1, n):
            L[i][j] = middle((entries[i][j] - dot(L[i][:j], L[j][:j])) / L[j][j])
    return L


def modes(M: Any, K: Any, digits: int) -> tuple[Row, Rows]:
    """Return eigenvalues and modes, ``K e = lambda M e``, ``e^T M e = 1``.

    Returns
    -------
    eigenvalues : list
    modes : list of rows, shape (dof, mode)
    """
    if M.nrows() == 0:
        return [], []
    inverse = matrix(lower(M)).inv()
    A = without_bounds(inverse * K * inverse.transpose())
    eigenvalues, V = _symmetric(A, digits)
    return eigenvalues, rows_of(without_bounds(inverse.transpose()) * V)


def _symmetric(A: Any, digits: int) -> tuple[Row, Any]:
    """Return eigenvalues and eigenvectors of a symmetric matrix.

    Eigenvectors in double precision are made orthogonal to all digits; what is left beside the
    diagonal then is 1e-15 of it, and each sweep of rotations squares that. Equal and almost
    equal eigenvalues are no exception.
    """
    n = A.nrows()
    scale = max((float(abs(value)) for row in A.tolist() for value in row), default=1.0) or 1.0
    _, start = np.linalg.eigh(doubles(A.tolist()) / scale)
    V = exact(start)
    for _ in range(2 + math.ceil(math.log2(digits))):
        excess = V.transpose() * V
        V = without_bounds(V * (3 * _identity(n) - excess) / 2)
    B = rows_of(V.transpose() * A * V)
    columns = rows_of(V.transpose())
    for _ in range(4 + math.ceil(math.log2(digits))):
        if not _sweep(B, columns, real(scale) * flint.arb(10) ** (2 - digits - GUARD)):
            break
    return [B[i][i] for i in range(n)], matrix(columns).transpose()


def _identity(n: int) -> Any:
    return flint.arb_mat(n, n, [int(i == j) for i in range(n) for j in range(n)])


def _sweep(B: Rows, columns: Rows, tiny: Real) -> bool:
    """Rotate away what is beside the diagonal, entry by entry; return whether there was any."""
    n, turned = len(B), False
    for p in range(n):
        for q in range(p + 1, n):
            off = B[p][q]
            if abs(off) <= tiny:
                continue
            turned = True
            half = (B[q][q] - B[p][p]) / (2 * off)
            t = 1 / (abs(half) + (half * half + 1).sqrt())
            if half < 0:
                t = -t
            c = middle(1 / (t * t + 1).sqrt())
            s = middle(t * c)
            for rows in (B, columns):
                a, b = rows[p], rows[q]
                rows[p] = [middle(c * x - s * y) for x, y in zip(a, b, strict=True)]
                rows[q] = [middle(s * x + c * y) for x, y in zip(a, b, strict=True)]
            for row in B:
                x, y = row[p], row[q]
                row[p], row[q] = middle(c * x - s * y), middle(s * x + c * y)
    return turned
