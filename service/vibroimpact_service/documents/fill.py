"""How long the factors of a structure's matrices take, told by where their entries are."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from vibroimpact_schema import systems

MOST: Final = 5e9
"""Operations of the factors of a matrix that is accepted: half a second to one. Finite elements of
5000 degrees of freedom take up to half of it."""


def factorized(system: systems.MatrixSystem) -> Iterator[tuple[str, systems.CoordinateMatrix]]:
    """Yield the names and matrices whose factors are computed while a request is planned.

    The mass matrix has to be positive definite, and so has the stiffness matrix of what has no
    mass. Only lists of entries are told: the factors of others go with the size of the body.
    """
    if isinstance(system.M, systems.CoordinateMatrix):
        yield "M", system.M
    if isinstance(system.K, systems.CoordinateMatrix) and _lacks_mass(system.M):
        yield "K", system.K


def _lacks_mass(M: Any) -> bool:
    """Whether a mass is zero."""
    match M:
        case systems.DiagonalMatrix():
            return 0.0 in M.diagonal
        case systems.BandedMatrix():
            return 0.0 in M.bands.get("0", ())
        case systems.CoordinateMatrix():
            triples = zip(M.row, M.col, M.data, strict=False)
            masses = {i for i, j, value in triples if i == j and value}
            return len(masses) < max(M.shape)
        case systems.ScalarMatrix():
            return M.scalar == 0.0
        case _:
            return any(k >= len(row) or row[k] == 0.0 for k, row in enumerate(M))


def work(matrix: systems.CoordinateMatrix) -> float:
    """Return about how many operations the factors take, 0 for a matrix that is none.

    Each row, from its first entry on, is filled if rows and columns are ordered so that entries
    are near the diagonal (Cuthill and McKee). Other orders leave less, though not by much where
    entries are anywhere.
    """
    # The numerical libraries load at the first request.
    import numpy as np
    import scipy.sparse.csgraph

    rows, columns = np.array(matrix.row), np.array(matrix.col)
    n = max(matrix.shape)
    if not rows.size or rows.shape != columns.shape:
        return 0.0
    if min(rows.min(), columns.min()) < 0 or max(rows.max(), columns.max()) >= n:
        return 0.0
    pattern = scipy.sparse.csr_array((np.ones(rows.size), (rows, columns)), shape=(n, n))
    order = scipy.sparse.csgraph.reverse_cuthill_mckee(pattern, symmetric_mode=True)
    place = np.empty(n, dtype=np.int64)
    place[order] = np.arange(n)
    widths = np.zeros(n)
    np.maximum.at(widths, place[rows], place[rows] - place[columns])
    return float(widths @ widths)
