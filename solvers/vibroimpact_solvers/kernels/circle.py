"""All real roots of trigonometric polynomials ``f = Re sum_h Q_h e^(i h phase) - wall``.

The circle is halved until the derivatives at the middle of an interval, and the bound
``sum h^3 |Q_h|`` of the third one, prove that f has no root there, that it is monotonic, or that
it bends to one side only. At the ends of what is monotonic, signs then tell whether there is a
root. Numbers within rounding of zero have the sign of the point before, so that no root is found
twice and none for lack of digits; two roots between which f does not leave zero by more than
rounding are not told from none.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.kernels.jit import inner, kernel
from vibroimpact_solvers.kernels.phases import sine_cosine

Complexes = NDArray[np.complex128]

_TURN: Final = 2.0 * math.pi
_HALVINGS = 48  # of the circle
_STEPS = 60  # towards a root
_CLEAR = 1e3  # roundings by which f is away from zero where the circle begins
_SPACING = 2.4  # rad between points at which it may begin: the golden angle, about
_TRIES = 200


class Bounds(NamedTuple):
    """What the coefficients tell of f, f' and f'' everywhere."""

    third: float  # bound of the third derivative
    zero: float  # roundings of the function and of its derivatives
    slope: float
    bend: float


class Interval(NamedTuple):
    """An interval on which f is monotonic, and the signs of f at its ends."""

    left: float
    right: float
    before: float
    after: float


@inner
def _values(
    Q: Complexes, orders: Integers, wall: float, phase: float
) -> tuple[float, float, float]:
    """Return f and its two first derivatives."""
    f, slope, bend = -wall, 0.0, 0.0
    for j in range(orders.size):
        h = float(orders[j])
        sine, cosine = sine_cosine(h * phase, 0.0)
        real = Q[j].real * cosine - Q[j].imag * sine
        imaginary = Q[j].real * sine + Q[j].imag * cosine
        f += real
        slope -= h * imaginary
        bend -= h * h * real
    return f, slope, bend


@inner
def _bounds(Q: Complexes, orders: Integers, wall: float) -> Bounds:
    third, zero, slope, bend = 0.0, abs(wall), 0.0, 0.0
    for j in range(orders.size):
        h, size = float(orders[j]), abs(Q[j])
        rounded = (2.0 + 2.0 * _TURN * h) * size
        third += h * h * h * size
        zero += rounded
        slope += h * rounded
        bend += h * h * rounded
    return Bounds(third, 4.0 * EPS * zero, 4.0 * EPS * slope, 4.0 * EPS * bend)


@inner
def _sign(value: float, rounding: float, before: float) -> float:
    """Return the sign of a number; within rounding of zero, that of the one before."""
    if abs(value) <= rounding:
        return before
    return 1.0 if value > 0.0 else -1.0


@inner
def _root(Q: Complexes, orders: Integers, wall: float, at: Interval) -> float:
    """Return the root where f is monotonic, by Newton's method or halving."""
    low, high = at.left, at.right
    x = 0.5 * (low + high)
    for _ in range(_STEPS):
        f, slope, _bend = _values(Q, orders, wall, x)
        if f == 0.0:
            return x
        if (f > 0.0) == (at.before > 0.0):
            low = x
        else:
            high = x
        ahead = x - f / slope if slope != 0.0 else low
        if not low < ahead < high:
            ahead = 0.5 * (low + high)
        if abs(ahead - x) <= 2.0 * EPS * abs(x) or not low < ahead < high:
            return ahead
        x = ahead
    return x


@inner
def _extremum(Q: Complexes, orders: Integers, wall: float, left: float, right: float) -> float:
    """Return where f turns, on an interval where it bends to one side; an end, if it does not."""
    low, high = left, right
    _f, slope, _bend = _values(Q, orders, wall, low)
    rises = slope > 0.0
    x = 0.5 * (low + high)
    for _ in range(_STEPS):
        _f, slope, bend = _values(Q, orders, wall, x)
        if slope == 0.0:
            return x
        if (slope > 0.0) == rises:
            low = x
        else:
            high = x
        ahead = x - slope / bend if bend != 0.0 else low
        if not low < ahead < high:
            ahead = 0.5 * (low + high)
        if abs(ahead - x) <= 2.0 * EPS * abs(x) or not low < ahead < high:
            return ahead
        x = ahead
    return x


