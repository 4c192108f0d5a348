"""Free flights and impacts in one compiled loop: no impact is missed, none is found twice.

A flight starts at an impact and is exact (`kernels.flow`). Its end is searched with certified
envelopes of the watched coordinates alone (`kernels.passages`): every expansion proves that no
wall is passed before its end, where the next one starts; close to a wall the remainder sinks
below rounding and the root is the impact. Times are kept as sums of two doubles.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Booleans, Floats, Integers
from vibroimpact_solvers.kernels import complementarity
from vibroimpact_solvers.kernels.flow import (
    bound,
    derivatives,
    magnitudes,
    product,
    propagators,
    rates,
    reach,
    take,
)
from vibroimpact_solvers.kernels.jit import inline, kernel
from vibroimpact_solvers.kernels.passages import (
    DEPTH,
    ORDER,
    first_passage,
    horizon,
    remainder,
)


class Stop(IntEnum):
    """Why the loop returned."""

    END = 0  # the end of the time was reached
    TABLE = 1  # the table of impacts is full
    SAMPLES = 2  # the buffer of samples is full
    PAUSE = 3  # the number of expansions agreed on was spent
    CONTACT = 4  # a constraint came to rest at its wall
    RELEASE = 5  # a contact force vanished
    STRUCK = 6  # an impact while other constraints are held


_END, _TABLE, _SAMPLES, _PAUSE, _CONTACT, _RELEASE, _STRUCK = range(7)

GRAIN: Final = 2.0 * 2.0**-52
"""Rounding of a watched coordinate, relative to the sum of magnitudes it is made of."""
_TOGETHER = 16.0  # grains within which two constraints are at their walls together
_EXACT = 2.0**-8  # remainder at an impact, in grains
_COARSE = 0.05  # remainder of a first expansion, relative to the room


@inline
def two_sum(a: float, b: float) -> tuple[float, float]:
    """Return a + b rounded, and what rounding took from it."""
    s = a + b
    part = s - a
    return s, (a - (s - part)) + (b - part)


@inline
def _room(room: float, slope: float, bend: float, grain: float) -> float:
    """Return the distance to a wall as an expansion may use it; negative: the wall is met.

    slope and bend are the first two derivatives towards the wall.
    """
    if room > grain:
        return room
    if slope < 0.0:
        return 0.0
    if bend < 0.0 and slope * slope <= -2.0 * bend * grain:
        return 2.0 * grain  # grazes within rounding: leaves by itself
    return room if room > 0.0 else -1.0


@inline
def _search(
    F: Floats,
    split: Integers,
    forms: Floats,
    sizes: Floats,
    walls: Floats,
    Z: Floats,
    clock: Floats,
    counts: Integers,
    idle: Booleans,
    grain: Floats,
    P: Floats,
    size: Floats,
    near: Floats,
    work: Floats,
    roots: Floats,
    d: Floats,
) -> tuple[float, float, int, int]:
    """Return the length of the flight from Z[0] (two doubles), and what ends it at which wall.

    It is ended by a watched coordinate (>= 0), by the end of the time (-1) or, provisionally,
    by the number of expansions (-2). near, shape (2, 2, pair), and the arrays after it are
    overwritten.
    """
    n = F.shape[1]
    changes = split[2] != 0 or split[0] < n
    s, ds = 0.0, 0.0
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
        for i in range(walls.shape[1]):
            if idle[i]:
                continue
            derivatives(F, split, forms, i, near, 0, work, d)
            above = _room(walls[1, i] - d[0], d[1], d[2], grain[i])
            below = _room(walls[0, i] + d[0], -d[1], -d[2], grain[i])
            if counts[9] == i + 1 and s == 0.0:
                # Just released: it leaves with a speed that is rounding.
                above = max(above, _TOGETHER * grain[i])
                below = max(below, _TOGETHER * grain[i])
            elif above < 0.0 or below < 0.0:
                best, rest, who, side = 0.0, 0.0, i, (1 if above < 0.0 else -1)
                break
            B = bound(F, split, forms, sizes, i, near, 0, size, ORDER, ahead)
            room = min(walls[0, i] + walls[1, i], grain[i] / GRAIN)
            H = min(horizon(B, _COARSE * room), min(ahead, best))
            h, met = first_passage(d, B, H, above, below, roots)
            if h < best or (met != 0 and who < 0):
                best, side, rest = h, met, remainder(B, h)
                who = i if met != 0 else -1
        counts[2] += 1
        s, lost = two_sum(s, best)
        ds += lost
        # The envelope meets the wall early by the remainder: always, and so as to add up.
        if who >= 0 and rest <= _EXACT * grain[who]:
            return s, ds, who, side
        if who < 0 and best >= left:
            return s, ds, -1, 0
        if counts[2] >= counts[3]:
            return s, ds, -2, 0
        propagators(F, split, s, ds, P)
        take(F, split, P, s + ds, Z, 0, near, 0)


@inline
def _single(
    forms: Floats, walls: Floats, i: int, speed: float, bend: float, Z: Floats, first: int
) -> float:
    """Take Z[first:], state 0 and deviations, through the impact of one constraint.

    speed and bend are the velocity and the acceleration of its coordinate before the impact;
    returns the impulse.
    """
    factor: float = walls[4, i]
    n = Z.shape[2]
    rest: float = walls[5, i]
    impulse = -(factor * speed + rest * speed)
    for c in range(max(first, 1), Z.shape[0]):
        place = product(forms, 0, i, Z, c)
        turn = factor * (bend * place / speed - product(forms, 1, i, Z, c))
        place *= factor
        for j in range(n):
            Z[c, 0, j] += turn * forms[2, i, 0, j] - place * forms[3, i, 0, j]
            Z[c, 1, j] += turn * forms[2, i, 1, j] - place * forms[3, i, 1, j]
    if first == 0:
        for j in range(n):
            Z[0, 0, j] += impulse * forms[2, i, 0, j]
            Z[0, 1, j] += impulse * forms[2, i, 1, j]
    return impulse


@kernel
def impulses(
    mobility: Floats, restitution: Floats, struck: Integers, sides: Floats, speeds: Floats
) -> Floats:
    """Return the impulses, >= 0, of constraints that are at their walls at the same time.

    Newton's law with complementarity: a wall does not pull, and no coordinate goes on into it;
    those that approach leave with at least their restitution.

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
    G, q, P = np.empty((m, m)), np.empty(m), np.empty(m)
    for a in range(m):
        i = struck[a]
        q[a] = -speeds[a] * (1.0 + restitution[i]) if speeds[a] > 0.0 else -speeds[a]
        for b in range(m):
            G[a, b] = sides[a] * sides[b] * mobility[i, struck[b]]
    complementarity.solve(G, q, P, np.empty(m, np.bool_), np.empty((m, m + 1)))
    return P


