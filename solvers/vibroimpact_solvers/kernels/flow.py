"""The exact flow of a linear structure in normal form, and derivatives of coordinates along it.

The state is a set of pairs z_j = (z1, z2), one pair for each mode or pair of complex modes:

- *rotations* ``z' = [[alpha, nu], [-nu, alpha]] z``, underdamped and undamped modes;
- *hyperbolas* ``z' = [[alpha, nu], [nu, alpha]] z``, overdamped and unstable ones;
- *parabolas* ``z' = [[alpha, 1], [0, alpha]] z + (0, push)``, rigid-body and critical ones.

A mode ``q'' + 2 delta q' + lambda q = push`` has alpha = -delta, z1 = nu q (q for parabolas)
and z2 = q' + delta q. Rotations come first, then hyperbolas, then parabolas.

A flow is the array F, shape (4 + 2 drive, pair), with rows alpha, nu, rest and push, where
nu + rest is nu to more than double precision, and split = [rotations, rotations + hyperbolas,
damped]. With w = z1 - i z2, a rotation is ``w' = (alpha + i nu) w``. Another one, with all but
the same rate, may drive it: ``w' = (alpha + i nu) w + kappa l``, where l is the w of a load in
resonance with a mode, or of a mode that damping makes almost equal to it. Two more rows describe
each such drive: first the indices of w and l, then the real and the imaginary part of kappa.

States stand in arrays Z of shape (states, 2, pair), each named by its index c. Linear forms
stand in an array of shape (4, watched, 2, pair): the watched coordinates, their velocities, the
changes of state by unit impulses, and the rates of these; `sizes`, shape (3, watched, pair),
holds |form_j| rate_j^n for the two derivatives n that are bounded (`passages.ORDER` and
`passages.LOW`), and |form_j| between.

Arrays are passed whole and indexed in place, and none is made (`jit.inner`).
"""

from __future__ import annotations

import math
from typing import Any

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.jit import fma, inline, inner
from vibroimpact_solvers.kernels.phases import sine_cosine

_LONG = 32  # pairs from which on sums for velocities at impacts are worth exact ones
_VERY_LONG = 256  # and those for the coordinates whose passages are searched for


@inner
def propagators(F: Floats, split: Integers, s: float, ds: float, P: Floats) -> None:
    """Fill in the propagators of states by a time s + ds, two numbers for every pair.

    Parameters
    ----------
    F, split : array
        See the module.
    s, ds : float
        The time and what rounding took from it.
    P : array, shape (2, pair)
        Rotations: e^(alpha s) (cos nu s, sin nu s); hyperbolas: with cosh and sinh; parabolas:
        e^(alpha s) (1, s).
    """
    for j in range(split[0]):
        phase = F[1, j] * s
        lost = fma(F[1, j], s, -phase)
        P[1, j], P[0, j] = sine_cosine(phase, fma(F[1, j], ds, fma(F[2, j], s, lost)))
    if split[2]:
        for j in range(split[0]):
            decay = math.exp(F[0, j] * s + F[0, j] * ds)
            P[1, j] *= decay
            P[0, j] *= decay
    time = s + ds
    for j in range(split[0], split[1]):
        slow = math.exp((F[0, j] - F[1, j]) * time)
        twice = math.expm1(2.0 * F[1, j] * time)
        P[1, j] = 0.5 * slow * twice
        P[0, j] = slow + P[1, j]
    for j in range(split[1], F.shape[1]):
        P[0, j] = math.exp(F[0, j] * time)
        P[1, j] = P[0, j] * time


@inline
def take(
    F: Floats, split: Integers, P: Floats, s: float, Z: Floats, c: int, out: Floats, o: int
) -> None:
    """Fill in the state Z[c], propagated by the time s that P belongs to, as out[o].

    Only Z[0] is a state that constant loads act on; the others are deviations.
    """
    for j in range(split[0]):
        a, b = Z[c, 0, j], Z[c, 1, j]
        out[o, 0, j] = fma(P[0, j], a, P[1, j] * b)
        out[o, 1, j] = fma(P[0, j], b, -(P[1, j] * a))
    for j in range(split[0], split[1]):
        a, b = Z[c, 0, j], Z[c, 1, j]
        out[o, 0, j] = P[0, j] * a + P[1, j] * b
        out[o, 1, j] = P[0, j] * b + P[1, j] * a
    for j in range(split[1], F.shape[1]):
        a, b = Z[c, 0, j], Z[c, 1, j]
        out[o, 0, j] = P[0, j] * a + P[1, j] * b
        out[o, 1, j] = P[0, j] * b
        if c == 0:
            out[o, 0, j] += 0.5 * F[3, j] * s * s
            out[o, 1, j] += F[3, j] * s
    for row in range(4, F.shape[0], 2):
        first, second = _drive(F, P, row, s, Z, c)
        j = int(F[row, 0])
        out[o, 0, j] += first
        out[o, 1, j] += second


