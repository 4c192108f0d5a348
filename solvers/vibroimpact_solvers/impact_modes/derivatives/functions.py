"""Functions of triangle-wave time that modal coordinates consist of, and their slopes.

A modal coordinate is ``q = A p + (f/omega^2) s`` with amplitude A and static load f. The profiles
p and s depend on ``mu = lambda/omega^2`` and, by time, on tau:

    antisymmetric   p = sin(gamma tau)/gamma           s = 0
    symmetric       p = cos(gamma tau)                 s = (1 - cos(gamma tau))/mu

and of unstable modes, with ``g = sqrt(-mu)``, as in `kernels.families`,

    antisymmetric   p = sinh(g tau)/(g cosh g)         s = 0
    symmetric       p = cosh(g tau)/cosh(g), mu <= -1  s = 1/mu

Their Fourier amplitudes are those of `kernels.motions`. All are smooth in mu, with slopes by mu of
closed form, and power series where these would cancel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import Booleans, Floats

_SERIES: Final = 0.25  # up to this ``|mu tau^2|`` slopes are power series
_TERMS: Final = 9
_RESONANT: Final = 0.5  # distance of gamma from a harmonic below which the quotient is written anew


class Profile(NamedTuple):
    """Values and slopes by mu of p and s, each (frequency, mode), or of a derivative by tau."""

    p: Floats
    p_slope: Floats
    s: Floats
    s_slope: Floats


@dataclass(frozen=True, eq=False, slots=True)
class Phases:
    """The natural modes at some frequencies, each (frequency, mode)."""

    mu: Floats
    gamma: Floats  # the root of |mu|
    low: Floats  # what rounding took from gamma
    symmetric: bool

    @property
    def scaled(self) -> Booleans:
        """Where profiles are those of unstable modes."""
        return self.mu <= -1.0 if self.symmetric else self.mu < 0.0

    def at_time(self, tau: float) -> Profile:
        """Return the profiles at a time."""
        return self._profiles(tau)[0]

    def at_impact(self) -> tuple[Profile, Profile]:
        """Return the profiles at tau = 1, and their derivatives by tau."""
        return self._profiles(1.0)

    def _profiles(self, tau: float) -> tuple[Profile, Profile]:
        c, s, c_slope, s_slope = _waves(self, tau)
        zero = np.zeros_like(c)
        if not self.symmetric:
            return Profile(s, s_slope, zero, zero), Profile(c, c_slope, zero, zero)
        sag, sag_slope = _sag(self, tau, s)
        # d/dtau cos(gamma tau) = -mu sin(gamma tau)/gamma
        place = Profile(c, c_slope, sag, sag_slope)
        speed = Profile(-self.mu * s, -s - self.mu * s_slope, s, s_slope)
        steep = self.scaled
        if steep.any():
            over = 1.0 / np.where(steep, self.mu, 1.0)
            place = place._replace(
                s=np.where(steep, over, place.s),
                s_slope=np.where(steep, -over * over, place.s_slope),
            )
            speed = speed._replace(
                s=np.where(steep, 0.0, speed.s), s_slope=np.where(steep, 0.0, speed.s_slope)
            )
        return place, speed

    def of_harmonic(self, order: int) -> Profile:
        """Return the Fourier amplitudes of the profiles: of sin for odd orders, of cos for even."""
        zero = np.zeros_like(self.mu)
        if self.symmetric is (order % 2 == 1):
            return Profile(zero, zero, zero, zero)
        return _fourier(self, order)


def phases(
    roots: Floats, rounding: Floats, omega: Floats, omega_rounding: Floats, symmetric: bool
) -> Phases:
    """Return the natural modes at some frequencies; roundings are relative to what they are of."""
    size = np.abs(roots)
    at = omega[:, np.newaxis]
    gamma = size / at
    product, missing = _product(gamma, at)
    low = ((size - product) - missing) / at
    low += gamma * (rounding - omega_rounding[:, np.newaxis])
    return Phases(gamma * gamma * np.sign(roots), gamma, low, symmetric)


def _product(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Return a product as the sum of two doubles (Veltkamp, Dekker)."""
    split = 2.0**27 + 1.0
    with np.errstate(over="ignore", invalid="ignore"):
        a_high, b_high = (x * split - (x * split - x) for x in (a, b))
        a_low, b_low = a - a_high, b - b_high
        product = a * b
        missing = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low
    return product, np.where(np.isfinite(missing), missing, 0.0)