@kernel
def length(Z: Floats, c: int, own: Floats) -> float:
    """Return the root of the sum of squares of the state Z[c], loads apart.

    own, shape (pair,), is 0 for the pairs of loads and 1 for the others.
    """
    s0, s1 = 0.0, 0.0
    for j in range(Z.shape[2]):
        s0 += own[j] * Z[c, 0, j] * Z[c, 0, j]
        s1 += own[j] * Z[c, 1, j] * Z[c, 1, j]
    return math.sqrt(s0 + s1)


@inline
def _disturb(
    Z: Floats, noise: Floats, own: Floats, clock: Floats, counts: Integers, s: float
) -> float:
    """Add what rounding does in one flight; return the deviations relative to the motion.

    Deviations are in units of the relative rounding. A flight and its impact add a vector of
    twice the length of the state, drawn from the noise, and more for its duration s (in units
    of the fastest mode): the rounding of the frequencies. The size of the motion is the
    largest so far.
    """
    size, squares = length(Z, 0, own), 0.0
    clock[7] = max(clock[7], size)
    columns = Z.shape[0] - 1
    for c in range(1, Z.shape[0]):
        # Multiplicative hashing picks the row and the sign.
        mixed = (counts[10] * columns + c) * 2654435761 % 4294967296
        row = (mixed >> 8) % noise.shape[0]
        factor = size * (2.0 + s)
        if (mixed >> 20) & 1:
            factor = -factor
        for j in range(Z.shape[2]):
            Z[c, 0, j] += factor * noise[row, 0, j]
            Z[c, 1, j] += factor * noise[row, 1, j]
        squares += length(Z, c, own) ** 2
    return math.sqrt(squares / columns) / clock[7] if columns and clock[7] > 0.0 else 0.0