@inner
def _drive(F: Floats, P: Floats, row: int, s: float, Z: Floats, c: int) -> tuple[float, float]:
    """Return what a drive adds to its pair in a time s.

    ``kappa l (e^(rho s) - e^(sigma s)) / (rho - sigma)``, rho being the rate of the driving pair,
    also where the denominator is small or zero: ``kappa l s e^(sigma s) (e^z - 1) / z``, z being
    s times the denominator.
    """
    j, k = int(F[row, 0]), int(F[row, 1])
    x = (F[0, k] - F[0, j]) * s
    y = ((F[1, k] - F[1, j]) + (F[2, k] - F[2, j])) * s
    real, imaginary = 1.0 + 0.5 * x, 0.5 * y
    square = x * x + y * y
    if square > 1e-18:
        half = math.sin(0.5 * y)
        a = math.expm1(x) * math.cos(y) - 2.0 * half * half
        b = math.exp(x) * math.sin(y)
        real, imaginary = (a * x + b * y) / square, (b * x - a * y) / square
    # times s kappa, then the load, then e^(sigma s)
    u, v = s * F[row + 1, 0], s * F[row + 1, 1]
    real, imaginary = real * u - imaginary * v, real * v + imaginary * u
    u, v = Z[c, 0, k], -Z[c, 1, k]
    real, imaginary = real * u - imaginary * v, real * v + imaginary * u
    return real * P[0, j] - imaginary * P[1, j], -(real * P[1, j] + imaginary * P[0, j])


@inner
def _driven(F: Floats, row: int, forms: Floats, i: int, Z: Floats, c: int, d: Floats) -> None:
    """Add what a drive does to derivatives of a coordinate."""
    j, k = int(F[row, 0]), int(F[row, 1])
    alpha, nu = F[0, j], F[1, j]
    a, b = Z[c, 0, k], -Z[c, 1, k]
    # kappa rho^n l, and the sum of all that it and its predecessors have become.
    u, v = F[row + 1, 0] * a - F[row + 1, 1] * b, F[row + 1, 0] * b + F[row + 1, 1] * a
    real, imaginary = u, v
    for n in range(1, d.size):
        d[n] += forms[0, i, 0, j] * real - forms[0, i, 1, j] * imaginary
        u, v = F[0, k] * u - F[1, k] * v, F[0, k] * v + F[1, k] * u
        grown = alpha * real - nu * imaginary + u
        imaginary = alpha * imaginary + nu * real + v
        real = grown


@inline
def rates(F: Floats, split: Integers, Z: Floats, c: int, out: Floats, o: int) -> None:
    """Fill in the rate of the state Z[c], pushes included, as out[o]."""
    for j in range(split[0]):
        a, b = Z[c, 0, j], Z[c, 1, j]
        out[o, 0, j] = F[0, j] * a + F[1, j] * b
        out[o, 1, j] = F[0, j] * b - F[1, j] * a
    for j in range(split[0], split[1]):
        a, b = Z[c, 0, j], Z[c, 1, j]
        out[o, 0, j] = F[0, j] * a + F[1, j] * b
        out[o, 1, j] = F[0, j] * b + F[1, j] * a
    for j in range(split[1], F.shape[1]):
        a, b = Z[c, 0, j], Z[c, 1, j]
        out[o, 0, j] = F[0, j] * a + b
        out[o, 1, j] = F[0, j] * b + F[3, j]
    for row in range(4, F.shape[0], 2):
        j, k = int(F[row, 0]), int(F[row, 1])
        a, b = Z[c, 0, k], -Z[c, 1, k]
        out[o, 0, j] += F[row + 1, 0] * a - F[row + 1, 1] * b
        out[o, 1, j] -= F[row + 1, 0] * b + F[row + 1, 1] * a


