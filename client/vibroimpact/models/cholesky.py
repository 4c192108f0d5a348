"""Sparse Cholesky factors by dense fronts, for large models with positive definite stiffness.

I. S. Duff, J. K. Reid, The multifrontal solution of indefinite sparse symmetric linear equations,
ACM Trans. Math. Softw. 9 (1983): the rows of a part and of what it touches form a dense matrix,
its front. The part is eliminated there by LAPACK, and what remains is added to the fronts of the
parts behind it. The order is that of `dissection`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy.linalg
import scipy.sparse as sparse
from scipy.linalg import blas, lapack

from vibroimpact.models import dissection
from vibroimpact.tables import Array

LARGE: Final = 5000
"""Degrees of freedom from which on these factors take less time than those of SuperLU, which hold
both triangles and work on few columns at once: a tenth of the time at 90,000."""


class NotDefinite(ValueError):  # noqa: N818
    """A matrix is not positive definite."""


@dataclass(frozen=True, eq=False)
class _Front:
    """A part that was eliminated.

    Parameters
    ----------
    start, stop : int
        Its rows, in the order of elimination.
    beyond : array of int
        Rows behind it that it touches.
    L : array, shape (part, part)
        Triangular factor.
    below : array, shape (beyond, part)
        Rows of the factor below it.
    """

    start: int
    stop: int
    beyond: Any
    L: Array
    below: Array


class Factors:
    """``K = L L'``, some rows of K last, which solutions can hold at zero.

    Parameters
    ----------
    K : sparse matrix, shape (n, n)
        Positive definite where the last rows are held at zero.
    last : array of int
        These rows.
    places : array, shape (n, dimension), optional
        Where rows lie.

    Raises
    ------
    NotDefinite
        If a pivot is not positive.
    """

    def __init__(self, K: Any, last: Any, places: Array | None = None) -> None:
        self.n, self._last = K.shape[0], np.asarray(last, dtype=np.int64)
        others = np.setdiff1d(np.arange(self.n), self._last)
        inner = sparse.csr_array(K)[others][:, others]
        parts = dissection.parts(inner, None if places is None else places[others])
        none = np.zeros(0, dtype=np.int64)
        self._order = np.concatenate([others[np.concatenate([none, *parts.rows])], self._last])
        ordered = sparse.csr_array(K)[self._order][:, self._order]
        ordered.sort_indices()
        self._fronts, rest = _eliminated(ordered, parts)
        self._rest = rest + _dense(ordered, others.size)
        self._held: dict[bytes, tuple[Any, Any]] = {}

    @property
    def entries(self) -> int:
        """Number of entries of the factor."""
        return sum(front.L.size + front.below.size for front in self._fronts)

    def solve(self, f: Array, held: Any = ()) -> Array:
        """Return x with ``K x = f`` but for the held rows, where ``x = 0``.

        Parameters
        ----------
        f : array, shape (n,) or (n, m)
        held : array of int
            Some of the last rows.

        Raises
        ------
        NotDefinite
            If K is not positive definite with these rows held.
        """
        x: Array = np.array(f[self._order], dtype=np.float64, order="F")
        many = x.ndim == 2
        for front in self._fronts:
            own = slice(front.start, front.stop)
            x[own] = y = _lower(front.L, x[own], many, 0)
            if front.beyond.size:
                x[front.beyond] -= front.below @ y
        free, factor = self._behind(held)
        behind = x[self.n - self._last.size :]
        inner = behind[free]
        behind[:] = 0.0
        if inner.size:
            behind[free] = scipy.linalg.cho_solve((factor, True), inner)
        for front in reversed(self._fronts):
            own = slice(front.start, front.stop)
            y = x[own]
            if front.beyond.size:
                y = y - front.below.T @ x[front.beyond]
            x[own] = _lower(front.L, y, many, 1)
        solution = np.empty_like(x)
        solution[self._order] = x
        return solution

    def _behind(self, held: Any) -> tuple[Any, Any]:
        """Return which of the last rows are free, and the factor of what remains of K for them."""
        held = np.asarray(held, dtype=np.int64)
        key = held.tobytes()
        if key not in self._held:
            free = ~np.isin(self._last, held)
            inner = self._rest[free][:, free]
            try:
                factor = scipy.linalg.cholesky(inner, lower=True) if inner.size else inner
            except scipy.linalg.LinAlgError:
                raise NotDefinite("not positive definite with these rows held") from None
            self._held[key] = free, factor
        return self._held[key]


def _lower(L: Array, y: Array, many: bool, transposed: int) -> Any:
    """Return ``L^-1 y`` or ``L^-T y``."""
    if many:
        return blas.dtrsm(1.0, L, y, lower=1, trans_a=transposed)
    return blas.dtrsv(L, y, lower=1, trans=transposed)


def _dense(ordered: Any, start: int) -> Array:
    """Return the last rows and columns of a matrix."""
    last: Array = ordered[start:][:, start:].toarray()
    return last


def _eliminated(A: Any, parts: dissection.Parts) -> tuple[list[_Front], Array]:
    """Return the fronts of all parts, and what they add to the rows behind all of them."""
    ends = np.cumsum([rows.size for rows in parts.rows], dtype=np.int64)
    fronts, updates = list[_Front](), dict[int, tuple[Any, Array]]()
    for number, stop in enumerate(ends.tolist()):
        start = stop - parts.rows[number].size
        own = [updates.pop(child) for child in parts.children[number]]
        rows, F = _assembled(A, start, stop, own)
        size = stop - start
        if size:
            front = _factored(F, start, stop, rows[size:])
            fronts.append(front)
            F = F[size:, size:]
            if front.beyond.size:
                F = blas.dsyrk(-1.0, front.below, beta=1.0, c=F, lower=1)
        updates[number] = rows[size:], F
    behind = A.shape[0] - (int(ends[-1]) if ends.size else 0)
    rest, first = np.zeros((behind, behind)), A.shape[0] - behind
    for rows, F in updates.values():
        rest[np.ix_(rows - first, rows - first)] += np.tril(F) + np.tril(F, -1).T
    return fronts, rest


def _assembled(A: Any, start: int, stop: int, own: list[tuple[Any, Array]]) -> tuple[Any, Array]:
    """Return the rows of a front, and its lower triangle."""
    span = slice(A.indptr[start], A.indptr[stop])
    column, value = A.indices[span], A.data[span]
    row = np.repeat(np.arange(stop - start), np.diff(A.indptr[start : stop + 1]))
    later = column >= start
    column, value, row = column[later], value[later], row[later]
    touched = [column[column >= stop], *(rows[rows >= stop] for rows, _ in own)]
    rows = np.concatenate([np.arange(start, stop), np.unique(np.concatenate(touched))])
    F = np.zeros((rows.size, rows.size), order="F")
    F[np.searchsorted(rows, column), row] = value
    for inner, update in own:
        at = np.searchsorted(rows, inner)
        F[at[:, np.newaxis], at] += update
    return rows, F


def _factored(F: Array, start: int, stop: int, beyond: Any) -> _Front:
    """Return the front whose first rows are eliminated."""
    size = stop - start
    L, failed = lapack.dpotrf(F[:size, :size], lower=1, clean=1)
    if failed:
        raise NotDefinite("a pivot is not positive")
    below = blas.dtrsm(1.0, L, F[size:, :size], side=1, lower=1, trans_a=1)
    return _Front(start, stop, beyond, L, below)
