"""Series of the forces of soft limiters, and where they hold.

The force of a limiter is ``-g |q|^p`` along its coordinate, q being this over its size and g a gain
for each side of zero. The series of q is known one order ahead of that of the force, since

    q_{k+1} = (slope . z_k) h / (k + 1)

takes no more than coefficients k of the state (`kernels.taylor`), and one of three ways leads from
q to the force:

- *grown*: by the differential equation of a power, ``q f' = p q' f`` (`series.power`);
- *linked*: a whole power by repeated squaring, also near q = 0, where the other has large
  roundings;
- *none*: a force that is zero, or so small that the state does not feel it.

Few coefficients do not show a high power near q = 0: forces are compared with their series at
the end of a step, and in its middle where they could hide. A series holds on one side of zero,
unless the law there is the same function.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.flow import Z1, Z2
from vibroimpact_solvers.kernels.jit import fma, inline, inner, record
from vibroimpact_solvers.kernels.series import (
    FIRST,
    PADDED,
    SECOND,
    TERMS,
    place_of,
    power,
    product,
    raised,
    rate,
    square,
    summed,
)

LARGEST: Final = 64
"""Largest whole exponent whose series is computed by products."""
_EPS: Final = 2.0**-52
_GROWTH: Final = 4.0  # of a step over the last one, at most
_LOOKS: Final = 1000  # at most, for a change of sides
_HALVINGS: Final = 30
NO_SERIES, _LINKED, _GROWN = 0, 1, 2
"""Ways to the series of a force; it has none where it is zero or too small to be felt."""

LAW: Final = record(
    [
        ("level", np.float64),  # q at the zero of the state
        ("below", np.float64),  # gains on both sides of zero
        ("above", np.float64),
        ("low", np.float64),  # compressions over |q| on both sides
        ("high", np.float64),
        ("strength", np.float64),  # size of the change of state by a unit impulse
        ("grain", np.float64),  # of q, for a unit of the size of a state
        ("exponent", np.float64),
        ("whole", np.int64),  # the exponent where products are to give the series, else 0
    ]
)
"""Numbers of a limiter."""

Q: Final = 0
"""Which of the powers q is."""
_POWERS: Final = 2 * LARGEST.bit_length()
BRANCH: Final = record(
    [
        ("way", np.int64),  # how the force is computed
        ("known", np.int64),  # coefficients so far
        ("side", np.float64),  # 1 or -1
        ("gain", np.float64),
        ("inverse", np.float64),  # 1/q at the beginning
        ("next", np.float64),  # the next coefficient of q
        ("end", np.float64),  # q at the end
        ("missed", np.float64),  # by the series of the force at the end
        ("force", np.float64, (PADDED,)),
        ("rising", np.float64, (PADDED,)),  # k q_k in reverse
        ("powers", np.float64, (_POWERS, TERMS)),  # q, and its powers by repeated squaring
        (
            "past",
            np.float64,
            (_POWERS, PADDED),
        ),  # in reverse; for forces that are grown without q_0 and q_1
    ]
)
"""A limiter within a step, and its series."""


class Limiters(NamedTuple):
    """Soft limiters, as linear forms on the state and a law."""

    forms: Floats  # (wall, 2, pair): coordinates over their sizes
    slopes: Floats  # (wall, 2, pair): their rates
    kicks: Floats  # (wall, 2, pair): changes of state by unit impulses
    laws: Any  # (wall,) of LAW


class Step(NamedTuple):
    """What is known of a step at its beginning."""

    h: float  # the last step, over which series are scaled
    scale: float  # the size of the state
    allowed: float  # the error of the step
    spread: float  # of roundings along the series of a force (`rounding_spread`)


@inline
def size_of(q: float, exponent: float, whole: int) -> float:
    """Return ``|q|^exponent``."""
    if whole > 0:
        return raised(abs(q), whole)
    return math.pow(abs(q), exponent)


@inline
def form(forms: Floats, i: int, z: Floats) -> float:
    """Return the value of a linear form at a state, shape (2, pair)."""
    n = z.shape[1]
    s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
    for j in range(0, n - 1, 2):
        s0 = fma(forms[i, Z1, j], z[Z1, j], s0)
        s1 = fma(forms[i, Z1, j + 1], z[Z1, j + 1], s1)
        s2 = fma(forms[i, Z2, j], z[Z2, j], s2)
        s3 = fma(forms[i, Z2, j + 1], z[Z2, j + 1], s3)
    if n % 2 == 1:
        s0 = fma(forms[i, Z1, n - 1], z[Z1, n - 1], s0)
        s2 = fma(forms[i, Z2, n - 1], z[Z2, n - 1], s2)
    return (s0 + s1) + (s2 + s3)


@inner
def rounding_spread(order: int, exponent: float) -> float:
    """Return more than the rounding of a force's series, over its first coefficient."""
    spread = math.lgamma(order + exponent + 1.0) - math.lgamma(exponent + 1.0)
    return (order + 1) * _EPS * math.exp(spread - math.lgamma(order + 1.0))


