"""Impacts: Newton's law for one coordinate, Poisson's or Moreau's for several at their walls.

The impulse P of one impact makes ``y'+ = -k y'-``; with ``w M^-1 w^T`` the mobility of y,
``P = -(1 + k) y'- / (w M^-1 w^T)``. It is added to the state with an error below one rounding: a
rounding of the velocity would be the same at every impact of a periodic motion, and so would be
what it takes from the energy.

Coordinates that are at their walls at the same time and coupled have impulses ``P >= 0``, none of
them tensile, by Poisson's law: those that end the approach, and those of the expansion, at least k
times as much each; both are linear complementarity problems (Glocker and Pfeiffer). The expansion
leaves the least energy that these bounds permit, and to give all of the first impulses back would
leave the energy as it was: it never grows, whatever the k are. Only where all k are exactly 1, it
is Moreau's law, which conserves the energy, as Poisson's may not.
"""

from __future__ import annotations

import math

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels import complementarity
from vibroimpact_solvers.kernels.deviations import (
    EPS,
    SAFETY,
    estimated_error,
    estimated_length,
    length,
    lose,
    random_row,
)
from vibroimpact_solvers.kernels.flow import (
    Z1,
    Z2,
    exact_product,
    magnitude,
    product,
    set_rate,
    two_sum,
)
from vibroimpact_solvers.kernels.jit import fma, inline, inner, kernel, never_inlined, once
from vibroimpact_solvers.kernels.next_impact import ROUNDING, SIMULTANEOUS
from vibroimpact_solvers.kernels.rigid_state import (
    BY_FORCE,
    HAS_GRAZED,
    MAYBE,
    STRIKES,
    STRUCK,
    Motion,
    Rows,
    Scratch,
    Structure,
)

_LONG_CHATTER = 1e-3  # time of bounces lower than rounding that is not passed over
_FIRST = 0  # a pair, whose sign is as good as any
_ALONE = 0  # the row of a coordinate that is struck alone
_UNCOUPLED = 1e-14  # couplings that are rounding, relative to the mobilities of both
_APPROACHES = 1e-13  # speeds that are no rounding, relative to the terms they are sums of
_PASSES = 10_000  # of Moreau's law
NEWTON, POISSON, MOREAU = range(3)
"""Laws of impact."""
BOUNCES, RESTS, OPENS = range(3)
"""What an impact does: the motion goes on, a coordinate comes to rest, or contacts may open."""


@inline
def _add_impulse(
    z: float, rest: float, impulse: float, taken: float, form: float
) -> tuple[float, float]:
    """Return ``z + rest + (impulse + taken) form`` as two numbers."""
    kick = impulse * form
    total, lost = two_sum(z, kick)
    rest += lost + fma(taken, form, fma(impulse, form, -kick))
    return two_sum(total, rest)


@inline
def room_at(walls: Rows, i: int, side: float, y: float) -> float:
    """Return the distance of a coordinate at y from its upper (side > 0) or lower wall."""
    return float(walls[i].upper - y if side > 0.0 else walls[i].lower + y)


@inline
def _kick(motion: Motion, scratch: Scratch, kick: Floats, impulse: float, taken: float) -> None:
    """Add an impulse, the sum of two numbers, to the state."""
    z, rest = motion.z, scratch.rest
    for j in range(z.shape[1]):
        z[Z1, j], rest[Z1, j] = _add_impulse(z[Z1, j], rest[Z1, j], impulse, taken, kick[Z1, j])
        z[Z2, j], rest[Z2, j] = _add_impulse(z[Z2, j], rest[Z2, j], impulse, taken, kick[Z2, j])


