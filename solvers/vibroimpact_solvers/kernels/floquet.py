"""Floquet multipliers of a structure of many modes that few impacts couple.

Between impacts each mode moves by itself, by a matrix of two rows. Impacts couple them through as
many numbers as an impact has rows in its saltation matrix: two. With m impacts the multipliers are
the zeros of ``det F(rho)``, F having 2 m rows, each entry a sum over the modes with their traces t
and determinants q over the cell,

    F_IJ = 1_IJ - rho^(0 or 1) sum_p (rho A_IJp + B_IJp) / (rho^2 - t_p rho + q_p).

``P = det F prod_p (rho^2 - t_p rho + q_p)`` is a polynomial with as many zeros as there are
multipliers. `zeros` approximates all of them at once: Ehrlich's and Aberth's method is Newton's,
with the other approximations divided out,

    z_k -= 1 / (P'/P - sum_(j /= k) 1 / (z_k - z_j)),

from the modes' own multipliers, moved by what impacts do to each mode alone. `refine` makes them
exact to rounding, and tells the effect of errors.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.kernels.jit import inner, kernel, sums

Complexes = NDArray[np.complex128]

A_PART: Final = 0
B_PART: Final = 1

_STEPS = 6  # of Newton's method
_SWEEPS = 60  # over all zeros
_SETTLED = 1e-8  # relative correction after which a zero is left: it is then far smaller
_SLIGHT = 1e-3  # angle by which approximations start off the real axis, where pairs may be born
_FARTHEST = 0.01  # of a multiplier, relative to it, that an approximation starts from it
_TOGETHER = 5  # sweeps in which those that start conjugate stay so, as most zeros are
_REAL = 1e-9  # of a multiplier, below which its imaginary part is rounding
_TINY = 1e-60  # of a multiplier beside the largest: nothing is left of it


class Cells(NamedTuple):
    """Cells of solutions with m impacts each."""

    trace: Floats  # (solution, mode): t
    determinant: Floats  # (solution, mode): q
    terms: Floats  # (solution, 2 m, 2 m, 2, mode): A and B
    doubt: Floats  # (solution, 2 m, 2 m, mode): error of rho A + B is doubt (|rho| + size)
    late: Floats  # (solution, m): error of column 2 j + 1, relative to 1 - column 2 j
    size: Floats  # (solution, mode): moduli of the modes' own multipliers
    inexact: Floats  # (solution, mode): their relative errors


class Room(NamedTuple):
    """Room for scratch of one solution."""

    real: Floats  # (mode,): 1 / (rho^2 - t rho + q)
    imaginary: Floats
    real_rate: Floats  # (mode,): (2 rho - t) / (rho^2 - t rho + q)^2
    imaginary_rate: Floats
    F: Complexes  # (2 m, 2 m)
    slope: Complexes  # (2 m, 2 m): its derivative
    minor: Complexes  # (2 m, 2 m)
    spread: Floats  # (2 m, 2 m): error of F
    x: Floats  # (2 mode,): real parts of all approximations
    y: Floats


@inner
def _determinant(matrix: Complexes, n: int) -> complex:
    """Return the determinant of the first n rows and columns, which are overwritten."""
    value = complex(1.0, 0.0)
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(matrix[i, k]) > abs(matrix[pivot, k]):
                pivot = i
        if matrix[pivot, k] == 0.0:
            return complex(0.0, 0.0)
        if pivot != k:
            value = -value
            for j in range(k, n):
                swapped = matrix[k, j]
                matrix[k, j] = matrix[pivot, j]
                matrix[pivot, j] = swapped
        value *= matrix[k, k]
        for i in range(k + 1, n):
            factor = matrix[i, k] / matrix[k, k]
            for j in range(k + 1, n):
                matrix[i, j] -= factor * matrix[k, j]
    return value


@sums
def _set_inverses(c: Cells, s: int, rho: complex, room: Room) -> complex:
    """Fill in inverses and their rates; return the logarithmic derivative of their product.

    Where rho is a multiplier of a mode itself, a number of the size of rounding is inverted.
    """
    x, y = rho.real, rho.imag
    least = EPS * (x * x + y * y)
    total, total_imaginary = 0.0, 0.0
    for p in range(room.real.size):
        trace = c.trace[s, p]
        u = (x * x - y * y) - trace * x + c.determinant[s, p]
        v = (2.0 * x - trace) * y
        length = u * u + v * v
        near = length < least * least
        u, v, length = (least, 0.0, least * least) if near else (u, v, length)
        u, v = u / length, -v / length
        room.real[p], room.imaginary[p] = u, v
        a, b = 2.0 * x - trace, 2.0 * y
        a, b = a * u - b * v, a * v + b * u
        total += a
        total_imaginary += b
        room.real_rate[p], room.imaginary_rate[p] = a * u - b * v, a * v + b * u
    return complex(total, total_imaginary)


@sums
def _entry(a: Floats, b: Floats, room: Room) -> tuple[complex, complex, complex, complex]:
    """Return the sums of a and b along the inverses, and of both along their rates."""
    first, second, third, fourth = 0.0, 0.0, 0.0, 0.0
    fifth, sixth, seventh, eighth = 0.0, 0.0, 0.0, 0.0
    for p in range(a.size):
        first += a[p] * room.real[p]
        second += a[p] * room.imaginary[p]
        third += b[p] * room.real[p]
        fourth += b[p] * room.imaginary[p]
        fifth += a[p] * room.real_rate[p]
        sixth += a[p] * room.imaginary_rate[p]
        seventh += b[p] * room.real_rate[p]
        eighth += b[p] * room.imaginary_rate[p]
    level, rest = complex(first, second), complex(third, fourth)
    return level, rest, complex(fifth, sixth), complex(seventh, eighth)


@inner
def _set_F(c: Cells, s: int, rho: complex, room: Room) -> complex:
    """Fill in F and its derivative; return P'/P without the part of det F."""
    n = room.F.shape[0]
    poles = _set_inverses(c, s, rho, room)
    for i in range(n):
        for j in range(n):
            a, b = c.terms[s, i, j, A_PART], c.terms[s, i, j, B_PART]
            level, rest, a_rate, b_rate = _entry(a, b, room)
            whole = rho * level + rest
            slope = level - rho * a_rate - b_rate
            if i // 2 > j // 2:
                slope = rho * slope + whole
                whole *= rho
            room.F[i, j] = (1.0 if i == j else 0.0) - whole
            room.slope[i, j] = -slope
    return poles