@inline
def _is_near(q: float, change: float, strength: float, whole: int, order: int, step: Step) -> bool:
    """Return whether q is so near zero that a power could not be grown to the order."""
    # A rounding of the force grows no larger than the force at this distance.
    away = abs(q) - abs(change)
    near = away < 0.7 * abs(q)
    if near and away > 0.0:
        near = not step.h * strength * raised(q * (q / away), whole) <= step.scale
    if near and whole > 3:
        # Or as all roundings of a force that is small as yet, in all of the terms.
        ratio = max(1.0, abs(change / q)) if q != 0.0 else math.inf
        rounding = step.spread * raised(ratio, order) * raised(abs(q), whole)
        near = not step.h * strength * rounding <= 0.1 * step.allowed
    return near


@inner
def _left_out(q: float, change: float, strength: float, exponent: float, step: Step) -> float:
    """Return how far over the last step a force may be left out; negative: it may not.

    As small a force moves the state by less than is allowed, in passing or in a time 1.
    """
    slight = step.allowed / strength
    least = math.pow(slight, 1.0 / exponent)
    least = max(least, math.pow(slight * abs(change) / step.h, 1.0 / (exponent + 1.0)))
    if abs(q) > least:
        return -1.0
    ahead = max(least + (abs(q) if q * change < 0.0 else -abs(q)), 0.1 * least)
    return ahead / abs(change) if ahead < _GROWTH * abs(change) else _GROWTH


@inline
def clear(now: Any) -> None:
    """Set the series of a force to zero."""
    for k in range(PADDED):
        now.force[k] = 0.0


@inline
def begin(limiters: Limiters, branches: Any, z: Floats, order: int, step: Step) -> float:
    """Choose how the series of forces are computed; return the longest step over the last one.

    Negative: a force is left out that is not zero.
    """
    reach, sign = _GROWTH, 1.0
    for i in range(limiters.laws.size):
        law, now = limiters.laws[i], branches[i]
        exponent, whole = law.exponent, law.whole
        q = law.level + form(limiters.forms, i, z)
        change = step.h * form(limiters.slopes, i, z)
        # Where q is zero but for its rounding the side is that to which it goes.
        rounding = 8.0 * _EPS * (abs(law.level) + step.scale * law.grain)
        above = (change if abs(q) <= rounding else q) > 0.0
        gain = law.above if above else law.below
        strength, way = law.strength * abs(gain), _GROWN
        if gain == 0.0:
            way = NO_SERIES
        elif whole > 0:
            if whole <= 3 or _is_near(q, change, strength, whole, order, step):
                way = _LINKED
        else:
            limit = _left_out(q, change, strength, exponent, step)
            if limit >= 0.0:
                way, sign, reach = NO_SERIES, -1.0, min(reach, limit)
        if way == _GROWN:
            now.inverse = 1.0 / q
            now.force[FIRST] = gain * size_of(q, exponent, whole)
        elif way == NO_SERIES:
            clear(now)
        elif whole % 2 == 1 and not above:
            gain = -gain  # of q^exponent, not of its size
        now.next, now.way, now.gain, now.known = q, way, gain, 0
        now.side = 1.0 if above else -1.0
    return sign * reach


@inline
def _linked(now: Any, k: int, whole: int) -> float:
    """Return coefficient k of the power of a coordinate, by repeated squaring."""
    f: float = now.powers[Q, k]
    count, bit = 0, 1
    while 2 * bit <= whole:
        bit *= 2
    while bit > 1:
        bit //= 2
        f = square(now.powers[count], now.past[count], k)
        count += 1
        now.powers[count, k] = now.past[count, place_of(k)] = f
        if whole & bit != 0:
            f = product(now.powers[count], now.powers[Q], now.past[Q], k)
            count += 1
            now.powers[count, k] = now.past[count, place_of(k)] = f
    return f


@inner
def coefficient(now: Any, part: float, exponent: float, whole: int) -> float:
    """Keep the next coefficient k of a coordinate, and return that of its force; part is 1/k."""
    k, q, f = now.known, now.next, 0.0
    now.known = k + 1
    now.powers[Q, k] = q
    if now.way == _GROWN:
        kept = q if k > 1 else 0.0
        now.past[Q, place_of(k)], now.rising[place_of(k)] = kept, k * kept
        f = now.force[FIRST]
        if k > 0:
            slope, past = now.powers[Q, SECOND], now.past[Q]
            f = power(q, slope, now.rising, past, now.force, k, exponent, part, now.inverse)
            now.force[k] = f
    elif now.way == _LINKED:
        now.past[Q, place_of(k)] = q
        f = now.gain * _linked(now, k, whole)
        now.force[k] = f
    return f


