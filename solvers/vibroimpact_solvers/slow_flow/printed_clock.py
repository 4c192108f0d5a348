"""Eq. 10.114 and 10.115 as printed, integrated: lambda and phi as functions of time.

    eps Omega t = [tan(s) + J1(s)],    eps phi = [tan(s)/s + 2 J2(s)]    from lambda0 to lambda

with the integrals J1 of tan(s)/s and J2 of tan(s)/s^2. Both are sums over the poles of the
tangent, of which the first is taken out and the others make a power series.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.special import zeta

from vibroimpact_solvers.arrays import Floats

_POLE: Final = 0.5 * np.pi
_ORDERS: Final = np.arange(1, 20)
_TAIL: Final = np.asarray(zeta(2.0 * _ORDERS, 1.5)) * np.pi ** (-2.0 * _ORDERS)
"""Sums of the powers -2n of all poles but the first."""


def _series(lam: Floats, weights: Floats) -> Floats:
    """Return the sum of weights[n-1] lam^(2n)."""
    square = lam * lam
    total = np.zeros_like(lam)
    for weight in weights[::-1]:
        total = (total + weight) * square
    return total


def tangent_over(lam: Floats) -> Floats:
    """Return the integral of tan(s)/s from 0 to lam < pi/2."""
    first = np.log((_POLE + lam) / (_POLE - lam)) / _POLE
    return first + 2.0 * _series(lam, _TAIL / (2 * _ORDERS - 1)) / lam


def tangent_over_square(lam: Floats) -> Floats:
    """Return an integral of tan(s)/s^2, up to a constant."""
    first = np.log(lam**2 / (_POLE**2 - lam**2)) / _POLE**2
    # The part 2 ln(s) of every other pole, and what is regular at 0.
    rest = 2.0 * _TAIL[0] * np.log(lam)
    total: Floats = first + rest + _series(lam, _TAIL[1:] / _ORDERS[:-1])
    return total


def clock(lam: Floats) -> Floats:
    """Return ``eps Omega t``, up to a constant; lam in (0, pi/2)."""
    total: Floats = np.tan(lam) + tangent_over(lam)
    return total


def phase(lam: Floats) -> Floats:
    """Return ``eps phi``, up to a constant."""
    return np.tan(lam) / lam + 2.0 * tangent_over_square(lam)


def ratio(target: Floats) -> Floats:
    """Return lambda of the clock, shape (time,), by Newton's method in z = tan(lambda)."""
    z = np.maximum(0.5 * target, target - 4.0)
    for _ in range(60):
        lam: Floats = np.arctan(z)
        # d clock / dz = 1 + cos(lambda) sin(lambda) / lambda
        slope = 1.0 + z / (lam * (1.0 + z * z))
        step = (clock(lam) - target) / slope
        z = np.maximum(z - step, 0.1 * z)
        if (np.abs(step) <= 4e-16 * z).all():
            break
    return np.asarray(np.arctan(z))
