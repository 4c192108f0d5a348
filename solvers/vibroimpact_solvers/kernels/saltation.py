"""Linearised deviations from a motion, advanced through free motion and through impacts.

A deviation is a column of a matrix with 2 n rows: ``scale_j dq_j`` of all modes, then
``dq_j'``. With ``scale_j = |lambda_j|^(1/2)`` its length is the energy norm, in which the free
motion of a stable mode is a rotation. An impact multiplies it by the saltation matrix

    S = R + (F+ - R F-) n^T / (n . F-)

with the impact law R, the rates F before and after the impact, and n the direction of the struck
coordinate y. Without damping F+ - R F- is a change of velocities alone. Both maps are exact; their
rounding errors are a few roundings of the norm of the map, and of the phase in free motion.
"""

from __future__ import annotations

import math

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.jit import kernel

# Growth of one unstable mode between two impacts, as an exponent: larger ones would overflow.
_LARGEST = 300.0


@kernel
def advance(X: Floats, roots: Floats, scale: Floats, time: float) -> None:
    """Advance deviations through free motion, in place.

    Parameters
    ----------
    X : array, shape (2 mode, column)
    roots : array, shape (mode,)
        Signed natural frequencies, rad per unit of time; minus the growth rate if unstable.
    scale : array, shape (mode,)
        Positive factors of the displacements, rad per unit of time.
    time : float
    """
    n = roots.size
    for j in range(n):
        rate = abs(roots[j])
        phase = rate * time
        if roots[j] > 0.0:
            stay, reach, pull = math.cos(phase), math.sin(phase) / rate, -rate * math.sin(phase)
        elif roots[j] < 0.0:
            phase = min(phase, _LARGEST)
            stay, reach, pull = math.cosh(phase), math.sinh(phase) / rate, rate * math.sinh(phase)
        else:
            stay, reach, pull = 1.0, time, 0.0
        for c in range(X.shape[1]):
            place, speed = X[j, c], X[n + j, c]
            X[j, c] = stay * place + reach * scale[j] * speed
            X[n + j, c] = pull / scale[j] * place + stay * speed


@kernel
def strike(X: Floats, row: Floats, scale: Floats, curvature: float) -> None:
    """Multiply deviations by the saltation matrix of one elastic impact, in place.

    Parameters
    ----------
    X : array, shape (2 mode, column)
    row : array, shape (mode,)
        ``w^T e_j``.
    scale : array, shape (mode,)
        As `advance` takes it.
    curvature : float
        Acceleration of y over its velocity, both just before the impact.
    """
    n, mobility = row.size, 0.0
    place, speed = np.empty(X.shape[1]), np.empty(X.shape[1])
    for c in range(X.shape[1]):
        place[c], speed[c] = 0.0, 0.0
    # Row by row, as the deviations lie in memory: the loops over columns are vector loops.
    for j in range(n):
        share = row[j] / scale[j]
        mobility += row[j] * row[j]
        for c in range(X.shape[1]):
            place[c] += share * X[j, c]
            speed[c] += row[j] * X[n + j, c]
    for j in range(n):
        back, turn = 2.0 / mobility * row[j] * scale[j], 2.0 / mobility * row[j]
        for c in range(X.shape[1]):
            X[j, c] -= back * place[c]
            X[n + j, c] += turn * (curvature * place[c] - speed[c])
