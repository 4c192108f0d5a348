"""Certified path check: whether a solution stays within its limits between its impacts.

The result is a proof that it does, or a time at which it does not (the witness).

A constrained coordinate is a finite sum of sines, cosines and hyperbolic functions, so its
second derivative has the bound ``B = sum_j |row_j| max |q_j''|``. From a time at which value,
slope and B are known, ``y + y' h + B h^2 / 2`` stays below the limit for a step h that can be
computed; such steps from impact to impact are the proof. A limit counts as passed where it is
exceeded by more than a tolerance, which also bounds the steps from below.
"""

from __future__ import annotations

import math

import numpy as np

from vibroimpact_solvers.arrays import Booleans, Floats, Integers
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

Motion = tuple[
    Floats,
    Floats,
    Floats,
    Floats,
    bool,
    Floats,
    Floats,
    Floats,
    Floats,
    float,
    Integers,
    Floats,
    Floats,
]
"""mu, D, U, force, symmetric and row of `_motion`; the arrays of `_waves`; two work arrays."""

_STILL = 1e-200  # mu below which a mode only moves along
_SHORTEST = 1e-12  # step
_MOST = 20_000_000  # steps of one path


@kernel
def _motion(
    mu: float, D: float, U: float, force: float, symmetric: bool, tau: float
) -> tuple[float, float]:
    """Return one modal coordinate and its slope, see `families.solutions`; force is f/omega^2."""
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


@kernel
def states(
    roots: Floats, load: Floats, omega: Floats, D: Floats, U: Floats, tau: float
) -> tuple[Floats, Floats]:
    """Return the modal coordinates and their slopes by tau, each (frequency, mode)."""
    symmetric = U.shape[1] > 0
    places, slopes = np.empty((omega.size, roots.size)), np.empty((omega.size, roots.size))
    for f in range(omega.size):
        for j in range(roots.size):
            mu = roots[j] / omega[f] * abs(roots[j] / omega[f])
            place = U[f, j] if symmetric else 0.0
            force = load[j] / (omega[f] * omega[f])
            places[f, j], slopes[f, j] = _motion(mu, D[f, j], place, force, symmetric, tau)
    return places, slopes


@kernel
def _reach(
    mu: Floats, D: Floats, U: Floats, force: Floats, symmetric: bool, row: Floats, terms: Floats
) -> tuple[float, float]:
    """Return a bound of the second derivative on [-1, 1], and the size of all terms."""
    for j in range(mu.size):
        terms[j] = abs(row[j] * D[j]) * math.sqrt(abs(mu[j]))
    curvature = folded(terms)
    for j in range(mu.size):
        terms[j] = abs(row[j] * D[j])
    size = folded(terms)
    if symmetric:
        for j in range(mu.size):
            terms[j] = abs(row[j] * U[j])
        size += folded(terms)
        for j in range(mu.size):
            bend = abs(U[j] * mu[j])
            if mu[j] > -1.0:
                bend = abs(force[j] - mu[j] * U[j]) * max(1.0, cosine(mu[j]))
            terms[j] = abs(row[j]) * bend
        curvature += folded(terms)
    return max(curvature, 1e-300), size


@kernel
def _waves(
    mu: Floats,
    D: Floats,
    U: Floats,
    force: Floats,
    symmetric: bool,
    row: Floats,
    gamma: Floats,
    sine_part: Floats,
    cosine_part: Floats,
) -> tuple[float, Integers]:
    """Fill in the harmonic terms of a coordinate: ``sum_j a_j sin(gamma_j tau) + s_j cos(...)``.

    Return the constant beside them, and the modes that are left out here and need formulas of
    their own: unstable and nearly rigid ones, those with more static displacement than
    vibration, and those whose phases are unknown.
    """
    for j in range(mu.size):
        g = math.sqrt(abs(mu[j]))
        oscillates = (mu[j] > _STILL) & (g < LARGEST) & ((force[j] == 0.0) | (mu[j] > 1.0))
        gamma[j] = g if oscillates else 0.0
        sine_part[j] = row[j] * D[j] / g if oscillates else 0.0
    constant, others, count = 0.0, np.empty(mu.size, np.int64), 0
    for j in range(mu.size):
        if gamma[j] == 0.0:
            others[count] = j
            count += 1
    for j in range(mu.size):
        cosine_part[j] = 0.0
    for j in range(mu.size if symmetric else 0):
        if gamma[j] > 0.0:
            rest = force[j] / mu[j]
            cosine_part[j] = row[j] * (U[j] - rest)
            constant += row[j] * rest
    return constant, others[:count]