@inline
def product(forms: Floats, kind: int, i: int, Z: Floats, c: int) -> float:
    """Return the value of the linear form forms[kind, i] at the state Z[c]."""
    s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
    t0, t1, t2, t3 = 0.0, 0.0, 0.0, 0.0
    n = Z.shape[2]
    whole = n - n % 4
    for j in range(0, whole, 4):
        s0 += forms[kind, i, 0, j] * Z[c, 0, j]
        s1 += forms[kind, i, 0, j + 1] * Z[c, 0, j + 1]
        s2 += forms[kind, i, 0, j + 2] * Z[c, 0, j + 2]
        s3 += forms[kind, i, 0, j + 3] * Z[c, 0, j + 3]
        t0 += forms[kind, i, 1, j] * Z[c, 1, j]
        t1 += forms[kind, i, 1, j + 1] * Z[c, 1, j + 1]
        t2 += forms[kind, i, 1, j + 2] * Z[c, 1, j + 2]
        t3 += forms[kind, i, 1, j + 3] * Z[c, 1, j + 3]
    for j in range(whole, n):
        s0 += forms[kind, i, 0, j] * Z[c, 0, j]
        t0 += forms[kind, i, 1, j] * Z[c, 1, j]
    return ((s0 + t0) + (s1 + t1)) + ((s2 + t2) + (s3 + t3))


@inline
def _added(total: float, lost: float, factor: float, value: float) -> tuple[float, float]:
    """Return total + factor value rounded, and lost with what rounding took from it."""
    high = factor * value
    grown = total + high
    part = grown - total
    lost += (total - (grown - part)) + (high - part) + fma(factor, value, -high)
    return grown, lost


@inline
def exact_product(forms: Floats, kind: int, i: int, Z: Floats, c: int) -> tuple[float, float]:
    """Return what `product` does and, of long forms, what rounding took from it (Dot2).

    The roundings of `product` are the same at every impact of a periodic motion, and so is what
    they take from its energy; in sums of few numbers they are no more than other roundings.
    """
    n = Z.shape[2]
    if n < _LONG:
        return product(forms, kind, i, Z, c), 0.0
    s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
    l0, l1, l2, l3 = 0.0, 0.0, 0.0, 0.0
    for j in range(0, n - n % 2, 2):
        s0, l0 = _added(s0, l0, forms[kind, i, 0, j], Z[c, 0, j])
        s1, l1 = _added(s1, l1, forms[kind, i, 0, j + 1], Z[c, 0, j + 1])
        s2, l2 = _added(s2, l2, forms[kind, i, 1, j], Z[c, 1, j])
        s3, l3 = _added(s3, l3, forms[kind, i, 1, j + 1], Z[c, 1, j + 1])
    for j in range(n - n % 2, n):
        s0, l0 = _added(s0, l0, forms[kind, i, 0, j], Z[c, 0, j])
        s2, l2 = _added(s2, l2, forms[kind, i, 1, j], Z[c, 1, j])
    s0, l0 = _added(s0, l0, 1.0, s1)
    s2, l2 = _added(s2, l2, 1.0, s3)
    s0, l0 = _added(s0, l0, 1.0, s2)
    lost = (l0 + l1) + (l2 + l3)
    total = s0 + lost
    return total, lost - (total - s0)


@inline
def _start(F: Floats, split: Integers, forms: Floats, i: int, Z: Floats, c: int, j: int) -> Any:
    """Return the part of a coordinate that pair j makes, its rate, 2 alpha and their product.

    Every pair obeys ``y'' = 2 alpha y' - (alpha^2 +- nu^2) y``.
    """
    sign = 1.0 if j < split[0] else (-1.0 if j < split[1] else 0.0)
    turn = F[1, j] if j < split[1] else 1.0
    first, second, alpha = forms[0, i, 0, j], forms[0, i, 1, j], F[0, j]
    a = first * Z[c, 0, j] + second * Z[c, 1, j]
    b = alpha * a + turn * (first * Z[c, 1, j] - sign * second * Z[c, 0, j])
    return a, b, 2.0 * alpha, -(alpha * alpha + sign * turn * turn)