def _waves(phases: Phases, tau: float) -> tuple[Floats, Floats, Floats, Floats]:
    """Return ``cos(gamma tau)``, ``sin(gamma tau)/gamma`` and their slopes by mu."""
    mu, gamma = phases.mu, phases.gamma
    angle, rest = gamma * tau, phases.low * tau
    if abs(tau) not in (1.0, 0.5):  # products with these are exact
        rest = rest + _product(gamma, np.full_like(gamma, tau))[1]
    z = mu * (tau * tau)
    near = np.abs(z) < _SERIES
    some = np.where(gamma > 0.0, gamma, 1.0)
    c, s = np.cos(angle), np.sin(angle)
    c, s = c - rest * s, (s + rest * c) / some
    unstable = mu < 0.0
    if unstable.any():
        c, s = _unstable_waves(phases, tau, c, s, unstable)
    if unstable.any():
        near &= ~phases.scaled
    if near.any():
        s = np.where(near, tau * _series(z, _SINE), s)
        s_slope = (tau * c - s) / (2.0 * np.where(near | (mu == 0.0), 1.0, mu))
        s_slope = np.where(near, tau**3 * _series(z, _SINE_SLOPE), s_slope)
    else:
        s_slope = (tau * c - s) / (2.0 * mu)
    c_slope = -0.5 * tau * s
    if unstable.any() and phases.scaled.any():
        s_slope, c_slope = _scaled_slopes(phases, tau, c, s, s_slope, c_slope)
    return c, s, c_slope, s_slope


def _unstable_waves(
    phases: Phases, tau: float, c: Floats, s: Floats, unstable: Booleans
) -> tuple[Floats, Floats]:
    """Return the hyperbolic functions where modes are unstable, over cosh(g) where scaled."""
    g = np.where(unstable, phases.gamma, 0.0)
    far, near = np.exp(-g * (1.0 - abs(tau))), np.exp(-g * (1.0 + abs(tau)))
    both = 1.0 + np.exp(-2.0 * g)
    some = np.where(g > 0.0, g, 1.0)
    rise = -np.sign(tau) * far * np.expm1(-2.0 * g * abs(tau))
    ch, sh = (far + near) / both, rise / (some * both)
    whole = np.where(phases.scaled, 1.0, np.cosh(np.minimum(g, 2.0)))
    return np.where(unstable, ch * whole, c), np.where(unstable, sh * whole, s)


def _scaled_slopes(
    phases: Phases, tau: float, c: Floats, s: Floats, s_slope: Floats, c_slope: Floats
) -> tuple[Floats, Floats]:
    """Return slopes of profiles over cosh(g), which changes too."""
    steep = phases.scaled
    mu = np.where(steep, phases.mu, -1.0)
    g = np.sqrt(-mu)
    shrink = np.tanh(g) / (2.0 * g)
    z = mu * tau * tau
    series = tau**3 * _series(np.where(np.abs(z) < _SERIES, z, 0.0), _SINE_SLOPE) / np.cosh(g)
    plain = np.where(np.abs(z) < _SERIES, series, (tau * c - s) / (2.0 * mu))
    s_slope = np.where(steep, plain + shrink * s, s_slope)
    c_slope = np.where(steep, -0.5 * tau * s + shrink * c, c_slope)
    return s_slope, c_slope


def _factorial(n: int) -> float:
    return float(np.prod(np.arange(1, n + 1, dtype=np.float64)))


_SINE: Final = [(-1.0) ** k / _factorial(2 * k + 1) for k in range(_TERMS)]
_SINE_SLOPE: Final = [k * (-1.0) ** k / _factorial(2 * k + 1) for k in range(1, _TERMS + 1)]
_SAG_SLOPE: Final = [k * (-1.0) ** k / _factorial(2 * k + 2) for k in range(1, _TERMS + 1)]


def _series(z: Floats, coefficients: list[float]) -> Floats:
    """Return a power series."""
    total = np.full_like(z, coefficients[-1])
    with np.errstate(over="ignore", invalid="ignore"):
        for coefficient in coefficients[-2::-1]:
            total = total * z + coefficient
    return total


def _sag(phases: Phases, tau: float, s: Floats) -> tuple[Floats, Floats]:
    """Return ``(1 - cos(gamma tau))/mu`` and its slope by mu, where modes are not scaled."""
    half = _waves(phases, 0.5 * tau)[1]
    sag = 2.0 * half * half
    z = phases.mu * tau * tau
    near = np.abs(z) < _SERIES
    safe = np.where(near, 1.0, phases.mu)
    slope = (0.5 * tau * s - sag) / safe
    return sag, np.where(near, tau**4 * _series(z, _SAG_SLOPE), slope)