@inline
def _turn_deviations(
    structure: Structure,
    motion: Motion,
    struck: Rows,
    a: int,
    acceleration: float,
    row: int,
    at_wall: bool,
    rounding: float,
    lasts: float,
) -> float:
    """Take the deviations through the impact of one coordinate (saltation).

    Returns the largest error of the end of a chatter, of which an impact with the speed u leaves a
    time ``lasts u``: errors that are the same at all of its impacts do not change it.

    acceleration is that of the coordinate before the impact; at_wall: it strikes at once. On
    their way deviations get the errors of the coordinate, of the place of the wall and of the kick;
    the rounding of where the coordinate was found to be, or, of a hop, what that of its duration
    makes of the place; and what the coordinate is away from its wall, if that is more than its
    rounding: of several that are taken together, or soon after it was released there. The formula
    is that of `kernels.deviations`.
    The square of the speed changes by ``2 y'' dy``, and the speed never by more than the root of
    that, however slow the impact is.
    """
    one, deviations, errors = struck[a], motion.deviations, structure.errors
    i, speed = one.coordinate, one.side * one.speed
    watched, wall = structure.watched, structure.walls[i]
    kick, kick_rate = watched.kick[i], watched.kick_rate[i]
    factor, impulse = wall.factor, -wall.factor * speed
    together = struck.size > 1 or one.hop_error > 0.0 or abs(one.room) > 2.0 * rounding
    place = wall.size + abs(one.room) / EPS if together else wall.size
    # Where it is taken to be at its wall: another sum of the same terms at every impact.
    misplaced = one.hop_error
    if misplaced == 0.0 and deviations.shape[0] > 0:
        misplaced = magnitude(watched.coordinate[i], motion.z)
    late = 0.0
    for c in range(deviations.shape[0]):
        dz, kick_error = deviations[c], errors.kicks[c, i]
        dy = product(watched.coordinate[i], dz) + product(errors.coordinates[c, i], motion.z)
        # That of their distance makes what goes to and fro between two walls drift.
        dy += -place if c & 1 else one.side * place
        signs = errors.signs[(row + c + 1) % errors.signs.shape[0]]
        dy += misplaced * signs[Z2, _FIRST]
        if at_wall:
            dy = 0.0
        faster = acceleration * dy / speed
        most = math.sqrt(2.0 * abs(acceleration * dy) / EPS)
        faster = min(max(faster, -most), most)
        off = product(watched.velocity[i], dz) + product(errors.velocities[c, i], motion.z)
        dP = factor * (faster - off)
        if lasts > 0.0:
            late = max(late, abs(one.side * lasts * (faster - off) + dy / speed))
        dy *= factor
        for j in range(dz.shape[1]):
            kicked = dP + impulse * signs[Z1, j]  # one rounding: of the impulse
            dz[Z1, j] += kicked * kick[Z1, j] - dy * kick_rate[Z1, j]
            dz[Z2, j] += kicked * kick[Z2, j] - dy * kick_rate[Z2, j]
            dz[Z1, j] += impulse * kick_error[Z1, j]
            dz[Z2, j] += impulse * kick_error[Z2, j]
    return late


@inline
def _error_after_hop(structure: Structure, motion: Motion, scratch: Scratch, i: int) -> float:
    """Return by how much a coordinate is off after a hop, in units of 2^-52; 0 where it was none.

    Its duration s is twice a speed over an acceleration, both known to roundings of their terms.
    """
    s, form = motion.progress[0].hop, structure.watched.velocity[i]
    if s == 0.0:
        return 0.0
    speed, slowed = magnitude(form, motion.z), magnitude(form, scratch.rate)
    return float(2.0 * s * (speed + 0.5 * s * slowed))


@inline
def _widen(structure: Structure, motion: Motion, i: int, impulse: float) -> None:
    """Let an impulse on a coordinate be unknown altogether."""
    kick, deviations = structure.watched.kick[i], motion.deviations
    for c in range(deviations.shape[0]):
        unknown = (-impulse if c & 1 else impulse) / EPS
        for j in range(kick.shape[1]):
            deviations[c, Z1, j] += unknown * kick[Z1, j]
            deviations[c, Z2, j] += unknown * kick[Z2, j]


@inner
def graze(structure: Structure, motion: Motion, scratch: Scratch, i: int, side: int) -> None:
    """Account for a coordinate that turns near a wall, where its error decides whether it strikes.

    By an error e of its place it strikes with the speed ``(2 a e)^(1/2)``, a being what turns it:
    the impulse that is or is not is the root of the error.
    """
    never_inlined()
    z, watched, walls = motion.z, structure.watched, structure.walls
    now = motion.progress[0]
    scratch.grazing[i] = HAS_GRAZED
    set_rate(structure.flow, z, scratch.rate)
    y, speed = product(watched.coordinate[i], z), side * product(watched.velocity[i], z)
    slowed = -side * product(watched.velocity[i], scratch.rate)
    room = room_at(walls, i, side, y)
    known, turns = 0.0, speed / slowed if slowed > 0.0 else 0.0
    for c in range(motion.deviations.shape[0]):
        dz = motion.deviations[c]
        dy = product(watched.coordinate[i], dz) + turns * product(watched.velocity[i], dz)
        known = max(known, abs(dy))
    # Beside the linear error, that of the curvature of the paths.
    margin, rounding = scratch.margin[i], scratch.rounding[i]
    error = SAFETY * EPS * known + rounding + margin * margin * ROUNDING / rounding
    squared = speed * speed + 2.0 * slowed * (error - room)
    certain = speed * speed > 2.0 * slowed * (error + room)  # that it strikes
    if squared > 0.0 and slowed > 0.0 and not certain:
        now.grazings += 1
        _widen(structure, motion, i, 0.5 * walls[i].factor * math.sqrt(squared))
        error = estimated_error(motion.deviations, structure.errors, motion.progress)
        lose(motion.progress, error, now.time)


