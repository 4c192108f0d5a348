"""Limits of the slow flow between lossy walls: high energy and grazing, eq. 10.117-10.123."""

from __future__ import annotations

import math

import numpy as np

from vibroimpact_solvers.arrays import Floats


def waves(phi: Floats) -> tuple[Floats, Floats]:
    """Return tau(phi) and e(phi)."""
    half = np.floor(0.5 * (phi + 1.0))
    e = 1.0 - 2.0 * (half % 2.0)
    return e * (phi - 2.0 * half), e


def high_energy(
    t: Floats, rate: float, omega0: float, Delta: float
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return omega, phi, x and v where the spring plays no part, eq. 10.117-10.119.

    `rate` is eps as printed, or kappa, with which the phase at impacts is exact to the second
    order.
    """
    growth = 1.0 + 0.5 * omega0 * rate * t
    omega = omega0 / growth
    phi = (2.0 / rate) * np.log1p(0.5 * omega0 * rate * t)
    tau, e = waves(phi)
    x = Delta * (tau - 0.25 * rate * (1.0 - tau**2) * e)
    v = Delta * omega * (e + 0.5 * rate * tau)
    return omega, phi, x, v


def grazing(clock: Floats, rate: float, lam0: float, *, printed: bool) -> tuple[Floats, Floats]:
    """Return lambda and phi near grazing, eq. 10.121-10.123; `clock` is Omega t.

    The energy balance gives ``rho' = -Omega rate rho / pi`` for rho = pi/2 - lambda: an
    exponential approach whose phase lag is bounded. The printed eq. 10.122 has ``rho^2``
    instead, an algebraic approach whose lag grows without bound.
    """
    rho0 = 0.5 * math.pi - lam0
    if printed:
        growth = 1.0 + rate * rho0 * clock
        rho = rho0 / growth
        # omega0(0) - (2/pi) Omega of eq. 10.123 is Omega (1/lambda0 - 2/pi)
        lead = 0.25 * math.pi**2 * rate * clock * (1.0 / lam0 - 2.0 / math.pi)
        lag = 2.0 / (rate * math.pi) * np.log1p(lead)
    else:
        decay = np.expm1(-rate * clock / math.pi)
        rho = rho0 * (1.0 + decay)
        lag = -(2.0 * rho0 / rate) * decay
    return 0.5 * math.pi - rho, (2.0 / math.pi) * (clock + lag)
