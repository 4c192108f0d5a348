"""Symmetric matrices of files, whose mirrored entries differ by rounding or are left out."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import scipy.sparse as sparse

from vibroimpact_schema.imaginary import real

ROUNDING: Final = 1e-9
"""Difference of mirrored entries, relative to the largest, that is taken for rounding."""


class NotSquareError(ValueError):
    """A matrix is not square."""


class NotSymmetricError(ValueError):
    """A matrix is not symmetric.

    Parameters
    ----------
    name : str
        Of the matrix.
    places : str
        The two entries that differ most, and by how much.
    relative : float
        Their difference relative to the largest entry.
    """

    def __init__(self, name: str, places: str, relative: float) -> None:
        super().__init__(f"{name} is not symmetric: {places}")
        self.places, self.relative = places, relative


def square(name: str, given: Any) -> Any:
    """Return a matrix as rows of its entries, in scipy's form; a triangle stands for the whole.

    Raises
    ------
    NotSquareError
        If it is not square.
    ValueError
        If it is not finite or not real.
    """
    given = real(name, given)
    if np.ndim(given) == 1:
        given = sparse.diags_array(np.asarray(given, dtype=np.float64))
    matrix = sparse.csr_array(given, dtype=np.float64)
    if matrix.shape[0] != matrix.shape[1]:
        raise NotSquareError(f"{name} is not square: {matrix.shape}")
    if not np.isfinite(matrix.data).all():
        raise ValueError(f"{name} has entries that are not finite")
    lower, upper = sparse.tril(matrix, -1), sparse.triu(matrix, 1)
    if lower.count_nonzero() == 0 or upper.count_nonzero() == 0:
        matrix = matrix + lower.T + upper.T
    return matrix


def check(name: str, matrix: Any, rounding: float = ROUNDING) -> None:
    """Refuse a matrix, as `square` returns it, whose mirrored entries differ by more.

    Raises
    ------
    NotSymmetricError
        With the entries that differ most.
    """
    difference = sparse.coo_array(abs(matrix - matrix.T))
    if difference.nnz and difference.max() > rounding * abs(matrix).max():
        at = int(difference.data.argmax())
        i, j = (int(index[at]) for index in difference.coords)
        relative = float(difference.data[at] / abs(matrix).max())
        places = f"entries ({i}, {j}) and ({j}, {i}) differ by {relative:.2g} of the largest entry"
        raise NotSymmetricError(name, places, relative)


def mean(matrix: Any) -> Any:
    """Return the mean of a matrix and its transpose, without entries that are zero."""
    symmetric = sparse.csr_array(0.5 * (matrix + matrix.T))
    symmetric.eliminate_zeros()
    return symmetric
