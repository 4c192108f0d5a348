"""Displacements, energies and Fourier amplitudes of impact modes from their modal amplitudes.

Between two impacts a mode with natural frequency r, eigenvalue ``lambda = r^2`` and
``gamma = r/omega`` is at

    q = D sin(gamma tau)/gamma + U cos(gamma tau) + f (1 - cos(gamma tau))/lambda

with the amplitudes of `families`, eq. 10.48; unstable modes have the hyperbolic functions over
``cosh(gamma)``. Energy is conserved between impacts, so that it is taken at tau = 0, where a mode
has ``q = U`` and ``q' = omega D``:

    E = sum_j [(omega D)^2 + lambda U^2]/2 - f U

The Fourier amplitudes are integrals of q times ``sin(kappa tau)`` or ``cos(kappa tau)``,
``kappa = n pi/2``, eq. 10.69. Close to resonance, gamma = kappa, they are written by
``sin(delta)/delta`` with ``delta = kappa - gamma``.

Coordinates have errors of a few roundings of their terms, and the error of the phase: one rounding
of gamma. The sines of all modes and times are evaluated by one vector loop; unstable and nearly
rigid modes have formulas of their own and are computed one by one.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.jit import inner, kernel
from vibroimpact_solvers.kernels.phases import LARGEST, sine_cosine
from vibroimpact_solvers.kernels.sums import folded
from vibroimpact_solvers.kernels.triangle_time import (
    cosine,
    hyperbolic_cosine,
    hyperbolic_sine,
    sag,
    sine,
)

_BLOCK = 512  # phases that a vector loop takes at once: they stay in the nearest cache
_STILL = 1e-100  # gamma below which a mode only moves along: D/gamma might overflow


class Motions(NamedTuple):
    """The motion of all modes in some solutions of one family."""

    roots: Floats  # natural frequencies; minus the growth rates of unstable modes, (mode,)
    load: Floats  # static loads f, (mode,)
    omega: Floats  # triangle-wave frequencies of the solutions, (frequency,)
    # Amplitudes, (frequency, mode); no columns where the motion has no such component
    D: Floats
    U: Floats


class _Block(NamedTuple):
    """A part of the solutions, and room for its phases."""

    first: int  # the first of its solutions
    size: int  # their number
    gamma: Floats  # (solution mode,)
    # Phases gamma tau, their sines and their cosines, each (solution tau mode,)
    phase: Floats
    sine: Floats
    cosine: Floats
    scale: Floats  # of the terms of one solution, (mode,)


@inner
def place_and_slope(
    mu: float, force: float, D: float, U: float, symmetric: bool, tau: float
) -> tuple[float, float]:
    """Return one modal coordinate, which may be unstable, and its slope; force is f/omega^2."""
    z = mu * tau * tau
    gamma = math.sqrt(abs(mu))
    if mu >= 0.0:
        place, slope = D * tau * sine(z), D * cosine(z)
    else:
        place, slope = D * hyperbolic_sine(gamma, tau), D * hyperbolic_cosine(gamma, tau)
    if symmetric and mu > -1.0:
        place += U * cosine(z) + force * tau * tau * sag(z)
        slope += (force - mu * U) * tau * sine(z)
    elif symmetric:
        place += U * hyperbolic_cosine(gamma, tau) + force / mu
        slope -= U * mu * hyperbolic_sine(gamma, tau)
    return place, slope


@inner
def _state(motions: Motions, f: int, j: int, tau: float) -> tuple[float, float]:
    """Return coordinate and slope of one mode in one solution."""
    gamma, omega = motions.roots[j] / motions.omega[f], motions.omega[f]
    D = motions.D[f, j] if motions.D.shape[1] > 0 else 0.0
    U = motions.U[f, j] if motions.U.shape[1] > 0 else 0.0
    force = motions.load[j] / (omega * omega)
    return place_and_slope(gamma * abs(gamma), force, D, U, motions.U.shape[1] > 0, tau)


@kernel
def states(motions: Motions, tau: float) -> tuple[Floats, Floats]:
    """Return the modal coordinates and their slopes by tau, each (frequency, mode)."""
    shape = motions.omega.size, motions.roots.size
    places, slopes = np.empty(shape), np.empty(shape)
    for f in range(motions.omega.size):
        for j in range(motions.roots.size):
            places[f, j], slopes[f, j] = _state(motions, f, j, tau)
    return places, slopes


@kernel
def coordinates(motions: Motions, tau: Floats) -> Floats:
    """Return the modal coordinates q, shape (frequency, tau, mode)."""
    roots, omega, n = motions.roots, motions.omega, motions.roots.size
    q = np.empty((omega.size, tau.size, n))
    if q.size == 0:
        return q
    furthest, fastest, loaded = 0.0, 0.0, False
    for t in range(tau.size):
        furthest = max(furthest, abs(tau[t]))
    for j in range(n):
        fastest = max(fastest, abs(roots[j]))
        loaded |= motions.load[j] != 0.0
    each = tau.size * n
    step = max(1, _BLOCK // each)
    gamma, scale, phase = np.empty(step * n), np.empty(n), np.empty(step * each)
    sines, cosines = np.empty(step * each), np.empty(step * each)
    for first in range(0, omega.size, step):
        count = min(step, omega.size - first)
        block = _Block(first, count, gamma, phase, sines, cosines, scale)
        _turn(motions, tau, block)
        _superpose(motions, block, q)
        if loaded and motions.U.shape[1] > 0:
            _add_sag(motions, block, q)
        for f in range(first, first + count):
            # Phases that are not known, and modes without any.
            unknown = furthest * fastest > LARGEST * omega[f]
            for j in range(n):
                if unknown or roots[j] < _STILL * omega[f]:
                    for t in range(tau.size):
                        q[f, t, j], _ = _state(motions, f, j, tau[t])
    return q


@inner
def _turn(motions: Motions, tau: Floats, block: _Block) -> None:
    """Fill in the phases of a block, their sines and their cosines."""
    n, place = motions.roots.size, 0
    for f in range(block.size):
        gamma = block.gamma[f * n : (f + 1) * n]
        for j in range(n):
            gamma[j] = motions.roots[j] / motions.omega[block.first + f]
        for t in range(tau.size):
            phase = block.phase[place : place + n]
            for j in range(n):
                phase[j] = gamma[j] * tau[t]
            place += n
    if motions.U.shape[1] > 0:
        for i in range(place):
            block.sine[i], block.cosine[i] = sine_cosine(block.phase[i], 0.0)
    else:
        for i in range(place):
            block.sine[i], _ = sine_cosine(block.phase[i], 0.0)


@inner
def _superpose(motions: Motions, block: _Block, q: Floats) -> None:
    """Put ``D sin(gamma tau)/gamma + U cos(gamma tau)`` in place."""
    n, place, scale = motions.roots.size, 0, block.scale
    for f in range(block.size):
        gamma, at = block.gamma[f * n : (f + 1) * n], block.first + f
        for j in range(n):
            scale[j] = 0.0
        for j in range(n if motions.D.shape[1] > 0 else 0):
            scale[j] = motions.D[at, j] / gamma[j] if gamma[j] > _STILL else 0.0
        for t in range(q.shape[1]):
            sines, cosines = block.sine[place : place + n], block.cosine[place : place + n]
            for j in range(n):
                q[at, t, j] = scale[j] * sines[j]
            for j in range(n if motions.U.shape[1] > 0 else 0):
                q[at, t, j] += motions.U[at, j] * cosines[j]
            place += n


@inner
def _add_sag(motions: Motions, block: _Block, q: Floats) -> None:
    """Add ``f (1 - cos(gamma tau))/lambda`` by the sines of half the phases: none cancels."""
    n, place, scale = motions.roots.size, 0, block.scale
    for i in range(block.size * q.shape[1] * n):
        block.sine[i], _ = sine_cosine(0.5 * block.phase[i], 0.0)
    for f in range(block.size):
        gamma, at = block.gamma[f * n : (f + 1) * n], block.first + f
        for j in range(n):
            over = 1.0 / (motions.omega[at] * gamma[j])
            scale[j] = over if gamma[j] > _STILL else 0.0
        for t in range(q.shape[1]):
            sines = block.sine[place : place + n]
            for j in range(n):
                half = sines[j] * scale[j]
                q[at, t, j] += 2.0 * motions.load[j] * half * half
            place += n


@kernel
def energies(motions: Motions) -> Floats:
    """Return the total energies, taken of every mode at tau = 0, shape (frequency,)."""
    roots, omega, load, n = motions.roots, motions.omega, motions.load, motions.roots.size
    total, terms, stiffness = np.zeros(omega.size), np.empty(n), np.empty(n)
    unstable = False
    for j in range(n):
        stiffness[j] = roots[j] * abs(roots[j])
        unstable |= roots[j] < 0.0
    for f in range(omega.size):
        if motions.D.shape[1] > 0:
            amplitudes = motions.D[f]
            for j in range(n):
                terms[j] = 0.5 * (omega[f] * amplitudes[j]) * (omega[f] * amplitudes[j])
            for j in range(n if unstable else 0):
                if roots[j] < 0.0:
                    factor = hyperbolic_cosine(-roots[j] / omega[f], 0.0)
                    terms[j] *= factor * factor
            total[f] = folded(terms)
        if motions.U.shape[1] > 0:
            place = motions.U[f]
            for j in range(n):
                terms[j] = place[j] * (0.5 * stiffness[j] * place[j] - load[j])
            for j in range(n if unstable else 0):
                gamma = roots[j] / omega[f]
                if gamma <= -1.0:
                    faded = place[j] * hyperbolic_cosine(-gamma, 0.0)
                    sagging = load[j] * load[j] / stiffness[j]
                    terms[j] = 0.5 * (stiffness[j] * faded * faded - sagging)
            total[f] += folded(terms)
    return total


@kernel
def fourier(motions: Motions, orders: Integers) -> Floats:
    """Return Fourier amplitudes of the modal coordinates, shape (frequency, order, mode).

    Of ``sin(n Omega t)`` for odd orders n and of ``cos(n Omega t)`` for even ones.
    """
    odd, even = motions.D.shape[1] > 0, motions.U.shape[1] > 0
    b = np.zeros((motions.omega.size, orders.size, motions.roots.size))
    for f in range(motions.omega.size):
        omega = motions.omega[f]
        for j in range(motions.roots.size):
            gamma, force = motions.roots[j] / omega, motions.load[j] / (omega * omega)
            mu = gamma * abs(gamma)
            for k in range(orders.size):
                if orders[k] % 2 == 1 and odd:
                    b[f, k, j] = motions.D[f, j] * _antisymmetric_amplitude(mu, orders[k])
                elif orders[k] % 2 == 0 and even:
                    b[f, k, j] = _symmetric_amplitude(mu, orders[k], motions.U[f, j], force)
    return b


@inner
def _antisymmetric_amplitude(mu: float, order: int) -> float:
    """Return the amplitude of ``sin(gamma tau)/gamma``, see the module."""
    kappa = 0.5 * math.pi * order
    if mu < 0.0:
        sign = 1.0 if order % 4 == 1 else -1.0
        return sign * 2.0 / (kappa * kappa - mu)
    gamma = math.sqrt(mu)
    delta = kappa - gamma
    return 2.0 * sine(delta * delta) / (kappa + gamma)


@inner
def _symmetric_amplitude(mu: float, order: int, place: float, force: float) -> float:
    """Return the amplitude of ``place cos(gamma tau) + force (1 - cos(gamma tau))/mu``."""
    kappa = 0.5 * math.pi * order
    sign = 1.0 if order % 4 == 0 else -1.0
    if mu <= -1.0:
        g = math.sqrt(-mu)
        if order == 0:
            return place * math.tanh(g) / g + force / mu
        return place * sign * 2.0 * g * math.tanh(g) / (kappa * kappa - mu)
    if order == 0:
        mean = 1.0 / 6.0 * (1.0 - mu / 20.0 * (1.0 - mu / 42.0 * (1.0 - mu / 72.0)))
        if abs(mu) > 1e-2:
            mean = (1.0 - sine(mu)) / mu
        return place * sine(mu) + force * mean
    if mu < 1.0:
        share = sign * 2.0 * sine(mu) / (mu - kappa * kappa)
        return share * (place * mu - force)
    gamma = math.sqrt(mu)
    delta = kappa - gamma
    return (place - force / mu) * 2.0 * gamma * sine(delta * delta) / (kappa + gamma)
