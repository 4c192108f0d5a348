"""Functions of the triangle-wave time that all families of impact modes are made of.

All take ``mu = lambda / omega**2`` with the eigenvalue ``lambda`` of a natural mode, so that
rigid-body modes (0) and unstable ones (negative) need no case at the call site.
"""

from __future__ import annotations

import math

import numpy as np

from vibroimpact_solvers.kernels.jit import kernel

# Below it, the first neglected term of each series is less than half a unit in the last place.
_SMALL = 1e-4


@kernel
def tangent_ratio(mu: float) -> float:
    """Return T(mu) = tan(gamma)/gamma with gamma = sqrt(mu); tanh for negative mu."""
    if abs(mu) < _SMALL:
        return 1.0 + mu * (1.0 / 3.0 + mu * (2.0 / 15.0 + mu * (17.0 / 315.0 + mu * 62.0 / 2835.0)))
    gamma = math.sqrt(abs(mu))
    return math.tan(gamma) / gamma if mu > 0.0 else math.tanh(gamma) / gamma


@kernel
def sine_ratio(mu: float, tau: float) -> float:
    """Return sin(gamma tau)/gamma; sinh(g tau)/(g cosh g) for negative mu.

    The hyperbolic one carries the cosine of `s` with it, because both overflow where their
    quotient does not.
    """
    if abs(mu) < _SMALL:
        z = mu * tau * tau
        series = tau * (1.0 - z / 6.0 * (1.0 - z / 20.0 * (1.0 - z / 42.0)))
        return series if mu >= 0.0 else series / math.cosh(math.sqrt(-mu))
    gamma = math.sqrt(abs(mu))
    if mu > 0.0:
        return math.sin(gamma * tau) / gamma
    return (
        math.copysign(1.0, tau)
        * math.exp(-gamma * (1.0 - abs(tau)))
        * (-math.expm1(-2.0 * gamma * abs(tau)))
        / (gamma * (1.0 + math.exp(-2.0 * gamma)))
    )


@kernel
def inverse_cosine(mu: float) -> float:
    """Return 1/cos(gamma); 1/cosh(g) for negative mu."""
    gamma = math.sqrt(abs(mu))
    if mu >= 0.0:
        return 1.0 / math.cos(gamma)
    return 2.0 * math.exp(-gamma) / (1.0 + math.exp(-2.0 * gamma))


@kernel
def sensitivity(mu: float) -> float:
    """Return the relative change of T(mu) per relative change of gamma, plus one.

    It is what an error of one rounding in the natural frequency does to the response of the
    mode: 1 + |d ln T / d ln gamma|, large near the poles.
    """
    gamma = math.sqrt(abs(mu))
    if mu <= 0.0:
        return 2.0
    sine = abs(math.sin(2.0 * gamma))
    return 2.0 + (2.0 * gamma / sine if sine > 0.0 else np.inf)
