"""Impulses of walls on coordinates that rest at them: integrals of contact forces over time."""

from __future__ import annotations

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.time_history.structure import Scene


def impulses(scene: Scene, z: Floats, span: float) -> Floats:
    """Return the integrals of the forces of all contacts from a state on.

    Parameters
    ----------
    scene : Scene
    z : array, shape (2, pair)
        The state at the beginning.
    span : float
        Duration, in units of the basis.

    Returns
    -------
    array, shape (contact,)
        In units of force and of the basis' time, as the scene orders its contacts.
    """
    first = len(scene.flying)
    integral = _integral(scene, z, span)
    forms, levels = scene.forms[0, first:], scene.walls[0, first:]
    return np.asarray((forms * integral).sum(axis=(1, 2)) + levels * span)


def _integral(scene: Scene, z: Floats, span: float) -> Floats:
    """Return the integral of a state over the flight that follows it, shape (2, pair).

    Written with ``(exp(x) - 1)/x``, so that nothing cancels in short contacts.
    """
    basis = scene.basis
    turning, apart = int(basis.split[0]), int(basis.split[1])
    alpha, nu, a, b = basis.alpha, basis.nu, z[0], z[1]
    found = np.empty_like(z)
    some = slice(0, turning)
    # (a - ib)' = (alpha + i nu)(a - ib)
    turned = (a[some] - 1j * b[some]) * _mean(span * (alpha[some] + 1j * nu[some]))
    found[0, some], found[1, some] = span * turned.real, -span * turned.imag
    some = slice(turning, apart)
    plus = (a[some] + b[some]) * _mean(span * (alpha[some] + nu[some]))
    minus = (a[some] - b[some]) * _mean(span * (alpha[some] - nu[some]))
    found[0, some], found[1, some] = 0.5 * span * (plus + minus), 0.5 * span * (plus - minus)
    some = slice(apart, basis.pairs)
    rate, push = span * alpha[some], basis.push[some]
    # a' = alpha a + b, b' = alpha b + push; a push has no alpha.
    found[1, some] = span * b[some] * _mean(rate) + 0.5 * span**2 * push
    found[0, some] = span * a[some] * _mean(rate) + span**2 * b[some] * _first_moment(rate)
    found[0, some] += span**3 * push / 6.0
    return found


def _mean(x: Floats) -> Floats:
    """Return the mean of exp(x u) over 0 <= u <= 1."""
    small = x == 0.0
    return np.asarray(np.where(small, 1.0, np.expm1(x) / np.where(small, 1.0, x)))


def _first_moment(x: Floats) -> Floats:
    """Return the integral of u exp(x u) over 0 <= u <= 1."""
    nodes, weights = np.polynomial.legendre.leggauss(24)
    nodes, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    near = np.clip(x, -20.0, 20.0)
    series = np.exp(near[..., np.newaxis] * nodes) @ (weights * nodes)
    with np.errstate(divide="ignore", invalid="ignore"):
        closed = (np.exp(x) * (x - 1.0) + 1.0) / x**2
    return np.asarray(np.where(np.abs(x) < 20.0, series, closed))