@inline
def _rounding_of_place(structure: Structure, motion: Motion, scratch: Scratch, i: int) -> float:
    """Return the rounding of a coordinate, be it by terms that cancelled when the motion began."""
    terms = magnitude(structure.watched.coordinate[i], motion.z) + structure.walls[i].size
    return float(max(scratch.rounding[i], ROUNDING * terms))


@inline
def _widen_all(structure: Structure, motion: Motion, impulses: Floats) -> None:
    """Let impulses on all coordinates be unknown."""
    for i in range(impulses.size):
        if impulses[i] > 0.0:
            _widen(structure, motion, i, impulses[i])


@once
def _widen_unknown_order(structure: Structure, motion: Motion, scratch: Scratch) -> None:
    """Account for coordinates that may strike before or after the one at its wall.

    What the impulse of one takes from the velocity of the other changes the impulse of that one.
    These impulses are unknown before the impact, and after it too: with little restitution it
    leaves nothing of what was unknown along its own coordinate.
    """
    now, watched, walls = motion.progress[0], structure.watched, structure.walls
    a, unknown = now.coordinate, scratch.unknown
    unknown[:] = 0.0
    speed = (1.0 if now.side > 0 else -1.0) * product(watched.velocity[a], motion.z)
    late = scratch.margin[a] / max(speed, 1e-300)
    for b in range(walls.size):
        if b == a or walls[b].restitution < 0.0 or structure.mobility[a, b] == 0.0:
            continue
        y, velocity = (
            product(watched.coordinate[b], motion.z),
            product(watched.velocity[b], motion.z),
        )
        lower = walls[b].lower + y < walls[b].upper - y
        room = walls[b].lower + y if lower else walls[b].upper - y
        other = -velocity if lower else velocity
        rounding = _rounding_of_place(structure, motion, scratch, b)
        near = max(scratch.margin[b], SIMULTANEOUS * rounding)
        if room <= near + max(other, 0.0) * late:
            same = lower == (now.side < 0)
            coupling = structure.mobility[a, b] if same else -structure.mobility[a, b]
            # A coordinate that leaves, and does so after the impulse, is not struck.
            taken = coupling * walls[a].factor * max(speed, 0.0)
            if max(other, other - taken) > 0.0:
                both = abs(coupling) * walls[a].factor * walls[b].factor
                unknown[b] += both * max(speed, 0.0)
                unknown[a] += both * max(other, 0.0)
    _widen_all(structure, motion, unknown)


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
    for a in range(m):
        P[a] = rows[a].impulse
    return P


@inner
def _simultaneous_impulses(
    mobility: Floats, struck: Rows, equations: Floats, q: Floats, P: Floats, basic: Integers
) -> None:
    """Fill in laws and impulses of coordinates at their walls; arrays of `Scratch` are overwritten.

    Poisson's law: impulses ``L`` that end the approach, ``0 <= L _|_ G L - u >= 0``, and then those
    of the expansion, ``k L + E`` with ``0 <= E _|_ G ((1 + k) L + E) - u >= 0``.
    """
    count = struck.size
    G, work = equations[:count], equations[count : 2 * count]
    _couple(mobility, struck, G)
    for a in range(count):
        q[a] = -struck[a].speed if struck[a].law != MOREAU else 0.0
    complementarity.solve(G, q[:count], P[:count], basic[:count], work)
    for a in range(count):
        recedes, expansion = -struck[a].speed, 0.0
        for b in range(count):
            recedes += G[a, b] * P[b]
            expansion += G[a, b] * struck[b].restitution * P[b]
        q[a] = expansion
        if P[a] == 0.0 and struck[a].law != MOREAU:
            q[a] += max(recedes, 0.0)
        struck[a].impulse = (1.0 + struck[a].restitution) * P[a]
    complementarity.solve(G, q[:count], P[:count], basic[:count], work)
    for a in range(count):
        struck[a].impulse += P[a]
    _reflect(struck, equations, q, P, basic)


