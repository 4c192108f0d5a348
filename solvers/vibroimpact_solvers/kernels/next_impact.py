"""The next impact of a structure in free motion: none is missed.

The free motion is exact (`kernels.flow`), so a watched coordinate y has known derivatives at any
instant, and a bound B of its n-th derivative for as long as the instant's expansion is used. The
envelopes ``p(h) -+ B h^n / n!`` of `kernels.passages` prove that no wall is passed before the
first of their roots, where the next expansion starts; close to a wall the remainder sinks below
rounding, and the root is the impact. Times are sums of two doubles.

One undamped mode needs no search: its state turns on a circle, and a wall is a line across it.
"""

from __future__ import annotations

import math
from typing import Final

from vibroimpact_solvers.kernels.deviations import EPS, SAFETY, set_spread
from vibroimpact_solvers.kernels.flow import (
    Z1,
    Z2,
    bound,
    derivatives,
    grown,
    grows,
    near_derivatives,
    propagate_state,
    reach,
    set_lengths,
    set_propagator,
    two_sum,
    weighted,
)
from vibroimpact_solvers.kernels.jit import fma, inline, inner, once
from vibroimpact_solvers.kernels.passages import (
    INNER,
    first_passage,
    horizon,
    near_passage,
    near_remainder,
    remainder,
    stays,
)
from vibroimpact_solvers.kernels.phases import sine_cosine
from vibroimpact_solvers.kernels.rigid_state import (
    MAY_GRAZE,
    NOT_GRAZING,
    SEARCHING,
    STRIKES,
    Motion,
    Rows,
    Scratch,
    Structure,
)

AT_END: Final = -1
NOT_ON: Final = -2
UNDECIDED: Final = -3
PAUSED: Final = -4
"""What may end a free motion in place of a watched coordinate: the end of the time, a search that
does not get on, and nothing that is known; or the search is not at its end."""

ROUNDING: Final = 2.0 * 2.0**-52
"""Rounding of a watched coordinate, relative to the sum of magnitudes it is made of."""
SIMULTANEOUS: Final = 16.0
"""Roundings within which two coordinates are at their walls at one time."""
_EXACT = 2.0**-8  # remainder at an impact, in roundings
_COARSE = 0.3  # remainder of a first expansion, relative to the room
_NEAR = 1e-3  # remainder, relative to the room, at which envelopes of low degree close in
_CLEAR = 1e-6  # squared speeds at a wall, relative to the motion, that are no grazing
_TURN = 6.283185307179586  # 2 pi
_NEVER = 1e300
_ONLY = 0  # the pair of a structure with one mode


@inline
def remaining(progress: Rows) -> float:
    """Return the time until the end of the motion."""
    now = progress[0]
    return float((now.end - now.time) - now.time_rest)


@once
def find_reach(structure: Structure, motion: Motion, scratch: Scratch) -> None:
    """Fill in how well the watched coordinates are known, and whether they may reach a wall.

    The margins are their errors by all that went before, the roundings those of this motion alone.
    """
    flow, watched, walls, z = structure.flow, structure.watched, structure.walls, motion.z
    lengths, left = scratch.lengths, remaining(motion.progress)
    progress, spread = motion.progress[0], scratch.spread
    # Beyond the tolerance nothing is claimed that a grazing could change.
    claims = motion.deviations.shape[0] > 0 and progress.known_until == math.inf
    set_lengths(flow, z, lengths)
    if claims:
        set_spread(flow, motion.deviations, spread)
    for i in range(walls.size):
        wall, sizes, now, ahead = walls[i], watched.size[i], 0.0, 0.0
        for _ in range(2):
            now = reach(flow, watched, i, z, lengths, ahead)
            if now + wall.size > 0.0:
                break
            ahead = min(left, 1.0)  # what is zero and still is rounded as it will soon be
        far = now
        if grows(flow):
            far = reach(flow, watched, i, z, lengths, left)
        rounding = ROUNDING * (now + wall.size)
        margin = rate = 0.0
        if claims and wall.restitution >= 0.0:
            margin = rounding + SAFETY * EPS * weighted(sizes, spread, spread.size)
            rate = SAFETY * EPS * structure.errors.drift * now
        scratch.rounding[i], scratch.margin[i], scratch.margin_rate[i] = rounding, margin, rate
        begins = progress.time == 0.0 and progress.impacts == 0
        if scratch.grazing[i] == MAY_GRAZE or (scratch.grazing[i] == STRIKES and not begins):
            scratch.grazing[i] = NOT_GRAZING
        scratch.in_reach[i] = not far + rounding < min(wall.lower, wall.upper)