@kernel
def _evaluate(motion: Motion, tau: float) -> tuple[float, float]:
    """Return a constrained coordinate and its slope."""
    (
        mu,
        D,
        U,
        force,
        symmetric,
        row,
        gamma,
        sine_part,
        cosine_part,
        constant,
        others,
        y,
        slope,
    ) = motion
    for j in range(gamma.size):
        s, c = sine_cosine(gamma[j] * tau, 0.0)
        y[j] = sine_part[j] * s + cosine_part[j] * c
        slope[j] = gamma[j] * (sine_part[j] * c - cosine_part[j] * s)
    total, rise = folded(y) + constant, folded(slope)
    for k in range(others.size):
        j = others[k]
        more, faster = _motion(mu[j], D[j], U[j], force[j], symmetric, tau)
        total += row[j] * more
        rise += row[j] * faster
    return total, rise


@kernel
def _step(slack: float, slope: float, curvature: float) -> float:
    """Return a step h for which ``slope h + curvature h^2/2`` stays below the slack."""
    if slack == np.inf:
        return np.inf
    root = math.sqrt(slope * slope + 2.0 * curvature * slack)
    if slope <= 0.0:
        return (root - slope) / curvature
    return 2.0 * slack / (root + slope)


@kernel
def _safe_time(slope: float, room: float, curvature: float) -> float:
    """Return for how long before an impact no limit can be passed.

    The coordinate rises towards its wall: the curvature alone cannot lift it over the wall
    within ``2 slope / B``, nor can it have come from beyond the other wall.
    """
    if slope <= 0.0:
        return 0.0
    return min(min(2.0 * slope / curvature, _step(room, slope, curvature)), 1.0)


@kernel
def _check_path(
    motion: Motion,
    symmetric: bool,
    bottom: float,
    top: float,
    struck_bottom: bool,
    struck_top: bool,
    curvature: float,
    tolerance: float,
    shift: float,
) -> tuple[float, bool, int]:
    """Return a time at which the coordinate is beyond a limit or nan, and whether that is sure.

    And in how many steps. Both limits are moved outwards by the shift.
    """
    tau, end, sure = -1.0, 1.0, True
    if not symmetric:
        # The other half is the mirror image.
        top = min(top, -bottom)
        bottom = -top
        tau = 0.0
    if struck_bottom and symmetric:
        _, slope = _evaluate(motion, -1.0)
        tau += _safe_time(slope, top - bottom, curvature)
    if struck_top:
        _, slope = _evaluate(motion, 1.0)
        end -= _safe_time(slope, top - bottom, curvature)
    top, bottom = top + shift, bottom - shift
    for steps in range(_MOST):
        if tau >= end:
            return np.nan, sure, steps
        y, slope = _evaluate(motion, tau)
        if y - top > tolerance or bottom - y > tolerance:
            return tau, sure, steps
        up = _step(max(top - y, 0.0) + tolerance, slope, curvature)
        down = _step(max(y - bottom, 0.0) + tolerance, -slope, curvature)
        step = min(up, down)
        # The proof would need shorter steps: the motion is sampled, and not certified.
        sure = sure and step > _SHORTEST
        tau += max(step, _SHORTEST)
    return np.nan, False, _MOST