@inner
def _set_spread(c: Cells, s: int, rho: complex, room: Room) -> None:
    """Fill in the error of F, of which the inverses are there."""
    n, size = room.F.shape[0], abs(rho)
    for i in range(n):
        for j in range(n):
            a, b = c.terms[s, i, j, A_PART], c.terms[s, i, j, B_PART]
            spread = 0.0
            for p in range(a.size):
                length, own = math.hypot(room.real[p], room.imaginary[p]), size + c.size[s, p]
                value = math.hypot(rho.real * a[p] + b[p], rho.imag * a[p]) * length
                near = 2.0 * c.size[s, p] * c.inexact[s, p] * own * length
                spread += c.doubt[s, i, j, p] * own * length + value * near
            room.spread[i, j] = spread * size if i // 2 > j // 2 else spread


@inner
def _cofactor(room: Room, i: int, j: int) -> complex:
    n, row = room.F.shape[0], 0
    if n == 2:  # one impact: most are asked for this
        only = complex(room.F[1 - i, 1 - j])
        return only if i == j else -only
    for k in range(n):
        if k == i:
            continue
        column = 0
        for q in range(n):
            if q != j:
                room.minor[row, column] = room.F[k, q]
                column += 1
        row += 1
    value = _determinant(room.minor, n - 1)
    return value if (i + j) % 2 == 0 else -value


@inner
def _newton(room: Room) -> complex:
    """Return the step of Newton's method for det F."""
    n = room.F.shape[0]
    along, value = complex(0.0, 0.0), complex(0.0, 0.0)
    for i in range(n):
        for j in range(n):
            cofactor = _cofactor(room, i, j)
            along += cofactor * room.slope[i, j]
            if i == 0:
                value += cofactor * room.F[i, j]
    return complex(math.inf, 0.0) if along == 0.0 else -value / along


