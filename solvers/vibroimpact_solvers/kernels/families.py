"""Solutions of the impact-mode families: impulses and modal amplitudes at given frequencies.

Between two impacts a mode with eigenvalue lambda has a component ``q_a`` that is antisymmetric
in tau and a symmetric one ``q_s``, ``q = q_a + q_s``:

    q_a = share (a_a . z) s(mu, tau) / omega^2
    q_s = share (a_s . z) h(mu, tau) / omega^2 + f / lambda

where ``mu = lambda / omega^2``, z are the impulses, a the rows of the mode at the struck
walls, f its static load, and ``share`` is one or a half (see `impact_modes.family`). The walls
demand ``sum_j a_ij q_j(1) = wall_i``.

s has a pole where ``cos gamma = 0`` and h one where ``sin gamma = 0``, rigid-body modes
(gamma = 0) among them, while the motion stays finite. A mode near its pole whose term would
drown the others is therefore not summed but keeps an unknown of its own,
``v = omega^2 q(1) / share``, and one more equation:

    antisymmetric:  a . z - gamma cot(gamma) v = 0
    symmetric:      a . z + gamma tan(gamma) v = f sin(gamma) / (share gamma)

(v of a symmetric component leaves out the static displacement under the load). The bordered
system is symmetric and stays well conditioned through the pole.
"""

from __future__ import annotations

import math

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.jit import fma, inline, kernel
from vibroimpact_solvers.kernels.phases import LARGEST, sine_cosine
from vibroimpact_solvers.kernels.sums import folded
from vibroimpact_solvers.kernels.triangle_time import (
    antisymmetric_response,
    cosine,
    sag,
    sine,
    symmetric_response,
)

Modes = tuple[Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats]
"""mu, what rounding took from it, its uncertainty, sine and cosine of gamma, then work arrays for

responses, their changes and terms of sums: an entry for each mode.
"""

_EPS = 2.220446049250313e-16

# A mode is a candidate for the border where cos or sin of its gamma is smaller ...
_NEAR = 0.0625
# ... and joins it where its term is this many times larger than all others together, ...
_DOMINANT = 4.0
# ... or so close to the pole that the term cannot be trusted to be finite.
_AT_POLE = 1e-9
_RIGID = 1e-200
# Responses of modes with smaller mu are power series.
_SOFT = 1e-3
# A symmetric component is near the pole at 0 where mu is less certain than this, relative to it.
_UNCERTAIN = 1e-6


@inline
def _is_near(parity: int, mu: float, sine: float, cosine: float) -> bool:
    """Whether the antisymmetric (0) or symmetric (1) response may be large at this mu."""
    if parity == 0:
        return bool(mu > 0.0 and abs(cosine) < _NEAR)
    return bool(abs(mu) < _NEAR or (mu > 0.0 and abs(sine) < _NEAR))


