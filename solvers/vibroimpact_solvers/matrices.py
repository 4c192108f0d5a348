"""Real symmetric matrices in the most compact form: products, sums, factors.

Examples
--------
>>> import numpy as np
>>> from vibroimpact_solvers.matrices import SymmetricMatrix
>>> K = SymmetricMatrix.dense([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]])
>>> K.form.value, K.data.shape
('tridiagonal', (2, 3))
>>> K @ np.array([1.0, 2.0, 3.0])
array([0., 0., 4.])
>>> K.factorize()(np.array([0.0, 0.0, 4.0])).round(12)
array([1., 2., 3.])
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg
from numpy.typing import ArrayLike

from vibroimpact_solvers import factors
from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.factors import Solve

# Entries that differ by less, relative to the largest, are taken as equal: assembled
# finite-element matrices are symmetric only up to the rounding of their sums.
_SYMMETRY = 1e-12

# Bands with this many times more numbers than nonzero entries are replaced by a list of the
# entries.
_FILL = 6


class Form(StrEnum):
    """Storage of a matrix."""

    DIAGONAL = "diagonal"
    TRIDIAGONAL = "tridiagonal"
    BANDED = "banded"
    SPARSE = "sparse"
    DENSE = "dense"


@dataclass(frozen=True, eq=False, slots=True)
class SymmetricMatrix:
    """A real symmetric matrix in the most compact form.

    The class methods check the entries and choose the form.

    Parameters
    ----------
    data : array
        The rows, shape (n, n); or the main diagonal and those below, shape (bands, n), row k
        holding the entries (i + k, i), as `scipy.linalg.eig_banded` takes them; or the
        entries of the sparse form, shape (entries,).
    form : Form
        Which of these, and how many bands.
    pattern : tuple of arrays, optional
        Of the sparse form: column indices and row starts, as in `scipy.sparse.csr_array`.
    """

    data: Floats
    form: Form
    pattern: tuple[Integers, Integers] | None = None
    n: int = field(init=False, repr=False)
    """Number of rows."""

    def __post_init__(self) -> None:
        rows = self.data.shape[1] if self.pattern is None else self.pattern[1].size - 1
        object.__setattr__(self, "n", int(rows))

    @classmethod
    def dense(cls, rows: ArrayLike) -> SymmetricMatrix:
        """Take a full matrix, shape (n, n); a banded one is detected."""
        try:
            full = np.array(rows, dtype=np.float64)
        except (TypeError, ValueError):
            raise ModelError((), "the rows have different lengths", code="not_square") from None
        if full.ndim != 2 or full.shape[0] != full.shape[1] or full.size == 0:
            size = " x ".join(str(side) for side in full.shape)
            raise ModelError((), f"the matrix is {size}, not square", code="not_square")
        _require_finite(full)
        gap = np.abs(full - full.T)
        if gap.max() > _SYMMETRY * np.abs(full).max():
            i, j = (int(k) for k in np.unravel_index(np.argmax(gap), gap.shape))
            message = f"entries ({i}, {j}) = {full[i, j]} and ({j}, {i}) = {full[j, i]} differ"
            raise ModelError((), message, code="not_symmetric")
        full = 0.5 * (full + full.T)
        row, col = np.nonzero(full)
        width = int(np.abs(row - col).max(initial=0))
        if 2 * width < full.shape[0] or width == 0:
            return cls.bands({k: np.diagonal(full, k) for k in range(width + 1)})
        return cls(frozen(full), Form.DENSE)

    @classmethod
    def diagonal(cls, entries: ArrayLike) -> SymmetricMatrix:
        """Take the diagonal, shape (n,)."""
        return cls.bands({0: np.asarray(entries, dtype=np.float64)})

    @classmethod
    def bands(cls, diagonals: Mapping[int, ArrayLike]) -> SymmetricMatrix:
        """Take diagonals by their offset from the main one, which must be among them."""
        if 0 not in diagonals:
            raise ModelError((), "the main diagonal, offset 0, is missing", code="missing_diagonal")
        given = {k: np.asarray(v, dtype=np.float64) for k, v in diagonals.items()}
        n = given[0].size
        for offset, entries in given.items():
            if not 0 <= offset < n or entries.shape != (n - offset,):
                message = f"diagonal {offset} has {entries.size} entries instead of {n - offset}"
                raise ModelError((str(offset),), message, code="not_square")
            _require_finite(entries)
        width = max((k for k, v in given.items() if v.any()), default=0)
        data = np.zeros((width + 1, n))
        for offset in range(width + 1):
            if offset in given:
                data[offset, : n - offset] = given[offset]
        return cls(frozen(data), _banded_form(width))

    @classmethod
    def sparse(
        cls, shape: Sequence[int], row: ArrayLike, col: ArrayLike, data: ArrayLike
    ) -> SymmetricMatrix:
        """Take entries by their coordinates; those given twice are added."""
        if len(shape) != 2 or shape[0] != shape[1] or shape[0] < 1:
            raise ModelError(("shape",), "the matrix is not square", code="not_square")
        n = int(shape[0])
        rows, columns = np.asarray(row, dtype=np.int64), np.asarray(col, dtype=np.int64)
        values = np.asarray(data, dtype=np.float64)
        if not rows.size == columns.size == values.size:
            raise ModelError((), "row, col and data have different lengths", code="wrong_length")
        for name, index in (("row", rows), ("col", columns)):
            if index.size and (index.min() < 0 or index.max() >= n):
                raise ModelError((name,), f"an index is not below {n}", code="index_out_of_range")
        _require_finite(values)
        matrix = scipy.sparse.coo_array((values, (rows, columns)), shape=(n, n)).tocsr()
        if abs(matrix - matrix.T).max() > _SYMMETRY * max(abs(matrix).max(), 1e-300):
            raise ModelError((), "the entries are not symmetric", code="not_symmetric")
        return cls.leanest(0.5 * (matrix + matrix.T))

    @classmethod
    def leanest(cls, matrix: scipy.sparse.csr_array) -> SymmetricMatrix:
        """Take a `scipy.sparse` array that is known to be finite and symmetric."""
        matrix.eliminate_zeros()
        lower = scipy.sparse.tril(matrix).tocoo()
        n, offsets = matrix.shape[0], lower.row - lower.col
        width = int(offsets.max(initial=0))
        if width > 1 and (width + 1) * n > _FILL * lower.nnz:
            if 8 * matrix.nnz > n * n:
                return cls(frozen(matrix.toarray()), Form.DENSE)
            matrix.sort_indices()
            pattern = (
                frozen(matrix.indices.astype(np.int64)),
                frozen(matrix.indptr.astype(np.int64)),
            )
            return cls(frozen(matrix.data), Form.SPARSE, pattern)
        if 2 * width >= n and width:
            return cls(frozen(matrix.toarray()), Form.DENSE)
        bands = np.zeros((width + 1, n))
        bands[offsets, lower.col] = lower.data
        return cls(frozen(bands), _banded_form(width))

    @property
    def width(self) -> int:
        """Number of diagonals below the main one that are stored."""
        narrow = self.form in {Form.DIAGONAL, Form.TRIDIAGONAL, Form.BANDED}
        return int(self.data.shape[0] - 1) if narrow else self.n - 1

    @property
    def entries(self) -> int:
        """Number of entries in a product with a vector."""
        return (
            self.data.size if self.pattern is not None else self.n * min(2 * self.width + 1, self.n)
        )

    @property
    def main_diagonal(self) -> Floats:
        """The entries (i, i), shape (n,)."""
        if self.form is Form.DENSE:
            return np.diagonal(self.data)
        if self.form is Form.SPARSE:
            return np.asarray(self.to_sparse().diagonal())
        return np.asarray(self.data[0])

    @property
    def joins_by_springs(self) -> bool:
        """Whether no entry on the diagonal is negative, and none beside it positive."""
        if self.pattern is not None:
            columns, starts = self.pattern
            on = columns == np.repeat(np.arange(starts.size - 1), np.diff(starts))
            return bool((np.where(on, self.data, -self.data) >= 0.0).all())
        if self.form is Form.DENSE:
            beside = self.data - np.diag(np.diagonal(self.data))
            return bool((np.diagonal(self.data) >= 0.0).all() and (beside <= 0.0).all())
        return bool((self.data[0] >= 0.0).all() and (self.data[1:] <= 0.0).all())

    def to_dense(self) -> Floats:
        """Return the full matrix, shape (n, n)."""
        if self.form is Form.DENSE:
            return self.data
        if self.form is Form.SPARSE:
            return np.asarray(self.to_sparse().toarray())
        full = np.zeros((self.n, self.n))
        for k, band in enumerate(self.data):
            index = np.arange(self.n - k)
            full[index, index + k] = full[index + k, index] = band[: self.n - k]
        return full

    def to_sparse(self) -> scipy.sparse.csr_array:
        """Return the matrix as a sparse array of scipy."""
        if self.pattern is not None:
            return scipy.sparse.csr_array((self.data, *self.pattern), shape=(self.n, self.n))
        if self.form is Form.DENSE:
            return scipy.sparse.csr_array(self.data)
        offsets, bands = [], []
        for k, band in enumerate(self.data):
            for offset in {-k, k}:
                offsets.append(offset)
                bands.append(band[: self.n - k])
        return scipy.sparse.diags_array(bands, offsets=offsets, shape=(self.n, self.n)).tocsr()

    def __matmul__(self, x: Floats) -> Floats:
        """Return the product with vectors, shape (n,) or (n, columns)."""
        if self.form is Form.DENSE:
            return np.asarray(self.data @ x)
        if self.form is Form.SPARSE:
            return np.asarray(self.to_sparse() @ x)
        column = (slice(None),) + (np.newaxis,) * (x.ndim - 1)
        y = self.data[0][column] * x
        for k, band in enumerate(self.data[1:], start=1):
            part = band[: self.n - k][column]
            y[k:] += part * x[:-k]
            y[:-k] += part * x[k:]
        return np.asarray(y)

    def block(self, rows: Integers, columns: Integers | None = None) -> scipy.sparse.csr_array:
        """Return some rows, of some columns or of all, without zeros."""
        some = self.to_sparse()[rows]
        some = scipy.sparse.csr_array(some if columns is None else some[:, columns])
        some.eliminate_zeros()
        return some

    def part(self, dofs: Integers) -> SymmetricMatrix:
        """Return the matrix of some degrees of freedom."""
        if self.form is Form.DENSE:
            return SymmetricMatrix.dense(self.data[np.ix_(dofs, dofs)])
        return SymmetricMatrix.leanest(self.block(dofs, dofs))

    def plus(self, factor: float, other: SymmetricMatrix) -> SymmetricMatrix:
        """Return ``self + factor * other``."""
        if Form.SPARSE in {self.form, other.form}:
            return SymmetricMatrix.leanest((self.to_sparse() + factor * other.to_sparse()).tocsr())
        if Form.DENSE in {self.form, other.form}:
            return SymmetricMatrix(self.to_dense() + factor * other.to_dense(), Form.DENSE)
        width = max(self.width, other.width)
        data = np.zeros((width + 1, self.n))
        data[: self.width + 1] += self.data
        data[: other.width + 1] += factor * other.data
        return SymmetricMatrix(data, _banded_form(width))

    def scaled(self, by: Floats) -> SymmetricMatrix:
        """Return the matrix with rows and columns times positive factors, shape (n,)."""
        if self.form is Form.DENSE:
            return SymmetricMatrix(by[:, np.newaxis] * self.data * by, Form.DENSE)
        if self.form is Form.SPARSE:
            diagonal = scipy.sparse.diags_array(by)
            return SymmetricMatrix.leanest((diagonal @ self.to_sparse() @ diagonal).tocsr())
        data = np.zeros_like(self.data)
        for k, band in enumerate(self.data):
            data[k, : self.n - k] = by[: self.n - k] * band[: self.n - k] * by[k:]
        return SymmetricMatrix(data, self.form)

    def factorize(self, *, definite: bool = False) -> Solve:
        """Return the function that solves with this matrix.

        Parameters
        ----------
        definite : bool
            Whether the matrix is known to be positive definite: if it is sparse, that takes half
            the time. Else it may be indefinite.

        Raises
        ------
        scipy.linalg.LinAlgError
            If the matrix is singular to the last bit.
        """
        match self.form:
            case Form.DIAGONAL:
                return factors.diagonal(self.data[0])
            case Form.SPARSE:
                sparse = factors.definite_sparse if definite else factors.sparse
                return sparse(self.to_sparse())
            case Form.DENSE:
                return factors.dense(self.data)
            case _:
                return factors.banded(self.data)

    def is_positive_definite(self) -> bool:
        """Whether all eigenvalues are positive."""
        try:
            if self.form is Form.DENSE:
                scipy.linalg.cholesky(self.data, lower=True, check_finite=False)
            elif self.form is Form.DIAGONAL:
                return bool((self.data[0] > 0.0).all())
            elif self.form is Form.SPARSE:
                return bool((factors.symmetric(self.to_sparse()).U.diagonal() > 0.0).all())
            else:
                scipy.linalg.cholesky_banded(self.data, lower=True, check_finite=False)
        except scipy.linalg.LinAlgError:
            return False
        return True

    def digest(self) -> bytes:
        """Return a hash of the content."""
        text = hashlib.blake2b(f"{self.form} {self.data.shape}".encode())
        for array in (self.data, *(self.pattern or ())):
            text.update(np.ascontiguousarray(array).tobytes())
        return text.digest()


def frozen(array: Any) -> Any:
    """Return an array, from now on read-only."""
    array.setflags(write=False)
    return array


def _require_finite(array: Floats) -> None:
    if not np.isfinite(array).all():
        raise ModelError((), "an entry is nan or infinite", code="not_finite")


def _banded_form(width: int) -> Form:
    return (Form.DIAGONAL, Form.TRIDIAGONAL)[width] if width < 2 else Form.BANDED
