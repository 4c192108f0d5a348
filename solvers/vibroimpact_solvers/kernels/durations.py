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

and Cauchy's inequality what their Taylor polynomials leave out on the box: this proves where the
polynomial of E shows no root, or exactly one. Few terms show most boxes without a root as such.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.jit import inner, kernel

TERMS: Final = 30
"""Of polynomials that tell roots to rounding."""
FEW_TERMS: Final = 12
"""Of polynomials that tell where there is none: they take a tenth of the time."""
RADIUS: Final = 3.0
"""Of the disc on which functions are bounded, in half widths of the box."""
STRONG: Final = 0.7
SINGULAR: Final = 1e4
"""Largest bounds of the kernel S, and of a part of rank one, with which a box is not cut."""

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
_BEYOND = 1.2  # of the box, up to where functions are known, for Cauchy's bound of derivatives
_DEEP = 64  # halvings that are left to examine
_HALVINGS = 40  # of an interval with one root

Complexes = NDArray[np.complex128]


class Boxes(NamedTuple):
    """What is known at the middle of boxes; time in half widths."""

    S: Floats  # (box, term, term): coefficients of S(s, t) for s^l t^j, times the half width
    beta: Floats  # (box, term): of the form at the beginning, of what the force makes of it
    alpha: Complexes  # (box, term): of the force by the load
    still: Floats  # (box, term): of the force by what is constant
    Q: Complexes  # (box,)
    g: Floats  # (box,)
    size: Floats  # (box, 3): bounds of what S, beta and alpha leave out on the disc
    end: Integers  # (box,): 1 or -1 where E has a double root at that end of the box, or 0


class _Room(NamedTuple):
    """Polynomials over a box."""

    moments: Complexes  # (term, term): of the force, by place and power
    turned: Complexes  # (term, term): S times them
    t: Complexes  # (term,): of D'/D
    D: Complexes
    Q: Complexes  # of D Q, …, (term,)
    R: Complexes
    g: Complexes
    h: Complexes
    A: Complexes  # (2 term,): g R* - h Q*
    B: Floats  # (2 term,): Im(Q* R)
    middle: Floats  # (_DEEP,): of intervals that are left to examine
    half: Floats  # (_DEEP,): their half widths


class _Sizes(NamedTuple):
    """Bounds of Q, R, g and h, times D, on the disc."""

    Q: float
    R: float
    g: float
    h: float


class _Doubts(NamedTuple):
    """Errors of A, B and their derivatives on a box, and bounds of their second and third ones."""

    A: float
    B: float
    A_slope: float
    B_slope: float
    A_bend: float
    B_bend: float
    A_third: float
    B_third: float


@inner
def _solve(S: Floats, right: Complexes, diagonal: bool, room: _Room) -> None:
    """Fill in the moments of ``f(s) + integral S f = right(s)``, order by order.

    Where `diagonal`, right(s) is S(s, x) instead.
    """
    moments, turned, terms = room.moments, room.turned, room.t.size
    for k in range(terms):
        for j in range(terms):
            moments[j, k] = turned[j, k] = 0.0
    for k in range(terms):
        for j in range(k):
            # the power k of x in m_j takes s^l with n = k - j - 1 at t^0, and what m has before
            total = 0.0 + 0.0j
            if not diagonal:
                total = right[k - j - 1] / k
            for n in range(k - j):
                if diagonal:
                    total += S[n, k - j - 1 - n] / (j + n + 1.0)
                total -= turned[n, k - j - n - 1] / (j + n + 1.0)
            moments[j, k] = total
        for n in range(terms - k):
            total = 0.0 + 0.0j
            for i in range(k):
                total += S[n, i] * moments[i, k]
            turned[n, k] = total


@inner
def _set_end(right: Complexes, room: _Room, out: Complexes) -> None:
    """Fill in the force at the end, ``right(x) - integral S(x, t) f(t) dt``."""
    for k in range(out.size):
        total = right[k]
        for n in range(k + 1):
            total -= room.turned[n, k - n]
        out[k] = total


@inner
def _set_start(first: complex, beta: Floats, room: _Room, out: Complexes) -> None:
    """Fill in the form at the beginning, ``first - integral beta(t) f(t) dt``."""
    for k in range(out.size):
        total = 0.0 + 0.0j
        for j in range(k):
            total -= beta[j] * room.moments[j, k]
        out[k] = total + (first if k == 0 else 0.0)


@inner
def _times(D: Complexes, p: Complexes) -> None:
    """Multiply a polynomial by another one, up to the degree that is kept."""
    for k in range(p.size - 1, -1, -1):
        total = 0.0 + 0.0j
        for j in range(k + 1):
            total += D[j] * p[k - j]
        p[k] = total


