"""Motion of a structure with soft limiters, step by step by Taylor series.

The state is that of `kernels.flow`. Its coefficients follow one another,

    C[k + 1] = (A C[k] + sum over the limiters of kick f[k]) h / (k + 1) ,

where f[k] are those of a limiter's force, and h is the last step: coefficients are scaled by it, so
that they neither overflow nor vanish. The force of a limiter is a gain times |q|^exponent, q being
its coordinate over a size, and each of its sides has its own gain.

A step is as long as the last two coefficients allow (Jorba and Zou). Near q = 0 a high power does
not show in few coefficients: at the end of a step, and in its middle where it could hide, forces
are compared with the sums of their series, and the step is shortened until they agree. Where the
two sides of a limiter have different laws a step ends where the coordinate changes sides, located
so that no change is missed. A power that is not whole has no series at q = 0, and is left out
there while its effect on the state is below the error of a step.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Final

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.jit import address, fma, inline, item, kernel, put
from vibroimpact_solvers.kernels.series import power, product, raised, square, summed

LARGEST: Final = 64
"""Largest whole exponent whose series is computed by products."""
_EPS: Final = 2.0**-52
_GROWTH: Final = 4.0  # of a step over the last one, at most
_SHORTER: Final = 0.8  # steps whose forces do not agree are taken this much shorter
_SHORTEST: Final = 1e-25  # of the motion: limiters that need less are too stiff
_FEW: Final = 8  # pairs up to which sums go pair by pair
_LOOKS: Final = 1000  # at most, for a change of sides
_HALVINGS: Final = 30
_NONE, _LINKED, _GROWN = 0.0, 1.0, 2.0  # series of a force: zero, by products, by its rate
_Q, _SIDE, _GAIN, _WAY, _INVERSE, _KICK, _FORCE, _GRAIN = range(8)  # rows of what is kept of walls
_KEPT: Final = 8
_SERIES: Final = 4  # of a limiter beside its products: q, that of j q_j, q without q_0, the force
_FORCES: Final = 3  # the place of the last of them
_ZEROS: Final = 4  # between two series, which `power` reads
_UNIT, _BELOW, _ABOVE, _LOW, _HIGH = range(5)  # rows of the laws


class Stop(IntEnum):
    """Why `follow` stopped."""

    END = 0
    BUDGET = 1
    STIFF = 2


def room(pairs: int, walls: int, order: int) -> int:
    """Return how many numbers `follow` needs to work with."""
    terms = order + 1
    series = walls * (_SERIES + 2 * LARGEST.bit_length()) * (terms + _ZEROS) + _ZEROS
    return 2 * pairs * (terms + 1) + 5 * pairs + _KEPT * walls + terms + 1 + series


@inline
def _size(q: float, exponent: float, whole: int) -> float:
    """Return ``|q|^exponent``."""
    if whole > 0:
        return raised(abs(q), whole)
    return math.pow(abs(q), exponent)


@inline
def _form(forms: int, C: int, n: int) -> float:
    """Return the value of a linear form at 2 n numbers."""
    s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
    for j in range(0, n - n % 2, 2):
        s0 = fma(item(forms, j), item(C, j), s0)
        s1 = fma(item(forms, j + 1), item(C, j + 1), s1)
        s2 = fma(item(forms, n + j), item(C, n + j), s2)
        s3 = fma(item(forms, n + j + 1), item(C, n + j + 1), s3)
    if n % 2 == 1:
        s0 = fma(item(forms, n - 1), item(C, n - 1), s0)
        s2 = fma(item(forms, 2 * n - 1), item(C, 2 * n - 1), s2)
    return (s0 + s1) + (s2 + s3)


@inline
def _largest(weights: int, C: int, n: int) -> float:
    """Return the largest of 2 n numbers, weighted; nan where one is."""
    largest, checked = 0.0, 0.0
    for j in range(n):
        a, b = item(weights, j) * item(C, j), item(weights, j) * item(C, n + j)
        largest = max(largest, abs(a), abs(b))
        checked += 0.0 * a + 0.0 * b
    return largest + checked


@kernel
def _moved(C: int, n: int, order: int, s: float, out: int) -> None:
    """Fill in the change of the state within a part s of the last step, 2 n numbers."""
    if n <= _FEW:
        for j in range(2 * n):
            total = item(C, 2 * n * order + j)
            for k in range(order - 1, 0, -1):
                total = fma(total, s, item(C, 2 * n * k + j))
            put(out, j, s * total)
    else:
        for j in range(2 * n):
            put(out, j, item(C, 2 * n * order + j))
        for k in range(order - 1, 0, -1):
            for j in range(2 * n):
                put(out, j, fma(item(out, j), s, item(C, 2 * n * k + j)))
        for j in range(2 * n):
            put(out, j, s * item(out, j))


@inline
def _rate(u: int, count: int, t: float) -> float:
    """Return the rate of a series."""
    total = (count - 1) * item(u, count - 1)
    for k in range(count - 2, 0, -1):
        total = fma(total, t, k * item(u, k))
    return total


@kernel
def _side_kept(u: int, count: int, s: float, side: float) -> float:
    """Return the time at which a series changes sides for the first time, s if not before.

    ``q(t + d) >= q + q' d - B d^2 / 2``, B being a bound of |q''|: while this is positive q keeps
    its side, and where it ends the next such bound begins. Zero is passed by no more than
    the rounding of q.
    """
    bound, size, reach = 0.0, s * abs(item(u, 1)), 1.0
    for k in range(2, count):
        bound += k * (k - 1) * abs(item(u, k)) * reach
        reach *= s
        size += abs(item(u, k)) * reach * s
    q, rate, t = side * item(u, 0), side * item(u, 1), 0.0
    kept = s
    if q <= size:
        slack = 4.0 * _EPS * (size + abs(q))
        for _ in range(_LOOKS):
            free = max(q, 0.0) + slack
            root = math.sqrt(rate * rate + 2.0 * bound * free)
            # The positive root of free + rate d - bound d^2 / 2, without a difference of equals.
            if rate > 0.0:
                t += (rate + root) / bound
            else:
                t += 2.0 * free / (root - rate)
            kept = min(t, s)
            if not t < s:
                break
            q, rate = side * summed(u, count, t), side * _rate(u, count, t)
            if q <= 0.0:
                break
    return kept


@kernel
def side_kept(S: Floats, s: float, side: float) -> float:
    """Return the time at which a series changes sides for the first time, s if not before.

    Parameters
    ----------
    S : array, shape (term,)
    s : float
        Positive; the end of the interval from 0.
    side : float
        1 or -1: that of the series from 0 on.
    """
    return _side_kept(address(S), S.size, s, side)


@kernel
def _begin(
    forms: int,
    levels: int,
    laws: int,
    n: int,
    walls: int,
    exponent: float,
    whole: int,
    C: int,
    h: float,
    allowed: float,
    scale: float,
    spread: float,
    now: int,
    S: int,
    depth: int,
    terms: int,
) -> float:
    """Choose how the series of forces are computed; return the longest step over the last one.

    Negative: a force is left out that is not zero.
    """
    reach, sign = _GROWTH, 1.0
    for i in range(walls):
        unit, f = item(laws, i), S + 8 * (i * depth + _FORCES * (terms + _ZEROS))
        q = unit * (item(levels, i) + _form(forms + 16 * n * i, C, n))
        rate = h * unit * _form(forms + 16 * n * (walls + i), C, n)
        # Where q is zero but for its rounding the side is that to which it goes.
        rounding = (
            8.0 * _EPS * unit * (abs(item(levels, i)) + scale * item(now, _GRAIN * walls + i))
        )
        above = (rate if abs(q) <= rounding else q) > 0.0
        gain = item(laws, (_ABOVE if above else _BELOW) * walls + i)
        strength = item(now, _KICK * walls + i) * abs(gain)
        way = _GROWN
        if gain == 0.0:
            way = _NONE
        elif whole > 0:
            # A rounding of the force grows no larger than the force at this distance.
            away = abs(q) - abs(rate)
            near = away < 0.7 * abs(q)
            if near and away > 0.0:
                near = not h * strength * raised(q * (q / away), whole) <= scale
            if near and whole > 3:
                # Or as all roundings of a force that is small as yet, in all of the terms.
                ratio = max(1.0, abs(rate / q)) if q != 0.0 else math.inf
                rounding = spread * raised(ratio, terms - 1) * raised(abs(q), whole)
                near = not h * strength * rounding <= 0.1 * allowed
            if near or whole <= 3:
                way = _LINKED
        else:
            # As small a force moves the state by less than is allowed, in passing or in a time 1.
            slight = allowed / strength
            least = math.pow(slight, 1.0 / exponent)
            least = max(least, math.pow(slight * abs(rate) / h, 1.0 / (exponent + 1.0)))
            if abs(q) <= least:
                way, sign = _NONE, -1.0
                ahead = max(least + (abs(q) if q * rate < 0.0 else -abs(q)), 0.1 * least)
                if ahead < reach * abs(rate):
                    reach = ahead / abs(rate)
        if way == _GROWN:
            put(now, _INVERSE * walls + i, 1.0 / q)
            put(f, 0, gain * _size(q, exponent, whole))
        elif way == _NONE:
            for k in range(terms):
                put(f, k, 0.0)
        elif whole % 2 == 1 and not above:
            gain = -gain  # of q^exponent, not of its size
        put(now, _Q * walls + i, q)
        put(now, _WAY * walls + i, way)
        put(now, _GAIN * walls + i, gain)
        put(now, _SIDE * walls + i, 1.0 if above else -1.0)
    return sign * reach


@kernel
def _pushed(
    now: int,
    i: int,
    walls: int,
    exponent: float,
    whole: int,
    top: int,
    base: int,
    k: int,
    part: float,
    terms: int,
) -> float:
    """Store coefficient k of a coordinate, and return that of its force."""
    q, way = item(now, _Q * walls + i), item(now, _WAY * walls + i)
    put(base, k, q)
    row = 8 * (terms + _ZEROS)
    f, force = 0.0, base + _FORCES * row
    if way == _GROWN:
        f = item(force, 0)
        if k > 0:
            put(base + row, k, k * q)
            put(base + 2 * row, k, q)
            start = item(now, _INVERSE * walls + i)
            f = power(base, base + row, base + 2 * row, force, k, exponent, part, start)
            put(force, k, f)
    elif way == _LINKED:
        f, last = q, base
        stage = force + row
        for bit in range(top, -1, -1):
            f = square(last, k)
            put(stage, k, f)
            last = stage
            stage += row
            if (whole >> bit) & 1:
                f = product(last, base, k)
                put(stage, k, f)
                last = stage
                stage += row
        f *= item(now, _GAIN * walls + i)
        put(force, k, f)
    return f


@kernel
def _linear(F: int, L: int, n: int, rows: int, C: int, k: int, factor: float) -> None:
    """Fill in coefficients k + 1 of the state, without the forces."""
    here = C + 16 * n * k
    there = here + 16 * n
    for j in range(n):
        a, b = item(here, j), item(here, n + j)
        put(there, j, factor * fma(item(L, j), a, item(L, n + j) * b))
        put(there, n + j, factor * fma(item(L, j), b, item(L, 2 * n + j) * a))
    if k == 0:
        for j in range(n):
            put(there, n + j, fma(factor, item(L, 3 * n + j), item(there, n + j)))
    for row in range(4, rows, 2):
        i, drive = int(item(F, row * n)), int(item(F, row * n + 1))
        u, v = item(F, row * n + n), item(F, row * n + n + 1)
        a, b = item(here, drive), -item(here, n + drive)
        put(there, i, fma(factor, u * a - v * b, item(there, i)))
        put(there, n + i, fma(-factor, u * b + v * a, item(there, n + i)))


@kernel
def _defect(
    forms: int,
    laws: int,
    n: int,
    walls: int,
    exponent: float,
    whole: int,
    out: int,
    s: float,
    middle: bool,
    now: int,
    S: int,
    depth: int,
    terms: int,
) -> float:
    """Return how much the series of forces miss at the end of a step, times their kicks.

    Fills in where the coordinates are then. What rounding makes of forces does not count.
    """
    worst = 0.0
    for i in range(walls):
        u = S + 8 * i * depth
        q = fma(item(laws, i), _form(forms + 16 * n * i, out, n), item(u, 0))
        put(now, _Q * walls + i, q)
        t = s
        for _ in range(2 if middle else 1):
            gain = item(laws, (_ABOVE if q > 0.0 else _BELOW) * walls + i)
            force = gain * _size(q, exponent, whole)
            missing = abs(force - summed(u + 8 * _FORCES * (terms + _ZEROS), terms - 1, t))
            missing -= 4.0 * exponent * _EPS * abs(force)
            worst = max(worst, item(now, _KICK * walls + i) * missing)
            t = 0.5 * s
            if middle:
                q = summed(u, terms, t)
    return worst


@kernel
def _compression(
    laws: int, walls: int, now: int, S: int, depth: int, terms: int, s: float, deepest: float
) -> float:
    """Return the largest compression, of those before and those within a step."""
    for i in range(walls):
        u, end = S + 8 * i * depth, item(now, _Q * walls + i)
        start, turn = item(u, 0), max(abs(item(u, 0)), abs(end))
        ratio = item(laws, (_HIGH if start + end > 0.0 else _LOW) * walls + i)
        # Within one step of many it comes hardly twice as far as at both ends.
        near = 2.0 * turn * ratio > deepest and start * item(u, 1) > 0.0
        if near and start * _rate(u, terms, s) < 0.0:
            # It moves away from zero and comes back: halve the time between.
            low, high = 0.0, s
            for _ in range(_HALVINGS):
                t = 0.5 * (low + high)
                if start * _rate(u, terms, t) > 0.0:
                    low = t
                else:
                    high = t
            turn = max(turn, abs(summed(u, terms, low)))
        deepest = max(deepest, turn * ratio)
    return deepest


@kernel
def follow(
    F: Floats,
    split: Integers,
    forms: Floats,
    levels: Floats,
    laws: Floats,
    weights: Floats,
    settings: Floats,
    output_times: Floats,
    z: Floats,
    clock: Floats,
    counts: Integers,
    samples: Floats,
    work: Floats,
) -> int:
    """Advance a motion to its end; return why it stopped, a `Stop`.

    Parameters
    ----------
    F, split, forms : array
        See `kernels.flow`.
    levels : array, shape (constraint,)
        The coordinates at the zero of the state.
    laws : array, shape (5, constraint)
        Factors from coordinates to q; the gains below and above zero, the force being the gain
        times ``|q|^exponent``; factors from |q| to compressions, below and above zero.
    weights : array, shape (pair,)
        Weights of the pairs in the size of a state.
    settings : array, shape (4,)
        The exponent; whether it is whole and at most `LARGEST`; the order of the series, at
        least 4; the error of a step, relative to the size of the state.
    output_times : array, shape (time,)
        Ascending times of the samples.
    z : array, shape (2, 2, pair)
        The state, and what rounding took from it.
    clock : array, shape (6,)
        The time and what rounding took from it, the end, the last step, the largest compression,
        and the most steps of this call.
    counts : array of int, shape (3,)
        Steps, samples, and shortenings of steps.
    samples : array, shape (time, 2, pair)
    work : array, shape (`room`,)
    """
    n, walls, order, rows = F.shape[1], levels.size, int(settings[2]), F.shape[0]
    exponent, eps, terms = settings[0], settings[3], int(settings[2]) + 1
    whole, top = 0, -1
    if settings[1] > 0.0:
        whole = int(exponent)
        while whole >> (top + 2) > 0:
            top += 1
    depth = (_SERIES + 2 * (top + 1)) * (terms + _ZEROS)
    C = address(work)
    out = C + 16 * n * terms
    L = out + 16 * n
    now = L + 40 * n
    inverse = now + 8 * _KEPT * walls
    S = inverse + 8 * (terms + 1 + _ZEROS)
    a_forms, a_levels, a_laws, a_F = address(forms), address(levels), address(laws), address(F)
    a_weights, a_z, kicks = address(weights), address(z), address(forms) + 32 * n * walls
    for j in range(n):
        turn = F[1, j] if j < split[1] else 1.0
        back = -F[1, j] if j < split[0] else (F[1, j] if j < split[1] else 0.0)
        put(L, j, F[0, j])
        put(L, n + j, turn)
        put(L, 2 * n + j, back)
        put(L, 3 * n + j, F[3, j])
        put(L, 4 * n + j, F[2, j] if j < split[0] else 0.0)
    for k in range(1, terms + 1):
        put(inverse, k, 1.0 / k)
    for k in range(-_ZEROS, walls * depth):
        put(S, k, 0.0)
    for i in range(walls):
        put(now, _KICK * walls + i, _largest(a_weights, kicks + 16 * n * i, n))
        reach = 0.0
        for j in range(n):
            if weights[j] > 0.0:
                reach += (abs(forms[0, i, 0, j]) + abs(forms[0, i, 1, j])) / weights[j]
        put(now, _GRAIN * walls + i, reach)
    # More than the rounding of a force's series, over its first coefficient (`series.power`).
    spread = math.lgamma(order + exponent + 1.0) - math.lgamma(exponent + 1.0)
    spread = terms * _EPS * math.exp(spread - math.lgamma(order + 1.0))
    fused = walls == 1 and n <= _FEW and rows == 4
    deepest, h, stop = clock[4], clock[3], 0
    last_step = counts[0] + int(clock[5])
    rest = (clock[2] - clock[0]) - clock[1]
    while rest > 0.0:
        if counts[0] >= last_step:
            stop = 1
            break
        for j in range(2 * n):
            put(C, j, item(a_z, j))
        scale = _largest(a_weights, C, n)
        allowed = eps * scale
        reach = _begin(
            a_forms, a_levels, a_laws, n, walls, exponent, whole, C, h, allowed, scale, spread, now,
            S, depth, terms,
        )  # fmt: skip
        for k in range(order):
            factor, part = h * item(inverse, k + 1), item(inverse, k)
            if fused:
                f = factor * _pushed(now, 0, 1, exponent, whole, top, S, k, part, terms)
                here, y0, y1 = C + 16 * n * k, 0.0, 0.0
                for j in range(n):
                    a, b = item(here, j), item(here, n + j)
                    c = fma(item(L, j), a, item(L, n + j) * b)
                    d = fma(item(L, j), b, item(L, 2 * n + j) * a)
                    if k == 0:
                        d += item(L, 3 * n + j)
                    c = fma(f, item(kicks, j), factor * c)
                    d = fma(f, item(kicks, n + j), factor * d)
                    put(here, 2 * n + j, c)
                    put(here, 3 * n + j, d)
                    y0 = fma(item(a_forms, j), c, y0)
                    y1 = fma(item(a_forms, n + j), d, y1)
                put(now, _Q, item(a_laws, 0) * (y0 + y1))
            else:
                for i in range(walls):
                    base = S + 8 * i * depth
                    f = _pushed(now, i, walls, exponent, whole, top, base, k, part, terms)
                    put(now, _FORCE * walls + i, factor * f)
                _linear(a_F, L, n, rows, C, k, factor)
                there = C + 16 * n * (k + 1)
                for i in range(walls):
                    f, kick = item(now, _FORCE * walls + i), kicks + 16 * n * i
                    for j in range(2 * n):
                        put(there, j, fma(f, item(kick, j), item(there, j)))
                for i in range(walls):
                    q = item(a_laws, i) * _form(a_forms + 16 * n * i, there, n)
                    put(now, _Q * walls + i, q)
        for i in range(walls):
            put(S + 8 * i * depth, order, item(now, _Q * walls + i))
        last = max(
            _largest(a_weights, C + 16 * n * (order - 1), n),
            _largest(a_weights, C + 16 * n * order, n),
        )
        if not last < math.inf:
            h *= 2.0**-20
            for k in range(walls * depth):
                put(S, k, 0.0)
            if h > _SHORTEST * clock[2]:
                continue
            stop = 2
            break
        s = min(abs(reach), rest / h)
        if last > 0.0:
            s = min(s, math.exp(math.log(allowed / last) * item(inverse, order)))
        hidden = reach < 0.0
        for i in range(walls):
            below, above = item(a_laws, _BELOW * walls + i), item(a_laws, _ABOVE * walls + i)
            if (whole > 0 and (whole % 2 == 0 or below != -above)) or item(
                now, _GAIN * walls + i
            ) == 0.0:
                s = _side_kept(S + 8 * i * depth, terms, s, item(now, _SIDE * walls + i))
            u = S + 8 * i * depth
            if order <= exponent + 2.0 and abs(item(u, 1)) > 0.3 * abs(item(u, 0)):
                hidden = True
        while True:
            _moved(C, n, order, s, out)
            worst = _defect(
                a_forms, a_laws, n, walls, exponent, whole, out, s, hidden, now, S, depth, terms
            )
            if worst * s * h <= 8.0 * allowed or not s > _SHORTEST:
                break  # shorter ones than that end as too stiff
            s *= _SHORTER
            counts[2] += 1
        span = s * h
        final = span >= rest * (1.0 - 8.0 * _EPS)
        if final:
            span = rest
        if not (s > _SHORTEST and span > _SHORTEST * clock[2]):
            stop = 2
            break
        deepest = _compression(a_laws, walls, now, S, depth, terms, s, deepest)
        while counts[1] < output_times.size:
            t = (output_times[counts[1]] - clock[0]) - clock[1]
            if t > span:
                break
            sample = address(samples) + 16 * n * counts[1]
            _moved(C, n, order, t / h, sample)
            for j in range(2 * n):
                put(sample, j, item(sample, j) + item(C, j))
            counts[1] += 1
        for j in range(n):
            # What rounding took from the frequency turns the state a little further.
            turn = item(L, 4 * n + j) * span
            put(out, j, item(out, j) + turn * item(C, n + j))
            put(out, n + j, item(out, n + j) - turn * item(C, j))
        for j in range(2 * n):
            old = item(a_z, j)
            change = item(out, j) + item(a_z, 2 * n + j)
            new = old + change
            back = new - old
            put(a_z, j, new)
            put(a_z, 2 * n + j, (old - (new - back)) + (change - back))
        counts[0] += 1
        if final:
            clock[0], clock[1] = clock[2], 0.0
        else:
            old = clock[0]
            change = span + clock[1]
            new = old + change
            back = new - old
            clock[0], clock[1] = new, (old - (new - back)) + (change - back)
        h = span
        rest = (clock[2] - clock[0]) - clock[1]
    clock[3], clock[4] = h, deepest
    return stop