def _fourier(phases: Phases, order: int) -> Profile:
    """Return the Fourier amplitudes of the profiles, and their slopes by mu."""
    mu, kappa = phases.mu, 0.5 * np.pi * order
    zero = np.zeros_like(mu)
    c, s, c_slope, s_slope = _waves(phases, 1.0)
    if order == 0:
        return _mean(phases, c, s, s_slope)
    sign = 1.0 if order % 4 in (0, 1) else -1.0
    delta = kappa - phases.gamma - phases.low
    resonant = (mu > 0.0) & (np.abs(delta) < _RESONANT)
    bottom = np.where(resonant, 1.0, kappa * kappa - mu)
    # 2 c/(kappa^2 - mu) of the antisymmetric one; near resonance 2 sin(delta)/(delta (kappa + g)).
    top, slope = (c, c_slope) if not phases.symmetric else (-s, -s_slope)
    if not phases.symmetric:
        top, slope = np.where(phases.scaled, 1.0, top), np.where(phases.scaled, 0.0, slope)
    value = sign * 2.0 * top / bottom
    by_mu = sign * 2.0 * (slope + top / bottom) / bottom
    if resonant.any():
        near, near_slope = _resonant(phases, kappa, delta, resonant)
        value, by_mu = np.where(resonant, near, value), np.where(resonant, near_slope, by_mu)
    if not phases.symmetric:
        return Profile(value, by_mu, zero, zero)
    # p = cos(gamma tau) has mu times that of (1 - cos)/mu with the other sign.
    p, p_slope, load, load_slope = mu * value, value + mu * by_mu, -value, -by_mu
    if phases.scaled.any():
        steep = phases.scaled
        g = np.where(steep, phases.gamma, 1.0)
        below = kappa * kappa + g * g
        t = np.tanh(g)
        rise = 2.0 * sign * g * t / below
        change = 2.0 * sign * ((t + g * (1.0 - t * t)) / below - 2.0 * g * g * t / below**2)
        p, p_slope = np.where(steep, rise, p), np.where(steep, -change / (2.0 * g), p_slope)
        load, load_slope = np.where(steep, 0.0, load), np.where(steep, 0.0, load_slope)
    return Profile(p, p_slope, load, load_slope)


def _resonant(
    phases: Phases, kappa: float, delta: Floats, resonant: Booleans
) -> tuple[Floats, Floats]:
    """Return ``2 sin(delta)/(delta (kappa + gamma))``, over gamma if symmetric, and slopes."""
    g = np.where(resonant, phases.gamma, 1.0)
    z = np.where(resonant, delta * delta, 0.0)
    sinc, sinc_slope = _series(z, _SINE), 2.0 * delta * _series(z, _SINE_SLOPE)
    value = 2.0 * sinc / (kappa + g)
    by_gamma = -2.0 * sinc_slope / (kappa + g) - value / (kappa + g)
    if phases.symmetric:
        value, by_gamma = value / g, by_gamma / g - value / (g * g)
    return value, by_gamma / (2.0 * g)


def _mean(phases: Phases, c: Floats, s: Floats, s_slope: Floats) -> Profile:
    """Return the means of the symmetric profiles."""
    mu = phases.mu
    near = np.abs(mu) < _SERIES
    safe = np.where(near, 1.0, mu)
    load = np.where(near, _series(mu, [-each for each in _SINE[1:]]), (1.0 - s) / safe)
    slopes = [k * (-1.0) ** k / _factorial(2 * k + 3) for k in range(1, _TERMS + 1)]
    load_slope = np.where(near, _series(mu, slopes), (-s_slope - load) / safe)
    p, p_slope = s, s_slope
    steep = phases.scaled
    if steep.any():
        g = np.where(steep, phases.gamma, 1.0)
        t = np.tanh(g)
        p = np.where(steep, t / g, p)
        p_slope = np.where(steep, -((1.0 - t * t) / g - t / (g * g)) / (2.0 * g), p_slope)
        over = 1.0 / np.where(steep, mu, 1.0)
        load, load_slope = np.where(steep, over, load), np.where(steep, -over * over, load_slope)
    return Profile(p, p_slope, load, load_slope)
