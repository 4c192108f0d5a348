"""Number of natural modes below a frequency, proved by Sylvester's law of inertia.

``K - lambda M`` has as many negative pivots as there are eigenvalues below lambda. Factors
without row exchanges are those of a nearby matrix: ``|E| <= c eps |L||U|``, computed from the
factors themselves. Eigenvalues farther from lambda than that are counted correctly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.linalg
import scipy.sparse

from vibroimpact_solvers import factors
from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.matrices import Form, SymmetricMatrix
from vibroimpact_solvers.model import System

_NUDGES: Final = (0.0, 1e-13, -1e-13, 3e-11, -3e-11, 1e-9, -1e-9)


@dataclass(frozen=True, slots=True)
class EigenvalueCount:
    """Number of eigenvalues below a value."""

    at: float  # the value
    below: int  # their number
    error: float  # eigenvalues closer to the value than this may be on the other side


@dataclass(frozen=True, eq=False)
class EigenvalueCounter:
    """Counts the eigenvalues of one system."""

    # The matrices with the diagonal of M scaled to ones, which changes no eigenvalue, (n, n)
    M: SymmetricMatrix
    K: SymmetricMatrix
    least: float  # lower bound of the eigenvalues of the scaled M

    @classmethod
    def of(cls, system: System) -> EigenvalueCounter:
        """Return the counter of a system."""
        scale = scipy.sparse.diags_array(1.0 / np.sqrt(system.M.main_diagonal))
        M, K = (
            SymmetricMatrix.leanest((scale @ matrix.to_sparse() @ scale).tocsr())
            for matrix in (system.M, system.K)
        )
        return cls(M, K, _least(M))

    def count(self, value: float) -> EigenvalueCount:
        """Return how many eigenvalues are below a value.

        Raise `ConvergenceError` where no factors without row exchanges exist at values close by.
        """
        for nudge in _NUDGES:
            at = value * (1.0 + nudge)
            try:
                pivots = factors.symmetric(self.K.plus(-at, self.M).to_sparse())
            except scipy.linalg.LinAlgError:
                continue
            below = int(np.count_nonzero(pivots.U.diagonal() < 0.0))
            return EigenvalueCount(at, below, _backward_error(pivots) / self.least)
        message = f"the natural modes below the squared frequency {value:g} cannot be counted"
        raise ConvergenceError(message)


def least_eigenvalue(M: SymmetricMatrix) -> float:
    """Return a lower bound of the eigenvalues of a mass matrix with its diagonal scaled to ones.

    Raise `ConvergenceError` where the matrix is singular up to rounding.
    """
    return _least(M.scaled(1.0 / np.sqrt(M.main_diagonal)))


def _least(M: SymmetricMatrix) -> float:
    """Return a lower bound of the eigenvalues of a mass matrix with ones on its diagonal."""
    if M.form is Form.DIAGONAL:
        return 1.0
    one = SymmetricMatrix.diagonal(np.ones(M.n))
    bound = 0.5
    while not M.plus(-bound, one).is_positive_definite():
        bound *= 0.5
        if bound < EPS:
            raise ConvergenceError("the mass matrix is too close to a singular one")
    return bound


def _backward_error(pivots: scipy.sparse.linalg.SuperLU) -> float:
    """Return a bound of the norm of the difference between a matrix and its factors' product."""
    L, U = abs(pivots.L), abs(pivots.U)
    sums: Floats = L @ (U @ np.ones(L.shape[0]))
    longest = int(np.diff(L.tocsr().indptr).max())
    return (longest + 2) * EPS * float(sums.max())