@inner
def _begin(Q: Complexes, orders: Integers, wall: float, rounding: float) -> float:
    """Return a phase at which f is clearly not zero; it has a mean square."""
    phase = 0.0
    for k in range(_TRIES):
        phase = (k * _SPACING) % _TURN
        f, _slope, _bend = _values(Q, orders, wall, phase)
        if abs(f) > _CLEAR * rounding:
            break
    return phase


@inner
def _set_change(Q: Complexes, orders: Integers, wall: float, at: Interval, roots: Floats) -> int:
    """Fill in the root of an interval on which f is monotonic; return whether there is one."""
    if at.after == at.before:
        return 0
    roots[:1] = _root(Q, orders, wall, at)
    return 1


@inner
def _set_roots(Q: Complexes, orders: Integers, wall: float, roots: Floats) -> int:
    """Fill in the roots of one polynomial, ascending from some phase; return their number."""
    bounds = _bounds(Q, orders, wall)
    begin = _begin(Q, orders, wall, bounds.zero)
    f, slope, bend = _values(Q, orders, wall, begin)
    before, count, level, k = _sign(f, 0.0, 1.0), 0, 0, 0
    while level > 0 or k == 0:
        width = math.ldexp(_TURN, -level)
        left, r = begin + k * width, 0.5 * width
        f, slope, bend = _values(Q, orders, wall, left + r)
        turns = 0.5 * (abs(bend) + bounds.third * r / 3.0) * r * r
        if abs(f) > bounds.zero + (abs(slope) + bounds.slope) * r + turns:
            at = Interval(left, left, before, _sign(f, 0.0, before))
            count += _set_change(Q, orders, wall, at, roots[count:])
            before = at.after
        else:
            monotonic = abs(slope) > bounds.slope + (abs(bend) + 0.5 * bounds.third * r) * r
            bent = abs(bend) > bounds.bend + bounds.third * r
            flat = abs(f) + abs(slope) * r + turns <= bounds.zero
            if not (monotonic or bent or flat or level >= _HALVINGS):
                level, k = level + 1, 2 * k
                continue
            right = left + width
            end = begin if k + 1 == 2**level else right
            if bent and not monotonic:
                top = _extremum(Q, orders, wall, left, right)
                f, slope, bend = _values(Q, orders, wall, top)
                at = Interval(left, top, before, _sign(f, bounds.zero, before))
                count += _set_change(Q, orders, wall, at, roots[count:])
                left, before = top, at.after
            f, slope, bend = _values(Q, orders, wall, end)
            at = Interval(left, right, before, _sign(f, bounds.zero, before))
            count += _set_change(Q, orders, wall, at, roots[count:])
            before = at.after
        k += 1
        while level > 0 and k % 2 == 0:
            level, k = level - 1, k // 2
    return count


@kernel
def circle_roots(
    Q: Complexes, orders: Integers, walls: Floats, begin: int, index: Integers, phases: Floats
) -> tuple[int, int]:
    """Fill in the roots of polynomials from one on, as many as there is room for.

    Parameters
    ----------
    Q : array, shape (polynomial, order)
        Of each with its wall, the sum of the moduli is about 1.
    orders : array of int, shape (order,)
        Ascending, at least 1.
    walls : array, shape (polynomial,)
    begin : int
        The first polynomial.
    index : array of int, shape (root,)
        The polynomials of the roots.
    phases : array, shape (root,)

    Returns
    -------
    next, count : int
        The first polynomial that is left, and the number of roots.
    """
    count, most = 0, 2 * orders[orders.size - 1]
    for k in range(begin, walls.size):
        if count + most > phases.size:
            return k, count
        first = count
        count += _set_roots(Q[k], orders, walls[k], phases[count:])
        for j in range(first, count):
            index[j] = k
    return walls.size, count
