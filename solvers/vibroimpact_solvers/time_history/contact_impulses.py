"""Impulses of walls on coordinates that rest at them: integrals of contact forces over time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.time_history.basis import Basis
from vibroimpact_solvers.time_history.structure import Configuration

_FAR: Final = 20.0
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
_NODES, _WEIGHTS = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS
_ROWS: Final = 256  # of impacts, at once


@dataclass(frozen=True, eq=False)
class Struck:
    """Impacts of free coordinates, which leave all contacts closed.

    Parameters
    ----------
    times : array, shape (impact,)
        Since the beginning, ascending, in units of the basis.
    places : array of int, shape (impact,)
        Of the coordinates among the free ones.
    impulses : array, shape (impact,)
        On the coordinates, with their signs, in units of mass and of the basis' time.
    """

    times: Floats
    places: Integers
    impulses: Floats


def impulses(configuration: Configuration, z: Floats, struck: Struck, span: float) -> Floats:
    """Return the impulses of all contacts from a state on.

    The motion is linear between impacts: each one adds the free motion that its kick begins.

    Parameters
    ----------
    configuration : Configuration
    z : array, shape (2, pair)
        The state at the beginning.
    struck : Struck
        What strikes in that time, and opens none of them.
    span : float
        Duration, in units of the basis.

    Returns
    -------
    array, shape (contact,)
        In units of force and of the basis' time, in the order of the configuration's contacts.
    """
    first, basis, kernel = len(configuration.free), configuration.basis, configuration.kernel
    integral = _integral(configuration, z, span)
    count = int(np.searchsorted(struck.times, span, "right"))
    for begin in range(0, count, _ROWS):
        some = slice(begin, min(begin + _ROWS, count))
        kicks = np.moveaxis(kernel.watched.kick[struck.places[some]], 1, 0)
        kicked = kicks * struck.impulses[some, np.newaxis]
        left = (span - struck.times[some])[:, np.newaxis]
        integral += _free_integral(basis, kicked, left).sum(axis=1)
    forms, levels = configuration.forces
    given = np.bincount(struck.places[:count], struck.impulses[:count], first)
    # Mass by velocity, in units of force and of the basis' time.
    answered = -math.ldexp(1.0, 2 * basis.exponent) * (configuration.answers @ given)
    return np.asarray((forms * integral).sum(axis=(1, 2)) + levels * span + answered)


def _integral(configuration: Configuration, z: Floats, span: float) -> Floats:
    """Return the integral of a state over the free motion that follows it, shape (2, pair).

    Written with ``(exp(x) - 1)/x``, so that nothing cancels in short contacts.
    """
    basis = configuration.basis
    turning, apart = basis.flow.rotations, basis.flow.hyperbolas_end
    alpha, nu, a, b = basis.alpha, basis.nu, z[0], z[1]
    integral = _free_integral(basis, z, span)
    for j, k, real, imaginary in basis.drives():
        # w' = sigma w + kappa l with l' = i omega l: a divided difference of means.
        kappa, load = complex(real, imaginary), complex(a[k], -b[k])
        if j >= turning:
            integral[:, j] += _swung(basis, j, kappa * load, float(nu[k]), span)
            continue
        sigma, other = complex(alpha[j], nu[j]), complex(alpha[k], nu[k])
        added = kappa * load * span**2 * _difference(span * sigma, span * other)
        integral[0, j] += added.real
        integral[1, j] -= added.imag
    for j, k, first, second in basis.pushes():
        integral[:, j] += _pushed(basis, j, first, second, z[:, k], span)
    # A push has no alpha.
    integral[1, apart:] += 0.5 * span**2 * basis.push[apart:]
    integral[0, apart:] += span**3 * basis.push[apart:] / 6.0
    return integral


def _free_integral(basis: Basis, z: Floats, span: Any) -> Floats:
    """Return the integral of states without pushes and drives, shape (2, ..., pair).

    span is a number, or an array of shape (..., 1).
    """
    turning, apart = basis.flow.rotations, basis.flow.hyperbolas_end
    alpha, nu, a, b = basis.alpha, basis.nu, z[0], z[1]
    integral = np.empty_like(z)
    some: Any = np.s_[..., :turning]
    # (a - ib)' = (alpha + i nu)(a - ib)
    turned = (a[some] - 1j * b[some]) * _mean(span * (alpha[some] + 1j * nu[some]))
    integral[0][some], integral[1][some] = span * turned.real, -span * turned.imag
    some = np.s_[..., turning:apart]
    plus = (a[some] + b[some]) * _mean(span * (alpha[some] + nu[some]))
    minus = (a[some] - b[some]) * _mean(span * (alpha[some] - nu[some]))
    integral[0][some], integral[1][some] = 0.5 * span * (plus + minus), 0.5 * span * (plus - minus)
    some = np.s_[..., apart:]
    rate = span * alpha[some]
    # a' = alpha a + b, b' = alpha b
    integral[1][some] = span * b[some] * _mean(rate)
    integral[0][some] = span * a[some] * _mean(rate) + span**2 * b[some] * _first_moment(rate)
    return integral


def _swung(
    basis: Basis, j: int, force: complex, turning: float, span: float
) -> tuple[float, float]:
    """Return the integral of what ``Re(force e^(i turning t))``, slow, adds to a rigid body."""
    turned = 1j * span * turning
    if j < basis.flow.hyperbolas_end:
        alpha, nu, force = float(basis.alpha[j]), float(basis.nu[j]), span**2 * force
        plus = (force * _difference(complex(span * (alpha + nu)), turned)).real
        minus = -(force * _difference(complex(span * (alpha - nu)), turned)).real
        return 0.5 * (plus + minus), 0.5 * (plus - minus)
    forces, left = (force * np.exp(turned * _NODES)).real, span * (1.0 - _NODES)
    once, twice = float(_WEIGHTS @ (left * forces)), float(_WEIGHTS @ (left**2 * forces))
    return 0.5 * span * twice, span * once


def _pushed(
    basis: Basis, j: int, first: float, second: float, ramp: Floats, span: float
) -> tuple[float, float]:
    """Return the integral of what a ramp adds to a pair."""
    alpha, nu = float(basis.alpha[j]), float(basis.nu[j])
    value, slope = span**2 * float(ramp[0]), span**3 * float(ramp[1])

    def gained(rate: complex) -> complex:
        # Weights of e^(x u) that value and slope get when integrated twice and three times.
        there = np.exp(span * rate * (1.0 - _NODES))
        if abs(span * rate) > _FAR:
            x = span * rate
            one = (np.exp(x) - 1.0 - x) / x**2
            return complex(value * one + slope * (one - 0.5) / x)
        return complex(_WEIGHTS @ (there * _NODES * (value + 0.5 * slope * _NODES)))

    if j < basis.flow.rotations:
        w = complex(first, -second) * gained(complex(alpha, nu))
        return w.real, -w.imag
    if j < basis.flow.hyperbolas_end:
        plus = (first + second) * gained(alpha + nu).real
        minus = (first - second) * gained(alpha - nu).real
        return 0.5 * (plus + minus), 0.5 * (plus - minus)
    once = 0.5 * value + slope / 6.0
    twice = span * (value / 6.0 + slope / 24.0)
    return first * once + second * twice, second * once


def _mean(x: Any) -> Any:
    """Return the mean of exp(x u) over 0 <= u <= 1."""
    small = x == 0.0
    return np.asarray(np.where(small, 1.0, np.expm1(x) / np.where(small, 1.0, x)))


def _first_moment(x: Any) -> Any:
    """Return the integral of u exp(x u) over 0 <= u <= 1, the derivative of `_mean`."""
    x = np.asarray(x)
    near = np.where(np.abs(x) < _FAR, x, 0.0)
    series = np.exp(near[..., np.newaxis] * _NODES) @ (_WEIGHTS * _NODES)
    far = np.where(np.abs(x) < _FAR, _FAR, x)
    return np.where(np.abs(x) < _FAR, series, (np.exp(far) * (far - 1.0) + 1.0) / far**2)


def _difference(x: complex, y: complex) -> complex:
    """Return the divided difference of `_mean` at two places, however near."""
    if abs(x - y) > 1.0:
        ends = _mean(np.array([x, y]))
        return complex((ends[1] - ends[0]) / (y - x))
    return complex(_WEIGHTS @ _first_moment(x + (y - x) * _NODES))