@inline
def _distance(room: float, slope: float, acceleration: float, rounding: float) -> float:
    """Return the distance to a wall as an expansion may use it.

    slope and acceleration are the first two derivatives towards the wall. Within rounding of it:
    0 where the coordinate leaves or stays; two roundings where it turns by itself within one, where
    its speed is no more than that of a fall from there; -1 where it moves on into the wall, or
    falls on it.
    """
    if room > rounding:
        return room
    if slope < 0.0 or (slope == 0.0 and acceleration <= 0.0):
        return 0.0
    if acceleration < 0.0 and slope * slope <= -2.0 * acceleration * rounding:
        return 2.0 * rounding
    falls = slope * slope <= 2.0 * acceleration * rounding
    return room if room > 0.0 and not falls else -1.0


@inline
def _turns_near(room: float, slope: float, acceleration: float, margin: float) -> bool:
    """Return whether a coordinate near a wall turns back within its error of it, or just not."""
    near = slope > 0.0 and acceleration < 0.0 and room <= INNER * margin
    return bool(near and slope * slope <= -2.0 * acceleration * (room + margin))


@inline
def _amplitude(walls: Rows, i: int, rounding: float) -> float:
    """Return the distance between the walls of a coordinate, or the magnitude of its motion.

    The latter is what `find_reach` made its rounding of.
    """
    return float(min(walls[i].lower + walls[i].upper, rounding / ROUNDING))


@inline
def _expanded(
    structure: Structure,
    scratch: Scratch,
    i: int,
    released: bool,
    margin: float,
    best: float,
    ahead: float,
) -> tuple[float, float, int]:
    """Return a time before which a coordinate passes no wall, the remainder, the wall it may pass.

    released: it has just left a wall. The time is negative where the wall is met already, and only
    times before best matter. Where the coordinate may turn before a wall, it stops within a margin
    of it, and is marked if its error decides whether it strikes.
    """
    flow, watched, walls = structure.flow, structure.watched, structure.walls
    d, rounding = scratch.derivatives, scratch.rounding[i]
    derivatives(flow, watched.coordinate[i], scratch.z, d)
    if scratch.grazing[i] == STRIKES:
        return -1.0, 0.0, (1 if d[1] > 0.0 else -1)
    above = _distance(walls[i].upper - d[0], d[1], d[2], rounding)
    below = _distance(walls[i].lower + d[0], -d[1], -d[2], rounding)
    if released:
        # It leaves with a speed that is rounding.
        above = max(above, SIMULTANEOUS * rounding)
        below = max(below, SIMULTANEOUS * rounding)
    elif above < 0.0 or below < 0.0:
        return -1.0, 0.0, (1 if above < 0.0 else -1)
    elif margin > 0.0:
        up = _turns_near(walls[i].upper - d[0], d[1], d[2], margin)
        if up or _turns_near(walls[i].lower + d[0], -d[1], -d[2], margin):
            if scratch.grazing[i] == NOT_GRAZING:
                scratch.grazing[i] = MAY_GRAZE
                return 0.0, 0.0, (1 if up else -1)
        else:
            scratch.grazing[i] = NOT_GRAZING
    B = bound(flow, watched, i, scratch.z, scratch.lengths, True, ahead)
    H = min(horizon(B, _COARSE * _amplitude(walls, i, rounding)), min(ahead, best))
    fine = 2.0 * _EXACT * rounding
    h, side, inner = first_passage(d, B, H, above, below, scratch.roots, fine, margin)
    more = remainder(B, h)
    return h, (max(more, rounding) if inner else more), side