@inline
def _push(F: Floats, split: Integers, forms: Floats, i: int, Z: Floats, c: int, d: Floats) -> None:
    """Add what pushes and drives do to derivatives."""
    for row in range(4, F.shape[0], 2):
        _driven(F, row, forms, i, Z, c, d)
    for j in range(split[1], F.shape[1]):
        if F[3, j] != 0.0:
            # The push moves z2 alone; only parabolas without damping carry one.
            d[1] += forms[0, i, 1, j] * F[3, j]
            d[2] += forms[0, i, 0, j] * F[3, j]


@inner
def derivatives(
    F: Floats, split: Integers, forms: Floats, i: int, Z: Floats, c: int, d: Floats
) -> None:
    """Fill in the derivatives 0 ... 11 of a watched coordinate along the flow.

    The sums stand in variables of their own: in an array they would go through memory.

    Parameters
    ----------
    F, split, forms, Z : array
        See the module.
    i, c : int
        Which coordinate, and at which state.
    d : array, shape (12,)
    """
    d0, d1, d2, d3, d4, d5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    d6, d7, d8, d9, d10, d11 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    turning = 0 if split[2] else split[0]
    for j in range(turning):
        first, second = forms[0, i, 0, j], forms[0, i, 1, j]
        a = first * Z[c, 0, j] + second * Z[c, 1, j]
        b = F[1, j] * (first * Z[c, 1, j] - second * Z[c, 0, j])
        square = -F[1, j] * F[1, j]
        d0 += a
        d1 += b
        a *= square
        b *= square
        d2 += a
        d3 += b
        a *= square
        b *= square
        d4 += a
        d5 += b
        a *= square
        b *= square
        d6 += a
        d7 += b
        a *= square
        b *= square
        d8 += a
        d9 += b
        a *= square
        b *= square
        d10 += a
        d11 += b
    for j in range(turning, F.shape[1]):
        a, b, twice, square = _start(F, split, forms, i, Z, c, j)
        d0 += a
        d1 += b
        a = twice * b + square * a
        b = twice * a + square * b
        d2 += a
        d3 += b
        a = twice * b + square * a
        b = twice * a + square * b
        d4 += a
        d5 += b
        a = twice * b + square * a
        b = twice * a + square * b
        d6 += a
        d7 += b
        a = twice * b + square * a
        b = twice * a + square * b
        d8 += a
        d9 += b
        a = twice * b + square * a
        b = twice * a + square * b
        d10 += a
        d11 += b
    d[0], d[1], d[2], d[3], d[4], d[5] = d0, d1, d2, d3, d4, d5
    d[6], d[7], d[8], d[9], d[10], d[11] = d6, d7, d8, d9, d10, d11
    _push(F, split, forms, i, Z, c, d)


@inner
def near_derivatives(
    F: Floats, split: Integers, forms: Floats, i: int, Z: Floats, c: int, d: Floats
) -> None:
    """Fill in the derivatives 0 ... 3 of a watched coordinate; see `derivatives`."""
    d1, d2, d3 = 0.0, 0.0, 0.0
    turning = 0 if split[2] else split[0]
    for j in range(turning):
        first, second = forms[0, i, 0, j], forms[0, i, 1, j]
        a = first * Z[c, 0, j] + second * Z[c, 1, j]
        b = F[1, j] * (first * Z[c, 1, j] - second * Z[c, 0, j])
        square = -F[1, j] * F[1, j]
        d1 += b
        d2 += square * a
        d3 += square * b
    for j in range(turning, F.shape[1]):
        a, b, twice, square = _start(F, split, forms, i, Z, c, j)
        d1 += b
        a = twice * b + square * a
        d2 += a
        d3 += twice * a + square * b
    if Z.shape[2] < _VERY_LONG:
        value = product(forms, 0, i, Z, c)
    else:
        value, _ = exact_product(forms, 0, i, Z, c)
    d[0], d[1], d[2], d[3] = value, d1, d2, d3
    _push(F, split, forms, i, Z, c, d)