@inner
def _couple(mobility: Floats, struck: Rows, G: Floats) -> None:
    """Fill in the mobility of coordinates towards their walls, and the law of each of them.

    Those that no impulse reaches from one another are apart, whatever they have in common.
    """
    count = struck.size
    for a in range(count):
        struck[a].group = a
        for b in range(count):
            i, j = struck[a].coordinate, struck[b].coordinate
            coupling = struck[a].side * struck[b].side * mobility[i, j]
            uncoupled = abs(coupling) <= _UNCOUPLED * math.sqrt(mobility[i, i] * mobility[j, j])
            G[a, b] = 0.0 if uncoupled else coupling
    for _ in range(count):
        for a in range(count):
            for b in range(count):
                if G[a, b] != 0.0:
                    struck[a].group = min(struck[a].group, struck[b].group)
    for a in range(count):
        one, others, elastic = struck[a], 0, True
        for b in range(count):
            if struck[b].group == one.group:
                others += 1
                elastic = elastic and struck[b].restitution == 1.0
        one.law = NEWTON if others == 1 else (MOREAU if elastic else POISSON)


@inner
def _reflect(struck: Rows, equations: Floats, q: Floats, P: Floats, basic: Integers) -> None:
    """Add the impulses of Moreau's law with k = 1, which is repeated while one approaches.

    Each pass, ``0 <= P _|_ G P - 2 u >= 0``, leaves the energy as it is. There are finitely many
    where walls leave room. Where they leave none, as on both sides of a body, velocities go to and
    fro for ever: they end without restitution, as does what comes after very many passes, of bodies
    unlike by a million.
    """
    count, ends = struck.size, False
    G, work = equations[:count], equations[count : 2 * count]
    for a in range(count):
        struck[a].reflected = 0.0
    for passes in range(_PASSES + 1):
        approaches = False
        for a in range(count):
            q[a] = 0.0
            if struck[a].law == MOREAU:
                u, size = struck[a].speed, abs(struck[a].speed)
                for b in range(count):
                    u -= G[a, b] * struck[b].impulse
                    size += abs(G[a, b]) * struck[b].impulse
                q[a] = -u if ends else -2.0 * u
                approaches = approaches or u > _APPROACHES * size
        if not approaches:
            return
        complementarity.solve(G, q[:count], P[:count], basic[:count], work)
        ends = passes + 1 == _PASSES or _returns(struck, G, P)
        for a in range(count):
            struck[a].impulse += P[a]
            struck[a].reflected = P[a]


@inline
def _returns(struck: Rows, G: Floats, P: Floats) -> bool:
    """Return whether impulses P undo what those of the pass before did to all velocities."""
    for a in range(struck.size):
        moved, size = 0.0, 0.0
        for b in range(struck.size):
            moved += G[a, b] * (struck[b].reflected + P[b])
            size += abs(G[a, b]) * (struck[b].reflected + P[b])
        if abs(moved) > _APPROACHES * size:
            return False
    return True


@inline
def _find_struck(structure: Structure, motion: Motion, scratch: Scratch) -> int:
    """List the coordinates at their walls; return how many there are."""
    walls, watched, now = structure.walls, structure.watched, motion.progress[0]
    count = 0
    for i in range(walls.size):
        wall, y = walls[i], product(watched.coordinate[i], motion.z)
        if i == now.coordinate:
            side = 1.0 if now.side > 0 else -1.0
            now.penetration = max(now.penetration, abs(room_at(walls, i, side, y)))
        elif wall.restitution < 0.0:
            continue
        else:
            at_a_wall = SIMULTANEOUS * _rounding_of_place(structure, motion, scratch, i)
            if wall.upper - y <= at_a_wall:
                side = 1.0
            elif wall.lower + y <= at_a_wall:
                side = -1.0
            else:
                continue
        speed, lost = exact_product(watched.velocity[i], motion.z)
        lost += product(watched.velocity[i], scratch.rest)
        row = scratch.struck[count]
        row.coordinate, row.side, row.restitution = i, side, wall.restitution
        row.speed, row.speed_rest = side * speed, side * lost
        row.room, row.hop_error, row.law = room_at(walls, i, side, y), 0.0, NEWTON
        count += 1
    return count


