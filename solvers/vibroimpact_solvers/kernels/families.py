"""Members of the family of impact modes: impulses and modal amplitudes at one frequency.

A mode with eigenvalue lambda moves, between two impacts, as ``q = q_odd + q_even`` with

    q_odd  = share (a_odd . z) s(mu, tau) / omega^2
    q_even = share (a_even . z) h(mu, tau) / omega^2 + f / lambda

where ``mu = lambda / omega^2``, z are the impulses, a the rows of the mode at the struck
walls, f its static load, and ``share`` is one or a half (see `impact_modes.family`). The walls
demand ``sum_j a_ij q_j(1) = wall_i``.

s has a pole where ``cos gamma = 0`` and h one where ``sin gamma = 0``, rigid-body modes
(gamma = 0) among them, while the motion stays finite. A mode near its pole whose term would
drown the others is therefore not summed but keeps an unknown of its own,
``v = omega^2 q(1) / share``, and one more equation:

    odd:   a . z - gamma cot(gamma) v = 0
    even:  a . z + gamma tan(gamma) v = f sin(gamma) / (share gamma)

(v of an even motion leaves out the sag of the load). The bordered system is symmetric and
stays well conditioned through the pole.
"""

from __future__ import annotations

import math

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.jit import fma, inline, kernel
from vibroimpact_solvers.kernels.phases import LARGEST, sine_cosine
from vibroimpact_solvers.kernels.triangle_time import (
    cosine,
    even_response,
    hyperbolic_cosine,
    hyperbolic_sine,
    odd_response,
    sag,
    sine,
)

_EPS = 2.220446049250313e-16

# A mode is a candidate for the border where cos or sin of its gamma is smaller ...
_NEAR = 0.0625
# ... and joins it where its term is this many times larger than all others together, ...
_LOUD = 4.0
# ... or so close to the pole that the term cannot be trusted to be finite.
_AT_POLE = 1e-9
_RIGID = 1e-200
# Of an even motion whose mu is less certain than this, relative to it, the pole at 0 is near.
_UNCERTAIN = 1e-6


@inline
def _is_near(parity: int, mu: float, sine: float, cosine: float) -> bool:
    """Whether the odd (0) or even (1) response may be large at this mu, and sine and cosine."""
    if parity == 0:
        return bool(mu > 0.0 and abs(cosine) < _NEAR)
    return bool(abs(mu) < _NEAR or (mu > 0.0 and abs(sine) < _NEAR))


@kernel
def is_at_pole(parity: int, mu: float) -> bool:
    """Whether the response must not even be evaluated."""
    if parity == 0:
        return abs(cosine(mu)) < _AT_POLE
    # Close to mu = 0 the response -1/mu is as good as mu is.
    return abs(mu) < _RIGID if abs(mu) < _NEAR else abs(mu * sine(mu)) < _AT_POLE


@kernel
def _add(
    S: Floats,
    dS: Floats,
    right: Floats,
    rows: Floats,
    j: int,
    parity: int,
    mu: float,
    rest: float,
    dmu: float,
    turn: tuple[float, float],
    static: float,
    noise: float,
) -> None:
    """Sum the response of mode j into the matrix, its wobble and the right-hand side.

    turn is the sine and the cosine of its gamma.
    """
    value, slope = _response(parity, mu, turn[0], turn[1])
    value += slope * rest
    change = abs(slope) * dmu + noise * abs(value)
    for i in range(rows.shape[0]):
        for k in range(rows.shape[0]):
            product = rows[i, j] * rows[k, j]
            S[i, k] += product * value
            dS[i, k] += abs(product) * change
        if parity == 1:
            for k in range(right.shape[1]):
                right[i, k] -= rows[i, j] * static / mu