@inner
def _set_determinant(S: Floats, room: _Room) -> None:
    """Fill in Fredholm's determinant by ``D' = t D`` with ``t = v . M^-1 u``."""
    _solve(S, room.D, True, room)
    for k in range(room.t.size):
        total = 0.0 + 0.0j
        for n in range(k + 1):
            total += S[n, k - n] - room.turned[n, k - n]
        room.t[k] = total
    for k in range(room.t.size):
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
def _strength(S: Floats, apart: bool) -> tuple[float, float]:
    """Return bounds of S on the disc: of a part of rank one, and of the remainder.

    Where not `apart` the former is zero. Near a duration of which the structure has a free motion
    as long as the period, S is large, but ``S(s, t) - S(s, 0) S(0, t) / S(0, 0)`` is not.
    """
    first = 0
    whole = S[first, first]
    total, outer, before, after = 0.0, 1.0, 0.0, 0.0
    for n in range(len(S)):
        power = outer
        before += abs(S[n, first]) * outer
        after += abs(S[first, n]) * outer
        for j in range(len(S)):
            taken = S[n, first] * S[first, j] / whole if apart else 0.0
            total += abs(S[n, j] - taken) * power
            power *= RADIUS
        outer *= RADIUS
    return (before * after / abs(whole) if apart else 0.0), total


@inner
def _fredholm(r: float, s: float) -> tuple[float, float]:
    """Return bounds of the determinant and of its first minor on the disc.

    S is the sum of a part of rank one, at most r, and of one of at most s: of the columns of a
    determinant one at most is of the former.
    """
    whole, minor, power, last = 0.0, 0.0, 1.0, 0.0
    for n in range(_SERIES):
        # s^n n^(n/2) / n! and s^(n+1) (n+1)^((n+1)/2) / n!, RADIUS^n times
        even = math.exp(0.5 * n * math.log(max(n, 1.0)) - math.lgamma(n + 1.0))
        odd = math.exp(0.5 * (n + 1.0) * math.log(n + 1.0) - math.lgamma(n + 1.0))
        whole += even * (power + n * r * RADIUS * last)
        minor += odd * (power * s + (n + 1.0) * r * power)
        last = power
        power *= s * RADIUS
    return whole, minor


@inner
def _set_equation(room: _Room) -> None:
    """Fill in the polynomials of A and B."""
    A, B = room.A, room.B
    for k in range(A.size):
        A[k], B[k] = 0.0, 0.0
    for j in range(room.t.size):
        for k in range(room.t.size):
            A[j + k] += room.g[j] * room.R[k].conjugate() - room.h[j] * room.Q[k].conjugate()
            B[j + k] += (room.Q[j].conjugate() * room.R[k]).imag


@inner
def _divide(A: Complexes, B: Floats, root: float) -> None:
    """Divide A and B by ``x - root``, where both are zero."""
    # A_k = q_(k-1) - root q_k, from the high end, where coefficients are small.
    above, higher = 0.0 + 0.0j, 0.0
    for k in range(A.size - 1, -1, -1):
        here, there = A[k], B[k]
        A[k], B[k] = above, higher
        above, higher = here + root * above, there + root * higher


@inner
def _pole(c: Complexes) -> tuple[int, float]:
    """Return whether the determinant has a root in the box, one at most, and where.

    `EMPTY`, `ROOT`, or `CUT` where there may be more.
    """
    other, bends, low, high = 0.0, 0.0, 0.0, 0.0
    for k in range(c.size - 1, -1, -1):
        low, high = c[k].real - low, c[k].real + high
        if k > 0:
            other += abs(c[k])
        if k > 1:
            bends += k * abs(c[k])
    if abs(c[0]) > other:
        return EMPTY, 0.0
    if abs(c[1]) <= bends:
        return CUT, 0.0
    if (low > 0.0) == (high > 0.0):
        return EMPTY, 0.0
    left, right, x = -1.0, 1.0, 0.0
    for _ in range(2 * _HALVINGS):
        x, value = 0.5 * (left + right), 0.0
        for k in range(c.size - 1, -1, -1):
            value = value * x + c[k].real
        if (value > 0.0) == (high > 0.0):
            right = x
        else:
            left = x
    return ROOT, x