@kernel
def _strike(
    F: Floats,
    split: Integers,
    forms: Floats,
    walls: Floats,
    mobility: Floats,
    Z: Floats,
    noise: Floats,
    own: Floats,
    clock: Floats,
    counts: Integers,
    at: Floats,
    where: Integers,
    what: Floats,
    grain: Floats,
    near: Floats,
    struck: Integers,
    sides: Floats,
    speeds: Floats,
    s: float,
) -> bool:
    """Let the constraint that ended the flight strike, and all others that are at their walls.

    Returns whether one of them comes to rest there.
    """
    who, first, count = counts[5], counts[0], 0
    for i in range(walls.shape[1]):
        y = product(forms, 0, i, Z, 0)
        together = _TOGETHER * grain[i]
        if i == who:
            sides[count] = counts[6]
            gap = walls[1, i] - y if counts[6] > 0 else walls[0, i] + y
            clock[6] = max(clock[6], abs(gap))
        elif walls[2, i] >= 0.0 and walls[1, i] - y <= together:
            sides[count] = 1.0
        elif walls[2, i] >= 0.0 and walls[0, i] + y <= together:
            sides[count] = -1.0
        else:
            continue
        struck[count] = i
        speeds[count] = sides[count] * product(forms, 1, i, Z, 0)
        count += 1
    rates(F, split, Z, 0, near, 1)
    if count == 1:
        bend = product(forms, 1, who, near, 1)
        speed, towards = speeds[0], sides[0] * bend
        if speed <= 0.0 or (towards < 0.0 and speed * speed <= -2.0 * towards * grain[who]):
            counts[8] += towards < 0.0
            clock[5] = 0.0
            return bool(towards >= 0.0)
        impulse = _single(forms, walls, who, sides[0] * speed, bend, Z, 0)
        where[first, 0], where[first, 1] = who, counts[6]
        what[first, 0], what[first, 1] = sides[0] * speed, abs(impulse)
        counts[0] += 1
    else:
        given = impulses(mobility, walls[2], struck[:count], sides[:count], speeds[:count])
        for a in range(count):
            i, row = struck[a], counts[0]
            if given[a] > 0.0:
                if speeds[a] > 0.0:
                    # The deviations go through one after the other.
                    bend = product(forms, 1, i, near, 1)
                    _single(forms, walls, i, sides[a] * speeds[a], bend, Z, 1)
                where[row, 0], where[row, 1] = i, int(sides[a])
                what[row, 0], what[row, 1] = sides[a] * speeds[a], given[a]
                counts[0] += 1
            for j in range(Z.shape[2]):
                Z[0, 0, j] -= sides[a] * given[a] * forms[2, i, 0, j]
                Z[0, 1, j] -= sides[a] * given[a] * forms[2, i, 1, j]
    counts[10] += 1
    spread = _disturb(Z, noise, own, clock, counts, s)
    for row in range(first, counts[0]):
        at[row, 0], at[row, 1], what[row, 2] = clock[0], clock[1], spread
    # Whoever is left almost without speed and is pressed on comes to rest at its wall.
    rates(F, split, Z, 0, near, 1)
    for a in range(count):
        i = struck[a]
        speed = -sides[a] * product(forms, 1, i, Z, 0)
        if count == 1:
            speed = walls[2, i] * speeds[a]  # without the rounding of the sum
        push = sides[a] * product(forms, 1, i, near, 1)
        if push < 0.0 or (push == 0.0 and speed > 0.0):
            continue
        lasts = math.inf
        if speed <= 0.0:
            lasts = 0.0
        elif walls[2, i] < 1.0:
            lasts = 2.0 * speed / (push * (1.0 - walls[2, i]))
        if lasts <= clock[4] or speed * speed <= 2.0 * push * grain[i]:
            counts[5], counts[6], clock[5] = i, int(sides[a]), lasts
            return True
    return False