@inline
def _closing_in(
    structure: Structure, scratch: Scratch, i: int, first: bool, margin: float, H: float
) -> tuple[float, float, int]:
    """Return what `_expanded` does, by envelopes of low degree; a negative time: they do not do.

    The first one runs straight to its wall. Of the others it is only told that they pass none
    before H, which is their time then.
    """
    flow, walls, low = structure.flow, structure.walls, scratch.low
    near_derivatives(flow, structure.watched.coordinate[i], scratch.z, low)
    above, below = walls[i].upper - low[0], walls[i].lower + low[0]
    if min(above, below) > scratch.rounding[i]:
        B = bound(flow, structure.watched, i, scratch.z, scratch.lengths, False, H)
        if not first:
            return (H if stays(low, B, H, min(above, below) - margin) else -1.0), 0.0, 0
        h, side = near_passage(low, B, above, below)
        return h, near_remainder(B, h), side
    return -1.0, 0.0, 0


@inner
def _grow_roundings(structure: Structure, scratch: Scratch) -> None:
    """Let the roundings of the watched coordinates grow with the motion."""
    flow, watched, walls = structure.flow, structure.watched, structure.walls
    for i in range(walls.size):
        now = reach(flow, watched, i, scratch.z, scratch.lengths, 0.0)
        scratch.rounding[i] = max(scratch.rounding[i], ROUNDING * (now + walls[i].size))


@inline
def _margin_after(structure: Structure, scratch: Scratch, i: int, s: float) -> float:
    """Return the error of a coordinate a time s after the beginning of a free motion."""
    margin = float(scratch.margin[i])
    if margin > 0.0:
        margin += s * scratch.margin_rate[i]
        if grows(structure.flow):
            sizes = structure.watched.size[i]
            margin += SAFETY * EPS * grown(structure.flow, sizes, scratch.spread, s)
    return margin


@once
def next_event(
    structure: Structure, motion: Motion, scratch: Scratch
) -> tuple[float, float, int, int]:
    """Return how long the motion is free (two doubles), what ends it, and at which wall.

    It is ended by a watched coordinate (>= 0), `AT_END` or, provisionally, `NOT_ON`. Where it is
    `PAUSED`, the next call goes on with the search. The scratch holds what `find_reach` made of
    this state; expansions are counted in the progress.
    """
    flow, walls, z = structure.flow, structure.walls, scratch.z
    rounding, progress, m = scratch.rounding, motion.progress[0], structure.walls.size
    piece = scratch.piece[0]
    changes = flow.damped or grows(flow)
    s, ds, close = 0.0, 0.0, -1
    if piece.stage == SEARCHING:
        s, ds, close = piece.time, piece.time_rest, piece.close
    else:
        for j in range(z.shape[1]):
            z[Z1, j], z[Z2, j] = motion.z[Z1, j], motion.z[Z2, j]
    while True:
        left = remaining(motion.progress) - s - ds
        if left <= 0.0:
            return s, ds, AT_END, 0
        best, remains, who, side = left, 0.0, AT_END, 0
        if s > 0.0 and changes:
            set_lengths(flow, z, scratch.lengths)
            if grows(flow):
                _grow_roundings(structure, scratch)
        ahead = min(left, progress.longest)
        for k in range(m):
            # The coordinate that is close to its wall first: the others have no time then.
            i = (max(close, 0) + k) % m
            if not scratch.in_reach[i]:
                continue
            margin = _margin_after(structure, scratch, i, s)
            if close >= 0:
                H = min(ahead, best)
                h, more, at = _closing_in(structure, scratch, i, k == 0, margin, H)
                if k > 0 and h >= 0.0:
                    continue
                if 0.0 <= h <= H and h < best:
                    best, side, remains, who = h, at, more, i
                    continue
            released = progress.released == i and s == 0.0
            h, more, at = _expanded(structure, scratch, i, released, margin, best, ahead)
            if h < 0.0:
                best, remains, who, side = 0.0, 0.0, i, at
                break
            if h < best or (at != 0 and who < 0):
                best, side, remains = h, at, more
                who = i if at != 0 else AT_END
        progress.expansions += 1
        piece.work += piece.expansion
        s, lost = two_sum(s, best)
        ds += lost
        # The envelope meets the wall early by the remainder: always, and so as to add up.
        if who >= 0 and remains <= _EXACT * rounding[who]:
            return s, ds, who, side
        if who < 0 and best >= left:
            return s, ds, AT_END, 0
        if best <= 0.0:
            return s, ds, NOT_ON, 0  # the next ones would be the same
        close = -1
        if who >= 0 and remains <= _NEAR * _amplitude(walls, who, rounding[who]):
            close = who
        set_propagator(flow, s, ds, scratch.propagator)
        propagate_state(flow, scratch.propagator, s + ds, motion.z, z)
        if piece.work >= progress.budget:
            piece.time, piece.time_rest, piece.close = s, ds, close
            return s, ds, PAUSED, 0