@inner
def _state(room: _Room, x: float, w: float, doubts: _Doubts) -> int:
    """Return what is proved of the roots of E in ``[x - w, x + w]``."""
    A, rise, bend = 0.0 + 0.0j, 0.0 + 0.0j, 0.0 + 0.0j
    B, slope, turn = 0.0, 0.0, 0.0
    for k in range(room.B.size - 1, -1, -1):
        bend, rise, A = bend * x + 2.0 * rise, rise * x + A, A * x + room.A[k]
        turn, slope, B = turn * x + 2.0 * slope, slope * x + B, B * x + room.B[k]
    # Bounds of A, B and their first three derivatives in the interval.
    A2, B2 = abs(bend) + w * doubts.A_third, abs(turn) + w * doubts.B_third
    A2, B2 = min(A2, doubts.A_bend), min(B2, doubts.B_bend)
    A1, B1 = abs(rise) + w * A2, abs(slope) + w * B2
    A0, B0 = abs(A) + w * A1, abs(B) + w * B1
    doubt = doubts.A * (2.0 * A0 + doubts.A) + doubts.B * (2.0 * B0 + doubts.B)
    value = (A.real * A.real + A.imag * A.imag) - B * B
    first = 2.0 * ((A.conjugate() * rise).real - B * slope)
    second = 2.0 * ((A.conjugate() * bend).real + abs(rise) ** 2 - B * turn - slope * slope)
    third = 2.0 * (A0 * doubts.A_third + 3.0 * A1 * A2 + B0 * doubts.B_third + 3.0 * B1 * B2)
    varies = w * (abs(first) + w * (0.5 * abs(second) + w * third / 6.0))
    if abs(value) > varies + doubt:
        return EMPTY
    steep = doubts.A * A1 + doubts.A_slope * (A0 + doubts.A)
    steep += doubts.B * B1 + doubts.B_slope * (B0 + doubts.B)
    if abs(first) > w * (abs(second) + 0.5 * w * third) + 2.0 * steep:
        return ROOT
    # Within its error E is zero all over, if it does not leave it: halves tell no more.
    return UNRESOLVED if abs(value) + varies <= doubt else CUT


@inner
def _value(room: _Room, x: float) -> float:
    """Return E."""
    A, B = 0.0 + 0.0j, 0.0
    for k in range(room.B.size - 1, -1, -1):
        A, B = A * x + room.A[k], B * x + room.B[k]
    return (A.real * A.real + A.imag * A.imag) - B * B


@inner
def _doubt_at(room: _Room, x: float, doubts: _Doubts) -> float:
    """Return the error of E."""
    A, B = 0.0 + 0.0j, 0.0
    for k in range(room.B.size - 1, -1, -1):
        A, B = A * x + room.A[k], B * x + room.B[k]
    return doubts.A * (2.0 * abs(A) + doubts.A) + doubts.B * (2.0 * abs(B) + doubts.B)


@inner
def _refined(room: _Room, x: float, w: float) -> tuple[float, float]:
    """Return the middle and the half width of a small interval around the only root of another."""
    low, high = x - w, x + w
    rises = _value(room, high) > _value(room, low)
    for _ in range(_HALVINGS):
        x = 0.5 * (low + high)
        if (_value(room, x) > 0.0) == rises:
            high = x
        else:
            low = x
    return 0.5 * (low + high), 0.5 * (high - low)


@inner
def _isolate(
    box: int, doubts: _Doubts, room: _Room, listed: int, which: Integers,
    middles: Floats, halves: Floats, kinds: Integers,
) -> int:  # fmt: skip
    """List the intervals of a box in which roots are; return how many there are then, or -1."""
    high, count = 1, 0
    room.middle[high - 1], room.half[high - 1] = 0.0, 1.0
    while high > 0 and count < _MOST:
        count += 1
        high -= 1
        x, w = room.middle[high], room.half[high]
        kind = _state(room, x, w, doubts)
        if kind == ROOT:
            # Strictly monotone: there is a root if the signs at the ends differ.
            low, up = _value(room, x - w), _value(room, x + w)
            if (low > 0.0) == (up > 0.0):
                # No more than one, if errors of the ends allow for one there.
                sure = abs(low) > _doubt_at(room, x - w, doubts)
                sure = sure and abs(up) > _doubt_at(room, x + w, doubts)
                kind = EMPTY if sure else ROOT
        if kind == CUT and w > _FINEST and high + 2 < room.half.size:
            w *= 0.5
            room.middle[high], room.half[high] = x + w, w
            room.middle[high + 1], room.half[high + 1] = x - w, w
            high += 2
            continue
        if kind != EMPTY:
            if listed >= kinds.size:
                return -1
            if kind == ROOT:
                x, w = _refined(room, x, w)
            which[listed], kinds[listed] = box, (ROOT if kind == ROOT else UNRESOLVED)
            middles[listed], halves[listed] = x, w
            listed += 1
    return listed if high == 0 else -1