@inline
def _opens(structure: Structure, motion: Motion, scratch: Scratch, count: int) -> bool:
    """Return whether impacts may open a contact, be it by the force that damping takes from it."""
    walls, watched = structure.walls, structure.watched
    for a in range(count):
        one = scratch.struck[a]
        i, wall = one.coordinate, walls[one.coordinate]
        opens = wall.opens_upper if one.side > 0.0 else wall.opens_lower
        if opens == MAYBE or (opens == BY_FORCE and count > 1):
            return True
        if opens == BY_FORCE:
            impulse = -wall.factor * one.side * max(one.speed, 0.0)
            for c in range(walls.size):
                if walls[c].restitution < 0.0:
                    form = watched.coordinate[c]
                    force = walls[c].lower + product(form, motion.z)
                    if force + impulse * product(form, watched.kick[i]) <= scratch.rounding[c]:
                        return True
    return False


@inline
def _write(motion: Motion, struck: Rows, a: int, acceleration: float) -> None:
    """Add an impact to the table."""
    now, one = motion.progress[0], struck[a]
    row = motion.impacts[now.rows]
    row.constraint, row.side = one.coordinate, int(one.side)
    row.velocity, row.impulse = one.side * one.speed, one.impulse
    row.acceleration, row.law = acceleration, one.law
    now.rows += 1


@inline
def _strike_one(structure: Structure, motion: Motion, scratch: Scratch, row: int) -> bool:
    """Apply the impact of one coordinate alone; return whether it comes to rest at its wall."""
    one, z, progress = scratch.struck[_ALONE], motion.z, motion.progress[0]
    i, wall = one.coordinate, structure.walls[one.coordinate]
    set_rate(structure.flow, z, scratch.rate)
    acceleration = product(structure.watched.velocity[i], scratch.rate)
    speed, towards, rounding = one.speed, one.side * acceleration, scratch.rounding[i]
    at_wall = scratch.grazing[i] == STRIKES
    if speed <= 0.0 or (speed * speed <= 2.0 * abs(towards) * rounding and not at_wall):
        # An impact as slow as a fall from within rounding is none.
        if towards >= 0.0:
            progress.chatter_late = math.inf
            bounce = max(speed, 0.0) if wall.restitution == 1.0 else 0.0
            return _comes_to_rest(structure, motion, scratch, _ALONE, bounce, towards)
        if scratch.grazing[i] != HAS_GRAZED:
            graze(structure, motion, scratch, i, progress.side)
        return False
    velocity, factor = one.side * speed, wall.factor
    # A speed that is rounding, by the motion as it is now, is one of a coordinate at rest.
    slight = ROUNDING * length(z, structure.errors.own) * math.sqrt(structure.mobility[i, i])
    impulse = -factor * velocity
    k, push = wall.restitution, one.side * (acceleration + impulse * wall.acceleration)
    lasts = 2.0 * k / (push * (1.0 - k)) if push > 0.0 and k < 1.0 else 0.0
    one.hop_error = _error_after_hop(structure, motion, scratch, i)
    if one.hop_error > 0.0:
        # Where the hops begin and end is for all of them the place of the wall.
        y, lost = exact_product(structure.watched.coordinate[i], z)
        lost += product(structure.watched.coordinate[i], scratch.rest)
        one.room = room_at(structure.walls, i, one.side, y) - one.side * lost
    late = _turn_deviations(
        structure, motion, scratch.struck[:1], _ALONE, acceleration, row, at_wall, rounding, lasts
    )
    progress.chatter_late = SAFETY * EPS * late if lasts > 0.0 else math.inf
    # What rounding takes from an impulse it takes from the energy, at each impact the same.
    taken = fma(-factor, velocity, -impulse)
    taken -= wall.factor_rest * velocity + factor * (one.side * one.speed_rest)
    _kick(motion, scratch, structure.watched.kick[i], impulse, taken)
    one.impulse = abs(impulse)
    if speed > slight:
        _write(motion, scratch.struck, _ALONE, acceleration)
    # Without the rounding of sums.
    return _comes_to_rest(structure, motion, scratch, _ALONE, k * speed, push)


