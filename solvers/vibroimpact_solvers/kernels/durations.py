"""Isolation of the durations of contact phases, with proof that none is missed.

Of a motion whose stop is loaded for a given duration, whatever its force is, the switching forms
at both ends of the phase are ``Re(Q e^(i theta)) + g`` and ``Re(R e^(i theta)) + h``, theta being
the drive's phase. Both are zero for some theta where

    E = |g R* - h Q*|^2 - Im(Q* R)^2 = 0 .

Over a box ``d + r x``, |x| <= 1, the force at the time x of a motion with the duration x solves
``f(s) + integral_0^x S(s, t) f(t) dt = alpha(s)``, and Q, R, g and h follow from its moments. Times
Fredholm's determinant D all of them are entire functions of x. With ``|S| <= s`` for
``|x| <= RADIUS``, Hadamard's inequality bounds them there,

    |D| <= sum (s RADIUS)^n n^(n/2) / n! ,

and Cauchy's what their Taylor polynomials of the degree `TERMS` - 1 leave out on the box: this
proves where the polynomial of E shows no root, or exactly one.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.jit import inner, kernel

TERMS: Final = 24
RADIUS: Final = 3.0
"""Of the disc on which functions are bounded, in half widths of the box."""
STRONG: Final = 0.7
"""Largest bound of the kernel S with which a box is not cut."""

OF_S: Final = 0
OF_BETA: Final = 1
OF_ALPHA: Final = 2
"""Columns of `Boxes.size`."""

EMPTY: Final = 0
ROOT: Final = 1
UNRESOLVED: Final = 2
CUT: Final = 3
FULL: Final = 4
"""Of an interval: no root, one simple root, one or more or none; of a box: it is cut in halves; it
has more roots than there is room for."""

_SERIES = 40  # terms of Fredholm's series, whose rest is far below the sum for STRONG * RADIUS
_FINEST = 1e-8  # half width of an interval, in those of the box, that is not cut any more
_MOST = 4096  # intervals of a box
_ROUNDED = 1e-13  # roundings of a polynomial, relative to the size of its terms
_DEEP = 64  # halvings that are left to examine
_HALVINGS = 40  # of an interval with one root

Complexes = NDArray[np.complex128]


class Boxes(NamedTuple):
    """What is known at the middle of boxes; time in half widths."""

    S: Floats  # (box, TERMS, TERMS): coefficients of S(s, t) for s^l t^j, times the half width
    beta: Floats  # (box, TERMS): of the form at the beginning, of what the force makes of it
    alpha: Complexes  # (box, TERMS): of the force by the load
    still: Floats  # (box, TERMS): of the force by what is constant
    Q: Complexes  # (box,)
    g: Floats  # (box,)
    size: Floats  # (box, 3): bounds of what S, beta and alpha leave out on the disc
    end: Integers  # (box,): 1 or -1 where E has a double root at that end of the box, or 0


class _Room(NamedTuple):
    """Polynomials over a box."""

    moments: Complexes  # (TERMS, TERMS): of the force, by place and power
    turned: Complexes  # (TERMS, TERMS): S times them
    t: Complexes  # (TERMS,): of D'/D
    D: Complexes
    Q: Complexes  # of D Q, …, (TERMS,)
    R: Complexes
    g: Complexes
    h: Complexes
    A: Complexes  # (2 TERMS,)
    E: Floats  # (4 TERMS,)
    middle: Floats  # (_DEEP,): of intervals that are left to examine
    half: Floats  # (_DEEP,): their half widths


class _Doubts(NamedTuple):
    """Errors of E and of its derivative on a box, and a bound of its third derivative."""

    value: float
    slope: float
    third: float


@inner
def _solve(S: Floats, right: Complexes, diagonal: bool, room: _Room) -> None:
    """Fill in the moments of ``f(s) + integral S f = right(s)``, order by order.

    Where `diagonal`, right(s) is S(s, x) instead.
    """
    moments, turned = room.moments, room.turned
    for k in range(TERMS):
        for j in range(TERMS):
            moments[j, k] = turned[j, k] = 0.0
    for k in range(TERMS):
        for j in range(k):
            # the power k of x in m_j takes s^l with l = k - j - 1 at t^0, and what m has before
            total = 0.0 + 0.0j
            if not diagonal:
                total = right[k - j - 1] / k
            for l in range(k - j):
                if diagonal:
                    total += S[l, k - j - 1 - l] / (j + l + 1.0)
                total -= turned[l, k - j - l - 1] / (j + l + 1.0)
            moments[j, k] = total
        for l in range(TERMS - k):
            total = 0.0 + 0.0j
            for i in range(k):
                total += S[l, i] * moments[i, k]
            turned[l, k] = total


@inner
def _set_end(right: Complexes, room: _Room, out: Complexes) -> None:
    """Fill in the force at the end, ``right(x) - integral S(x, t) f(t) dt``."""
    for k in range(TERMS):
        total = right[k]
        for l in range(k + 1):
            total -= room.turned[l, k - l]
        out[k] = total


@inner
def _set_start(first: complex, beta: Floats, room: _Room, out: Complexes) -> None:
    """Fill in the form at the beginning, ``first - integral beta(t) f(t) dt``."""
    for k in range(TERMS):
        total = 0.0 + 0.0j
        for j in range(k):
            total -= beta[j] * room.moments[j, k]
        out[k] = total + (first if k == 0 else 0.0)


@inner
def _times(D: Complexes, p: Complexes) -> None:
    """Multiply a polynomial by another one, up to the degree that is kept."""
    for k in range(TERMS - 1, -1, -1):
        total = 0.0 + 0.0j
        for j in range(k + 1):
            total += D[j] * p[k - j]
        p[k] = total


@inner
def _set_determinant(S: Floats, room: _Room) -> None:
    """Fill in Fredholm's determinant by ``D' = t D`` with ``t = v . M^-1 u``."""
    _solve(S, room.D, True, room)
    for k in range(TERMS):
        total = 0.0 + 0.0j
        for l in range(k + 1):
            total += S[l, k - l] - room.turned[l, k - l]
        room.t[k] = total
    for k in range(TERMS):
        total = 0.0 + 0.0j
        for j in range(k):
            total += room.t[j] * room.D[k - 1 - j]
        room.D[k] = total / k if k > 0 else 1.0


@inner
def _largest(p: Complexes, radius: float) -> float:
    """Return a bound of a polynomial on a disc."""
    total, power = 0.0, 1.0
    for k in range(p.size):
        total += abs(p[k]) * power
        power *= radius
    return total


@inner
def _strength(S: Floats) -> float:
    """Return a bound of the polynomial of S on the disc."""
    total, outer = 0.0, 1.0
    for l in range(TERMS):
        power = outer
        for j in range(TERMS):
            total += abs(S[l, j]) * power
            power *= RADIUS
        outer *= RADIUS
    return total


@inner
def _fredholm(s: float) -> tuple[float, float]:
    """Return the bounds of the determinant and of its first minor for |S| <= s on the disc."""
    whole, minor, power = 0.0, 0.0, 1.0
    for n in range(_SERIES):
        root = math.sqrt(n + 1.0)
        # n^(n/2)/n! and (n+1)^((n+1)/2)/n! by their logarithms
        size = 0.5 * n * math.log(max(n, 1.0)) - math.lgamma(n + 1.0)
        whole += power * math.exp(size)
        minor += s * power * math.exp(0.5 * n * math.log(n + 1.0) - math.lgamma(n + 1.0)) * root
        power *= s * RADIUS
    return whole, minor


@inner
def _set_equation(room: _Room) -> None:
    """Fill in the polynomial of E."""
    A, E = room.A, room.E
    for k in range(E.size):
        E[k] = 0.0
    for k in range(A.size):
        A[k] = 0.0
    for j in range(TERMS):
        for k in range(TERMS):
            A[j + k] += room.g[j] * room.R[k].conjugate() - room.h[j] * room.Q[k].conjugate()
    for j in range(A.size):
        for k in range(A.size):
            E[j + k] += (A[j] * A[k].conjugate()).real
    for k in range(A.size):
        A[k] = 0.0
    for j in range(TERMS):
        for k in range(TERMS):
            A[j + k] += (room.Q[j].conjugate() * room.R[k]).imag
    for j in range(A.size):
        for k in range(A.size):
            E[j + k] -= A[j].real * A[k].real


@inner
def _divide(E: Floats, end: int) -> None:
    """Divide E by ``1 - x`` or ``1 + x``, whose root it has, the end being 1 or -1."""
    # E_k = q_k - end q_(k-1), from the high end, where coefficients are small.
    above = 0.0
    for k in range(E.size - 1, -1, -1):
        here = E[k]
        E[k] = above
        above = end * (above - here)


@inner
def _state(E: Floats, x: float, w: float, doubts: _Doubts) -> int:
    """Return what is proved of the roots in ``[x - w, x + w]``."""
    doubt, slope_doubt, third = doubts
    value, slope, bend = 0.0, 0.0, 0.0
    for k in range(E.size - 1, -1, -1):
        bend = bend * x + 2.0 * slope
        slope = slope * x + value
        value = value * x + E[k]
    if abs(value) > w * (abs(slope) + w * (0.5 * abs(bend) + w * third / 6.0)) + doubt:
        return EMPTY
    if abs(slope) > w * (abs(bend) + 0.5 * w * third) + slope_doubt:
        return ROOT
    return CUT


@inner
def _value(E: Floats, x: float) -> float:
    value = 0.0
    for k in range(E.size - 1, -1, -1):
        value = value * x + E[k]
    return value


@inner
def _refined(E: Floats, x: float, w: float) -> tuple[float, float]:
    """Return the middle and the half width of a small interval around the only root of another."""
    low, high = x - w, x + w
    rises = _value(E, high) > _value(E, low)
    for _ in range(_HALVINGS):
        x = 0.5 * (low + high)
        if (_value(E, x) > 0.0) == rises:
            high = x
        else:
            low = x
    return 0.5 * (low + high), 0.5 * (high - low)


@inner
def _isolate(
    box: int, doubts: _Doubts, room: _Room, found: int, which: Integers,
    middles: Floats, halves: Floats, kinds: Integers,
) -> int:  # fmt: skip
    """List the intervals of a box in which roots are; return how many there are then, or -1."""
    E, doubt, high, count = room.E, doubts.value, 1, 0
    room.middle[high - 1], room.half[high - 1] = 0.0, 1.0
    while high > 0 and count < _MOST:
        count += 1
        high -= 1
        x, w = room.middle[high], room.half[high]
        kind = _state(E, x, w, doubts)
        if kind == ROOT:
            # Strictly monotone: there is a root if the signs at the ends differ.
            low, up = _value(E, x - w), _value(E, x + w)
            if min(abs(low), abs(up)) > doubt and (low > 0.0) == (up > 0.0):
                kind = EMPTY
        if kind == CUT and w > _FINEST and high + 2 < room.half.size:
            w *= 0.5
            room.middle[high], room.half[high] = x + w, w
            room.middle[high + 1], room.half[high + 1] = x - w, w
            high += 2
            continue
        if kind != EMPTY:
            if found >= kinds.size:
                return -1
            if kind == ROOT:
                x, w = _refined(E, x, w)
            which[found], kinds[found] = box, (ROOT if kind == ROOT else UNRESOLVED)
            middles[found], halves[found] = x, w
            found += 1
    return found if high == 0 else -1


@inner
def _bounds(boxes: Boxes, i: int, s: float, room: _Room) -> _Doubts:
    """Return the errors of what is known of E on a box, from a bound s of |S| on the disc."""
    whole, minor = _fredholm(s)
    alpha, still, beta = 0.0, 0.0, 0.0
    power = 1.0
    for l in range(TERMS):
        alpha += abs(boxes.alpha[i, l]) * power
        still += abs(boxes.still[i, l]) * power
        beta += abs(boxes.beta[i, l]) * power
        power *= RADIUS
    beta, alpha = beta + boxes.size[i, OF_BETA], alpha + boxes.size[i, OF_ALPHA]
    still += boxes.size[i, OF_ALPHA]
    along = whole + RADIUS * minor
    # On |x| <= 1.5, half a radius around the box, for Cauchy's bound of derivatives.
    part = 2.0 * (1.5 / RADIUS) ** TERMS
    force, level = alpha * along, still * along
    lost_R, lost_h = part * force, part * level
    lost_Q = part * (abs(boxes.Q[i]) * whole + RADIUS * beta * force)
    lost_g = part * (abs(boxes.g[i]) * whole + RADIUS * beta * level)
    Q, R = _largest(room.Q, 1.5), _largest(room.R, 1.5)
    g, h = _largest(room.g, 1.5), _largest(room.h, 1.5)
    lost_Q, lost_R = lost_Q + _ROUNDED * Q, lost_R + _ROUNDED * R
    lost_g, lost_h = lost_g + _ROUNDED * g, lost_h + _ROUNDED * h
    both = (g + lost_g) * lost_R + lost_g * R + (h + lost_h) * lost_Q + lost_h * Q
    cross = (Q + lost_Q) * lost_R + lost_Q * R
    doubt = both * (2.0 * (g * R + h * Q) + both) + cross * (2.0 * Q * R + cross)
    third = 0.0
    for k in range(3, room.E.size):
        third += k * (k - 1.0) * (k - 2.0) * abs(room.E[k])
    if boxes.end[i] != 0:
        # Half a radius around the end the quotient is not larger than 1/0.5^2 times that.
        doubt *= 4.0
    return _Doubts(doubt, 2.0 * doubt, third)


@kernel
def isolate(
    boxes: Boxes, which: Integers, middles: Floats, halves: Floats, kinds: Integers,
    states: Integers,
) -> int:  # fmt: skip
    """List all intervals of boxes in which there are roots of E.

    Parameters
    ----------
    boxes : Boxes
    which : array of int, shape (room,)
        Receives the boxes of the intervals.
    middles, halves : array, shape (room,)
        Receive their middles and half widths, in half widths of the box.
    kinds : array of int, shape (room,)
        Receives `ROOT` or `UNRESOLVED`.
    states : array of int, shape (box,)
        Receives `EMPTY`, `CUT` where bounds are too large, and `FULL`.

    Returns
    -------
    int
        Number of intervals.
    """
    shape = TERMS, TERMS
    room = _Room(
        np.empty(shape, np.complex128), np.empty(shape, np.complex128),
        np.empty(TERMS, np.complex128), np.empty(TERMS, np.complex128),
        np.empty(TERMS, np.complex128), np.empty(TERMS, np.complex128),
        np.empty(TERMS, np.complex128), np.empty(TERMS, np.complex128),
        np.empty(2 * TERMS, np.complex128), np.empty(4 * TERMS), np.empty(_DEEP), np.empty(_DEEP),
    )  # fmt: skip
    still, found = np.empty(TERMS, np.complex128), 0
    for i in range(states.size):
        s = _strength(boxes.S[i]) + boxes.size[i, OF_S]
        states[i] = EMPTY if s <= STRONG else CUT
        if not s <= STRONG:
            continue
        for k in range(TERMS):
            still[k] = boxes.still[i, k]
        _set_determinant(boxes.S[i], room)
        _solve(boxes.S[i], boxes.alpha[i], False, room)
        _set_end(boxes.alpha[i], room, room.R)
        _set_start(boxes.Q[i], boxes.beta[i], room, room.Q)
        _solve(boxes.S[i], still, False, room)
        _set_end(still, room, room.h)
        _set_start(complex(boxes.g[i]), boxes.beta[i], room, room.g)
        _times(room.D, room.Q)
        _times(room.D, room.R)
        _times(room.D, room.g)
        _times(room.D, room.h)
        _set_equation(room)
        if boxes.end[i] != 0:
            _divide(room.E, boxes.end[i])
            _divide(room.E, boxes.end[i])
        doubts = _bounds(boxes, i, s, room)
        more = _isolate(i, doubts, room, found, which, middles, halves, kinds)
        if more < 0:
            states[i] = FULL
        else:
            found = more
    return found
