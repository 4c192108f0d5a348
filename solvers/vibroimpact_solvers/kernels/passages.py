"""First passage of a coordinate through a wall, proved from its Taylor polynomial and remainder.

A coordinate with derivatives d_0 ... d_{n-1} at some instant and ``|y^(n)| <= B`` after it
stays between the envelopes ``p(h) -+ B h^n / n!``, p being its Taylor polynomial. The first
root of an envelope minus the wall is therefore not later than the first passage of y: nothing
that happens before it can be missed. Roots are isolated by the signs of Bernstein coefficients
(Descartes' rule on an interval), which never skips one.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.jit import fma, inline

ORDER: Final = 12
"""Degree n of the envelopes: derivatives up to n - 1 and a bound of the n-th."""
LOW: Final = 4
"""Degree of the envelopes that close in on a passage which is near."""
DEPTH: Final = 48
"""Halvings after which the left end of an interval counts as the root."""

INNER: Final = 1.5
"""Margins from a wall within which a coordinate runs to the wall itself."""

_FACTORIALS = np.array([1.0 / math.factorial(k) for k in range(ORDER + 1)])
# Bernstein coefficients of the powers: row k holds those of t^k.
_BERNSTEIN = np.array(
    [[math.comb(i, k) / math.comb(ORDER, k) for i in range(ORDER + 1)] for k in range(ORDER + 1)]
)
_NEVER = 2.0
# Rows of the work array; a stack of up to DEPTH intervals lies between them.
_POWERS, _BERNSTEIN_ROW, _STACK, _LEFTS, _ENDS = 0, 1, 2, DEPTH + 3, DEPTH + 4


@inline
def near_remainder(bound: float, h: float) -> float:
    """Return ``bound h^n / n!`` of an envelope of degree `LOW`."""
    return float(bound * h * h * h * h * _FACTORIALS[LOW])


@inline
def near_passage(d: Floats, bound: float, above: float, below: float) -> tuple[float, int]:
    """Return what `first_passage` does, from derivatives below `LOW`; -1 where they do not suffice.

    They suffice where the coordinate runs straight to a wall.
    """
    h = _straight(d, bound, math.inf, above, below, LOW, math.inf)
    return h, (1 if d[1] > 0.0 else -1)


@inline
def stays(d: Floats, bound: float, H: float, room: float) -> bool:
    """Return whether derivatives below `LOW` prove that nothing moves as far as room before H."""
    moved = abs(d[1]) * H + 0.5 * abs(d[2]) * H * H + abs(d[3]) * H * H * H * _FACTORIALS[3]
    return bool(moved + near_remainder(bound, H) < room)


@inline
def horizon(bound: float, allowed: float) -> float:
    """Return the h at which the remainder ``bound h^n / n!`` reaches what is allowed."""
    if bound <= 0.0:
        return math.inf
    return float((allowed / (bound * _FACTORIALS[ORDER])) ** (1.0 / ORDER))


@inline
def remainder(bound: float, h: float) -> float:
    """Return ``bound h^n / n!``."""
    return float(bound * h**ORDER * _FACTORIALS[ORDER])


@inline
def first_passage(
    d: Floats,
    bound: float,
    H: float,
    above: float,
    below: float,
    work: Floats,
    fine: float = math.inf,
    margin: float = 0.0,
) -> tuple[float, int, bool]:
    """Return a time before which no wall is passed, and the wall that may be passed then.

    Parameters
    ----------
    d : array, shape (ORDER,)
        Derivatives of y at h = 0; the value itself is not used.
    bound : float
        Of the magnitude of derivative ORDER in [0, H].
    H : float
        Length of the interval, finite.
    above, below : float
        Distances to the upper and lower wall, infinite where there is none; zero for a wall
        that is just being left (its derivative points away).
    work : array, shape (DEPTH + 5, DEPTH + 2)
    fine : float
        Remainder of the last expansion before a wall. The time that one with a larger remainder
        yields need not be the latest, as another one follows.
    margin : float
        From a wall, at which a coordinate is stopped that comes nearer but turns before the wall;
        one that is about as near already may turn there.

    Returns
    -------
    h : float
        H where no envelope meets a wall.
    side : int
        1 upper, -1 lower, 0 none.
    inner : bool
        Whether the coordinate is at the margin of this wall.
    """
    h = _straight(d, bound, H, above, below, ORDER, fine)
    if h >= 0.0:
        return h, (0 if h >= H else (1 if d[1] > 0.0 else -1)), False
    upper = above - margin if above > INNER * margin else above
    lower = below - margin if below > INNER * margin else below
    c, b = work[_POWERS], work[_BERNSTEIN_ROW]
    power = 1.0
    c[0] = 0.0
    moved = 0.0
    for k in range(1, ORDER):
        power *= H
        c[k] = d[k] * power * _FACTORIALS[k]
        moved += abs(c[k])
    rest = bound * power * H * _FACTORIALS[ORDER]
    if moved + rest < min(upper, lower):
        return H, 0, False
    for i in range(ORDER + 1):
        b[i] = c[1] * _BERNSTEIN[1, i]
    for k in range(2, ORDER):
        for i in range(ORDER + 1):
            b[i] += c[k] * _BERNSTEIN[k, i]
    highest, lowest = b[ORDER] + rest, b[ORDER] - rest
    for i in range(1, ORDER):
        highest = max(highest, b[i])
        lowest = min(lowest, b[i])
    up, down = _NEVER, _NEVER
    if highest >= above:
        up = _first_root(b, c, rest, 1.0, above, work)
    if lowest <= -below:
        down = _first_root(b, c, rest, -1.0, below, work)
    first, side = (up, 1) if up <= down else (down, -1)
    up, down = _NEVER, _NEVER
    if upper < above and highest >= upper:
        up = _first_root(b, c, rest, 1.0, upper, work)
    if lower < below and lowest <= -lower:
        down = _first_root(b, c, rest, -1.0, lower, work)
    if first <= 1.0:
        # On its way through a wall it passes the margin, which is not where it turns.
        if side > 0 and _runs(c, 1.0, up, first, margin):
            up = _NEVER
        if side < 0 and _runs(c, -1.0, down, first, margin):
            down = _NEVER
    if min(up, down) <= 1.0 and min(up, down) < first:
        return (up * H, 1, True) if up <= down else (down * H, -1, True)
    if first <= 1.0:
        return first * H, side, False
    return H, 0, False


@inline
def _runs(c: Floats, sign: float, at: float, first: float, margin: float) -> bool:
    """Return whether a coordinate runs from a margin straight to its wall: no slower than half."""
    slope = 0.0
    for k in range(ORDER - 1, 0, -1):
        slope = fma(slope, at, k * sign * c[k])
    return at <= first and (first - at) * slope <= 2.0 * margin


@inline
def _straight(
    d: Floats, bound: float, H: float, above: float, below: float, order: int, fine: float
) -> float:
    """Return a time before which no wall is passed where y runs to one only, -1 if unsure.

    It is H where y does not get there before. While the terms that slow y down, each at its
    largest, leave it a velocity of its sign, y moves towards that wall only, and so does the
    envelope: how far that is beyond the wall, over that velocity, is no less than how late a time
    is. fine is that of `first_passage`.
    """
    speed, room = abs(d[1]), (above if d[1] > 0.0 else below)
    if not room < speed * 1e300:
        return -1.0
    sign = 1.0 if d[1] > 0.0 else -1.0
    rest = bound * _FACTORIALS[order]
    t, step = min(H, room / speed), 0.0
    for _ in range(12):
        # y / t, its slope, and the least velocity until t: three short chains of products.
        value, slope, least = rest, 0.0, -order * rest
        for k in range(order - 1, 0, -1):
            term = sign * d[k] * _FACTORIALS[k]
            slope = fma(slope, t, value)
            value = fma(value, t, term)
            least = fma(least, t, k * (term if k == 1 else min(term, 0.0)))
        slope = fma(slope, t, value)
        beyond = fma(value, t, -room)
        if not least >= 0.25 * speed:
            return -1.0
        step = beyond / slope
        if t == H and beyond < 0.0:
            return H
        exact = abs(step) <= 1e-9 * t
        if exact or (abs(step) <= 1e-5 * t and rest * t**order > fine):
            return float(max(t - step if exact else t - max(beyond, 0.0) / least, 0.0))
        t = min(max(t - step, 0.0), H)
    return -1.0


@inline
def _first_root(b: Floats, c: Floats, rest: float, sign: float, room: float, work: Floats) -> float:
    """Return the first root in (0, 1] of ``sign p(t) + rest t^n - room``, or _NEVER."""
    n, top = ORDER, _STACK
    lefts, ends = work[_LEFTS], work[_ENDS]
    for i in range(n + 1):
        work[top, i] = sign * b[i] - room
    work[top, n] += rest
    lefts[top - _STACK], ends[top - _STACK] = 0.0, 1.0
    # Intervals wait on a stack, the leftmost on top.
    while top >= _STACK:
        f, left, end = work[top], lefts[top - _STACK], ends[top - _STACK]
        changes, last = 0, 0.0
        for i in range(n + 1):
            if f[i] != 0.0:
                if last * f[i] < 0.0:
                    changes += 1
                last = 1.0 if f[i] > 0.0 else -1.0
        if changes == 0 and last > 0.0:
            return float(left)
        if changes == 1 and last > 0.0:
            # The control polygon crosses near the root.
            k = 0
            while f[k + 1] <= 0.0:
                k += 1
            first = (k + f[k] / (f[k] - f[k + 1])) / n
            return _bracketed(c, rest, sign, room, left, end, left + first * (end - left))
        if changes == 0:
            top -= 1
        elif top == _STACK + DEPTH:
            return float(left)
        else:
            # de Casteljau: f keeps the right half, the left one goes on top of it.
            g = work[top + 1]
            g[0] = f[0]
            for j in range(1, n + 1):
                for i in range(n - j + 1):
                    f[i] = 0.5 * (f[i] + f[i + 1])
                g[j] = f[0]
            middle = 0.5 * (left + end)
            place = top - _STACK
            lefts[place + 1], ends[place + 1] = left, middle
            lefts[place] = middle
            top += 1
    return _NEVER


@inline
def _bracketed(
    c: Floats, rest: float, sign: float, room: float, left: float, right: float, first: float
) -> float:
    """Return the only root in (left, right] by Newton's method kept inside the bracket.

    first is where it starts.
    """
    t, before = first, 0.0
    for _ in range(200):
        value, slope = rest, 0.0
        for k in range(ORDER - 1, 0, -1):
            slope = fma(slope, t, value)
            value = fma(value, t, sign * c[k])
        slope = fma(slope, t, value)
        value = fma(value, t, -room)
        if value < 0.0:
            left = t
        elif value > 0.0:
            right = t
        else:
            return t
        step = abs(value / slope) if slope > 0.0 else math.inf
        new = t - value / slope
        # Steps that shrink like squares: the next one would be rounding.
        if step <= 2e-16 * t or (step <= 1e-8 * t and step <= 1e-4 * before):
            return min(max(new, left), right)
        before = step
        if not left < new < right:
            new, before = 0.5 * (left + right), 0.0
        if new == t:
            return t
        t = new
    return t
