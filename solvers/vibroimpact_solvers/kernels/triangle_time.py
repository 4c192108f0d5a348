"""Elementary functions of the triangle-wave time in which impact modes are written.

Modes enter by ``mu = lambda / omega**2`` with their eigenvalue lambda, so that rigid-body modes
(0) and unstable ones (negative) need no case at the call site; gamma is ``sqrt(mu)``. In their
terms the antisymmetric and symmetric responses between two impacts are

    s(mu, tau) = tau sine(mu tau^2) / cosine(mu),      s(mu, 1) = T(mu) = tan(gamma)/gamma
    h(mu, tau) = -cosine(mu tau^2) / (mu sine(mu)),    h(mu, 1) = G(mu) = -cot(gamma)/gamma

Their numerators are entire functions of mu; the denominators vanish at the poles, which is
why they are kept apart.
"""

from __future__ import annotations

import math

from vibroimpact_solvers.kernels.jit import inner


@inner
def cosine(mu: float) -> float:
    """Return cos(sqrt(mu)), cosh(sqrt(-mu)) for negative mu."""
    return math.cos(math.sqrt(mu)) if mu >= 0.0 else math.cosh(math.sqrt(-mu))


@inner
def sine(mu: float) -> float:
    """Return sin(sqrt(mu))/sqrt(mu), sinh(sqrt(-mu))/sqrt(-mu) for negative mu."""
    if abs(mu) < 1e-3:
        return 1.0 - mu / 6.0 * (1.0 - mu / 20.0 * (1.0 - mu / 42.0 * (1.0 - mu / 72.0)))
    gamma = math.sqrt(abs(mu))
    return (math.sin(gamma) if mu > 0.0 else math.sinh(gamma)) / gamma


@inner
def sag(mu: float) -> float:
    """Return (1 - cos(sqrt(mu)))/mu, a half at mu = 0."""
    half = sine(0.25 * mu)
    return 0.5 * half * half


@inner
def antisymmetric_response(mu: float) -> tuple[float, float]:
    """Return T(mu) = tan(gamma)/gamma (tanh for negative mu) and its derivative."""
    if abs(mu) < 1e-3:
        value = 1.0 + mu * (1 / 3 + mu * (2 / 15 + mu * (17 / 315 + mu * (62 / 2835))))
        slope = 1 / 3 + mu * (4 / 15 + mu * (51 / 315 + mu * (248 / 2835)))
        return value, slope
    gamma = math.sqrt(abs(mu))
    value = (math.tan(gamma) if mu > 0.0 else math.tanh(gamma)) / gamma
    return value, (1.0 + mu * value * value - value) / (2.0 * mu)


@inner
def symmetric_response(mu: float) -> tuple[float, float]:
    """Return G(mu) = -cot(gamma)/gamma (coth for negative mu) and its derivative."""
    gamma = math.sqrt(abs(mu))
    value = (-1.0 / math.tan(gamma) if mu > 0.0 else 1.0 / math.tanh(gamma)) / gamma
    return value, (1.0 + mu * value * value - value) / (2.0 * mu)


@inner
def hyperbolic_sine(g: float, tau: float) -> float:
    """Return sinh(g tau)/(g cosh(g)), which overflows nowhere."""
    if g < 0.1:
        return tau * sine(-g * g * tau * tau) / math.cosh(g)
    rise = -math.exp(-g * (1.0 - abs(tau))) * math.expm1(-2.0 * g * abs(tau))
    return math.copysign(rise, tau) / (g * (1.0 + math.exp(-2.0 * g)))


@inner
def hyperbolic_cosine(g: float, tau: float) -> float:
    """Return cosh(g tau)/cosh(g), which overflows nowhere."""
    rise = math.exp(-g * (1.0 - abs(tau))) + math.exp(-g * (1.0 + abs(tau)))
    return rise / (1.0 + math.exp(-2.0 * g))
