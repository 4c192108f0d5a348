"""Impacts: Newton's law for one coordinate, with complementarity for several at their walls.

The impulse P of one impact makes ``y'+ = -k y'-``; with ``w M^-1 w^T`` the mobility of y,
``P = -(1 + k) y'- / (w M^-1 w^T)``. It is added to the state with an error below one rounding: a
rounding of the velocity would be the same at every impact of a periodic motion, and so would be
what it takes from the energy. Coordinates that are at their walls at the same time have impulses
``P >= 0`` that are not tensile, and leave with at least their restitution: a linear complementarity
problem (Moreau; Glocker and Pfeiffer).
"""

from __future__ import annotations

import math

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels import complementarity
from vibroimpact_solvers.kernels.deviations import estimated_error, random_row
from vibroimpact_solvers.kernels.flow import Z1, Z2, exact_product, product, set_rate
from vibroimpact_solvers.kernels.jit import fma, inline, inner, kernel
from vibroimpact_solvers.kernels.next_impact import SIMULTANEOUS, two_sum
from vibroimpact_solvers.kernels.rigid_state import STRUCK, Motion, Rows, Scratch, Structure

_ALONE = 0  # the row of a coordinate that is struck alone


@inline
def _add_impulse(z: float, impulse: float, taken: float, form: float) -> float:
    """Return ``z + (impulse + taken) form`` rounded once."""
    kick = impulse * form
    total, lost = two_sum(z, kick)
    return total + (lost + fma(taken, form, fma(impulse, form, -kick)))


@inline
def _turn_deviations(
    structure: Structure, motion: Motion, i: int, speed: float, acceleration: float, row: int
) -> None:
    """Take the deviations through the impact of one coordinate (saltation).

    speed and acceleration are those of the coordinate before the impact. On their way deviations
    get the rounding of the place of the wall and of the kick; the formula is that of
    `kernels.deviations`.
    """
    deviations, errors = motion.deviations, structure.errors
    watched, wall = structure.watched, structure.walls[i]
    kick, kick_rate = watched.kick[i], watched.kick_rate[i]
    factor, impulse = wall.factor, -wall.factor * speed
    for c in range(deviations.shape[0]):
        dz, kick_error = deviations[c], errors.kicks[c, i]
        dy = product(watched.coordinate[i], dz)
        dy += -wall.size if c & 1 else wall.size
        dP = factor * (acceleration * dy / speed - product(watched.velocity[i], dz))
        dy *= factor
        signs = errors.signs[(row + c + 1) % errors.signs.shape[0]]
        for j in range(dz.shape[1]):
            kicked = dP + impulse * signs[Z1, j]  # one rounding: of the impulse
            dz[Z1, j] += kicked * kick[Z1, j] - dy * kick_rate[Z1, j]
            dz[Z2, j] += kicked * kick[Z2, j] - dy * kick_rate[Z2, j]
            dz[Z1, j] += impulse * kick_error[Z1, j]
            dz[Z2, j] += impulse * kick_error[Z2, j]