@inline
def magnitudes(split: Integers, Z: Floats, c: int, out: Floats) -> None:
    """Fill in |z_j| of every pair, shape (pair,); |z1| + |z2| where it is not a rotation."""
    for j in range(split[0]):
        out[j] = math.sqrt(Z[c, 0, j] * Z[c, 0, j] + Z[c, 1, j] * Z[c, 1, j])
    for j in range(split[0], Z.shape[2]):
        out[j] = abs(Z[c, 0, j]) + abs(Z[c, 1, j])


@inline
def _weighted(sizes: Floats, kind: int, i: int, size: Floats, n: int) -> float:
    """Return the sum of ``sizes[kind, i, j] size[j]`` over the first n pairs."""
    s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
    whole = n - n % 4
    for j in range(0, whole, 4):
        s0 += sizes[kind, i, j] * size[j]
        s1 += sizes[kind, i, j + 1] * size[j + 1]
        s2 += sizes[kind, i, j + 2] * size[j + 2]
        s3 += sizes[kind, i, j + 3] * size[j + 3]
    for j in range(whole, n):
        s0 += sizes[kind, i, j] * size[j]
    return (s0 + s1) + (s2 + s3)


@inline
def bound(
    F: Floats,
    split: Integers,
    forms: Floats,
    sizes: Floats,
    i: int,
    Z: Floats,
    c: int,
    size: Floats,
    kind: int,
    order: int,
    H: float,
) -> float:
    """Return a bound of the derivative `order` (at least 3) of a coordinate in the next H.

    Parameters
    ----------
    F, split, forms, sizes, Z : array
        See the module.
    i, c : int
        Which coordinate, and from which state on.
    size : array, shape (pair,)
        As `magnitudes` returns it.
    kind, order : int
        The row of `sizes` and the derivative that it is for.
    H : float
        Finite.
    """
    largest = _weighted(sizes, kind, i, size, split[0])
    for j in range(split[0], split[1]):
        largest += sizes[kind, i, j] * size[j] * math.exp(max(0.0, F[0, j] + F[1, j]) * H)
    for j in range(split[1], F.shape[1]):
        rate = abs(F[0, j])
        if rate > 0.0:
            # (alpha + N)^order = alpha^order + order alpha^(order-1) N on e^(alpha h)(z1 + h z2).
            slides = abs(forms[0, i, 0, j] * Z[c, 1, j])
            first = abs(forms[0, i, 0, j] * Z[c, 0, j]) + H * slides
            first += abs(forms[0, i, 1, j] * Z[c, 1, j])
            growth = math.exp(max(0.0, F[0, j]) * H)
            largest += growth * rate ** (order - 1) * (rate * first + order * slides)
    for row in range(4, F.shape[0], 2):
        j, k = int(F[row, 0]), int(F[row, 1])
        force = math.hypot(F[row + 1, 0], F[row + 1, 1]) * size[k]
        rate = max(math.hypot(F[0, j], F[1, j]), math.hypot(F[0, k], F[1, k]))
        longest = sizes[kind, i, j] * H + sizes[1, i, j] * order * rate ** (order - 1)
        largest += force * longest * math.exp(max(0.0, F[0, j], F[0, k]) * H)
    return largest


@inline
def reach(
    F: Floats, split: Integers, sizes: Floats, i: int, Z: Floats, c: int, size: Floats, H: float
) -> float:
    """Return a bound of the magnitude of a coordinate in the next H; arguments as of `bound`."""
    largest = _weighted(sizes, 1, i, size, split[0])
    for j in range(split[0], split[1]):
        if sizes[1, i, j] * size[j] > 0.0:
            largest += sizes[1, i, j] * size[j] * math.exp(max(0.0, F[0, j] + F[1, j]) * H)
    for j in range(split[1], F.shape[1]):
        if sizes[1, i, j] > 0.0:
            moved = abs(Z[c, 0, j]) + H * abs(Z[c, 1, j]) + 0.5 * H * H * abs(F[3, j])
            largest += sizes[1, i, j] * math.exp(max(0.0, F[0, j]) * H) * moved
    for row in range(4, F.shape[0], 2):
        j, k = int(F[row, 0]), int(F[row, 1])
        force = math.hypot(F[row + 1, 0], F[row + 1, 1]) * size[k]
        largest += sizes[1, i, j] * H * force * math.exp(max(0.0, F[0, j], F[0, k]) * H)
    return largest