@inner
def _doubt(sizes: _Sizes, radius: float, room: _Room) -> tuple[float, float]:
    """Return the errors of A and B on a disc."""
    part = (radius / RADIUS) ** room.t.size * RADIUS / (RADIUS - radius)
    Q, R = _largest(room.Q, radius), _largest(room.R, radius)
    g, h = _largest(room.g, radius), _largest(room.h, radius)
    lost_Q, lost_R = part * sizes.Q + _ROUNDED * Q, part * sizes.R + _ROUNDED * R
    lost_g, lost_h = part * sizes.g + _ROUNDED * g, part * sizes.h + _ROUNDED * h
    both = (g + lost_g) * lost_R + lost_g * R + (h + lost_h) * lost_Q + lost_h * Q
    return both, (Q + lost_Q) * lost_R + lost_Q * R


@inner
def _bounds(
    boxes: Boxes, i: int, strength: tuple[float, float], divided: bool, room: _Room
) -> _Doubts:
    """Return the errors of what is known of E on a box, from bounds of S (`_fredholm`).

    Where `divided`, A and B have been divided by ``x - root``.
    """
    whole, minor = _fredholm(*strength)
    alpha, still, beta = 0.0, 0.0, 0.0
    power = 1.0
    for n in range(room.t.size):
        alpha += abs(boxes.alpha[i, n]) * power
        still += abs(boxes.still[i, n]) * power
        beta += abs(boxes.beta[i, n]) * power
        power *= RADIUS
    beta, alpha = beta + boxes.size[i, OF_BETA], alpha + boxes.size[i, OF_ALPHA]
    still += boxes.size[i, OF_ALPHA]
    along = whole + RADIUS * minor
    force, level = alpha * along, still * along
    sizes = _Sizes(
        abs(boxes.Q[i]) * whole + RADIUS * beta * force, force,
        abs(boxes.g[i]) * whole + RADIUS * beta * level, level,
    )  # fmt: skip
    of_A, of_B = _doubt(sizes, 1.0, room)
    wide_A, wide_B = _doubt(sizes, _BEYOND, room)
    if divided:
        # Quotients are not larger than on a circle around the root.
        wide_A, wide_B = wide_A / (_BEYOND - 1.0), wide_B / (_BEYOND - 1.0)
        of_A, of_B = wide_A, wide_B
    A_bend, A_third, B_bend, B_third = 0.0, 0.0, 0.0, 0.0
    for k in range(2, room.B.size):
        A_bend += k * (k - 1.0) * abs(room.A[k])
        B_bend += k * (k - 1.0) * abs(room.B[k])
        A_third += k * (k - 1.0) * (k - 2.0) * abs(room.A[k])
        B_third += k * (k - 1.0) * (k - 2.0) * abs(room.B[k])
    off = 1.0 / (_BEYOND - 1.0)
    return _Doubts(of_A, of_B, off * wide_A, off * wide_B, A_bend, B_bend, A_third, B_third)


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
        Receives the boxes of the intervals. Without room, boxes with any are `FULL`.
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
    terms = boxes.alpha.shape[1]
    shape = terms, terms
    room = _Room(
        np.empty(shape, np.complex128), np.empty(shape, np.complex128),
        np.empty(terms, np.complex128), np.empty(terms, np.complex128),
        np.empty(terms, np.complex128), np.empty(terms, np.complex128),
        np.empty(terms, np.complex128), np.empty(terms, np.complex128),
        np.empty(2 * terms, np.complex128), np.empty(2 * terms), np.empty(_DEEP), np.empty(_DEEP),
    )  # fmt: skip
    still, listed = np.empty(terms, np.complex128), 0
    for i in range(states.size):
        r, s = _strength(boxes.S[i], False)
        if not s + boxes.size[i, OF_S] <= STRONG:
            r, s = _strength(boxes.S[i], True)
        s += boxes.size[i, OF_S]
        states[i] = EMPTY if s <= STRONG and r <= SINGULAR else CUT
        if states[i] == CUT:
            continue
        for k in range(terms):
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
        # Where D is zero, or at an end at which both forms are the same, A and B are zero, too.
        pole, zero = _pole(room.D)
        if boxes.end[i] != 0:
            pole, zero = (CUT if pole != EMPTY else ROOT), float(boxes.end[i])
        if pole == CUT:
            states[i] = CUT
            continue
        if pole == ROOT:
            _divide(room.A, room.B, zero)
        doubts = _bounds(boxes, i, (r, s), pole == ROOT, room)
        more = _isolate(i, doubts, room, listed, which, middles, halves, kinds)
        if more < 0:
            states[i] = FULL
        else:
            listed = more
    return listed