@inner
def _strike_several(
    structure: Structure, motion: Motion, scratch: Scratch, count: int, row: int
) -> bool:
    """Apply simultaneous impacts; return whether one of the coordinates comes to rest."""
    never_inlined()
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
            acceleration = product(watched.velocity[i], rate)
            if one.speed > 0.0:
                # One after the other: where the order matters, they are widened beside.
                at_wall = scratch.grazing[i] == STRIKES
                rounding = scratch.rounding[i]
                _turn_deviations(
                    structure, motion, struck, a, acceleration, row + a, at_wall, rounding, 0.0
                )
            _write(motion, struck, a, acceleration)
        _kick(motion, scratch, kick, -one.side * one.impulse, 0.0)
    set_rate(flow, z, rate)
    motion.progress[0].chatter_late = math.inf
    for a in range(count):
        one = struck[a]
        velocity = watched.velocity[one.coordinate]
        speed, push = -one.side * product(velocity, z), one.side * product(velocity, rate)
        if _comes_to_rest(structure, motion, scratch, a, speed, push):
            return True
    return False


@inline
def _comes_to_rest(
    structure: Structure, motion: Motion, scratch: Scratch, a: int, speed: float, push: float
) -> bool:
    """Return whether a coordinate that leaves with some speed and is pressed to its wall rests.

    Its bounces last ``2 speed / (push (1 - k))`` in all, the sum of a geometric series: once that
    is short enough, they are one sum. Bounces lower than rounding are too; those that go on for
    long leave the velocity unknown by their speed.
    """
    one, progress = scratch.struck[a], motion.progress[0]
    if push < 0.0 or (push == 0.0 and speed > 0.0):
        return False
    i, lasts = one.coordinate, math.inf
    if speed <= 0.0:
        lasts = 0.0
    elif one.restitution < 1.0:
        lasts = 2.0 * speed / (push * (1.0 - one.restitution))
    if lasts <= progress.chatter or speed * speed <= 2.0 * push * scratch.rounding[i]:
        if lasts > _LONG_CHATTER and progress.largest > 0.0:
            unknown = math.sqrt(
                (speed * speed + 2.0 * push * scratch.margin[i]) / structure.mobility[i, i]
            )
            progress.unresolved = max(progress.unresolved, unknown / (EPS * progress.largest))
        progress.coordinate, progress.side = i, int(one.side)
        progress.chatter_left = lasts if lasts < math.inf else 0.0
        return True
    return False


@once
def strike(structure: Structure, motion: Motion, scratch: Scratch) -> int:
    """Apply the impact of the coordinate that reached its wall, and of all others at theirs.

    Returns `BOUNCES`, `RESTS`, or `OPENS`, where nothing was applied.
    """
    progress, errors = motion.progress[0], structure.errors
    first, row = progress.rows, random_row(progress.impacts, errors.signs.shape[0])
    order_matters = structure.walls.size > 1 and motion.deviations.shape[0] > 0
    if order_matters:
        _widen_unknown_order(structure, motion, scratch)
    count = _find_struck(structure, motion, scratch)
    if _opens(structure, motion, scratch, count):
        return OPENS
    before = estimated_length(motion.deviations, errors, motion.progress)
    if count == 1:
        rests = _strike_one(structure, motion, scratch, row)
    else:
        rests = _strike_several(structure, motion, scratch, count, row)
    if order_matters:
        _widen_all(structure, motion, scratch.unknown)
    slow = progress.rows == first or structure.walls[progress.coordinate].restitution == 0.0
    if not rests and slow:
        # It leaves with a speed that is rounding: the search, which found it at its wall by other
        # sums, would find it there for ever.
        progress.released = progress.coordinate
    if count > 1 or progress.rows > first:
        progress.impacts += 1
        error = estimated_error(motion.deviations, errors, motion.progress)
        if motion.deviations.shape[0] == 0:
            error = math.nan
        else:
            lose(motion.progress, error, progress.time)
        for line in range(first, progress.rows):
            impact = motion.impacts[line]
            impact.time, impact.time_rest = progress.time, progress.time_rest
            impact.deviation, impact.before = error, before
            if count > 1:  # one after the other
                impact.before = max(before, error * progress.largest)
    return RESTS if rests else BOUNCES