@kernel
def _border(
    A: Floats,
    dA: Floats,
    right: Floats,
    row: int,
    column: Floats,
    parity: int,
    mu: float,
    rest: float,
    dmu: float,
    static: float,
    noise: float,
) -> None:
    """Give a mode its own unknown and equation, number `row`."""
    for i in range(column.size):
        A[i, row] = column[i]
        A[row, i] = column[i]
        dA[i, row] = noise * abs(column[i])
        dA[row, i] = dA[i, row]
    if parity == 0:
        gamma = math.sqrt(mu)
        cotangent = 1.0 / math.tan(gamma)
        A[row, row] = -gamma * cotangent
        slope = 0.5 * (1.0 + cotangent * cotangent - cotangent / gamma)
    else:
        ratio, _ = odd_response(mu)
        A[row, row] = mu * ratio
        slope = 0.5 * (1.0 + mu * ratio * ratio + ratio)
        for k in range(right.shape[1]):
            right[row, k] = static * sine(mu)
        for i in range(column.size):
            for k in range(right.shape[1]):
                right[i, k] -= column[i] * static * sag(mu)
    A[row, row] += slope * rest
    dA[row, row] = abs(slope) * dmu + 2.0 * _EPS * abs(A[row, row])


@kernel
def _inverse(matrix: Floats) -> tuple[Floats, bool]:
    """Invert a small matrix by Gauss-Jordan elimination after equilibrating it."""
    m = matrix.shape[0]
    d = np.empty(m)
    for i in range(m):
        largest = np.max(np.abs(matrix[i]))
        d[i] = 1.0 / math.sqrt(largest) if largest > 0.0 else 1.0
    work = np.empty((m, m))
    inverse = np.zeros((m, m))
    for i in range(m):
        inverse[i, i] = 1.0
        for k in range(m):
            work[i, k] = matrix[i, k] * d[i] * d[k]
    for column in range(m):
        pivot = column
        for row in range(column + 1, m):
            if abs(work[row, column]) > abs(work[pivot, column]):
                pivot = row
        if not abs(work[pivot, column]) > 1e-30:
            return inverse, False
        for k in range(m):
            work[column, k], work[pivot, k] = work[pivot, k], work[column, k]
            inverse[column, k], inverse[pivot, k] = inverse[pivot, k], inverse[column, k]
        factor = 1.0 / work[column, column]
        for k in range(m):
            work[column, k] *= factor
            inverse[column, k] *= factor
        for row in range(m):
            factor = work[row, column]
            if row != column and factor != 0.0:
                for k in range(m):
                    work[row, k] -= factor * work[column, k]
                    inverse[row, k] -= factor * inverse[column, k]
    for i in range(m):
        for k in range(m):
            inverse[i, k] *= d[i] * d[k]
    return inverse, True


