"""Linear complementarity problems of simultaneous impacts, solved by principal pivots."""

from __future__ import annotations

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.jit import inner, never_inlined

_DEPENDENT = 1e-13  # pivots, relative to the diagonal, of what the rows before it decide already


@inner
def solve(G: Floats, q: Floats, z: Floats, basic: Integers, work: Floats) -> bool:
    """Solve ``w = q + G z``, ``w >= 0``, ``z >= 0``, ``w . z = 0`` for positive definite G.

    Murty's least-index pivots end after finitely many steps, at the one solution there is.

    Parameters
    ----------
    G : array, shape (m, m)
    q : array, shape (m,)
    z : array, shape (m,)
        Filled in.
    basic : array of int, shape (m,)
        Filled in: 1 for every z that may be positive, else 0.
    work : array, shape (m, m + 1)

    Returns
    -------
    bool
        Whether a solution was found, as it always is where G is positive definite.
    """
    never_inlined()
    m = q.size
    for i in range(m):
        basic[i] = 0
    for _ in range(50 + 2 ** min(m, 12)):
        _basic_solution(G, q, z, basic, work)
        wrong = -1
        for i in range(m):
            if basic[i]:
                if z[i] < 0.0:
                    wrong = i
                    break
            else:
                w, size = q[i], abs(q[i])
                for j in range(m):
                    w += G[i, j] * z[j]
                    size += abs(G[i, j] * z[j])
                if w < -1e-14 * size:
                    wrong = i
                    break
        if wrong < 0:
            return True
        basic[wrong] = 1 - basic[wrong]
    return False


@inner
def _basic_solution(G: Floats, q: Floats, z: Floats, basic: Integers, work: Floats) -> None:
    """Fill in z with ``G z = -q`` in the basic rows and columns, zero elsewhere."""
    m = q.size
    for i in range(m):
        z[i] = 0.0
        for j in range(m):
            inside = basic[i] != 0 and basic[j] != 0
            work[i, j] = G[i, j] if inside else (1.0 if i == j else 0.0)
        work[i, m] = -q[i] if basic[i] else 0.0
    for i in range(m):  # G is positive definite: the pivots need no exchange of rows
        if not work[i, i] > _DEPENDENT * G[i, i]:
            for j in range(i + 1, m + 1):
                work[i, j] = 0.0
            work[i, i] = 1.0
        for r in range(i + 1, m):
            factor = work[r, i] / work[i, i]
            if factor != 0.0:
                for j in range(i, m + 1):
                    work[r, j] -= factor * work[i, j]
    for i in range(m - 1, -1, -1):
        value = work[i, m]
        for j in range(i + 1, m):
            value -= work[i, j] * z[j]
        z[i] = value / work[i, i]