@kernel
def impulses(
    mobility: Floats, restitution: Floats, struck: Integers, sides: Floats, speeds: Floats
) -> Floats:
    """Return the impulses, >= 0, of constraints that are at their walls at the same time.

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
    rows = np.empty(m, STRUCK)
    for a in range(m):
        row = rows[a]
        row.coordinate, row.side, row.speed = struck[a], sides[a], speeds[a]
        row.restitution = restitution[struck[a]]
    equations, q, P = np.empty((2 * m, m + 1)), np.empty(m), np.empty(m)
    _simultaneous_impulses(mobility, rows, equations, q, P, np.empty(m, np.int64))
    return P


@inner
def _simultaneous_impulses(
    mobility: Floats, struck: Rows, equations: Floats, q: Floats, P: Floats, basic: Integers
) -> None:
    """Fill in the impulses of coordinates at their walls; arrays of `Scratch` are overwritten."""
    count = struck.size
    G, work = equations[:count], equations[count : 2 * count]
    for a in range(count):
        one = struck[a]
        q[a] = -one.speed * (1.0 + one.restitution) if one.speed > 0.0 else -one.speed
        for b in range(count):
            other = struck[b]
            G[a, b] = one.side * other.side * mobility[one.coordinate, other.coordinate]
    complementarity.solve(G, q[:count], P[:count], basic[:count], work)
    for a in range(count):
        struck[a].impulse = P[a]


@inline
def _find_struck(structure: Structure, motion: Motion, scratch: Scratch) -> int:
    """List the coordinates at their walls; return how many there are."""
    walls, watched, now = structure.walls, structure.watched, motion.progress[0]
    count = 0
    for i in range(walls.size):
        wall, y = walls[i], product(watched.coordinate[i], motion.z)
        at_a_wall = SIMULTANEOUS * scratch.rounding[i]
        if i == now.coordinate:
            side = 1.0 if now.side > 0 else -1.0
            gap = wall.upper - y if now.side > 0 else wall.lower + y
            now.penetration = max(now.penetration, abs(gap))
        elif wall.restitution >= 0.0 and wall.upper - y <= at_a_wall:
            side = 1.0
        elif wall.restitution >= 0.0 and wall.lower + y <= at_a_wall:
            side = -1.0
        else:
            continue
        speed, lost = exact_product(watched.velocity[i], motion.z)
        row = scratch.struck[count]
        row.coordinate, row.side, row.restitution = i, side, wall.restitution
        row.speed, row.speed_rest = side * speed, side * lost
        count += 1
    return count


@inline
def _write(motion: Motion, struck: Rows, a: int) -> None:
    """Add an impact to the table."""
    now, one = motion.progress[0], struck[a]
    row = motion.impacts[now.rows]
    row.constraint, row.side = one.coordinate, int(one.side)
    row.velocity, row.impulse = one.side * one.speed, one.impulse
    now.rows += 1


@inline
def _strike_one(structure: Structure, motion: Motion, scratch: Scratch, row: int) -> bool:
    """Apply the impact of one coordinate alone; return whether it comes to rest at its wall."""
    one, z, progress = scratch.struck[_ALONE], motion.z, motion.progress[0]
    i, wall = one.coordinate, structure.walls[one.coordinate]
    set_rate(structure.flow, z, scratch.rate)
    acceleration = product(structure.watched.velocity[i], scratch.rate)
    speed, towards, rounding = one.speed, one.side * acceleration, scratch.rounding[i]
    if speed <= 0.0 or (towards < 0.0 and speed * speed <= -2.0 * towards * rounding):
        progress.grazings += towards < 0.0
        progress.chatter_left = 0.0
        return bool(towards >= 0.0)
    velocity, factor = one.side * speed, wall.factor
    _turn_deviations(structure, motion, i, velocity, acceleration, row)
    impulse = -factor * velocity
    # What rounding takes from an impulse it takes from the energy, at each impact the same.
    taken = fma(-factor, velocity, -impulse)
    taken -= wall.factor_rest * velocity + factor * (one.side * one.speed_rest)
    kick = structure.watched.kick[i]
    for j in range(z.shape[1]):
        z[Z1, j] = _add_impulse(z[Z1, j], impulse, taken, kick[Z1, j])
        z[Z2, j] = _add_impulse(z[Z2, j], impulse, taken, kick[Z2, j])
    one.impulse = abs(impulse)
    _write(motion, scratch.struck, _ALONE)
    # Without the rounding of sums.
    speed, push = wall.restitution * speed, one.side * (acceleration + impulse * wall.acceleration)
    return _comes_to_rest(motion, scratch, _ALONE, speed, push)


@inner
def _strike_several(
    structure: Structure, motion: Motion, scratch: Scratch, count: int, row: int
) -> bool:
    """Apply simultaneous impacts; return whether one of the coordinates comes to rest."""
    flow, watched, z = structure.flow, structure.watched, motion.z
    struck, rate = scratch.struck[:count], scratch.rate
    set_rate(flow, z, rate)
    _simultaneous_impulses(
        structure.mobility,
        struck,
        scratch.equations,
        scratch.right,
        scratch.solution,
        scratch.basic,
    )
    for a in range(count):
        one = struck[a]
        i, kick = one.coordinate, watched.kick[one.coordinate]
        if one.impulse > 0.0:
            if one.speed > 0.0:
                # The deviations go through one after the other.
                acceleration = product(watched.velocity[i], rate)
                _turn_deviations(structure, motion, i, one.side * one.speed, acceleration, row + a)
            _write(motion, struck, a)
        for j in range(z.shape[1]):
            z[Z1, j] -= one.side * one.impulse * kick[Z1, j]
            z[Z2, j] -= one.side * one.impulse * kick[Z2, j]
    set_rate(flow, z, rate)
    for a in range(count):
        one = struck[a]
        velocity = watched.velocity[one.coordinate]
        speed, push = -one.side * product(velocity, z), one.side * product(velocity, rate)
        if _comes_to_rest(motion, scratch, a, speed, push):
            return True
    return False


@inline
def _comes_to_rest(motion: Motion, scratch: Scratch, a: int, speed: float, push: float) -> bool:
    """Return whether a coordinate that leaves with some speed and is pressed to its wall rests.

    Its bounces last ``2 speed / (push (1 - k))`` in all, the sum of a geometric series: once that
    is short enough, they are one sum.
    """
    one, progress = scratch.struck[a], motion.progress[0]
    if push < 0.0 or (push == 0.0 and speed > 0.0):
        return False
    lasts = math.inf
    if speed <= 0.0:
        lasts = 0.0
    elif one.restitution < 1.0:
        lasts = 2.0 * speed / (push * (1.0 - one.restitution))
    rounding = scratch.rounding[one.coordinate]
    if lasts <= progress.chatter or speed * speed <= 2.0 * push * rounding:
        progress.coordinate, progress.side = one.coordinate, int(one.side)
        progress.chatter_left = lasts
        return True
    return False


@inline
def strike(structure: Structure, motion: Motion, scratch: Scratch) -> bool:
    """Apply the impact of the coordinate that reached its wall, and of all others at theirs.

    Returns whether one of them comes to rest there.
    """
    progress, errors = motion.progress[0], structure.errors
    first, row = progress.rows, random_row(progress.impacts, errors.signs.shape[0])
    count = _find_struck(structure, motion, scratch)
    if count == 1:
        rests = _strike_one(structure, motion, scratch, row)
    else:
        rests = _strike_several(structure, motion, scratch, count, row)
    if count > 1 or progress.rows > first:
        progress.impacts += 1
        error = estimated_error(motion.deviations, errors.own, motion.progress)
        if motion.deviations.shape[0] == 0:
            error = math.nan
        for line in range(first, progress.rows):
            impact = motion.impacts[line]
            impact.time, impact.time_rest = progress.time, progress.time_rest
            impact.deviation = error
    return rests