@kernel
def _scaled(
    roots: Floats, rests: Floats, omega: float, rest: float, uncertainty: float, norms: float
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return mu of all modes, what rounding took from it, and how uncertain it is.

    And the sines and cosines of their gamma, shape (2, mode), which mean nothing where mu is
    negative: one vector loop, as calls for one mode after the other would take most of the time.
    """
    mu, missing, doubt = np.empty(roots.size), np.empty(roots.size), np.empty(roots.size)
    turn, largest = np.empty((2, roots.size)), 0.0
    for j in range(roots.size):
        gamma = roots[j] / omega
        mu[j] = gamma * abs(gamma)
        root = roots[j] if roots[j] != 0.0 else 1.0
        missing[j] = 2.0 * mu[j] * (fma(-gamma, omega, roots[j]) / root + rests[j] - rest)
        doubt[j] = (_EPS + norms) * abs(mu[j]) + uncertainty / (omega * omega)
    for j in range(roots.size):
        turn[0, j], turn[1, j] = sine_cosine(math.sqrt(abs(mu[j])), 0.0)
        largest = max(largest, mu[j])
    if largest > LARGEST * LARGEST:
        for j in range(roots.size):
            gamma = math.sqrt(abs(mu[j]))
            turn[0, j], turn[1, j] = math.sin(gamma), math.cos(gamma)
    return mu, missing, doubt, turn


@inline
def _response(parity: int, mu: float, sine: float, cosine: float) -> tuple[float, float]:
    """Return the odd or even response and its derivative from the sine and cosine of gamma."""
    if mu < 1e-3:
        return odd_response(mu) if parity == 0 else even_response(mu)
    value = (sine / cosine if parity == 0 else -cosine / sine) / math.sqrt(mu)
    return value, (1.0 + mu * value * value - value) / (2.0 * mu)


@kernel
def _loud(
    mu: Floats,
    rest: Floats,
    dmu: Floats,
    turn: Floats,
    odd: Floats,
    even: Floats,
    load: Floats,
    share: float,
    noise: float,
    near: Integers,
    S: Floats,
    dS: Floats,
    right: Floats,
) -> Integers:
    """Return the candidates that need a border; the others are summed, quiet ones first."""
    loudness = np.empty(near.size)
    for k in range(near.size):
        j, parity = near[k] // 2, near[k] % 2
        column = odd[:, j] if parity == 0 else even[:, j]
        weight = np.max(np.abs(column)) ** 2
        loudness[k] = np.inf if weight > 0.0 else 0.0
        uncertain = parity == 1 and dmu[j] > _UNCERTAIN * abs(mu[j])
        if weight > 0.0 and not uncertain and not is_at_pole(parity, mu[j]):
            value, _ = odd_response(mu[j]) if parity == 0 else even_response(mu[j])
            loudness[k] = abs(value) * weight
    kept = 0
    bordered = np.empty(near.size, dtype=np.int64)
    order = np.argsort(loudness)
    for place in range(order.size):
        k = order[place]
        if loudness[k] == 0.0:
            continue
        # Of modes that are all loud, as many as there are impulses drown the others and not
        # one another: more borders would only make the system singular.
        quiet = order.size - place > S.shape[0]
        loudest = 0.0
        for i in range(S.shape[0]):
            loudest = max(loudest, abs(S[i, i]))
        if loudness[k] < np.inf and (quiet or loudness[k] <= _LOUD * loudest or loudest == 0.0):
            j, parity = near[k] // 2, near[k] % 2
            rows, static = odd if parity == 0 else even, load[j] / share
            both = turn[0, j], turn[1, j]
            _add(S, dS, right, rows, j, parity, mu[j], rest[j], dmu[j], both, static, noise)
        else:
            bordered[kept] = near[k]
            kept += 1
    return bordered[:kept]


@kernel
def _system(
    mu: Floats,
    rest: Floats,
    dmu: Floats,
    turn: Floats,
    odd: Floats,
    even: Floats,
    load: Floats,
    walls: Floats,
    omega: float,
    share: float,
    noise: float,
) -> tuple[Floats, Floats, Floats, Integers]:
    """Return the bordered matrix, its wobble, the right-hand sides and the bordered modes.

    A bordered mode j is named 2 j for its odd and 2 j + 1 for its even motion.
    """
    nz, modes = walls.shape[1], mu.size
    S, dS = np.zeros((nz, nz)), np.zeros((nz, nz))
    right = np.empty((nz, walls.shape[0]))
    for i in range(nz):
        for k in range(walls.shape[0]):
            right[i, k] = walls[k, i] * (omega * omega / share)
    near = np.empty(2 * modes, dtype=np.int64)
    count = 0
    for parity in range(2):
        rows = odd if parity == 0 else even
        if rows.shape[0] == 0:
            continue
        for j in range(modes):
            both = turn[0, j], turn[1, j]
            if _is_near(parity, mu[j], both[0], both[1]):
                near[count] = 2 * j + parity
                count += 1
            else:
                static = load[j] / share
                _add(S, dS, right, rows, j, parity, mu[j], rest[j], dmu[j], both, static, noise)
    near = _loud(mu, rest, dmu, turn, odd, even, load, share, noise, near[:count], S, dS, right)
    size = nz + near.size
    A, dA = np.zeros((size, size)), np.zeros((size, size))
    b = np.zeros((size, walls.shape[0]))
    A[:nz, :nz], dA[:nz, :nz], b[:nz] = S, dS, right
    for k in range(near.size):
        j, parity = near[k] // 2, near[k] % 2
        column = odd[:, j] if parity == 0 else even[:, j]
        _border(A, dA, b, nz + k, column, parity, mu[j], rest[j], dmu[j], load[j] / share, noise)
    return A, dA, b, near


@kernel
def _amplitudes(
    mu: Floats,
    rest: Floats,
    turn: Floats,
    rows: Floats,
    load: Floats,
    omega: float,
    share: float,
    parity: int,
    z: Floats,
    unit: Floats,
) -> None:
    """Fill in the amplitudes of all modes but the bordered ones, see `members`."""
    scale = share / (omega * omega)
    for j in range(mu.size):
        force = 0.0
        for i in range(rows.shape[0]):
            force += rows[i, j] * z[i]
        force *= scale
        if parity == 0:
            unit[j] = force
            if mu[j] > 0.0 and force != 0.0:
                unit[j] = force / (turn[1, j] - 0.5 * (turn[0, j] / math.sqrt(mu[j])) * rest[j])
        elif mu[j] <= -1.0:
            value, _ = even_response(mu[j])
            unit[j] = force * value
        else:
            unit[j] = load[j] / (mu[j] * omega * omega) if load[j] != 0.0 else 0.0
            if force != 0.0:
                slope = 0.5 * (sine(mu[j]) + cosine(mu[j]))
                unit[j] -= force / (mu[j] * sine(mu[j]) + slope * rest[j])


@kernel
def members(
    roots: Floats,
    rests: Floats,
    odd: Floats,
    even: Floats,
    load: Floats,
    walls: Floats,
    omega: Floats,
    omega_rests: Floats,
    share: float,
    uncertainty: float,
    norms: float,
    z: Floats,
    error: Floats,
    D: Floats,
    U: Floats,
) -> None:
    """Find impulses and amplitudes, for several sets of walls at once.

    What the sets share, all but the right-hand sides, is done once for each frequency; the
    numbers of a set do not depend on the others.

    Parameters
    ----------
    roots : array, shape (mode,)
        Signed natural frequencies.
    rests : array, shape (mode,)
        What rounding took from them, relative to them.
    odd, even : array, shape (unknown, mode)
        Rows of the odd and the even motion; with no rows where there is no such motion.
    load : array, shape (mode,)
        Static load of each mode.
    walls : array, shape (set, unknown)
        Where each struck wall is, seen along its row.
    omega : array, shape (frequency,)
        Triangle-wave frequencies.
    omega_rests : array, shape (frequency,)
        What rounding took from them, relative to them.
    share : float
        Factor of the modal forces, 1 or 1/2.
    uncertainty : float
        Absolute error of the eigenvalues.
    norms : float
        Error of the modes' norms and of their orthogonality, and relative one of eigenvalues.
    z : array, shape (set, frequency, unknown)
        Receives the impulses; nan where the system is singular.
    error : array, shape (set, frequency, unknown)
        Receives the absolute error of z that roundings in the data cause.
    D : array, shape (set, frequency, mode)
        Receives the amplitudes of the odd motion, ``D sin(gamma tau)/gamma`` or, for
        negative mu, ``D sinh(g tau)/(g cosh g)``; not wanted where it has no columns.
    U : array, shape (set, frequency, mode)
        Receives the place of the even motion at tau = 0, static one included, or, for mu
        <= -1, U of ``U cosh(g tau)/cosh(g)``; not wanted where it has no columns.
    """
    nz = walls.shape[1]
    for f in range(omega.size):
        mu, rest, dmu, turn = _scaled(roots, rests, omega[f], omega_rests[f], uncertainty, norms)
        A, dA, right, near = _system(
            mu, rest, dmu, turn, odd, even, load, walls, omega[f], share, 2.0 * _EPS + norms
        )
        inverse, sound = _inverse(A)
        for s in range(walls.shape[0]):
            if not sound:
                z[s, f] = np.nan
                error[s, f] = np.inf
                D[s, f] = 0.0
                U[s, f] = 0.0
                continue
            b = right[:, s].copy()
            v = np.dot(inverse, b)
            v += np.dot(inverse, b - np.dot(A, v))
            z[s, f] = v[:nz]
            size = np.dot(dA, np.abs(v)) + 2.0 * _EPS * np.abs(b)
            error[s, f] = np.dot(np.abs(inverse), size)[:nz]
            if D.shape[2] > 0:
                _amplitudes(mu, rest, turn, odd, load, omega[f], share, 0, v[:nz], D[s, f])
            if U.shape[2] > 0:
                _amplitudes(mu, rest, turn, even, load, omega[f], share, 1, v[:nz], U[s, f])
            for k in range(near.size):
                j = near[k] // 2
                place = v[nz + k] * share / (omega[f] * omega[f])
                if near[k] % 2 == 0 and D.shape[2] > 0:
                    D[s, f, j] = place / sine(mu[j])
                elif near[k] % 2 == 1 and U.shape[2] > 0:
                    U[s, f, j] = place / cosine(mu[j])