@kernel
def fly(
    F: Floats,
    split: Integers,
    forms: Floats,
    sizes: Floats,
    walls: Floats,
    mobility: Floats,
    Z: Floats,
    noise: Floats,
    own: Floats,
    clock: Floats,
    counts: Integers,
    at: Floats,
    where: Integers,
    what: Floats,
    wanted: Floats,
    samples: Floats,
) -> int:
    """Follow a motion until its end or until something that is not decided here.

    Parameters
    ----------
    F, split, forms, sizes : array
        See `kernels.flow`.
    walls : array, shape (6, watched)
        Distances to the lower and upper walls from the zero of the coordinate, infinite where
        there is none; coefficients of restitution, negative for a contact force that ends a
        contact; magnitudes that the rounding of the coordinate is relative to beside the
        motion; (1 + restitution) over the diagonal of the mobility, as two doubles.
    mobility : array, shape (watched, watched)
        ``W M^-1 W^T``.
    Z : array, shape (1 + column, 2, pair)
        The state; then deviations, in units of the relative rounding, that go along by the
        linearised flow and by saltation. Replaced.
    noise : array, shape (row, 2, pair)
        Vectors of length 1 that stand for rounding.
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
    wanted : array, shape (sample,)
        Ascending times at which the state is wanted.
    samples : array, shape (buffer, 2, pair)
        The states there.
    """
    m, n = walls.shape[1], F.shape[1]
    P, size, work, near = np.empty((2, n)), np.empty(n), np.empty((4, n)), np.empty((2, 2, n))
    roots, d = np.empty((DEPTH + 5, DEPTH + 2)), np.empty(ORDER)
    idle, grain = np.zeros(m, np.bool_), np.empty(m)
    struck, sides, speeds = np.empty(m, np.int64), np.empty(m), np.empty(m)
    while True:
        if counts[0] + m > at.shape[0]:
            return _TABLE
        if counts[2] >= counts[3]:
            return _PAUSE  # flights that end at a wall each, however short, must not go on unseen
        left = (clock[2] - clock[0]) - clock[1]
        magnitudes(split, Z, 0, size)
        for i in range(m):
            close = far = reach(F, split, sizes, i, Z, 0, size, 0.0)
            if split[0] < n:
                far = reach(F, split, sizes, i, Z, 0, size, left)
            grain[i] = GRAIN * (close + walls[3, i])
            idle[i] = far + grain[i] < min(walls[0, i], walls[1, i])
        s, ds, who, side = _search(
            F, split, forms, sizes, walls, Z, clock, counts, idle, grain, P, size, near, work,
            roots, d,
        )  # fmt: skip
        # Samples of this flight.
        stop = (clock[0] + s) + (clock[1] + ds)
        while counts[1] < wanted.size and (wanted[counts[1]] <= stop or who == -1):
            place = counts[1] - counts[4]
            if place == samples.shape[0]:
                return _SAMPLES
            since, lost = two_sum(wanted[counts[1]], -clock[0])
            lost -= clock[1]
            propagators(F, split, since, lost, P)
            take(F, split, P, since + lost, Z, 0, samples, place)
            counts[1] += 1
        # Its end.
        propagators(F, split, s, ds, P)
        for c in range(Z.shape[0]):
            take(F, split, P, s + ds if c == 0 else 0.0, Z, c, near, 0)
            for j in range(n):
                Z[c, 0, j], Z[c, 1, j] = near[0, 0, j], near[0, 1, j]
        clock[0], lost = two_sum(clock[0], s)
        clock[1] += lost + ds
        counts[9] = 0
        if who < 0:
            return _END if who == -1 else _PAUSE
        counts[5], counts[6] = who, side
        if walls[2, who] < 0.0:
            return _RELEASE
        if counts[7]:
            return _STRUCK
        if _strike(
            F, split, forms, walls, mobility, Z, noise, own, clock, counts, at, where, what, grain,
            near, struck, sides, speeds, s,
        ):  # fmt: skip
            return _CONTACT
