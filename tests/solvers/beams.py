"""Cantilevers of length 1 with a stop at the tip."""

from __future__ import annotations

import numpy as np
import scipy.sparse

from benchmarks.beams import EI, RHO_A, matrices
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

FIRST = 3.5160152685
"""``Omega_1 L^2 (rho A/(E I))^(1/2)`` of a cantilever."""
GAP = 0.01
OMEGA = FIRST * (EI / RHO_A) ** 0.5


def cantilever(elements: int, *, damped: bool = True) -> System:
    """Return a cantilever with a stop at its tip and Rayleigh damping, 2 % at its first mode."""
    M, K = matrices(elements)
    b = 1e-3 / OMEGA
    C = 2.0 * OMEGA * (0.02 - 0.5 * b * OMEGA) * M + b * K
    return system(M, K, C if damped else None)


def system(M: np.ndarray, K: np.ndarray, C: np.ndarray | None) -> System:
    """Return a structure with a stop at its last deflection."""
    lean = [SymmetricMatrix.leanest(scipy.sparse.csr_array(A)) for A in (M, K)]
    damping = None if C is None else SymmetricMatrix.leanest(scipy.sparse.csr_array(C))
    return System(*lean, (Constraint.at(len(M) - 2, GAP),), C=damping)
