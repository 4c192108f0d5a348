"""Motion of a structure with rigid limiters in one compiled loop, from impact to impact.

The free motion between two impacts is exact (`kernels.flow`). The next impact is searched for
with certified envelopes of the watched coordinates alone (`kernels.passages`), so that none is
missed: every expansion proves that no wall is passed before its end, where the next one starts;
close to a wall the remainder sinks below rounding and the root is the impact. Times are kept as
sums of two doubles.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels import complementarity
from vibroimpact_solvers.kernels.flow import (
    bound,
    derivatives,
    exact_product,
    magnitudes,
    near_derivatives,
    product,
    propagators,
    rates,
    reach,
    take,
)
from vibroimpact_solvers.kernels.jit import fma, inline, inner, kernel
from vibroimpact_solvers.kernels.passages import (
    DEPTH,
    LOW,
    ORDER,
    first_passage,
    horizon,
    near_passage,
    near_remainder,
    remainder,
    stays,
)


class Stop(IntEnum):
    """Why the loop returned."""

    END = 0  # the end of the time was reached
    TABLE = 1  # the table of impacts is full
    SAMPLES = 2  # the buffer of samples is full
    PAUSE = 3  # the number of expansions agreed on was spent
    CONTACT = 4  # a constraint came to rest at its wall
    RELEASE = 5  # a contact force vanished
    STRUCK = 6  # an impact while other constraints are in contact


_END, _TABLE, _SAMPLES, _PAUSE, _CONTACT, _RELEASE, _STRUCK = range(7)

ROUNDING: Final = 2.0 * 2.0**-52
"""Rounding of a watched coordinate, relative to the sum of magnitudes it is made of."""
_SIMULTANEOUS = 16.0  # roundings within which two constraints are at their walls at one time
_EXACT = 2.0**-8  # remainder at an impact, in roundings
_COARSE = 0.3  # remainder of a first expansion, relative to the room
_NEAR = 1e-3  # remainder, relative to the room, at which envelopes of low degree close in
_CLEAR = 1e-6  # squared speeds at a wall, relative to the motion, that are no grazing
_TURN = 6.283185307179586  # 2 pi
_NEVER = 1e300
_PROPAGATED = 2.0  # rounding of a pair by the free motion from one impact to the next
SAFETY: Final = 4.0
"""Factor on the largest of the sampled deviations: errors do not exceed the product."""


@inline
def two_sum(a: float, b: float) -> tuple[float, float]:
    """Return a + b rounded, and what rounding took from it."""
    s = a + b
    part = s - a
    return s, (a - (s - part)) + (b - part)


@inline
def _distance(room: float, slope: float, bend: float, rounding: float) -> float:
    """Return the distance to a wall as an expansion may use it; negative: the wall is met.

    slope and bend are the first two derivatives towards the wall.
    """
    if room > rounding:
        return room
    if slope < 0.0:
        return 0.0
    if bend < 0.0 and slope * slope <= -2.0 * bend * rounding:
        return 2.0 * rounding  # grazes within rounding: leaves by itself
    return room if room > 0.0 else -1.0


@inline
def _next_event(
    F: Floats,
    split: Integers,
    forms: Floats,
    sizes: Floats,
    walls: Floats,
    Z: Floats,
    clock: Floats,
    counts: Integers,
    out_of_reach: Integers,
    rounding: Floats,
    P: Floats,
    size: Floats,
    near: Floats,
    roots: Floats,
    d: Floats,
    low: Floats,
) -> tuple[float, float, int, int]:
    """Return how long the motion from Z[0] is free (two doubles), what ends it, at which wall.

    It is ended by a watched coordinate (>= 0), by the end of the time (-1) or, provisionally,
    by the number of expansions (-2). near, shape (2, 2, pair), and the arrays after it are
    overwritten.
    """
    n, m = F.shape[1], walls.shape[1]
    changes = split[2] != 0 or split[0] < n
    s, ds, close = 0.0, 0.0, -1
    for j in range(n):
        near[0, 0, j], near[0, 1, j] = Z[0, 0, j], Z[0, 1, j]
    while True:
        left = ((clock[2] - clock[0]) - clock[1]) - s - ds
        if left <= 0.0:
            return s, ds, -1, 0
        best, rest, who, side = left, 0.0, -1, 0
        if s > 0.0 and changes:
            magnitudes(split, near, 0, size)
        ahead = min(left, clock[3])
        for k in range(m):
            # The constraint that is close to its wall first: the others have no time then.
            i = (max(close, 0) + k) % m
            if out_of_reach[i]:
                continue
            if close >= 0:
                near_derivatives(F, split, forms, i, near, 0, low)
                above, below = walls[1, i] - low[0], walls[0, i] + low[0]
                if min(above, below) > rounding[i]:
                    H = min(ahead, best)
                    B = bound(F, split, forms, sizes, i, near, 0, size, 2, LOW, H)
                    if k > 0 and stays(low, B, H, above, below):
                        continue
                    if k == 0:
                        h, met = near_passage(low, B, above, below)
                        if 0.0 <= h < best:
                            best, side, rest, who = h, met, near_remainder(B, h), i
                            continue
            derivatives(F, split, forms, i, near, 0, d)
            above = _distance(walls[1, i] - d[0], d[1], d[2], rounding[i])
            below = _distance(walls[0, i] + d[0], -d[1], -d[2], rounding[i])
            if counts[9] == i + 1 and s == 0.0:
                # Just released: it leaves with a speed that is rounding.
                above = max(above, _SIMULTANEOUS * rounding[i])
                below = max(below, _SIMULTANEOUS * rounding[i])
            elif above < 0.0 or below < 0.0:
                best, rest, who, side = 0.0, 0.0, i, (1 if above < 0.0 else -1)
                break
            B = bound(F, split, forms, sizes, i, near, 0, size, 0, ORDER, ahead)
            room = min(walls[0, i] + walls[1, i], rounding[i] / ROUNDING)
            H = min(horizon(B, _COARSE * room), min(ahead, best))
            h, met = first_passage(d, B, H, above, below, roots, 2.0 * _EXACT * rounding[i])
            if h < best or (met != 0 and who < 0):
                best, side, rest = h, met, remainder(B, h)
                who = i if met != 0 else -1
        counts[2] += 1
        s, lost = two_sum(s, best)
        ds += lost
        # The envelope meets the wall early by the remainder: always, and so as to add up.
        if who >= 0 and rest <= _EXACT * rounding[who]:
            return s, ds, who, side
        if who < 0 and best >= left:
            return s, ds, -1, 0
        if counts[2] >= counts[3]:
            return s, ds, -2, 0
        close = -1
        if who >= 0:
            room = min(walls[0, who] + walls[1, who], rounding[who] / ROUNDING)
            close = who if rest <= _NEAR * room else -1
        propagators(F, split, s, ds, P)
        take(F, split, P, s + ds, Z, 0, near, 0)


@inline
def _next_crossing(
    F: Floats,
    forms: Floats,
    walls: Floats,
    Z: Floats,
    clock: Floats,
    counts: Integers,
    out_of_reach: Integers,
    rounding: Floats,
) -> tuple[float, float, int, int]:
    """Return what `_next_event` does, for one mode without damping, in closed form.

    The state turns on a circle; a wall is a line that it crosses. Where a wall is all but
    touched, which rounding may decide, nothing is decided here: the third value is -3 then.
    """
    a, b = Z[0, 0, 0], Z[0, 1, 0]
    circle = a * a + b * b
    best, who, side = _NEVER, -1, 0
    for i in range(walls.shape[1]):
        form = forms[0, i, 0, 0]
        if out_of_reach[i] or form == 0.0:
            continue
        if counts[9] == i + 1:
            return 0.0, 0.0, -3, 0
        # The wall that it moves towards comes first, if it gets there at all.
        ahead = 1 if form * b > 0.0 else 0
        for turned in range(2):
            upper = ahead if turned == 0 else 1 - ahead
            wall = walls[upper, i]
            if wall == math.inf:
                continue
            towards = form if upper else -form
            c = wall / towards
            squared = b * b + (a - c) * (a + c)
            if abs(squared) <= _CLEAR * circle:
                return 0.0, 0.0, -3, 0
            if squared < 0.0:
                continue
            if wall - towards * a <= rounding[i] and towards * b > 0.0:
                return 0.0, 0.0, -3, 0  # there already
            speed = math.copysign(math.sqrt(squared), towards)
            angle = math.atan2(b * c - a * speed, a * c + b * speed)
            if angle < 0.0:
                angle += _TURN
            if angle < best:
                best, who, side = angle, i, (1 if upper else -1)
            break
    counts[2] += 1
    left = (clock[2] - clock[0]) - clock[1]
    if left <= 0.0:
        return 0.0, 0.0, -1, 0
    s = best / F[1, 0]
    if s >= left:
        return left, 0.0, -1, 0
    ds = (fma(-s, F[1, 0], best) - s * F[2, 0]) / F[1, 0]
    return s, ds, who, side


@inline
def _add_impulse(z: float, impulse: float, taken: float, form: float) -> float:
    """Return ``z + (impulse + taken) form`` rounded once."""
    kick = impulse * form
    total, lost = two_sum(z, kick)
    return total + (lost + fma(taken, form, fma(impulse, form, -kick)))


@inline
def _single_impact(
    forms: Floats,
    walls: Floats,
    i: int,
    speed: float,
    lost: float,
    bend: float,
    Z: Floats,
    noise: Floats,
    bends: Floats,
    row: int,
    first: int,
) -> float:
    """Take Z[first:], state 0 and deviations, through the impact of one constraint.

    speed, lost and bend are the velocity of its coordinate before the impact, what rounding took
    from it, and the acceleration; returns the impulse. Deviations get the rounding of the place
    of the wall and of the kick on their way.
    """
    factor: float = walls[4, i]
    n = Z.shape[2]
    rest: float = walls[5, i]
    impulse = -factor * speed
    # What rounding takes from an impulse it takes from the energy, at each impact the same.
    taken = fma(-factor, speed, -impulse) - (rest * speed + factor * lost)
    for c in range(max(first, 1), Z.shape[0]):
        place = product(forms, 0, i, Z, c)
        place += walls[3, i] if c & 1 else -walls[3, i]
        turn = factor * (bend * place / speed - product(forms, 1, i, Z, c))
        place *= factor
        at = (row + c) % noise.shape[0]
        for j in range(n):
            kicked = turn + impulse * noise[at, 0, j]
            Z[c, 0, j] += kicked * forms[2, i, 0, j] - place * forms[3, i, 0, j]
            Z[c, 1, j] += kicked * forms[2, i, 1, j] - place * forms[3, i, 1, j]
            Z[c, 0, j] += impulse * bends[c - 1, i, 0, j]
            Z[c, 1, j] += impulse * bends[c - 1, i, 1, j]
    if first == 0:
        for j in range(n):
            Z[0, 0, j] = _add_impulse(Z[0, 0, j], impulse, taken, forms[2, i, 0, j])
            Z[0, 1, j] = _add_impulse(Z[0, 1, j], impulse, taken, forms[2, i, 1, j])
    return impulse


@kernel
def impulses(
    mobility: Floats, restitution: Floats, struck: Integers, sides: Floats, speeds: Floats
) -> Floats:
    """Return the impulses, >= 0, of constraints that are at their walls at the same time.

    Newton's law with complementarity: impulses are not tensile, and no coordinate moves on into
    its wall; those that approach leave with at least their restitution.

    Parameters
    ----------
    mobility : array, shape (watched, watched)
        ``W M^-1 W^T``.
    restitution : array, shape (watched,)
    struck : array of int, shape (m,)
        The constraints at their walls.
    sides : array, shape (m,)
        1 at upper and -1 at lower walls.
    speeds : array, shape (m,)
        Velocities towards the walls.
    """
    m = struck.size
    levels, marks, square = np.empty((5, m)), np.empty((3, m), np.int64), np.empty((2 * m, m + 1))
    levels[1], levels[2], marks[1] = sides, speeds, struck
    _simultaneous_impulses(mobility, restitution, m, levels, marks, square)
    P: Floats = levels[3]
    return P


@inner
def _simultaneous_impulses(
    mobility: Floats,
    restitution: Floats,
    count: int,
    levels: Floats,
    marks: Integers,
    square: Floats,
) -> None:
    """Fill in the impulses of the first `count` constraints at their walls (`workspace`)."""
    struck, basic = marks[1], marks[2, :count]
    sides, speeds, P, q = levels[1], levels[2], levels[3, :count], levels[4, :count]
    G, work = square[:count], square[count : 2 * count]
    for a in range(count):
        i = struck[a]
        q[a] = -speeds[a] * (1.0 + restitution[i]) if speeds[a] > 0.0 else -speeds[a]
        for b in range(count):
            G[a, b] = sides[a] * sides[b] * mobility[i, struck[b]]
    complementarity.solve(G, q, P, basic, work)


@inner
def state_norm(Z: Floats, c: int, own: Floats) -> float:
    """Return the root of the sum of squares of the state Z[c], loads apart.

    own, shape (pair,), is 0 for the pairs of loads and 1 for the others.
    """
    s0, s1 = 0.0, 0.0
    for j in range(Z.shape[2]):
        s0 += own[j] * Z[c, 0, j] * Z[c, 0, j]
        s1 += own[j] * Z[c, 1, j] * Z[c, 1, j]
    return math.sqrt(s0 + s1)


@inline
def _add_rounding(
    Z: Floats, noise: Floats, drifts: Floats, own: Floats, clock: Floats, row: int, s: float
) -> None:
    """Add to the deviations, in units of 2^-52, the rounding of a free motion of duration s.

    Every pair is known to two units of its length after it, with any sign; its frequency is
    known to its drift, with the same sign from impact to impact. The size of the motion is the
    largest so far.
    """
    clock[7] = max(clock[7], state_norm(Z, 0, own))
    for c in range(1, Z.shape[0]):
        at = (row + 7 * c) % noise.shape[0]
        for j in range(Z.shape[2]):
            a, b = Z[0, 0, j], Z[0, 1, j]
            rounding = _PROPAGATED * (abs(a) + abs(b))
            turned = s * drifts[c - 1, j]
            Z[c, 0, j] += rounding * noise[at, 0, j] + turned * b
            Z[c, 1, j] += rounding * noise[at, 1, j] - turned * a


@kernel
def start_deviations(Z: Floats, noise: Floats, own: Floats, clock: Floats) -> None:
    """Set the deviations that a motion starts with, and the size of its state."""
    clock[7] = state_norm(Z, 0, own)
    rounding = _PROPAGATED * clock[7] / math.sqrt(2.0 * Z.shape[2])
    for c in range(1, Z.shape[0]):
        for j in range(Z.shape[2]):
            Z[c, 0, j] = rounding * own[j] * noise[c, 0, j]
            Z[c, 1, j] = rounding * own[j] * noise[c, 1, j]


@kernel
def estimated_error(Z: Floats, own: Floats, size: float) -> float:
    """Return the error estimated from the deviations, relative to the size of the motion."""
    largest = 0.0
    for c in range(1, Z.shape[0]):
        largest = max(largest, state_norm(Z, c, own))
    return SAFETY * largest / size if size > 0.0 else 0.0


@inline
def _row(count: int, rows: int) -> int:
    """Return a row of the noise that seems drawn at random (multiplicative hashing)."""
    return (count * 2654435761 % 4294967296 >> 8) % rows


@inner
def _impact(
    F: Floats,
    split: Integers,
    forms: Floats,
    walls: Floats,
    mobility: Floats,
    Z: Floats,
    noise: Floats,
    bends: Floats,
    own: Floats,
    clock: Floats,
    counts: Integers,
    at: Floats,
    where: Integers,
    what: Floats,
    rounding: Floats,
    near: Floats,
    levels: Floats,
    marks: Integers,
    square: Floats,
) -> bool:
    """Apply the impact of the constraint that reached its wall, and of all others at theirs.

    Returns whether one of them comes to rest there.
    """
    sides, speeds, given, struck = levels[1], levels[2], levels[3], marks[1]
    who, first, count = counts[5], counts[0], 0
    bend, impulse, lost = 0.0, 0.0, 0.0
    row = _row(counts[10], noise.shape[0])
    for i in range(walls.shape[1]):
        y = product(forms, 0, i, Z, 0)
        simultaneous = _SIMULTANEOUS * rounding[i]
        if i == who:
            sides[count] = counts[6]
            gap = walls[1, i] - y if counts[6] > 0 else walls[0, i] + y
            clock[6] = max(clock[6], abs(gap))
        elif walls[2, i] >= 0.0 and walls[1, i] - y <= simultaneous:
            sides[count] = 1.0
        elif walls[2, i] >= 0.0 and walls[0, i] + y <= simultaneous:
            sides[count] = -1.0
        else:
            continue
        struck[count] = i
        speed, lost = exact_product(forms, 1, i, Z, 0)
        speeds[count] = sides[count] * speed
        count += 1
    rates(F, split, Z, 0, near, 1)
    if count == 1:
        bend = product(forms, 1, who, near, 1)
        speed, towards = speeds[0], sides[0] * bend
        if speed <= 0.0 or (towards < 0.0 and speed * speed <= -2.0 * towards * rounding[who]):
            counts[8] += towards < 0.0
            clock[5] = 0.0
            return bool(towards >= 0.0)
        impulse = _single_impact(
            forms, walls, who, sides[0] * speed, lost, bend, Z, noise, bends, row, 0
        )
        where[first, 0], where[first, 1] = who, counts[6]
        what[first, 0], what[first, 1] = sides[0] * speed, abs(impulse)
        counts[0] += 1
    else:
        _simultaneous_impulses(mobility, walls[2], count, levels, marks, square)
        for a in range(count):
            i, line = struck[a], counts[0]
            if given[a] > 0.0:
                if speeds[a] > 0.0:
                    # The deviations go through one after the other.
                    bend = product(forms, 1, i, near, 1)
                    _single_impact(
                        forms, walls, i, sides[a] * speeds[a], 0.0, bend, Z, noise, bends, row + a,
                        1,
                    )  # fmt: skip
                where[line, 0], where[line, 1] = i, int(sides[a])
                what[line, 0], what[line, 1] = sides[a] * speeds[a], given[a]
                counts[0] += 1
            for j in range(Z.shape[2]):
                Z[0, 0, j] -= sides[a] * given[a] * forms[2, i, 0, j]
                Z[0, 1, j] -= sides[a] * given[a] * forms[2, i, 1, j]
    counts[10] += 1
    error = estimated_error(Z, own, clock[7])
    for line in range(first, counts[0]):
        at[line, 0], at[line, 1], what[line, 2] = clock[0], clock[1], error
    # A coordinate with almost no speed left that is pressed to its wall comes to rest there.
    if count > 1:
        rates(F, split, Z, 0, near, 1)
    for a in range(count):
        i = struck[a]
        if count == 1:
            # Without the rounding of the sums.
            speed, push = walls[2, i] * speeds[a], sides[a] * (bend + impulse * walls[6, i])
        else:
            speed = -sides[a] * product(forms, 1, i, Z, 0)
            push = sides[a] * product(forms, 1, i, near, 1)
        if push < 0.0 or (push == 0.0 and speed > 0.0):
            continue
        lasts = math.inf
        if speed <= 0.0:
            lasts = 0.0
        elif walls[2, i] < 1.0:
            lasts = 2.0 * speed / (push * (1.0 - walls[2, i]))
        if lasts <= clock[4] or speed * speed <= 2.0 * push * rounding[i]:
            counts[5], counts[6], clock[5] = i, int(sides[a]), lasts
            return True
    return False


def workspace(pairs: int, watched: int) -> tuple[Any, ...]:
    """Return the arrays that `advance` takes for its own use.

    They are states; rows for the search; rows of numbers of the watched coordinates: rounding,
    then side, speed, impulse and a rest of those that are struck; rows of whole numbers: whether
    out of reach, then which are at their walls and which of these get an impulse; equations of
    impacts.
    """
    m, search = watched, np.empty((DEPTH + 7, DEPTH + 2))
    return (
        np.empty((4, 2, pairs)), search, np.empty((5, m)), np.empty((3, m), dtype=np.int64),
        np.empty((2 * m, m + 1)),
    )  # fmt: skip


@kernel
def advance(
    F: Floats,
    split: Integers,
    forms: Floats,
    sizes: Floats,
    walls: Floats,
    mobility: Floats,
    Z: Floats,
    noise: Floats,
    drifts: Floats,
    bends: Floats,
    own: Floats,
    clock: Floats,
    counts: Integers,
    at: Floats,
    where: Integers,
    what: Floats,
    output_times: Floats,
    samples: Floats,
    room: Floats,
    search: Floats,
    levels: Floats,
    marks: Integers,
    square: Floats,
) -> int:
    """Advance a motion to its end, or to an event that the caller has to handle (`Stop`).

    Parameters
    ----------
    F, split, forms, sizes : array
        See `kernels.flow`.
    walls : array, shape (7, watched)
        Distances to the lower and upper walls from the zero of the coordinate, infinite where
        there is none; coefficients of restitution, negative for a contact force that ends a
        contact; magnitudes that the rounding of the coordinate is relative to beside the
        motion; (1 + restitution) over the diagonal of the mobility, as two doubles; the change
        of the coordinate's acceleration by a unit impulse.
    mobility : array, shape (watched, watched)
        ``W M^-1 W^T``.
    Z : array, shape (1 + column, 2, pair)
        The state; then deviations, in units of 2^-52, that obey the linearised flow and
        saltation. Replaced. Without columns no errors are estimated.
    noise : array, shape (row, 2, pair)
        Numbers of random sign and size 1 that stand for rounding.
    drifts : array, shape (column, pair)
        Errors of the frequencies, in units of 2^-52.
    bends : array, shape (column, watched, 2, pair)
        Errors of the changes of state by unit impulses, in units of 2^-52.
    own : array, shape (pair,)
        0 for the pairs of loads, 1 for the others.
    clock : array, shape (8,)
        Given: 0 time, 1 its rest, 2 end, 3 longest expansion, 4 shortest time of chatter that
        is followed impact by impact. Returned: 0, 1; 5 remaining time of chatter; 6 largest
        distance between a wall and the place of an impact at it; 7 largest length of the state.
    counts : array of int, shape (11,)
        Given: 3 most expansions, 4 first sample in the buffer, 7 whether an impact ends the
        loop. Kept: 0 rows in the table, 1 samples taken, 2 expansions, 8 grazings, 9 one more
        than the watched constraint that was just released or 0, 10 impacts of all. Returned:
        5 the constraint and 6 the side of what ended the loop.
    at, where, what : array, shape (row, 2), (row, 2), (row, 3)
        Table of impacts: times and their rests; constraint and side; velocity before, impulse
        and deviations relative to the motion.
    output_times : array, shape (sample,)
        Ascending times of the samples.
    samples : array, shape (buffer, 2, pair)
        The states there.
    room, search, levels, marks, square : array
        Of `workspace`; overwritten.
    """
    m, n = walls.shape[1], F.shape[1]
    near, P, size = room[:2], room[2], room[3, 0]
    roots, d, low = search[:-2], search[-2, :ORDER], search[-1, :LOW]
    rounding, out_of_reach = levels[0], marks[0]
    undamped_mode = n == 1 and split[0] == 1 and split[2] == 0
    for i in range(m):
        undamped_mode = undamped_mode and forms[0, i, 1, 0] == 0.0
    while True:
        if counts[0] + m > at.shape[0]:
            return _TABLE
        if counts[2] >= counts[3]:
            return _PAUSE  # however short the free motions are: the caller checks for progress
        left = (clock[2] - clock[0]) - clock[1]
        magnitudes(split, Z, 0, size)
        for i in range(m):
            close = far = reach(F, split, sizes, i, Z, 0, size, 0.0)
            if split[0] < n or F.shape[0] > 4:
                far = reach(F, split, sizes, i, Z, 0, size, left)
            rounding[i] = ROUNDING * (close + walls[3, i])
            out_of_reach[i] = far + rounding[i] < min(walls[0, i], walls[1, i])
        s, ds, who, side = 0.0, 0.0, -3, 0
        if undamped_mode:
            s, ds, who, side = _next_crossing(
                F, forms, walls, Z, clock, counts, out_of_reach, rounding
            )
        if who == -3:
            s, ds, who, side = _next_event(
                F, split, forms, sizes, walls, Z, clock, counts, out_of_reach, rounding, P, size,
                near, roots, d, low,
            )  # fmt: skip
        # Samples of this free motion.
        stop = (clock[0] + s) + (clock[1] + ds)
        while counts[1] < output_times.size and (output_times[counts[1]] <= stop or who == -1):
            place = counts[1] - counts[4]
            if place == samples.shape[0]:
                return _SAMPLES
            since, lost = two_sum(output_times[counts[1]], -clock[0])
            lost -= clock[1]
            propagators(F, split, since, lost, P)
            take(F, split, P, since + lost, Z, 0, samples, place)
            counts[1] += 1
        # Its end.
        propagators(F, split, s, ds, P)
        for c in range(Z.shape[0]):
            take(F, split, P, s + ds, Z, c, near, 0)
            for j in range(n):
                Z[c, 0, j], Z[c, 1, j] = near[0, 0, j], near[0, 1, j]
        clock[0], lost = two_sum(clock[0], s)
        clock[1] += lost + ds
        counts[9] = 0
        if Z.shape[0] > 1:
            _add_rounding(Z, noise, drifts, own, clock, _row(counts[10] + 1, noise.shape[0]), s)
        if who < 0:
            return _END if who == -1 else _PAUSE
        counts[5], counts[6] = who, side
        if walls[2, who] < 0.0:
            return _RELEASE
        if counts[7]:
            return _STRUCK
        if _impact(
            F, split, forms, walls, mobility, Z, noise, bends, own, clock, counts, at, where,
            what, rounding, near, levels, marks, square,
        ):  # fmt: skip
            return _CONTACT
