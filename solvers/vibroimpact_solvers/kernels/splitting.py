"""Steps of a structure with soft limiters: exact linear flow and kicks of the limiters, in turns.

A composition of order six with symmetric coefficients (Yoshida's solution A). Each half of it
is exact, so that the steps are symplectic where nothing is damped: the energy swings by the
error of a step and does not drift away.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.flow import product, take
from vibroimpact_solvers.kernels.jit import inline, kernel

_W1, _W2, _W3 = -1.17767998417887100695, 0.23557321335935813368, 0.78451361047755726382
_KICKS = (_W3, _W2, _W1, 1.0 - 2.0 * (_W1 + _W2 + _W3), _W1, _W2, _W3)
KICKS: Final = np.array(_KICKS)
"""Lengths of the kicks of one step, relative to it."""
FLIGHTS: Final = 0.5 * (np.append(KICKS, 0.0) + np.append(0.0, KICKS))
"""Lengths of the flights before, between and after them."""


@inline
def force(y: float, lower: float, upper: float, exponent: float, stiffness: float) -> float:
    """Return the force of a limiter, ``-+ stiffness |y / size|^exponent``."""
    if y > 0.0:
        return -stiffness * math.pow(y / upper, exponent)
    return stiffness * math.pow(-y / lower, exponent)


@kernel
def advance(
    F: Floats,
    split: Integers,
    forms: Floats,
    levels: Floats,
    limits: Floats,
    exponent: float,
    stiffness: float,
    propagators: Floats,
    h: float,
    steps: int,
    Z: Floats,
    other: Floats,
) -> float:
    """Take the state Z[0] through equal steps, in place; return the deepest compression.

    Parameters
    ----------
    F, split, forms : array
        See `kernels.flow`.
    levels : array, shape (constraint,)
        The coordinates at the zero of the state.
    limits : array, shape (2, constraint)
        Sizes that the coordinates are divided by below and above zero; infinite: no wall.
    exponent, stiffness : float
        Of the limiters.
    propagators : array, shape (8, 2, pair)
        Of the flights of one step, as `kernels.flow.propagators` returns them.
    h : float
        One step.
    steps : int
    Z, other : array, shape (1, 2, pair)
    """
    deepest = 0.0
    for _ in range(steps):
        for stage in range(propagators.shape[0]):
            P = propagators[stage]
            take(F, split, P, FLIGHTS[stage] * h, Z, 0, other, 0)
            Z[:] = other
            if stage == KICKS.size:
                break
            for i in range(levels.size):
                y = levels[i] + product(forms, 0, i, Z, 0)
                deepest = max(deepest, y / limits[1, i], -y / limits[0, i])
                kick = KICKS[stage] * h
                kick *= force(y, limits[0, i], limits[1, i], exponent, stiffness)
                for j in range(Z.shape[2]):
                    Z[0, 0, j] += kick * forms[2, i, 0, j]
                    Z[0, 1, j] += kick * forms[2, i, 1, j]
    return deepest
