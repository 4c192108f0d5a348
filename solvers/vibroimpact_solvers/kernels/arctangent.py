"""The inverse tangent integral and its inverse, the clock of an oscillator between lossy walls.

    Ti2(z) = integral of atan(s)/s from 0 to z

With lambda = atan(z) it is the integral of 2 s / sin(2 s) from 0 to lambda: the time, in units of
2 / (kappa Omega), that an oscillator between lossy walls needs to slow down to the frequency
ratio lambda.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.polynomial import chebyshev
from scipy.special import spence

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.jit import inner

# The inverse has its nearest singularities at +-i pi^2/8, so that on panels of this width
# polynomials of degree 12 leave less than rounding.
_WIDTH: Final = 0.25
_DEGREE: Final = 12
_MIDDLE: Final = 4.0
"""From here on the table holds ln(z) less its asymptote instead of ln(z) less ln(y)."""
_FAR: Final = 32.0
"""Beyond it two terms of the expansion at infinity are exact to rounding."""


def inverse_tangent_integral(z: Floats) -> Floats:
    """Return Ti2(z), z >= 0, of any shape; relative error about 1e-15."""
    z = np.asarray(z, dtype=np.float64)
    inner = np.minimum(z, 1.0 / np.maximum(z, 1.0))
    # Li2(i z) by Spence's function; its real part is not needed.
    near = np.where(inner < 1e-2, _small(inner), spence(1.0 - 1j * inner).imag)
    return near + 0.5 * np.pi * np.log(np.maximum(z, 1.0))


def _small(z: Floats) -> Floats:
    """Return the first terms of the power series, for which Spence's function cancels."""
    q = z * z
    return z * (1.0 - q * (1 / 9 - q * (1 / 25 - q * (1 / 49 - q / 81))))


@lru_cache(maxsize=1)
def table() -> Floats:
    """Return coefficients of ``ln(z) - ln(y)``, later ``ln(z) - (2/pi) y``, one row per panel."""
    nodes = chebyshev.chebpts1(_DEGREE + 1)
    left = np.arange(0.0, _FAR, _WIDTH)
    y = left[:, None] + 0.5 * _WIDTH * (nodes + 1.0)
    w = np.log(y)
    for _ in range(60):
        # Ti2(z) = Ti2(1/z) + (pi/2) ln(z), without rounding on the way from w to z and back.
        value = inverse_tangent_integral(np.exp(-np.abs(w))) + 0.5 * np.pi * np.maximum(w, 0.0)
        step = (value - y) / np.arctan(np.exp(w))
        w -= step
        if np.abs(step).max() < 1e-15 * _FAR:
            break
    asymptote = -inverse_tangent_integral(np.exp(-np.abs(w))) / (0.5 * np.pi)
    values = np.where(y < _MIDDLE, w - np.log(y), asymptote)
    basis = chebyshev.chebvander(nodes, _DEGREE)
    basis[:, 0] *= 0.5
    series = basis.T @ values.T * (2.0 / nodes.size)  # orthogonal at the nodes
    rows = np.zeros_like(y)
    for row, column in zip(rows, series.T, strict=True):
        powers = chebyshev.cheb2poly(column)  # without zeros at the end
        row[: powers.size] = powers
    rows.setflags(write=False)
    return rows


@inner
def log_tangent(y: float, rows: Floats) -> float:
    """Return ln z for y = Ti2(z), y > 0; `rows` is `table()`."""
    if y >= _FAR:
        far = y / (0.5 * math.pi)
        return far - math.exp(-far) / (0.5 * math.pi)
    place = y / _WIDTH
    panel = int(place)
    u = 2.0 * (place - panel) - 1.0
    value = 0.0
    for k in range(_DEGREE, -1, -1):
        value = value * u + rows[panel, k]
    return value + (math.log(y) if y < _MIDDLE else y / (0.5 * math.pi))
