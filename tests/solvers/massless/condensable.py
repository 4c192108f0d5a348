"""Structures with degrees of freedom without mass whose condensed matrices are exact in doubles.

The stiffness of what has no mass is ``L D L^T`` with a unit lower triangle of integers and powers
of two, so that its inverse, and all that follows from it, are fractions that doubles hold. The
condensed structure is thus known by hand, in fractions, and shares no rounding with the solvers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from tests.solvers.structures import symmetric
from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

Fractions = list[list[Fraction]]


@dataclass(frozen=True)
class Condensable:
    """A structure, and the condensed one."""

    M: Floats
    K: Floats
    C: Floats
    massive: Integers
    massless: Integers
    condensed_K: Floats
    static: Floats  # displacements without mass by those with mass

    def whole(
        self, limiters: Sequence[Constraint], *, damped: bool = False, sparse: bool = False
    ) -> System:
        """Return the structure; limiters count the degrees of freedom with mass."""
        moved = tuple(
            Constraint(
                tuple(int(self.massive[dof]) for dof in one.dofs),
                one.weights, one.lower, one.upper, one.restitution,
            )
            for one in limiters
        )  # fmt: skip
        M, K, C = (_stored(A, sparse=sparse) for A in (self.M, self.K, self.C))
        return System(M, K, moved, C=C if damped else None)

    def condensed(self, limiters: Sequence[Constraint], *, damped: bool = False) -> System:
        """Return the structure that was condensed by hand."""
        some = np.ix_(self.massive, self.massive)
        M, K, C = (SymmetricMatrix.dense(A) for A in (self.M[some], self.condensed_K, self.C[some]))
        return System(M, K, tuple(limiters), C=C if damped else None)

    def spread(self, x: Floats) -> Floats:
        """Return vectors of all degrees of freedom, (…, dof), of those with mass."""
        all_x = np.zeros((*x.shape[:-1], len(self.M)))
        all_x[..., self.massive] = x
        return all_x


def _stored(A: Floats, *, sparse: bool) -> SymmetricMatrix:
    if not sparse:
        return SymmetricMatrix.dense(A)
    rows, columns = np.nonzero(A)
    return SymmetricMatrix.sparse(A.shape, rows, columns, A[rows, columns])


def condensable(
    seed: int, massive: int, massless: int, *, lumped: bool = False, graded: bool = False
) -> Condensable:
    """Return a random structure; a row of its static relation may be zero.

    Where it is graded, some springs of what has no mass are a million times as stiff as others.
    """
    rng = np.random.default_rng(seed)
    n = massive + massless
    L = np.tril(rng.integers(-1, 2, (massless, massless)), -1) + np.eye(massless)
    D = 2.0 ** (rng.integers(-10, 11, massless) if graded else rng.integers(-2, 4, massless))
    inner = L @ np.diag(D) @ L.T  # exact: few bits
    coupling = rng.integers(-2, 3, (massless, massive)) * (rng.random((massless, massive)) < 0.5)
    inverse = np.linalg.inv(L).round()
    solved = _product(_fractions(inverse.T), _fractions(np.diag(1.0 / D)), _fractions(inverse))
    assert _product(_fractions(inner), solved) == _fractions(np.eye(massless))
    static = _product(solved, _fractions(-coupling.astype(float)))
    condensed = np.round(symmetric(rng, massive, 0.3) * 256.0) / 256.0
    back = _product(_fractions(coupling.astype(float).T), static)
    outer = [[Fraction(a) - b for a, b in zip(*rows, strict=True)]
             for rows in zip(condensed.tolist(), back, strict=True)]  # fmt: skip
    order = rng.permutation(n)
    with_mass, without = np.sort(order[:massive]), np.sort(order[massive:])
    M, K, C = np.zeros((3, n, n))
    mass = np.diag(rng.uniform(0.5, 2.0, massive)) if lumped else symmetric(rng, massive, 0.3)
    M[np.ix_(with_mass, with_mass)] = 0.5 * (mass + mass.T)
    C[np.ix_(with_mass, with_mass)] = 0.1 * symmetric(rng, massive)
    K[np.ix_(with_mass, with_mass)] = _doubles(outer, massive)
    K[np.ix_(without, without)] = inner
    K[np.ix_(without, with_mass)] = coupling
    K[np.ix_(with_mass, without)] = coupling.T
    C = 0.5 * (C + C.T)
    return Condensable(M, K, C, with_mass, without, condensed, _doubles(static, massive))


def _fractions(A: Floats) -> Fractions:
    return [[Fraction(value) for value in row] for row in A.tolist()]


def _product(*factors: Fractions) -> Fractions:
    first, *rest = factors
    for other in rest:
        columns = list(zip(*other, strict=True))
        first = [[sum((a * b for a, b in zip(row, column, strict=True)), Fraction(0))
                  for column in columns] for row in first]  # fmt: skip
    return first


def _doubles(rows: Fractions, columns: int) -> Floats:
    values = np.array([[float(value) for value in row] for row in rows]).reshape(-1, columns)
    assert all(Fraction(v) == value for row, exact in zip(values.tolist(), rows, strict=True)
               for v, value in zip(row, exact, strict=True))  # fmt: skip
    return values
