"""Cantilevers of Euler-Bernoulli elements, whose natural frequencies differ by up to 1e6."""

from __future__ import annotations

import numpy as np
import scipy.sparse

from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

FIRST = 3.5160152685
"""``Omega_1 L^2 (rho A/(E I))^(1/2)`` of a cantilever."""
EI, RHO_A, LENGTH, GAP = 100.0, 0.8, 1.0, 0.01
OMEGA = FIRST * (EI / RHO_A) ** 0.5 / LENGTH**2


def element(h: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the stiffness and the mass of an element of length h."""
    stiffness = np.array(
        [
            [12.0, 6.0 * h, -12.0, 6.0 * h],
            [6.0 * h, 4.0 * h * h, -6.0 * h, 2.0 * h * h],
            [-12.0, -6.0 * h, 12.0, -6.0 * h],
            [6.0 * h, 2.0 * h * h, -6.0 * h, 4.0 * h * h],
        ]
    )
    mass = np.array(
        [
            [156.0, 22.0 * h, 54.0, -13.0 * h],
            [22.0 * h, 4.0 * h * h, 13.0 * h, -3.0 * h * h],
            [54.0, 13.0 * h, 156.0, -22.0 * h],
            [-13.0 * h, -3.0 * h * h, -22.0 * h, 4.0 * h * h],
        ]
    )
    return EI / (h * h * h) * stiffness, RHO_A * h / 420.0 * mass


def matrices(elements: int) -> tuple[np.ndarray, np.ndarray]:
    """Return M and K of a cantilever, deflections and rotations of its nodes by turns."""
    h = LENGTH / elements
    stiffness, mass = element(h)
    M, K = np.zeros((2, 2 * elements + 2, 2 * elements + 2))
    for first in range(0, 2 * elements, 2):
        some = slice(first, first + 4)
        M[some, some] += mass
        K[some, some] += stiffness
    return M[2:, 2:], K[2:, 2:]


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