@inner
def side_kept(u: Floats, last: int, s: float, side: float) -> float:
    """Return the time at which a series changes sides for the first time, s if not before.

    ``q(t + d) >= q + q' d - B d^2 / 2``, B being a bound of |q''|: while this is positive q keeps
    its side, and where it ends the next such bound begins. Zero is passed by no more than
    the rounding of q.
    """
    bound, size, reach = 0.0, s * abs(u[SECOND]), 1.0
    for k in range(2, last + 1):
        bound += k * (k - 1) * abs(u[k]) * reach
        reach *= s
        size += abs(u[k]) * reach * s
    q, slope, t = side * u[FIRST], side * u[SECOND], 0.0
    kept = s
    if q <= size and size > 0.0:
        slack = 4.0 * _EPS * (size + abs(q))
        for _ in range(_LOOKS):
            free = max(q, 0.0) + slack
            root = math.sqrt(slope * slope + 2.0 * bound * free)
            # The positive root of free + slope d - bound d^2 / 2, without a difference of equals.
            if slope > 0.0:
                t += (slope + root) / bound
            else:
                t += 2.0 * free / (root - slope)
            kept = min(t, s)
            if not t < s:
                break
            q, slope = side * summed(u, last, t), side * rate(u, last, t)
            if q <= 0.0:
                break
    return kept


@inline
def sides_kept(limiters: Limiters, branches: Any, order: int, s: float) -> float:
    """Return the part of a step up to s in which every law stays the same function."""
    for i in range(limiters.laws.size):
        law, now = limiters.laws[i], branches[i]
        whole, one_sided = law.whole, law.below == 0.0 or law.above == 0.0
        differ = whole > 0 and (whole % 2 == 0 or law.below != -law.above)
        if differ or one_sided:
            s = side_kept(branches[i].powers[Q], order, s, now.side)
    return s


@inline
def could_hide(limiters: Limiters, branches: Any, order: int) -> bool:
    """Return whether forces could rise and fall within a step, too steeply for the series."""
    hidden = False
    for i in range(limiters.laws.size):
        steep = order <= limiters.laws[i].exponent + 2.0
        hidden = hidden or (
            steep and abs(branches[i].powers[Q, SECOND]) > 0.3 * abs(branches[i].powers[Q, FIRST])
        )
    return hidden


@inline
def defect(
    limiters: Limiters, branches: Any, end: Floats, order: int, s: float, middle: bool
) -> float:
    """Return how much the series of forces miss at the end of a step, times their strengths.

    Fills in where the coordinates are then, and what is missed there. What rounding makes of forces
    does not count. Infinite where a coordinate is so far away that its force, or its series, is no
    number.
    """
    worst = 0.0
    for i in range(limiters.laws.size):
        law, now, u, t = limiters.laws[i], branches[i], branches[i].powers[Q], s
        exponent = law.exponent
        q = u[FIRST] + form(limiters.forms, i, end)
        now.end = q
        for _ in range(2 if middle else 1):
            gain = law.above if q > 0.0 else law.below
            # A side without a limiter has none, however far away.
            force = gain * size_of(q, exponent, law.whole) if gain != 0.0 else 0.0
            off = force - summed(now.force, order - 1, t)
            missing = abs(off)
            if not missing < math.inf:  # nor a number, which a maximum would pass over
                return math.inf
            worst = max(worst, law.strength * (missing - 4.0 * exponent * _EPS * abs(force)))
            if t == s:
                now.missed = off
            if middle:
                t = 0.5 * s
                q = summed(u, order, t)
    return worst


@inner
def _turn(u: Floats, last: int, s: float) -> float:
    """Return how far from zero a series turns, which moves away at 0 and comes back at s."""
    low, high = 0.0, s
    for _ in range(_HALVINGS):
        t = 0.5 * (low + high)
        if u[FIRST] * rate(u, last, t) > 0.0:
            low = t
        else:
            high = t
    return abs(summed(u, last, low))


@inline
def compression(
    limiters: Limiters, branches: Any, end: Floats, order: int, s: float, step: Step, deepest: float
) -> float:
    """Return the largest compression, of those before and those within a step."""
    for i in range(limiters.laws.size):
        law, u, q = limiters.laws[i], branches[i].powers[Q], branches[i].end
        far = max(abs(u[FIRST]), abs(q))
        ratio = law.high if u[FIRST] + q > 0.0 else law.low
        # Within one step of many it comes hardly twice as far as at both ends.
        away = 2.0 * far * ratio > deepest and u[FIRST] * u[SECOND] > 0.0
        if away and u[FIRST] * (u[SECOND] + step.h * form(limiters.slopes, i, end)) < 0.0:
            far = max(far, _turn(u, order, s))
        deepest = max(deepest, far * ratio)
    return deepest