@inline
def has_one_undamped_mode(structure: Structure) -> bool:
    """Return whether a motion can use `next_crossing`."""
    flow, watched = structure.flow, structure.watched
    alone = flow.alpha.size == 1 and flow.rotations == 1 and not flow.damped
    if alone:
        for i in range(structure.walls.size):
            alone = alone and watched.coordinate[i, Z2, _ONLY] == 0.0
    return alone


@inline
def next_crossing(
    structure: Structure, motion: Motion, scratch: Scratch
) -> tuple[float, float, int, int]:
    """Return what `next_event` does, for one mode without damping, in closed form.

    Where a wall is all but touched, which rounding may decide, it is `UNDECIDED`.
    """
    walls, progress = structure.walls, motion.progress[0]
    nu, nu_rest = structure.flow.nu[_ONLY], structure.flow.rest[_ONLY]
    a, b = motion.z[Z1, _ONLY], motion.z[Z2, _ONLY]
    circle = a * a + b * b
    best, who, side, c_best = _NEVER, AT_END, 0, 0.0
    for i in range(walls.size):
        form = structure.watched.coordinate[i, Z1, _ONLY]
        if not scratch.in_reach[i] or form == 0.0:
            continue
        if progress.released == i:
            return 0.0, 0.0, UNDECIDED, 0
        # The wall that it moves towards comes first, if it gets there at all.
        rising = form * b > 0.0
        for turned in range(2):
            upper = rising if turned == 0 else not rising
            wall = walls[i].upper if upper else walls[i].lower
            if wall == math.inf:
                continue
            towards = form if upper else -form
            c = wall / towards
            squared = b * b + (a - c) * (a + c)
            if scratch.grazing[i] == STRIKES or abs(
                squared
            ) <= _CLEAR * circle + 4.0 * scratch.margin[i] * abs(c / form):
                return 0.0, 0.0, UNDECIDED, 0
            if squared < 0.0:
                continue
            if wall - towards * a <= scratch.rounding[i] and towards * b > 0.0:
                return 0.0, 0.0, UNDECIDED, 0  # there already
            speed = math.copysign(math.sqrt(squared), towards)
            angle = math.atan2(b * c - a * speed, a * c + b * speed)
            if angle < 0.0:
                angle += _TURN
            if angle < best:
                best, who, side = angle, i, (1 if upper else -1)
                c_best = c
            break
    progress.expansions += 1
    left = remaining(motion.progress)
    if left <= 0.0:
        return 0.0, 0.0, AT_END, 0
    s = best / nu
    if s >= left:
        return left, 0.0, AT_END, 0
    ds = (fma(-s, nu, best) - s * nu_rest) / nu
    return s, _corrected(structure, motion, scratch, s, ds, c_best), who, side


@inline
def _corrected(
    structure: Structure, motion: Motion, scratch: Scratch, s: float, ds: float, c: float
) -> float:
    """Return the rest of the time s at which one undamped mode is at c.

    By a step of Newton with exact products: an angle near pi has a rounding that a small c does
    not have, in all periods the same.
    """
    nu, nu_rest = structure.flow.nu[_ONLY], structure.flow.rest[_ONLY]
    a, b = motion.z[Z1, _ONLY], motion.z[Z2, _ONLY]
    phase = nu * s
    lost = fma(nu, ds, fma(nu_rest, s, fma(nu, s, -phase)))
    sine, cosine = sine_cosine(phase, lost)
    p, q = cosine * a, sine * b
    place, more = two_sum(p, q)
    more += fma(cosine, a, -p) + fma(sine, b, -q)
    more += cosine * scratch.rest[Z1, _ONLY] + sine * scratch.rest[Z2, _ONLY]
    return float(ds + ((c - place) - more) / (nu * (b * cosine - a * sine)))