@inner
def _effect(c: Cells, s: int, room: Room) -> float:
    """Return what errors of F do to a zero of det F.

    An error ``late`` of the acceleration adds as much of the column before, less 1 in its own
    row, to a column. The determinant with the column before in place of this one vanishes, so
    that the 1 is what is left.
    """
    n = room.F.shape[0]
    along, doubt = complex(0.0, 0.0), 0.0
    for i in range(n):
        for j in range(n):
            cofactor = _cofactor(room, i, j)
            along += cofactor * room.slope[i, j]
            doubt += abs(cofactor) * room.spread[i, j]
            if j == i + 1 and j % 2 == 1:
                doubt += abs(cofactor) * c.late[s, j // 2]
    return math.inf if along == 0.0 else doubt / abs(along)


@inner
def _start(c: Cells, s: int, values: Complexes) -> float:
    """Fill in the modes' own multipliers, moved by their impacts; return the largest modulus."""
    modes, n, largest = c.trace.shape[1], c.terms.shape[1], 0.0
    for p in range(modes):
        half = 0.5 * c.trace[s, p]
        square = half * half - c.determinant[s, p]
        root = complex(math.sqrt(max(square, 0.0)), math.sqrt(max(-square, 0.0)))
        # The smaller one of two real ones is what the product leaves.
        outer = half + root if half >= 0.0 else half - root
        other = complex(half, -outer.imag)
        if square >= 0.0:
            other = complex(c.determinant[s, p] / outer.real if outer.real != 0.0 else 0.0, 0.0)
        a, b = 0.0, 0.0
        for i in range(n):
            a += c.terms[s, i, i, A_PART, p]
            b += c.terms[s, i, i, B_PART, p]
        for half_plane in range(2):
            own, far = (outer, other) if half_plane == 0 else (other, outer)
            farthest = _FARTHEST * abs(own)
            shift, apart = own * a + b, own - far
            moved = complex(farthest, 0.0)
            if abs(shift) < farthest * abs(apart):
                moved = shift / apart
            elif apart != 0.0 and shift != 0.0:
                moved = shift / apart * (farthest * abs(apart) / abs(shift))
            angle = _SLIGHT * (1.0 if half_plane == 0 else -1.0)
            values[2 * p + half_plane] = (own + moved) * complex(1.0, angle)
            largest = max(largest, abs(own))
    return largest


@sums
def _others(x: Floats, y: Floats, k: int) -> complex:
    """Return the sum of ``1 / (z_k - z_j)`` over all other approximations z = x + i y."""
    total, total_imaginary = 0.0, 0.0
    for j in range(x.size):
        u, v = x[k] - x[j], y[k] - y[j]
        length = u * u + v * v
        weight = 1.0 / (length if length > 0.0 else math.inf)  # itself, and equal ones
        total += u * weight
        total_imaginary -= v * weight
    return complex(total, total_imaginary)


@kernel
def zeros(c: Cells, values: Complexes, room: Room) -> None:
    """Approximate all multipliers of solutions.

    Parameters
    ----------
    c : Cells
    values : array, shape (solution, 2 mode)
        Filled in; some of those far below the largest one are left at zero. All those of a
        solution are nan where some did not come to rest.
    room : Room
    """
    count = values.shape[1]
    active = np.empty(count, np.bool_)
    for s in range(values.shape[0]):
        z = values[s]
        tiny = _TINY * _start(c, s, z)
        for k in range(count):
            active[k] = not abs(z[k]) <= tiny
            if not active[k]:
                z[k] = complex(0.0, 0.0)
            room.x[k], room.y[k] = z[k].real, z[k].imag
        for sweep in range(_SWEEPS):
            left = 0
            for k in range(count):
                if not active[k]:
                    continue
                other = k ^ 1
                conjugate = sweep < _TOGETHER and z[other] == z[k].conjugate()
                if conjugate and k > other:
                    continue
                poles = _set_F(c, s, z[k], room)
                step, change = _newton(room), complex(0.0, 0.0)
                if step != 0.0:
                    total = poles - 1.0 / step - _others(room.x, room.y, k)
                    change = 1.0 / total if total != 0.0 else complex(math.inf, 0.0)
                    if not abs(change) < math.inf:
                        change = complex(0.0, _SLIGHT) * z[k]
                z[k] -= change
                room.x[k], room.y[k] = z[k].real, z[k].imag
                active[k] = abs(change) > _SETTLED * abs(z[k])
                left += int(active[k])
                if conjugate:
                    z[other], active[other] = z[k].conjugate(), active[k]
                    room.x[other], room.y[other] = z[k].real, -z[k].imag
            if left == 0:
                break
        else:
            z[:] = complex(math.nan, math.nan)


@kernel
def refine(c: Cells, close: float, values: Complexes, errors: Floats, room: Room) -> None:
    """Refine approximate multipliers, and estimate their errors to first order.

    Parameters
    ----------
    c : Cells
    close : float
        How far values may be off, relative to them.
    values : array, shape (solution, value)
        Refined in place.
    errors : array, shape (solution, value)
        Filled in; that of values which are farther off is at least how far Newton's step goes.
    room : Room
    """
    for s in range(values.shape[0]):
        largest = 0.0
        for k in range(values.shape[1]):
            largest = max(largest, abs(values[s, k]))
        for k in range(values.shape[1]):
            rho = values[s, k]
            if rho == 0.0:
                errors[s, k] = _TINY * largest
                continue
            if abs(rho.imag) < _REAL * abs(rho):
                rho = complex(rho.real, 0.0)
            _set_F(c, s, rho, room)
            step = _newton(room)
            far = close * abs(rho)
            for _ in range(_STEPS):
                if not abs(step) < far or abs(step) <= EPS * abs(rho):
                    break
                far = 0.5 * abs(step)
                rho = rho + step
                _set_F(c, s, rho, room)
                step = _newton(room)
            _set_spread(c, s, rho, room)
            values[s, k] = rho
            errors[s, k] = _effect(c, s, room) + abs(step) + 4.0 * EPS * abs(rho)
