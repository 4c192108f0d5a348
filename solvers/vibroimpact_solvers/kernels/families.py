"""Solutions of the impact-mode families: impulses and modal amplitudes at given frequencies.

Equations 10.49-10.59 and 10.87-10.89, and the same for walls at unequal distances.

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

Errors dA and db of the equations come from roundings and from errors of eigenvalues,
participations and loads. The computed z leaves a residual r, B is the computed inverse, and with

    t = |B| (|r| + |dA| |z| + |db|) ,      kappa = max_i ((|1 - B A| + |B| |dA|) t)_i / t_i < 1

the error of z is at most ``t/(1 - kappa)``, from
``dz = B (r - dA z - db - dA dz) + (1 - B A) dz``.

Modal amplitudes inherit it; beside it they have the errors of their own eigenvalue and
participation, magnified by ``1/cos gamma`` or ``1/sin gamma``. As modes are orthogonal, the error
of all displacements in the norm of M is the root of the sum of squares of those of the modal
coordinates; a coordinate ``y = w . x`` errs by at most ``sqrt(w . M^-1 w)`` times as much.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.jit import fma, inner, kernel, sums
from vibroimpact_solvers.kernels.phases import LARGEST, sine_cosine
from vibroimpact_solvers.kernels.sums import folded
from vibroimpact_solvers.kernels.triangle_time import (
    antisymmetric_response,
    cosine,
    sag,
    sine,
    symmetric_response,
)

_EPS = 2.220446049250313e-16
_UNIT = 0.5 * _EPS

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


class Modes(NamedTuple):
    """Natural modes, each array (mode,)."""

    roots: Floats  # signed natural frequencies
    rests: Floats  # what rounding took from them, relative to them
    load: Floats  # static loads
    load_errors: Floats
    errors: Floats  # of the eigenvalues, beside the rests
    angles: Floats  # errors of the modes in the norm of M


class LinearSystem(NamedTuple):
    """Which impulses drive the two components of the motion, and what they have to reach."""

    # Rows of the two components; none where there is no such component, (unknown, mode)
    antisymmetric: Floats
    symmetric: Floats
    # Their errors
    antisymmetric_errors: Floats
    symmetric_errors: Floats
    # Where each struck wall is, seen along its row; several sets at once, (set, unknown)
    walls: Floats
    share: float  # factor of the modal forces, 1 or 1/2


class Solutions(NamedTuple):
    """Impulses and modal amplitudes, by sets of walls and frequencies."""

    z: Floats  # impulses; nan where the system is singular, (set, frequency, unknown)
    error: Floats  # their absolute errors that roundings in the data cause, likewise
    # Amplitudes of the antisymmetric component, ``D sin(gamma tau)/gamma`` or, for negative mu,
    # ``D sinh(g tau)/(g cosh g)``; left out if it has no columns, (set, frequency, mode)
    D: Floats
    # The symmetric component at tau = 0, static displacement included, or, for mu <= -1, U of
    # ``U cosh(g tau)/cosh(g)``; left out if it has no columns, (set, frequency, mode)
    U: Floats
    # Errors of the displacements at all times, in the norm of M, and of the energy; (set,
    # frequency)
    motion_error: Floats
    energy_error: Floats


class _Phases(NamedTuple):
    """The modes at one frequency, each (mode,)."""

    mu: Floats
    rest: Floats  # what rounding took from it
    uncertainty: Floats  # of mu
    # Of gamma; they mean nothing where mu is negative
    sine: Floats
    cosine: Floats
    # Over the share
    load: Floats
    load_error: Floats


class _Sums(NamedTuple):
    """The equations without borders, of n unknowns."""

    S: Floats  # (n, n)
    dS: Floats  # errors of S, (n, n)
    right: Floats  # (n, set)
    blur: Floats  # errors of the right-hand sides that the load causes, (n,)
    noise: float  # relative rounding of the terms and their sums
    loaded: bool  # whether there are static loads


class _Products(NamedTuple):
    """Products of all pairs of rows, and their errors, each (pair, mode)."""

    value: Floats
    error: Floats


class _Room(NamedTuple):
    """Room for terms, (mode,), and for lists of modes or of their components."""

    value: Floats
    change: Floats
    terms: Floats
    lost: Floats
    others: Integers  # modes that are not plain, (mode,)
    # Components near their poles and their sizes: 2 j of mode j is the antisymmetric one, 2 j + 1
    # the symmetric one; (2 mode,)
    near: Integers
    magnitude: Floats


class _Bordered(NamedTuple):
    """The equations with borders, for up to m unknowns."""

    # Each (m, m)
    A: Floats
    dA: Floats  # errors of A
    work: Floats
    inverse: Floats
    right: Floats  # (m, set)
    # Each (m,)
    scale: Floats
    b: Floats
    v: Floats
    other: Floats
    spread: Floats
    blur: Floats  # errors of the right-hand sides that the load causes
    error: Floats  # errors of the unknowns


@inner
def _is_near(parity: int, phases: _Phases, j: int) -> bool:
    """Whether the antisymmetric (0) or symmetric (1) response may be large."""
    mu = phases.mu[j]
    if parity == 0:
        return bool(mu > 0.0 and abs(phases.cosine[j]) < _NEAR)
    return bool(abs(mu) < _NEAR or (mu > 0.0 and abs(phases.sine[j]) < _NEAR))


@inner
def _is_at_pole(parity: int, phases: _Phases, j: int) -> bool:
    """Whether the response of a candidate must not even be evaluated."""
    mu = phases.mu[j]
    if parity == 0:
        return bool(abs(phases.cosine[j]) < _AT_POLE)
    # Close to mu = 0 the response -1/mu is as accurate as mu is.
    uncertain = phases.uncertainty[j] > _UNCERTAIN * abs(mu)
    if uncertain or abs(mu) < _NEAR:
        return bool(uncertain or abs(mu) < _RIGID)
    return bool(math.sqrt(mu) * abs(phases.sine[j]) < _AT_POLE)


@inner
def _response(parity: int, phases: _Phases, j: int) -> tuple[float, float]:
    """Return the response of a mode and its derivative by mu."""
    mu = phases.mu[j]
    if mu < _SOFT:
        return antisymmetric_response(mu) if parity == 0 else symmetric_response(mu)
    s, c = phases.sine[j], phases.cosine[j]
    value = (s / c if parity == 0 else -c / s) / math.sqrt(mu)
    return value, (1.0 + mu * value * value - value) / (2.0 * mu)


@inner
def _scale(modes: Modes, omega: float, omega_rest: float, phases: _Phases, terms: Floats) -> None:
    """Fill in the modes at one frequency; `terms` are room."""
    largest, over, inverse = 0.0, 1.0 / (omega * omega), 1.0 / omega
    for j in range(terms.size):
        gamma = modes.roots[j] / omega
        mu = gamma * abs(gamma)
        lost = fma(-gamma, omega, modes.roots[j]) * inverse
        phases.rest[j] = 2.0 * fma(mu, modes.rests[j] - omega_rest, abs(gamma) * lost)
        phases.mu[j], terms[j] = mu, abs(gamma)
    for j in range(terms.size):
        # Phases are known to the square of a rounding.
        phases.uncertainty[j] = modes.errors[j] * over + 8.0 * _EPS * _EPS * abs(phases.mu[j])
        phases.sine[j], phases.cosine[j] = sine_cosine(terms[j], 0.0)
    for j in range(terms.size):
        largest = max(largest, terms[j])
    if largest > LARGEST:
        for j in range(terms.size):
            phases.sine[j], phases.cosine[j] = math.sin(terms[j]), math.cos(terms[j])


@inner
def _add(
    sums: _Sums, rows: Floats, row_errors: Floats, parity: int, phases: _Phases, j: int
) -> None:
    """Add the response of mode j to the equations."""
    value, slope = _response(parity, phases, j)
    moved = slope * phases.rest[j]
    change = abs(slope) * phases.uncertainty[j] + sums.noise * abs(value)
    if value != 0.0:
        change += abs(moved / value * moved)
    value += moved
    static, loose = phases.load[j], phases.load_error[j]
    for i in range(rows.shape[0]):
        row, blur = rows[i, j], row_errors[i, j]
        for k in range(rows.shape[0]):
            product = row * rows[k, j]
            cross = abs(row) * row_errors[k, j] + blur * (abs(rows[k, j]) + row_errors[k, j])
            sums.S[i, k] += product * value
            sums.dS[i, k] += abs(product) * change + cross * abs(value)
        if parity == 1 and (static != 0.0 or loose != 0.0):
            lifted, mu = static / phases.mu[j], abs(phases.mu[j])
            spread = abs(lifted) * (sums.noise + phases.uncertainty[j] / mu) + loose / mu
            sums.blur[i] += abs(row) * spread + blur * (abs(lifted) + loose / mu)
            for k in range(sums.right.shape[1]):
                sums.right[i, k] -= row * lifted


@inner
def _evaluate_plain(parity: int, phases: _Phases, noise: float, room: _Room) -> int:
    """Evaluate the responses of all modes that are neither near their poles nor soft.

    Their values and errors, 0 of the others; list these and return their number.
    """
    mu, value, change = phases.mu, room.value, room.change
    for j in range(mu.size):
        # The response is sine/(cosine gamma), or -cosine/(sine gamma), by one division.
        s, c = phases.sine[j], phases.cosine[j]
        top, low = (s, c) if parity == 0 else (-c, s)
        plain = (mu[j] > _SOFT) & (abs(low) >= _NEAR) & ((parity == 0) | (mu[j] >= _NEAR))
        over = 1.0 / (low * mu[j]) if plain else 0.0
        response = top * math.sqrt(abs(mu[j])) * over
        value[j] = response
        change[j] = (1.0 + mu[j] * response * response - response) * (0.5 * low * over)
    # Loops apart: of many arrays none would be known to be apart from the others.
    for j in range(mu.size):
        value[j] += change[j] * phases.rest[j]
        change[j] = abs(change[j]) * phases.uncertainty[j] + noise * abs(value[j])
    count = 0
    for j in range(mu.size):
        if change[j] == 0.0:
            room.others[count] = j
            count += 1
    return count


@inner
def _add_plain(
    sums: _Sums,
    rows: Floats,
    row_errors: Floats,
    products: _Products,
    parity: int,
    phases: _Phases,
    room: _Room,
) -> int:
    """Add the responses of all modes that are neither near their poles nor soft.

    The others are listed, their number is returned.
    """
    count = _evaluate_plain(parity, phases, sums.noise, room)
    value, change, terms, place = room.value, room.change, room.terms, 0
    for i in range(rows.shape[0]):
        for k in range(i, rows.shape[0]):
            product, cross = products.value[place], products.error[place]
            for j in range(terms.size):
                terms[j] = product[j] * value[j]
            sums.S[i, k] += folded(terms)
            for j in range(terms.size):
                terms[j] = abs(product[j]) * change[j] + cross[j] * abs(value[j])
            sums.dS[i, k] += folded(terms)
            sums.S[k, i], sums.dS[k, i] = sums.S[i, k], sums.dS[i, k]
            place += 1
        if parity == 1 and sums.loaded:
            _add_loads(sums, rows[i], row_errors[i], i, phases, room)
    return count


@inner
def _add_loads(
    sums: _Sums, row: Floats, row_error: Floats, i: int, phases: _Phases, room: _Room
) -> None:
    """Take the static displacement of all these modes from the distance of a wall."""
    change, terms, mu = room.change, room.terms, phases.mu
    for j in range(terms.size):
        lifted = row[j] * phases.load[j] / mu[j]
        terms[j] = lifted if change[j] != 0.0 else 0.0
    total = folded(terms)
    for k in range(sums.right.shape[1]):
        sums.right[i, k] -= total
    for j in range(terms.size):
        size, loose = abs(phases.load[j]), phases.load_error[j]
        spread = size * (sums.noise + phases.uncertainty[j] / abs(mu[j])) + loose
        blur = (abs(row[j]) * spread + row_error[j] * (size + loose)) / abs(mu[j])
        terms[j] = blur if change[j] != 0.0 else 0.0
    sums.blur[i] += folded(terms)


@inner
def _sort(system: LinearSystem, phases: _Phases, room: _Room, count: int) -> None:
    """Sort the candidates for a border by their sizes; those at their poles come last."""
    near, magnitude = room.near, room.magnitude
    for k in range(count):
        j, parity = near[k] // 2, near[k] % 2
        rows, weight = system.antisymmetric if parity == 0 else system.symmetric, 0.0
        for i in range(rows.shape[0]):
            weight = max(weight, abs(rows[i, j]))
        weight *= weight
        size = np.inf if weight > 0.0 else 0.0
        if weight > 0.0 and not _is_at_pole(parity, phases, j):
            value, _ = _response(parity, phases, j)
            size = abs(value) * weight
        one, place = near[k], k
        while place > 0 and magnitude[place - 1] > size:
            near[place], magnitude[place] = near[place - 1], magnitude[place - 1]
            place -= 1
        near[place], magnitude[place] = one, size


@inner
def _add_mode(system: LinearSystem, sums: _Sums, parity: int, phases: _Phases, j: int) -> None:
    if parity == 0:
        _add(sums, system.antisymmetric, system.antisymmetric_errors, parity, phases, j)
    else:
        _add(sums, system.symmetric, system.symmetric_errors, parity, phases, j)


@inner
def _select_bordered(
    system: LinearSystem, sums: _Sums, phases: _Phases, room: _Room, count: int
) -> int:
    """Add the candidates that need no border, small terms first; move the others to the front.

    The number of the latter is returned.
    """
    _sort(system, phases, room, count)
    near, magnitude, kept, n = room.near, room.magnitude, 0, sums.S.shape[0]
    for k in range(count):
        if magnitude[k] == 0.0:
            continue
        # Of dominant terms, as many as there are impulses drown the others and not one another:
        # more borders would only make the system singular.
        surplus = count - k > n
        largest = 0.0
        for i in range(n):
            largest = max(largest, abs(sums.S[i, i]))
        small = surplus or magnitude[k] <= _DOMINANT * largest or largest == 0.0
        if magnitude[k] < np.inf and small:
            j, parity = near[k] // 2, near[k] % 2
            _add_mode(system, sums, parity, phases, j)
        else:
            near[kept] = near[k]
            kept += 1
    return kept


@inner
def _sum(
    system: LinearSystem,
    odd_products: _Products,
    even_products: _Products,
    sums: _Sums,
    phases: _Phases,
    room: _Room,
) -> int:
    """Sum the responses of all modes; return how many need a border, which `near` lists."""
    count = 0
    for parity in range(2):
        rows = system.antisymmetric if parity == 0 else system.symmetric
        if rows.shape[0] == 0:
            continue
        errors = system.antisymmetric_errors if parity == 0 else system.symmetric_errors
        products = odd_products if parity == 0 else even_products
        for k in range(_add_plain(sums, rows, errors, products, parity, phases, room)):
            j = room.others[k]
            if _is_near(parity, phases, j):
                room.near[count] = 2 * j + parity
                count += 1
            else:
                _add_mode(system, sums, parity, phases, j)
    return _select_bordered(system, sums, phases, room, count) if count > 0 else 0


@inner
def _begin(system: _Bordered, sums: _Sums, size: int) -> None:
    """Put the equations without borders in place."""
    n = sums.S.shape[0]
    for i in range(size):
        for k in range(size):
            within = i < n and k < n
            system.A[i, k] = sums.S[i, k] if within else 0.0
            system.dA[i, k] = sums.dS[i, k] if within else 0.0
        for k in range(sums.right.shape[1]):
            system.right[i, k] = sums.right[i, k] if i < n else 0.0
        system.blur[i] = sums.blur[i] if i < n else 0.0


@inner
def _border_load(
    system: _Bordered,
    sums: _Sums,
    n: int,
    rows: Floats,
    row_errors: Floats,
    phases: _Phases,
    j: int,
) -> None:
    """Add the static load of mode j, whose symmetric component has the equation number n.

    Near the poles sin(gamma)/gamma is next to zero, and no more accurate than its phase.
    """
    right, mu, static, rest = system.right, phases.mu[j], phases.load[j], phases.rest[j]
    turn, tilt, lift, lean = sine(mu), -1.0 / 6.0, sag(mu), 1.0 / 24.0
    if mu >= _SOFT:
        turn = phases.sine[j] / math.sqrt(mu)
        tilt, lean = (phases.cosine[j] - turn) / (2.0 * mu), abs(0.5 * turn - lift) / mu
    size, loose, unsure = abs(static), phases.load_error[j], phases.uncertainty[j]
    moved = tilt * rest
    turn += moved
    spread = sums.noise * abs(turn) + 4.0 * _EPS * abs(moved) + abs(tilt) * unsure
    system.blur[n] = size * spread + loose * abs(turn)
    spread = sums.noise * lift + lean * (unsure + abs(rest) + _EPS * abs(mu))
    for k in range(right.shape[1]):
        right[n, k] = static * turn
    for i in range(rows.shape[0]):
        row, blur = abs(rows[i, j]), row_errors[i, j]
        system.blur[i] += row * (size * spread + loose * lift) + blur * (size + loose) * lift
        for k in range(right.shape[1]):
            right[i, k] -= rows[i, j] * static * lift


@inner
def _border(
    system: _Bordered,
    sums: _Sums,
    n: int,
    rows: Floats,
    row_errors: Floats,
    parity: int,
    phases: _Phases,
    j: int,
) -> None:
    """Give mode j its own unknown and equation, number n."""
    A, dA, mu = system.A, system.dA, phases.mu[j]
    for i in range(rows.shape[0]):
        A[i, n] = A[n, i] = rows[i, j]
        dA[i, n] = dA[n, i] = sums.noise * abs(rows[i, j]) + row_errors[i, j]
    if parity == 0:
        gamma, cotangent = math.sqrt(mu), phases.cosine[j] / phases.sine[j]
        A[n, n] = -gamma * cotangent
        slope = 0.5 * (1.0 + cotangent * cotangent - cotangent / gamma)
    else:
        ratio, _ = antisymmetric_response(mu)
        if mu >= _SOFT:
            ratio = phases.sine[j] / (phases.cosine[j] * math.sqrt(mu))
        A[n, n] = mu * ratio
        slope = 0.5 * (1.0 + mu * ratio * ratio + ratio)
        _border_load(system, sums, n, rows, row_errors, phases, j)
    moved = slope * phases.rest[j]
    A[n, n] += moved
    dA[n, n] = abs(slope) * phases.uncertainty[j] + 4.0 * _EPS * abs(A[n, n]) + moved * moved


@inner
def _invert(system: _Bordered, m: int) -> bool:
    """Invert the first m rows and columns by Gauss-Jordan elimination after equilibrating them."""
    matrix, work, inverse, d = system.A, system.work, system.inverse, system.scale
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


@inner
def _times(matrix: Floats, m: int, vector: Floats, out: Floats) -> None:
    """Multiply the first m rows and columns of a matrix by a vector."""
    for i in range(m):
        total = 0.0
        for k in range(m):
            total += matrix[i, k] * vector[k]
        out[i] = total


@inner
def _solve(system: _Bordered, m: int, s: int, z: Floats, error: Floats) -> None:
    """Solve for one set of walls with the inverse; fill in impulses and their errors."""
    A, dA, inverse = system.A, system.dA, system.inverse
    b, v, other, spread = system.b, system.v, system.other, system.spread
    for i in range(m):
        b[i] = system.right[i, s]
    _times(inverse, m, b, v)
    # What is left of the right-hand side corrects the solution.
    _times(A, m, v, other)
    for i in range(m):
        other[i] = b[i] - other[i]
    _times(inverse, m, other, spread)
    for i in range(m):
        v[i] += spread[i]
    _times(A, m, v, other)
    for i in range(m):
        size = 0.0
        for k in range(m):
            size += (dA[i, k] + (m + 1) * _UNIT * abs(A[i, k])) * abs(v[k])
        spread[i] = abs(b[i] - other[i]) + size + system.blur[i] + 3.0 * _EPS * abs(b[i])
    for i in range(m):
        system.error[i] = 1e-300
        for k in range(m):
            system.error[i] += abs(inverse[i, k]) * spread[k]
    part = _contraction(system, m)
    for i in range(m):
        system.error[i] *= 1.0 / (1.0 - part) if part < 1.0 else np.inf
    for i in range(z.size):
        z[i], error[i] = v[i], system.error[i]


@inner
def _contraction(system: _Bordered, m: int) -> float:
    """Return kappa, see the module, with what the inverse misses of being one."""
    A, dA, inverse, t = system.A, system.dA, system.inverse, system.error
    largest, noise = 0.0, (m + 2) * _UNIT
    for i in range(m):
        moved = 0.0
        for k in range(m):
            missed, loose = 1.0 if i == k else 0.0, 0.0
            for j in range(m):
                missed -= inverse[i, j] * A[j, k]
                loose += abs(inverse[i, j]) * (dA[j, k] + noise * abs(A[j, k]))
            moved += (abs(missed) + loose) * t[k]
        largest = max(largest, moved / t[i])
    return largest


@inner
def _forces(rows: Floats, z: Floats, scale: float, force: Floats) -> None:
    """Fill in the modal forces of impulses z, times a scale."""
    for j in range(force.size):
        force[j] = 0.0
    for i in range(rows.shape[0]):
        row, p = rows[i], scale * z[i]
        for j in range(force.size):
            force[j] += row[j] * p


@inner
def _antisymmetric_amplitudes(phases: _Phases, force: Floats, unit: Floats) -> None:
    """Fill in D of all modes but the bordered ones, see `Solutions`."""
    mu = phases.mu
    for j in range(mu.size):
        gamma = math.sqrt(abs(mu[j]))
        oscillates = (mu[j] > 0.0) & (force[j] != 0.0)
        low = fma(phases.cosine[j], gamma, -0.5 * phases.sine[j] * phases.rest[j])
        unit[j] = force[j] * gamma / low if oscillates else force[j]


@inner
def _symmetric_amplitudes(
    phases: _Phases, force: Floats, load: Floats, omega: float, unit: Floats
) -> None:
    """Fill in U of all modes but the bordered ones, see `Solutions`."""
    mu, square, any_soft = phases.mu, omega * omega, False
    for j in range(mu.size):
        gamma, s, c = math.sqrt(abs(mu[j])), phases.sine[j], phases.cosine[j]
        low = fma(mu[j], s, 0.5 * fma(c, gamma, s) * phases.rest[j])
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
                unit[j] -= force[j] / (mu[j] * sine(mu[j]) + slope * phases.rest[j])


@inner
def _magnitudes(rows: Floats, errors: Floats, v: Floats, v_error: Floats, out: Floats) -> None:
    """Fill in errors of the modal forces ``rows . v``."""
    for j in range(out.size):
        out[j] = 0.0
    for i in range(rows.shape[0]):
        row, blur, size, error = rows[i], errors[i], abs(v[i]) + v_error[i], v_error[i]
        loose = 2.0 * _EPS * size + error
        for j in range(out.size):
            out[j] += abs(row[j]) * loose + blur[j] * size


@inner
def _amplitudes(
    modes: Modes,
    system: LinearSystem,
    phases: _Phases,
    room: _Room,
    v: Floats,
    kept: int,
    omega: float,
    D: Floats,
    U: Floats,
) -> None:
    """Fill in the amplitudes that unknowns v cause, which are those of `kept` modes themselves."""
    scale, n = system.share / (omega * omega), system.walls.shape[1]
    if D.size > 0:
        _forces(system.antisymmetric, v, scale, room.terms)
        _antisymmetric_amplitudes(phases, room.terms, D)
    if U.size > 0:
        _forces(system.symmetric, v, scale, room.terms)
        _symmetric_amplitudes(phases, room.terms, modes.load, omega, U)
    for k in range(kept):
        j, place = room.near[k] // 2, v[n + k] * scale
        mu, s, c = phases.mu[j], phases.sine[j], phases.cosine[j]
        # The digits of a large phase are in its sine and cosine and in the rest, not in mu.
        gamma = math.sqrt(abs(mu))
        turned = 0.5 * phases.rest[j] / gamma if mu >= _SOFT else 0.0
        if room.near[k] % 2 == 0 and D.size > 0:
            D[j] = place * gamma / (s + c * turned)
        elif room.near[k] % 2 == 1 and U.size > 0:
            U[j] = place / (c - s * turned if mu >= _SOFT else cosine(mu))


@inner
def _odd_errors(
    system: LinearSystem, phases: _Phases, room: _Room, bordered: _Bordered, kept: int,
    scale: float, D: Floats, out: Floats,
) -> None:  # fmt: skip
    """Fill in errors of the amplitudes D, roundings of the phase apart."""
    mu, n = phases.mu, system.walls.shape[1]
    force = room.value
    _magnitudes(
        system.antisymmetric, system.antisymmetric_errors, bordered.v, bordered.error, force
    )
    for j in range(mu.size):
        low = 1.0
        if mu[j] > _SOFT:
            turned = 0.5 * phases.rest[j] / math.sqrt(mu[j])
            low = abs(phases.cosine[j] - phases.sine[j] * turned)
        steep = phases.uncertainty[j] / low
        out[j] = scale * force[j] / low + abs(D[j]) * (steep / low + 3.0 * _EPS)
    for k in range(kept):
        if room.near[k] % 2 == 0:
            j = room.near[k] // 2
            low = abs(sine(mu[j]))
            out[j] = bordered.error[n + k] * scale / low + abs(D[j]) * (
                3.0 * _EPS + phases.uncertainty[j] / low
            )


@inner
def _even_errors(
    system: LinearSystem, phases: _Phases, room: _Room, bordered: _Bordered, kept: int,
    scale: float, U: Floats, out: Floats,
) -> None:  # fmt: skip
    """Fill in errors of the amplitudes U, and of static displacements."""
    mu, n = phases.mu, system.walls.shape[1]
    force = room.value
    _magnitudes(system.symmetric, system.symmetric_errors, bordered.v, bordered.error, force)
    for j in range(mu.size):
        size, low, change = abs(mu[j]), 1.0, phases.uncertainty[j]
        if mu[j] > _SOFT:
            turned = 0.5 * phases.cosine[j] * phases.rest[j]
            low = abs(phases.sine[j] * math.sqrt(size) + turned)
        elif mu[j] >= 0.0:
            low = 0.5 * size
        elif mu[j] < 0.0:
            low = min(size, math.sqrt(size))
        lifted = scale * (phases.load_error[j] + abs(phases.load[j]) * (3.0 * _EPS + change / size))
        moved = abs(U[j]) + scale * abs(phases.load[j]) / size
        steep = change * (1.0 + size) / min(low, size) + 3.0 * _EPS
        out[j] = scale * force[j] / low + lifted / size + moved * steep
        if U[j] == 0.0 and force[j] == 0.0 and phases.load_error[j] == 0.0:
            out[j] = 0.0
    for k in range(kept):
        if room.near[k] % 2 == 1:
            j = room.near[k] // 2
            low, load = abs(cosine(mu[j])), scale * abs(phases.load[j])
            loose = phases.load_error[j] * scale + load * (3.0 * _EPS + phases.uncertainty[j])
            out[j] = (
                bordered.error[n + k] * scale / low
                + loose
                + abs(U[j]) * (3.0 * _EPS + phases.uncertainty[j] / low)
            )


@sums
def _motion_errors(
    modes: Modes, system: LinearSystem, phases: _Phases, room: _Room, bordered: _Bordered,
    kept: int, omega: float, D: Floats, U: Floats,
) -> tuple[float, float]:  # fmt: skip
    """Return errors of the motion in the norm of M and of its energy."""
    scale, n = system.share / (omega * omega), modes.roots.size
    squares, sizes, errors, mu = room.terms, room.change, room.lost, phases.mu
    energy, rounding = 0.0, (n + 4) * _UNIT
    summed = 3.0 + 0.5 * math.log2(n + 1.0)
    for j in range(n):
        squares[j], sizes[j] = 0.0, 0.0
    if D.size > 0:
        _odd_errors(system, phases, room, bordered, kept, scale, D, errors)
        for j in range(n):
            gamma = math.sqrt(abs(mu[j]))
            least = 1.0 / max(1.0, gamma)
            sizes[j] = abs(D[j]) * least
            blur = errors[j] * least + 3.0 * _EPS * abs(D[j])
            squares[j] = blur
            energy += omega * omega * abs(D[j]) * (errors[j] + summed * _EPS * abs(D[j]))
    if U.size > 0:
        _even_errors(system, phases, room, bordered, kept, scale, U, errors)
        for j in range(n):
            gamma = math.sqrt(abs(mu[j]))
            load, stiff = abs(modes.load[j]), abs(mu[j]) * omega * omega
            static = load / (omega * omega) * min(0.5, 2.0 / max(abs(mu[j]), 1e-200))
            sizes[j] += abs(U[j]) + static
            squares[j] += errors[j] + 3.0 * _EPS * ((1.0 + gamma) * abs(U[j]) + static)
            change = errors[j] + summed * _EPS * abs(U[j])
            energy += (stiff * abs(U[j]) + load) * change + modes.load_errors[j] * abs(U[j])
            energy += 0.5 * modes.errors[j] * U[j] * U[j]
    total, size = 0.0, 0.0
    for j in range(n):
        turned = sizes[j] * modes.angles[j]
        total += squares[j] * squares[j] + n * turned * turned
        size += sizes[j] * sizes[j]
    return 1.5 * math.sqrt(total) + rounding * math.sqrt(size), energy


@inner
def _fill(values: Floats, number: float) -> None:
    for j in range(values.size):
        values[j] = number


@inner
def _multiply(rows: Floats, errors: Floats, products: _Products) -> None:
    """Fill in the products of all pairs of rows."""
    place = 0
    for i in range(rows.shape[0]):
        for k in range(i, rows.shape[0]):
            for j in range(rows.shape[1]):
                products.value[place, j] = rows[i, j] * rows[k, j]
                products.error[place, j] = (
                    abs(rows[i, j]) * errors[k, j] + errors[i, j] * abs(rows[k, j])
                ) + errors[i, j] * errors[k, j]
            place += 1


@kernel
def solutions(
    modes: Modes, system: LinearSystem, omega: Floats, omega_rests: Floats, first: int,
    into: Solutions,
) -> None:  # fmt: skip
    """Compute impulses and modal amplitudes, for several sets of walls at once.

    The sets share all but the right-hand sides, which is computed once for each frequency; the
    numbers of a set do not depend on the others.

    Parameters
    ----------
    modes : Modes
    system : LinearSystem
    omega : array, shape (frequency,)
        Triangle-wave frequencies.
    omega_rests : array, shape (frequency,)
        What rounding took from them, relative to them.
    first : int
        Where the results of the first frequency belong.
    into : Solutions
        Receives the results.
    """
    (sets, n), count, m = system.walls.shape, modes.roots.size, 0
    odd, even = system.antisymmetric.shape[0], system.symmetric.shape[0]
    odd, even = odd * (odd + 1) // 2, even * (even + 1) // 2
    odd_products = _Products(np.empty((odd, count)), np.empty((odd, count)))
    even_products = _Products(np.empty((even, count)), np.empty((even, count)))
    _multiply(system.antisymmetric, system.antisymmetric_errors, odd_products)
    _multiply(system.symmetric, system.symmetric_errors, even_products)
    phases = _Phases(
        np.empty(count), np.empty(count), np.empty(count), np.empty(count), np.empty(count),
        np.empty(count), np.empty(count),
    )  # fmt: skip
    room = _Room(
        np.empty(count), np.empty(count), np.empty(count), np.empty(count),
        np.empty(count, np.int64),
        np.empty(2 * count, np.int64), np.empty(2 * count),
    )  # fmt: skip
    loaded = False
    for j in range(count):
        phases.load[j] = modes.load[j] / system.share
        phases.load_error[j] = modes.load_errors[j] / system.share
        loaded |= modes.load[j] != 0.0 or modes.load_errors[j] != 0.0
    # Roundings of a term, and of sums that are folded.
    noise = (3.0 + 0.5 * math.log2(count + 1.0)) * _EPS
    sums = _Sums(
        np.empty((n, n)), np.empty((n, n)), np.empty((n, sets)), np.empty(n), noise, loaded
    )
    for f in range(omega.size):
        _scale(modes, omega[f], omega_rests[f], phases, room.terms)
        for i in range(n):
            sums.blur[i] = 0.0
            for k in range(n):
                sums.S[i, k], sums.dS[i, k] = 0.0, 0.0
            for s in range(sets):
                sums.right[i, s] = system.walls[s, i] * (omega[f] * omega[f] / system.share)
        kept = _sum(system, odd_products, even_products, sums, phases, room)
        if f == 0 or n + kept > m:
            m = n + kept + 4
            bordered = _Bordered(
                np.empty((m, m)), np.empty((m, m)), np.empty((m, m)), np.empty((m, m)),
                np.empty((m, sets)),
                np.empty(m), np.empty(m), np.empty(m), np.empty(m), np.empty(m), np.empty(m),
                np.empty(m),
            )  # fmt: skip
        _begin(bordered, sums, n + kept)
        for k in range(kept):
            parity = room.near[k] % 2
            rows = system.antisymmetric if parity == 0 else system.symmetric
            errors = system.antisymmetric_errors if parity == 0 else system.symmetric_errors
            _border(bordered, sums, n + k, rows, errors, parity, phases, room.near[k] // 2)
        sound = _invert(bordered, n + kept)
        for s in range(sets):
            z, error = into.z[s, first + f], into.error[s, first + f]
            D, U = into.D[s, first + f], into.U[s, first + f]
            if sound:
                _solve(bordered, n + kept, s, z, error)
                _amplitudes(modes, system, phases, room, bordered.v, kept, omega[f], D, U)
                motion_error, energy_error = _motion_errors(
                    modes, system, phases, room, bordered, kept, omega[f], D, U
                )
                into.motion_error[s, first + f] = motion_error
                into.energy_error[s, first + f] = energy_error
            else:
                into.motion_error[s, first + f] = into.energy_error[s, first + f] = np.inf
                _fill(z, np.nan)
                _fill(error, np.inf)
                _fill(D, 0.0)
                _fill(U, 0.0)
