"""Matrices of beams of Euler-Bernoulli elements, whose natural frequencies differ by up to 1e6."""

from __future__ import annotations

import numpy as np

from vibroimpact_solvers.arrays import Floats

EI, RHO_A = 100.0, 0.8


def element(h: float) -> tuple[Floats, Floats]:
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


def matrices(elements: int) -> tuple[Floats, Floats]:
    """Return M and K of a cantilever of length 1: deflection and rotation of each node in turn."""
    stiffness, mass = element(1.0 / elements)
    M, K = np.zeros((2, 2 * elements + 2, 2 * elements + 2))
    for first in range(0, 2 * elements, 2):
        some = slice(first, first + 4)
        M[some, some] += mass
        K[some, some] += stiffness
    return M[2:, 2:], K[2:, 2:]