@kernel
def _verdict(
    motion: Motion,
    symmetric: bool,
    bottom: float,
    top: float,
    struck_bottom: bool,
    struck_top: bool,
    curvature: float,
    tolerance: float,
    uncertainty: float,
) -> tuple[float, bool, int]:
    """Return what `_check_path` does for a coordinate with the given uncertainty."""
    shifts, steps = np.zeros(3), 0
    if uncertainty >= 0.1 * tolerance:
        # Passed for certain, passed at all, nearly passed.
        shifts[0], shifts[2] = uncertainty, -uncertainty
    for k in range(3):
        tau, sure, more = _check_path(
            motion,
            symmetric,
            bottom,
            top,
            struck_bottom,
            struck_top,
            curvature,
            tolerance,
            shifts[k],
        )
        steps += more
        if uncertainty < 0.1 * tolerance or (k == 0 and not np.isnan(tau)):
            return tau, sure, steps
        if k == 1 and not np.isnan(tau):
            return tau, False, steps
    return np.nan, sure and np.isnan(tau), steps


@kernel
def check(
    roots: Floats,
    load: Floats,
    omega: Floats,
    D: Floats,
    U: Floats,
    rows: Floats,
    lower: Floats,
    upper: Floats,
    struck_lower: Booleans,
    struck_upper: Booleans,
    tolerance: Floats,
    error: Floats,
    witness: Floats,
    certified: Booleans,
) -> int:
    """Check all solutions against all limits; return the number of steps that this took.

    Parameters
    ----------
    roots, load, omega, D, U
        As `families.solutions` takes and fills them in.
    rows : array, shape (limit, mode)
        ``W E`` of the constrained coordinates, struck or not.
    lower, upper : array, shape (limit,)
        Their limits, infinite where there is no wall.
    struck_lower, struck_upper : array of bool, shape (limit,)
        Whether the solution touches the wall at tau = -1 and at tau = 1.
    tolerance : array, shape (limit,)
        Excess that does not count.
    error : array, shape (frequency,)
        Relative error of the motion.
    witness : array, shape (frequency,)
        Receives a time at which a limit is passed, nan where there is none.
    certified : array of bool, shape (frequency,)
        Receives whether neither rounding nor that error could have changed the outcome.
    """
    symmetric, steps = U.shape[1] > 0, 0
    mu, force, place = np.empty(roots.size), np.empty(roots.size), np.zeros(roots.size)
    gamma, sine_part, cosine_part = (
        np.empty(roots.size),
        np.empty(roots.size),
        np.empty(roots.size),
    )
    y, slope = np.empty(roots.size), np.empty(roots.size)
    for f in range(omega.size):
        witness[f] = np.nan
        certified[f] = True
        for j in range(roots.size):
            mu[j] = roots[j] / omega[f] * abs(roots[j] / omega[f])
            force[j] = load[j] / (omega[f] * omega[f])
            if symmetric:
                place[j] = U[f, j]
        for a in range(lower.size):
            amplitudes, row = D[f], rows[a]
            curvature, size = _reach(mu, amplitudes, place, force, symmetric, row, y)
            constant, others = _waves(
                mu, amplitudes, place, force, symmetric, row, gamma, sine_part, cosine_part
            )
            witness[f], sure, more = _verdict(
                (
                    mu,
                    amplitudes,
                    place,
                    force,
                    symmetric,
                    row,
                    gamma,
                    sine_part,
                    cosine_part,
                    constant,
                    others,
                    y,
                    slope,
                ),
                symmetric,
                -lower[a],
                upper[a],
                struck_lower[a],
                struck_upper[a],
                curvature,
                tolerance[a],
                (1e-15 + 2.0 * error[f]) * size,
            )
            steps += more
            if not np.isnan(witness[f]):
                certified[f] = sure
                break
            certified[f] = certified[f] and sure
    return steps
