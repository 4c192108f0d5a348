"""Displacements, energies and Fourier amplitudes of impact modes from their modal amplitudes.

Between two impacts a mode with natural frequency r and ``gamma = r/omega`` is at

    q = D sin(gamma tau)/gamma + U cos(gamma tau) + f (1 - cos(gamma tau))/lambda

with the amplitudes of `kernels.families`. The sines of all modes and times are evaluated by one
vector loop; unstable and nearly rigid modes have formulas of their own and are computed one by
one.
"""

from __future__ import annotations

import math

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.jit import kernel
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


@kernel
def coordinates(
    roots: Floats, load: Floats, omega: Floats, D: Floats, U: Floats, tau: Floats
) -> Floats:
    """Modal coordinates q, shape (frequency, tau, mode); D or U may have no columns."""
    modes, times = roots.size, tau.size
    q = np.empty((omega.size, times, modes))
    antisymmetric, symmetric = D.shape[1] > 0, U.shape[1] > 0
    if not antisymmetric:
        q[:] = 0.0
    if q.size == 0 or not (antisymmetric or symmetric):
        return q
    loaded = symmetric and np.any(load != 0.0)
    step = max(1, _BLOCK // (times * modes))
    gamma, turns = np.empty((step, modes)), np.empty((3, step, times, modes))
    furthest = np.max(np.abs(tau)) * np.max(np.abs(roots))
    exceptions = np.flatnonzero(roots < _STILL * np.max(omega))
    for first in range(0, omega.size, step):
        last = min(first + step, omega.size)
        count = (last - first) * times * modes
        phase, sines = turns[0].reshape(-1)[:count], turns[1].reshape(-1)[:count]
        _phases(roots, omega[first:last], tau, gamma, turns[0])
        if antisymmetric and not symmetric:
            _sines(phase, sines)
        else:
            _turns(phase, sines, turns[2].reshape(-1)[:count])
        if antisymmetric:
            _put_antisymmetric(gamma, D[first:last], turns[1], q[first:last])
        if symmetric:
            _add_symmetric(U[first:last], turns[2], q[first:last])
        if loaded:
            for i in range(count):
                phase[i] *= 0.5
            _sines(phase, sines)
            _add_sag(gamma, load, omega[first:last], turns[1], q[first:last])
        for f in range(first, last):
            # Phases that are not known, and modes without any.
            unknown = furthest > LARGEST * omega[f]
            for k in range(modes if unknown else exceptions.size):
                j = k if unknown else exceptions[k]
                if not (unknown or roots[j] < _STILL * omega[f]):
                    continue
                amplitude, place = D[f, j] if antisymmetric else 0.0, U[f, j] if symmetric else 0.0
                for t in range(times):
                    q[f, t, j] = _place(
                        roots[j], load[j], omega[f], amplitude, place, symmetric, tau[t]
                    )
    return q


@kernel
def _phases(roots: Floats, omega: Floats, tau: Floats, gamma: Floats, phase: Floats) -> None:
    """Fill in gamma, shape (frequency, mode), and gamma tau, (frequency, tau, mode)."""
    for f in range(omega.size):
        for j in range(roots.size):
            gamma[f, j] = roots[j] / omega[f]
        for t in range(tau.size):
            for j in range(roots.size):
                phase[f, t, j] = gamma[f, j] * tau[t]


@kernel
def _sines(phase: Floats, sines: Floats) -> None:
    for i in range(phase.size):
        sines[i] = sine_cosine(phase[i], 0.0)[0]


@kernel
def _turns(phase: Floats, sines: Floats, cosines: Floats) -> None:
    for i in range(phase.size):
        sines[i], cosines[i] = sine_cosine(phase[i], 0.0)


@kernel
def _put_antisymmetric(gamma: Floats, D: Floats, sines: Floats, q: Floats) -> None:
    scale = np.empty(gamma.shape[1])
    for f in range(q.shape[0]):
        for j in range(scale.size):
            scale[j] = D[f, j] / gamma[f, j] if gamma[f, j] > _STILL else 0.0
        for t in range(q.shape[1]):
            for j in range(scale.size):
                q[f, t, j] = scale[j] * sines[f, t, j]


@kernel
def _add_symmetric(U: Floats, cosines: Floats, q: Floats) -> None:
    for f in range(q.shape[0]):
        for t in range(q.shape[1]):
            for j in range(q.shape[2]):
                q[f, t, j] += U[f, j] * cosines[f, t, j]


@kernel
def _add_sag(gamma: Floats, load: Floats, omega: Floats, halves: Floats, q: Floats) -> None:
    """Add ``f (1 - cos(gamma tau))/lambda`` by the sines of half the phases: none cancels."""
    scale = np.empty(gamma.shape[1])
    for f in range(q.shape[0]):
        for j in range(scale.size):
            scale[j] = 1.0 / (omega[f] * gamma[f, j]) if gamma[f, j] > _STILL else 0.0
        for t in range(q.shape[1]):
            for j in range(scale.size):
                half = halves[f, t, j] * scale[j]
                q[f, t, j] += 2.0 * load[j] * half * half


@kernel
def _place(
    root: float, load: float, omega: float, D: float, U: float, symmetric: bool, tau: float
) -> float:
    """Return the coordinate of one mode, which may be unstable, at one time."""
    mu = root / omega * abs(root / omega)
    z, gamma = mu * tau * tau, math.sqrt(abs(mu))
    place = D * tau * sine(z) if mu >= 0.0 else D * hyperbolic_sine(gamma, tau)
    if symmetric and mu > -1.0:
        return place + U * cosine(z) + load / (omega * omega) * tau * tau * sag(z)
    if symmetric:
        return place + U * hyperbolic_cosine(gamma, tau) + load / (mu * omega * omega)
    return place


@kernel
def energies(roots: Floats, load: Floats, omega: Floats, D: Floats, U: Floats) -> Floats:
    """Total energies, taken of every mode at tau = 0, shape (frequency,)."""
    total, terms, modes = np.zeros(omega.size), np.empty(roots.size), roots.size
    stiffness = roots * np.abs(roots)
    unstable = np.flatnonzero(roots < 0.0)
    for f in range(omega.size):
        if D.shape[1] > 0:
            amplitudes = D[f]
            for j in range(modes):
                terms[j] = 0.5 * (omega[f] * amplitudes[j]) * (omega[f] * amplitudes[j])
            for k in range(unstable.size):
                factor = _inverse_cosh(roots[unstable[k]] / omega[f])
                terms[unstable[k]] *= factor * factor
            total[f] = folded(terms)
        if U.shape[1] > 0:
            place = U[f]
            for j in range(modes):
                terms[j] = place[j] * (0.5 * stiffness[j] * place[j] - load[j])
            for k in range(unstable.size):
                j = unstable[k]
                gamma = roots[j] / omega[f]
                if gamma * gamma >= 1.0:
                    faded = place[j] * _inverse_cosh(gamma)
                    sagging = load[j] * load[j] / stiffness[j]
                    terms[j] = 0.5 * (stiffness[j] * faded * faded - sagging)
            total[f] += folded(terms)
    return total


@kernel
def _inverse_cosh(gamma: float) -> float:
    """Return 1/cosh(gamma), which overflows nowhere."""
    g = abs(gamma)
    return 2.0 * math.exp(-g) / (1.0 + math.exp(-2.0 * g))


@kernel
def fourier(
    roots: Floats, load: Floats, omega: Floats, D: Floats, U: Floats, orders: Integers
) -> Floats:
    """Fourier amplitudes of the modal coordinates, eq. 10.69, shape (frequency, order, mode).

    Of ``sin(n Omega t)`` for odd orders n and of ``cos(n Omega t)`` for even ones.
    """
    b = np.zeros((omega.size, orders.size, roots.size))
    for f in range(omega.size):
        for j in range(roots.size):
            mu = roots[j] / omega[f] * abs(roots[j] / omega[f])
            for k in range(orders.size):
                if orders[k] % 2 == 1 and D.shape[1] > 0:
                    b[f, k, j] = D[f, j] * _antisymmetric_amplitude(mu, orders[k])
                elif orders[k] % 2 == 0 and U.shape[1] > 0:
                    force = load[j] / (omega[f] * omega[f])
                    b[f, k, j] = _symmetric_amplitude(mu, orders[k], U[f, j], force)
    return b


@kernel
def _antisymmetric_amplitude(mu: float, order: int) -> float:
    kappa = 0.5 * math.pi * order
    if mu < 0.0:
        sign = 1.0 if order % 4 == 1 else -1.0
        return sign * 2.0 / (kappa * kappa - mu)
    gamma = math.sqrt(mu)
    delta = kappa - gamma
    return 2.0 * sine(delta * delta) / (kappa + gamma)


@kernel
def _symmetric_amplitude(mu: float, order: int, place: float, force: float) -> float:
    """Amplitude of ``place cos(gamma tau) + force (1 - cos(gamma tau))/mu``."""
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