@inline
def _is_at_pole(parity: int, mu: float, sine: float, cosine: float) -> bool:
    """Whether the response of a candidate must not even be evaluated."""
    if parity == 0:
        return abs(cosine) < _AT_POLE
    # Close to mu = 0 the response -1/mu is as accurate as mu is.
    return abs(mu) < _RIGID if abs(mu) < _NEAR else math.sqrt(mu) * abs(sine) < _AT_POLE


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
    """Add the response of mode j to the matrix, its uncertainty dS and the right-hand side.

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
        if parity == 1 and static != 0.0:
            for k in range(right.shape[1]):
                right[i, k] -= rows[i, j] * static / mu


@kernel
def _add_plain(
    S: Floats,
    dS: Floats,
    right: Floats,
    rows: Floats,
    products: Floats,
    parity: int,
    modes: Modes,
    load: Floats,
    share: float,
    noise: float,
    others: Integers,
) -> int:
    """Add the responses of all modes that are neither near their poles nor soft; list the others.

    `products` are those of all pairs of rows; the number of others is returned.
    """
    mu, rest, dmu, sines, cosines, value, change, terms = modes
    for j in range(mu.size):
        # The response is sine/(cosine gamma), or -cosine/(sine gamma), by one division.
        top, low = (sines[j], cosines[j]) if parity == 0 else (-cosines[j], sines[j])
        plain = (mu[j] > _SOFT) & (abs(low) >= _NEAR) & ((parity == 0) | (mu[j] >= _NEAR))
        over = 1.0 / (low * mu[j]) if plain else 0.0
        response = top * math.sqrt(abs(mu[j])) * over
        value[j] = response
        change[j] = (1.0 + mu[j] * response * response - response) * (0.5 * low * over)
    # Loops apart: of many arrays none would be known to be apart from the others.
    for j in range(mu.size):
        value[j] += change[j] * rest[j]
        change[j] = abs(change[j]) * dmu[j] + noise * abs(value[j])
    count = 0
    for j in range(mu.size):
        if change[j] == 0.0:
            others[count] = j
            count += 1
    place = 0
    for i in range(rows.shape[0]):
        for k in range(i, rows.shape[0]):
            product = products[place]
            for j in range(mu.size):
                terms[j] = product[j] * value[j]
            S[i, k] += folded(terms)
            for j in range(mu.size):
                terms[j] = abs(product[j]) * change[j]
            dS[i, k] += folded(terms)
            S[k, i], dS[k, i] = S[i, k], dS[i, k]
            place += 1
    if parity == 1 and np.any(load != 0.0):
        for i in range(rows.shape[0]):
            row = rows[i]
            for j in range(mu.size):
                terms[j] = row[j] * load[j] / (share * mu[j]) if change[j] != 0.0 else 0.0
            lifted = folded(terms)
            for k in range(right.shape[1]):
                right[i, k] -= lifted
    return count


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
        ratio, _ = antisymmetric_response(mu)
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
def _invert(matrix: Floats, m: int, work: Floats, inverse: Floats, d: Floats) -> bool:
    """Invert a small matrix of order m by Gauss-Jordan elimination after equilibrating it."""
    for i in range(m):
        largest = 0.0
        for k in range(m):
            largest = max(largest, abs(matrix[i, k]))
        d[i] = 1.0 / math.sqrt(largest) if largest > 0.0 else 1.0
    for i in range(m):
        for k in range(m):
            inverse[i, k] = 1.0 if i == k else 0.0
            work[i, k] = matrix[i, k] * d[i] * d[k]
    for column in range(m):
        pivot = column
        for row in range(column + 1, m):
            if abs(work[row, column]) > abs(work[pivot, column]):
                pivot = row
        if not abs(work[pivot, column]) > 1e-30:
            return False
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
    return True


@kernel
def _times(matrix: Floats, m: int, vector: Floats, out: Floats) -> None:
    for i in range(m):
        total = 0.0
        for k in range(m):
            total += matrix[i, k] * vector[k]
        out[i] = total


@kernel
def _scale(
    roots: Floats,
    rests: Floats,
    omega: float,
    rest: float,
    uncertainty: float,
    norms: float,
    modes: Modes,
) -> None:
    """Fill in mu of all modes, what rounding took from it, and how uncertain it is.

    And the sines and cosines of their gamma, which mean nothing where mu is negative.
    """
    mu, missing, dmu, sines, cosines, _, _, terms = modes
    largest, over, inverse = 0.0, uncertainty / (omega * omega), 1.0 / omega
    for j in range(roots.size):
        gamma = roots[j] / omega
        mu[j] = gamma * abs(gamma)
        terms[j] = gamma
    for j in range(roots.size):
        lost = fma(-terms[j], omega, roots[j]) * inverse
        missing[j] = 2.0 * fma(mu[j], rests[j] - rest, abs(terms[j]) * lost)
    for j in range(roots.size):
        dmu[j] = (_EPS + norms) * abs(mu[j]) + over
        terms[j] = abs(terms[j])
    for j in range(roots.size):
        sines[j], cosines[j] = sine_cosine(terms[j], 0.0)
    for j in range(roots.size):
        largest = max(largest, terms[j])
    if largest > LARGEST:
        for j in range(roots.size):
            sines[j], cosines[j] = math.sin(terms[j]), math.cos(terms[j])


@inline
def _response(parity: int, mu: float, sine: float, cosine: float) -> tuple[float, float]:
    """Return the response and its derivative by mu from the sine and cosine of gamma."""
    if mu < _SOFT:
        return antisymmetric_response(mu) if parity == 0 else symmetric_response(mu)
    value = (sine / cosine if parity == 0 else -cosine / sine) / math.sqrt(mu)
    return value, (1.0 + mu * value * value - value) / (2.0 * mu)


@kernel
def _select_bordered(
    modes: Modes,
    antisymmetric: Floats,
    symmetric: Floats,
    load: Floats,
    share: float,
    noise: float,
    near: Integers,
    magnitude: Floats,
    S: Floats,
    dS: Floats,
    right: Floats,
) -> int:
    """Add the candidates that need no border, small terms first; move the others to the front.

    The number of the latter is returned; nz is the order of the matrix without borders.
    """
    mu, rest, dmu, sines, cosines, _, _, _ = modes
    nz = max(antisymmetric.shape[0], symmetric.shape[0])
    for k in range(near.size):
        j, parity = near[k] // 2, near[k] % 2
        rows, weight = antisymmetric if parity == 0 else symmetric, 0.0
        for i in range(nz):
            weight = max(weight, abs(rows[i, j]))
        weight *= weight
        magnitude[k] = np.inf if weight > 0.0 else 0.0
        uncertain = parity == 1 and dmu[j] > _UNCERTAIN * abs(mu[j])
        if weight > 0.0 and not uncertain and not _is_at_pole(parity, mu[j], sines[j], cosines[j]):
            value, _ = _response(parity, mu[j], sines[j], cosines[j])
            magnitude[k] = abs(value) * weight
    for k in range(1, near.size):
        one, size, place = near[k], magnitude[k], k
        while place > 0 and magnitude[place - 1] > size:
            near[place], magnitude[place] = near[place - 1], magnitude[place - 1]
            place -= 1
        near[place], magnitude[place] = one, size
    kept = 0
    for k in range(near.size):
        if magnitude[k] == 0.0:
            continue
        # Of dominant terms, as many as there are impulses drown the others and not one another:
        # more borders would only make the system singular.
        surplus = near.size - k > nz
        largest_diagonal = 0.0
        for i in range(nz):
            largest_diagonal = max(largest_diagonal, abs(S[i, i]))
        if magnitude[k] < np.inf and (
            surplus or magnitude[k] <= _DOMINANT * largest_diagonal or largest_diagonal == 0.0
        ):
            j, parity = near[k] // 2, near[k] % 2
            rows, static = antisymmetric if parity == 0 else symmetric, load[j] / share
            both = sines[j], cosines[j]
            _add(S, dS, right, rows, j, parity, mu[j], rest[j], dmu[j], both, static, noise)
        else:
            near[kept] = near[k]
            kept += 1
    return kept


@kernel
def _sum(
    modes: Modes,
    antisymmetric: Floats,
    symmetric: Floats,
    products: tuple[Floats, Floats],
    load: Floats,
    share: float,
    noise: float,
    near: Integers,
    others: Integers,
    magnitude: Floats,
    S: Floats,
    dS: Floats,
    right: Floats,
) -> int:
    """Sum the responses of all modes; return how many need a border, which `near` lists.

    The antisymmetric component of mode j has the number 2 j, the symmetric one 2 j + 1.
    """
    mu, rest, dmu, sines, cosines, _, _, _ = modes
    count = 0
    for parity in range(2):
        rows = antisymmetric if parity == 0 else symmetric
        if rows.shape[0] == 0:
            continue
        pairs = products[0] if parity == 0 else products[1]
        left = _add_plain(S, dS, right, rows, pairs, parity, modes, load, share, noise, others)
        for k in range(left):
            j = others[k]
            both = sines[j], cosines[j]
            if _is_near(parity, mu[j], both[0], both[1]):
                near[count] = 2 * j + parity
                count += 1
            else:
                static = load[j] / share
                _add(S, dS, right, rows, j, parity, mu[j], rest[j], dmu[j], both, static, noise)
    if count == 0:
        return 0
    return _select_bordered(
        modes, antisymmetric, symmetric, load, share, noise, near[:count], magnitude, S, dS, right
    )


@kernel
def _products(rows: Floats) -> Floats:
    """Return the products of all pairs of rows, shape (pair, mode)."""
    n = rows.shape[0]
    products, place = np.empty((n * (n + 1) // 2, rows.shape[1])), 0
    for i in range(n):
        for k in range(i, n):
            products[place] = rows[i] * rows[k]
            place += 1
    return products


@kernel
def _forces(rows: Floats, z: Floats, scale: float, force: Floats) -> None:
    for j in range(force.size):
        force[j] = 0.0
    for i in range(rows.shape[0]):
        row, p = rows[i], scale * z[i]
        for j in range(force.size):
            force[j] += row[j] * p


@kernel
def _antisymmetric_amplitudes(modes: Modes, force: Floats, unit: Floats) -> None:
    """Fill in D of all modes but the bordered ones, see `solutions`."""
    mu, rest, _, sines, cosines, _, _, _ = modes
    for j in range(mu.size):
        gamma = math.sqrt(abs(mu[j]))
        oscillates = (mu[j] > 0.0) & (force[j] != 0.0)
        low = fma(cosines[j], gamma, -0.5 * sines[j] * rest[j])
        unit[j] = force[j] * gamma / low if oscillates else force[j]


@kernel
def _symmetric_amplitudes(
    modes: Modes, force: Floats, load: Floats, omega: float, unit: Floats
) -> None:
    """Fill in U of all modes but the bordered ones, see `solutions`."""
    mu, rest, _, sines, cosines, _, _, _ = modes
    square, any_soft = omega * omega, False
    for j in range(mu.size):
        gamma = math.sqrt(abs(mu[j]))
        low = fma(mu[j], sines[j], 0.5 * fma(cosines[j], gamma, sines[j]) * rest[j])
        moved = -force[j] * gamma / low if force[j] != 0.0 else 0.0
        unit[j] = moved + (load[j] / (mu[j] * square) if load[j] != 0.0 else 0.0)
    for j in range(mu.size):
        any_soft |= mu[j] < _SOFT
    for j in range(mu.size if any_soft else 0):
        if mu[j] <= -1.0:
            value, _ = symmetric_response(mu[j])
            unit[j] = force[j] * value
        elif mu[j] < _SOFT:
            unit[j] = load[j] / (mu[j] * square) if load[j] != 0.0 else 0.0
            if force[j] != 0.0:
                slope = 0.5 * (sine(mu[j]) + cosine(mu[j]))
                unit[j] -= force[j] / (mu[j] * sine(mu[j]) + slope * rest[j])


@kernel
def solutions(
    roots: Floats,
    rests: Floats,
    antisymmetric: Floats,
    symmetric: Floats,
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
    """Compute impulses and modal amplitudes, for several sets of walls at once.

    The sets share all but the right-hand sides, which is computed once for each frequency; the
    numbers of a set do not depend on the others.

    Parameters
    ----------
    roots : array, shape (mode,)
        Signed natural frequencies.
    rests : array, shape (mode,)
        What rounding took from them, relative to them.
    antisymmetric, symmetric : array, shape (unknown, mode)
        Rows of the two components; with no rows where there is no such component.
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
        Receives the amplitudes of the antisymmetric component, ``D sin(gamma tau)/gamma`` or,
        for negative mu, ``D sinh(g tau)/(g cosh g)``; left out where it has no columns.
    U : array, shape (set, frequency, mode)
        Receives the symmetric component at tau = 0, static displacement included, or, for mu
        <= -1, U of ``U cosh(g tau)/cosh(g)``; left out where it has no columns.
    """
    nz, count, room = walls.shape[1], roots.size, walls.shape[1] + 4
    mu, rest, dmu, sines = np.empty(count), np.empty(count), np.empty(count), np.empty(count)
    cosines, value, change = np.empty(count), np.empty(count), np.empty(count)
    modes = (mu, rest, dmu, sines, cosines, value, change, np.empty(count))
    near, others = np.empty(2 * count, np.int64), np.empty(count, np.int64)
    force, magnitude, noise = np.empty(count), np.empty(2 * count), 2.0 * _EPS + norms
    products = _products(antisymmetric), _products(symmetric)
    A, dA, work, inverse = _matrix(room), _matrix(room), _matrix(room), _matrix(room)
    right, vectors = np.empty((room, walls.shape[0])), np.empty((5, room))
    for f in range(omega.size):
        _scale(roots, rests, omega[f], omega_rests[f], uncertainty, norms, modes)
        _clear(A, dA, right, 0, nz)
        for i in range(nz):
            for s in range(walls.shape[0]):
                right[i, s] = walls[s, i] * (omega[f] * omega[f] / share)
        kept = _sum(
            modes,
            antisymmetric,
            symmetric,
            products,
            load,
            share,
            noise,
            near,
            others,
            magnitude,
            A,
            dA,
            right,
        )
        size = nz + kept
        if size > room:
            room = size
            A, dA = _larger(A, nz, room), _larger(dA, nz, room)
            work, inverse = _matrix(room), _matrix(room)
            taller = np.empty((room, walls.shape[0]))
            taller[:nz] = right[:nz]
            right, vectors = taller, np.empty((5, room))
        _clear(A, dA, right, nz, size)
        for k in range(kept):
            j, parity = near[k] // 2, near[k] % 2
            column = antisymmetric[:, j] if parity == 0 else symmetric[:, j]
            static = load[j] / share
            _border(A, dA, right, nz + k, column, parity, mu[j], rest[j], dmu[j], static, noise)
        sound = _invert(A, size, work, inverse, vectors[0])
        b, v, other, spread = vectors[1], vectors[2], vectors[3], vectors[4]
        for s in range(walls.shape[0]):
            if not sound:
                z[s, f] = np.nan
                error[s, f] = np.inf
                D[s, f] = 0.0
                U[s, f] = 0.0
                continue
            for i in range(size):
                b[i] = right[i, s]
            _times(inverse, size, b, v)
            _times(A, size, v, other)
            for i in range(size):
                other[i] = b[i] - other[i]
            _times(inverse, size, other, spread)
            for i in range(size):
                v[i] += spread[i]
                other[i] = abs(v[i])
            _times(dA, size, other, spread)
            for i in range(size):
                spread[i] += 2.0 * _EPS * abs(b[i])
            for i in range(nz):
                z[s, f, i] = v[i]
                error[s, f, i] = 0.0
                for k in range(size):
                    error[s, f, i] += abs(inverse[i, k]) * spread[k]
            scale = share / (omega[f] * omega[f])
            if D.shape[2] > 0:
                _forces(antisymmetric, v, scale, force)
                _antisymmetric_amplitudes(modes, force, D[s, f])
            if U.shape[2] > 0:
                _forces(symmetric, v, scale, force)
                _symmetric_amplitudes(modes, force, load, omega[f], U[s, f])
            for k in range(kept):
                j = near[k] // 2
                place = v[nz + k] * scale
                if near[k] % 2 == 0 and D.shape[2] > 0:
                    D[s, f, j] = place / sine(mu[j])
                elif near[k] % 2 == 1 and U.shape[2] > 0:
                    U[s, f, j] = place / cosine(mu[j])


@kernel
def _clear(A: Floats, dA: Floats, right: Floats, start: int, size: int) -> None:
    """Empty the rows and columns from start to size of a system."""
    for i in range(start, size):
        for k in range(size):
            A[i, k] = A[k, i] = dA[i, k] = dA[k, i] = 0.0
        for k in range(right.shape[1]):
            right[i, k] = 0.0


@kernel
def _matrix(order: int) -> Floats:
    return np.empty((order, order))


@kernel
def _larger(matrix: Floats, order: int, room: int) -> Floats:
    """Return a larger matrix with the first rows and columns of the given one."""
    larger = np.empty((room, room))
    larger[:order, :order] = matrix[:order, :order]
    return larger
