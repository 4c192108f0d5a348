"""Certified path check: whether a solution stays within its limits between its impacts.

The result is a proof that it does, or a time at which it does not (the witness).

A constrained coordinate ``y = sum_j row_j q_j`` is a finite sum of sines, cosines and hyperbolic
functions of the triangle-wave time, see `motions`, so its second derivative has the bound

    |y''| <= B = sum_j |row_j| max |q_j''|

From a time at which value and slope are known, ``y + y' h + B h^2/2`` stays below the limit for a
step h that can be computed (Taylor's theorem with Lagrange's remainder); such steps from impact
to impact are the proof.

A limit is passed where it is exceeded at all; to touch it is allowed. The motion is known to an
error e, so that the proof keeps the coordinate below ``limit - e``, and a witness is a time at
which it is above ``limit + e``. Between the two nothing is decided: the outcome is that of the
computed motion and not certain. As every step is based on a value below ``limit - 2 e``, the
error also bounds the steps from below. Shortly before an impact the coordinate rises to its wall
with a velocity that is known: within ``y'(1)/B`` it cannot exceed the wall, however wrong it is
elsewhere.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import Booleans, Floats, Integers
from vibroimpact_solvers.kernels.jit import inner, kernel
from vibroimpact_solvers.kernels.motions import Motions, place_and_slope
from vibroimpact_solvers.kernels.phases import LARGEST, sine_cosine
from vibroimpact_solvers.kernels.sums import folded
from vibroimpact_solvers.kernels.triangle_time import cosine

_STILL = 1e-200  # mu below which a mode only moves along
_MOST = 1_000_000  # steps of one path


class Limits(NamedTuple):
    """Limits of the constrained coordinates, struck or not."""

    rows: Floats  # ``W E``, (limit, mode)
    # Distances of the walls, infinite where there is none, (limit,)
    lower: Floats
    upper: Floats
    # Whether the solution touches the wall at tau = -1 and at tau = 1, (limit,)
    struck_lower: Booleans
    struck_upper: Booleans
    reach: Floats  # errors of the coordinates over that of the motion, (limit,)


class _Modes(NamedTuple):
    """The motion of the modes in one solution, see `motions`, each (mode,)."""

    mu: Floats
    force: Floats  # load over omega^2
    D: Floats
    U: Floats  # 0 in antisymmetric motions


class _Waves(NamedTuple):
    """Harmonic terms ``s_j sin(gamma_j tau) + c_j cos(gamma_j tau)`` of a coordinate."""

    # Each (mode,); 0 of modes that have formulas of their own
    gamma: Floats
    sine: Floats
    cosine: Floats
    others: Integers  # the latter, (mode,); the first `count` entries count
    # Room for values and slopes of the terms, (mode,)
    values: Floats
    slopes: Floats


class _Path(NamedTuple):
    """A constrained coordinate of one solution."""

    modes: _Modes
    waves: _Waves
    row: Floats
    constant: float  # beside the harmonic terms
    others: int  # number of modes that are not among the waves
    symmetric: bool  # whether the motion has a symmetric component
    curvature: float  # B


@inner
def _bounds(modes: _Modes, row: Floats, symmetric: bool, terms: Floats) -> tuple[float, float]:
    """Return B, the bound of the second derivative on [-1, 1], and the size of all terms."""
    mu, force, D, U = modes
    for j in range(mu.size):
        terms[j] = abs(row[j] * D[j]) * math.sqrt(abs(mu[j]))
    curvature = folded(terms)
    for j in range(mu.size):
        terms[j] = abs(row[j] * D[j]) + abs(row[j] * U[j])
    size = folded(terms)
    if symmetric:
        for j in range(mu.size):
            bend = abs(U[j] * mu[j])
            if mu[j] > -1.0:
                bend = abs(force[j] - mu[j] * U[j]) * max(1.0, cosine(mu[j]))
            terms[j] = abs(row[j]) * bend
        curvature += folded(terms)
    return max(curvature, 1e-300), size


@inner
def _separate(modes: _Modes, row: Floats, symmetric: bool, waves: _Waves) -> tuple[float, int]:
    """Fill in the harmonic terms; return the constant beside them and the number of other modes.

    Those need formulas of their own: unstable and nearly rigid modes, those with more static
    displacement than vibration, and those whose phases are unknown.
    """
    mu, force, D, U = modes
    for j in range(mu.size):
        g = math.sqrt(abs(mu[j]))
        oscillates = (mu[j] > _STILL) & (g < LARGEST) & ((force[j] == 0.0) | (mu[j] > 1.0))
        waves.gamma[j] = g if oscillates else 0.0
        waves.sine[j] = row[j] * D[j] / g if oscillates else 0.0
        waves.cosine[j] = 0.0
    constant, count = 0.0, 0
    for j in range(mu.size):
        if waves.gamma[j] == 0.0:
            waves.others[count] = j
            count += 1
        elif symmetric:
            rest = force[j] / mu[j]
            waves.cosine[j] = row[j] * (U[j] - rest)
            constant += row[j] * rest
    return constant, count


@inner
def _evaluate(path: _Path, tau: float) -> tuple[float, float]:
    """Return a constrained coordinate and its slope."""
    gamma, sines, cosines, others, values, slopes = path.waves
    for j in range(gamma.size):
        s, c = sine_cosine(gamma[j] * tau, 0.0)
        values[j] = sines[j] * s + cosines[j] * c
        slopes[j] = gamma[j] * (sines[j] * c - cosines[j] * s)
    y, rise = folded(values) + path.constant, folded(slopes)
    mu, force, D, U = path.modes
    for k in range(path.others):
        j = others[k]
        more, faster = place_and_slope(mu[j], force[j], D[j], U[j], path.symmetric, tau)
        y += path.row[j] * more
        rise += path.row[j] * faster
    return y, rise


@inner
def _step(slack: float, slope: float, curvature: float) -> float:
    """Return a step h for which ``slope h + curvature h^2/2`` stays below the slack."""
    if slack == np.inf:
        return np.inf
    root = math.sqrt(slope * slope + 2.0 * curvature * slack)
    if slope <= 0.0:
        return (root - slope) / curvature
    return 2.0 * slack / (root + slope)


@inner
def _safe_time(slope: float, room: float, curvature: float) -> float:
    """Return for how long before an impact no limit can be passed.

    The coordinate rises towards its wall: the curvature alone cannot lift it over the wall
    within ``2 slope / B``, nor can it have come from beyond the other wall. Half that time is safe
    whatever the errors of slope and curvature.
    """
    if slope <= 0.0:
        return 0.0
    return 0.5 * min(min(2.0 * slope / curvature, _step(room, slope, curvature)), 1.0)


@inner
def _suspect_time(
    path: _Path, tau: float, end: float, bottom: float, top: float, error: float
) -> tuple[float, bool, int]:
    """Return a time up to the end at which a limit is almost reached, or nan; in how many steps.

    And whether it is proved that there is none before.
    """
    for steps in range(_MOST):
        if tau >= end:
            return np.nan, True, steps
        y, slope = _evaluate(path, tau)
        if not (y < top - 2.0 * error and y > bottom + 2.0 * error):
            return tau, True, steps
        up = _step(top - error - y, slope, path.curvature)
        down = _step(y - bottom - error, -slope, path.curvature)
        tau += min(up, down)
    return np.nan, False, _MOST


@inner
def _excess_time(
    path: _Path, tau: float, end: float, bottom: float, top: float, error: float
) -> tuple[float, bool, int]:
    """Return a time up to the end at which a limit is passed or nan, and whether that is sure.

    And in how many steps.
    """
    witness = np.nan
    for steps in range(_MOST):
        if tau >= end:
            return witness, False, steps
        y, slope = _evaluate(path, tau)
        if y > top + error or y < bottom - error:
            return tau, True, steps
        if math.isnan(witness) and (y > top or y < bottom):
            witness = tau
        up = _step(top - y + 2.0 * error, slope, path.curvature)
        down = _step(y - bottom + 2.0 * error, -slope, path.curvature)
        tau += min(up, down)
    return witness, False, _MOST


@inner
def _verdict(path: _Path, limits: Limits, a: int, error: float) -> tuple[float, bool, int]:
    """Return what `_excess_time` does from impact to impact, for an uncertain coordinate."""
    bottom, top = -limits.lower[a], limits.upper[a]
    tau, end = -1.0, 1.0
    if not path.symmetric:
        # The other half is the mirror image.
        tau, top = 0.0, min(top, -bottom)
        bottom = -top
    elif limits.struck_lower[a]:
        tau += _safe_time(_evaluate(path, -1.0)[1], top - bottom, path.curvature)
    if limits.struck_upper[a]:
        end -= _safe_time(_evaluate(path, 1.0)[1], top - bottom, path.curvature)
    if not error < np.inf:
        return np.nan, False, 0
    suspect, sure, steps = _suspect_time(path, tau, end, bottom, top, error)
    if math.isnan(suspect):
        return np.nan, sure, steps
    witness, passed, more = _excess_time(path, suspect, end, bottom, top, error)
    return witness, passed, steps + more


@kernel
def check(
    motions: Motions, limits: Limits, error: Floats, witness: Floats, certified: Booleans
) -> int:
    """Check all solutions against all limits; return the number of steps that this took.

    Parameters
    ----------
    motions : Motions
    limits : Limits
    error : array, shape (frequency,)
        Error of the motion at all times, in the norm of M.
    witness : array, shape (frequency,)
        Receives a time at which a limit is passed, nan where there is none.
    certified : array of bool, shape (frequency,)
        Receives whether neither rounding nor that error could have changed the outcome.
    """
    n, symmetric, steps = motions.roots.size, motions.U.shape[1] > 0, 0
    waves = _Waves(
        np.empty(n), np.empty(n), np.empty(n), np.empty(n, np.int64), np.empty(n), np.empty(n)
    )
    mu, force, place = np.empty(n), np.empty(n), np.empty(n)
    for f in range(motions.omega.size):
        omega, witness[f], certified[f] = motions.omega[f], np.nan, True
        for j in range(n):
            gamma = motions.roots[j] / omega
            mu[j], force[j] = gamma * abs(gamma), motions.load[j] / (omega * omega)
            place[j] = motions.U[f, j] if symmetric else 0.0
        modes = _Modes(mu, force, motions.D[f], place)
        for a in range(limits.lower.size):
            row = limits.rows[a]
            curvature, size = _bounds(modes, row, symmetric, waves.values)
            constant, count = _separate(modes, row, symmetric, waves)
            path = _Path(modes, waves, row, constant, count, symmetric, curvature)
            doubt = max(limits.reach[a] * error[f], 1e-16 * size)
            witness[f], sure, more = _verdict(path, limits, a, doubt)
            steps += more
            if not math.isnan(witness[f]):
                certified[f] = sure
                break
            certified[f] = certified[f] and sure
    return steps
