"""How a motion with rigid limiters changes with parameters, to first order.

The impacts are known. Between them the rates dz of the state with each parameter obey the equations
of the motion with a source, and are

    dz(s) = P(s) dz(0) + int P(s - u) U (V z(u) + c) du ,

P being the propagator, and U (V z + c) what the parameter changes in the equations: a sum of few
products. Where all pairs that a parameter names are rotations, the integrals are divided
differences of exponentials; else, and over so short a time that few nodes cost less, Gauss sums,
over pieces of so few radians of the fastest pair that what they lack is below rounding. Their nodes
are symmetric: what remains of a piece after one node is the time to another one.
An impact of the coordinate y = w z at the wall Y, by the impulse
``J = -f y'``, is later by

    dt = -(dy - dY)/y' ,    dz+ = dz- + k dJ + dk J - k' J dt ,    dJ = -f (dy' + y'' dt) - df y' ,

k being the change of the state by a unit impulse and k' its rate: motions before and after the
impact are compared at one instant, and so are states beside an event.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.deviations import EPS, random_row
from vibroimpact_solvers.kernels.flow import (
    EVEN,
    ODD,
    Z1,
    Z2,
    Flow,
    product,
    propagate,
    propagate_state,
    set_propagator,
    set_rate,
    two_sum,
)
from vibroimpact_solvers.kernels.jit import bare, inner, never_inlined, record

PIECE: Final = 8.0
"""Radians of a piece over which Gauss sums of `MANY` nodes are exact to rounding, of products of
two functions that both turn by so much."""
MANY: Final = 16
SHORT: Final = 1.0
"""Radians for which a sum of `FEW` nodes is enough."""
FEW: Final = 8
_LATE = 1e-3  # part of its speed that a coordinate may lose while a time is put right
_CORRECTIONS = 2
_SMALL = 0.5  # differences of rates, times the duration, from which quotients lose no digits
_TERMS = 15
_LOWER, _UPPER = range(2)
_TIME, _VELOCITY, _IMPULSE = range(3)
_MOTION = 0  # the state among the rates of the state
_PLACES, _WEIGHTS = range(2)

PROGRESS: Final = record(
    [
        ("time", "f8"),
        ("time_rest", "f8"),
        ("impact", "i8"),  # the next one
        ("sample", "i8"),  # the next one
        ("count", "i8"),  # of free motions, by which signs of roundings are drawn
    ]
)
"""How far the rates are."""


class Stops(NamedTuple):
    """The stops: forms of their coordinates and what an impulse on them does."""

    coordinate: Floats  # (constraint, 2, pair)
    velocity: Floats
    kick: Floats
    kick_rate: Floats
    walls: Floats  # (2, constraint): places of lower and upper walls
    factor: Floats  # (constraint,): (1 + restitution) over the mobility


class Sources(NamedTuple):
    """Terms ``u (v z + constant)``, some times t, of the equations of the rates, a row for each.

    v is a list of pairs, each with the numbers of its two parts, u one of numbers, each with its
    place in a state of 2 pair numbers.
    """

    of: Integers  # (parameter + 1,): its first row
    form_start: Integers  # (row + 1,)
    form_place: Integers  # (form,): the pair
    form_value: Floats  # (form, 2)
    direction_start: Integers
    direction_place: Integers
    direction_value: Floats
    constant: Floats  # (row,)
    by_time: NDArray[np.bool_]  # (row,): whether the whole row grows with time
    fastest: float  # rate of the fastest pair
    # (parameter,): radians of the fastest pair from which on integrals are in closed form; infinite
    # where a pair that its rows name is no rotation, or one drives another; the largest of all
    closed_from: Floats
    longest: float


class Changes(NamedTuple):
    """Rates of the stops, a row for each stop that a parameter changes."""

    of: Integers  # (parameter + 1,): its first row
    constraint: Integers  # (row,)
    walls: Floats  # (2, row): of the places of lower and upper walls
    factor: Floats  # (row,)
    level: Floats  # (row,): of the coordinate where the state is zero
    coordinate: Floats  # (row, 2, pair); one row of zeros where none changes
    velocity: Floats
    kick: Floats


class Events(NamedTuple):
    """The impacts, and the rates of each with the parameters."""

    time: Floats  # (impact,)
    constraint: Integers
    side: Integers
    rates: Floats  # (3, impact, parameter): of times, velocities and impulses


class State(NamedTuple):
    """The motion and its rates, now and at the output times."""

    z: Floats  # (1 + parameter, 2, pair): the motion, then its rates
    progress: NDArray[np.void]  # (1,), of `PROGRESS`
    times: Floats  # (sample,): output times
    states: Floats  # (sample, 1 + parameter, 2, pair): as many as there is room for


class Room(NamedTuple):
    """Arrays that functions overwrite, the nodes of Gauss sums, and signs of roundings."""

    propagator: Floats  # (2, pair)
    nodes: Floats  # (node, 2, pair): propagators to the nodes of a Gauss sum
    node: Floats  # (2, pair)
    pushed: Floats  # (2, pair)
    moved: Floats  # (2, pair)
    sums: Floats  # (parameter, 2, pair)
    few: Floats  # (2, node): places in [0, 1] and weights
    many: Floats  # (2, node)
    signs: Floats  # (row, 2, pair)


@inner
def _add_source(sources: Sources, row: int, t: float, z: Floats, out: Floats) -> None:
    """Add the term of one row at a state; both are flat, (2 pair,)."""
    pairs, total = z.size // 2, sources.constant[row]
    for k in range(sources.form_start[row], sources.form_start[row + 1]):
        pair = sources.form_place[k]
        total += sources.form_value[k, Z1] * z[pair]
        total += sources.form_value[k, Z2] * z[pairs + pair]
    if sources.by_time[row]:
        total *= t
    for k in range(sources.direction_start[row], sources.direction_start[row + 1]):
        out[sources.direction_place[k]] += sources.direction_value[k] * total


@inner
def _quotient(y: complex) -> tuple[complex, complex]:
    """Return the averages of e^(y u) and of u e^(y u) over u in [0, 1], for small y."""
    second = 1.0 + 0.0j
    for n in range(_TERMS, 2, -1):
        second = 1.0 + second * y * (1.0 / n)  # of the second average of `flow._averages`
    first = 1.0 + 0.5 * y * second
    return first, first - 0.5 * second


@inner
def _differences(
    flow: Flow, propagator: Floats, i: int, k: int, mirrored: bool, s: float
) -> tuple[complex, complex]:
    """Return the integrals of ``e^(q (s - x)) e^(p x)`` and of x times that, x from 0 to s.

    q is the rate of pair i; p that of pair k or its conjugate, or zero for k below zero.
    """
    end = complex(propagator[EVEN, i], propagator[ODD, i])
    apart, other = -complex(flow.alpha[i], flow.nu[i] + flow.rest[i]), 1.0 + 0.0j
    if k >= 0:
        sign = -1.0 if mirrored else 1.0
        other = complex(propagator[EVEN, k], sign * propagator[ODD, k])
        turned = (sign * flow.nu[k] - flow.nu[i]) + (sign * flow.rest[k] - flow.rest[i])
        apart = complex(flow.alpha[k] - flow.alpha[i], turned)
    y = apart * s
    if y.real * y.real + y.imag * y.imag <= _SMALL * _SMALL:
        first, second = _quotient(y)
        return s * end * first, s * s * end * second
    over = apart.conjugate() * (1.0 / (apart.real * apart.real + apart.imag * apart.imag))
    first = (other - end) * over
    return first, (s * other - first) * over


@inner
def _integrate_row(
    flow: Flow, sources: Sources, row: int, state: State, room: Room, s: float
) -> None:
    """Set the pushed state to the integral of one source over a free motion, in closed form."""
    t, z, pairs = state.progress[0].time, state.z[_MOTION], state.z.shape[2]
    for d in range(sources.direction_start[row], sources.direction_start[row + 1]):
        at = sources.direction_place[d]
        half = Z2 if at >= pairs else Z1
        i, value = at - half * pairs, sources.direction_value[d]
        total, grown = 0.0 + 0.0j, 0.0 + 0.0j
        if sources.constant[row] != 0.0:
            first, second = _differences(flow, room.propagator, i, -1, False, s)
            total += sources.constant[row] * first
            grown += sources.constant[row] * second
        for f in range(sources.form_start[row], sources.form_start[row + 1]):
            k = sources.form_place[f]
            form = complex(sources.form_value[f, Z1], sources.form_value[f, Z2])
            w = complex(z[Z1, k], -z[Z2, k]) * (0.5 * form)
            first, second = _differences(flow, room.propagator, i, k, False, s)
            total += w * first
            grown += w * second
            first, second = _differences(flow, room.propagator, i, k, True, s)
            total += w.conjugate() * first
            grown += w.conjugate() * second
        if sources.by_time[row]:
            total = t * total + grown
        if half == Z2:
            total *= -1.0j
        room.pushed[Z1, i] += value * total.real
        room.pushed[Z2, i] -= value * total.imag


@inner
def _integrate_exactly(flow: Flow, sources: Sources, state: State, room: Room, s: float) -> None:
    """Set the sums to the integrals in closed form, for which the propagator is that of s."""
    turned = s * sources.fastest
    for p in range(room.sums.shape[0]):
        if not sources.closed_from[p] <= turned or sources.of[p] == sources.of[p + 1]:
            continue
        for j in range(room.pushed.shape[1]):
            room.pushed[Z1, j] = room.pushed[Z2, j] = 0.0
        for row in range(sources.of[p], sources.of[p + 1]):
            _integrate_row(flow, sources, row, state, room, s)
        for j in range(room.pushed.shape[1]):
            room.sums[p, Z1, j], room.sums[p, Z2, j] = room.pushed[Z1, j], room.pushed[Z2, j]


@inner
def _integrate(
    flow: Flow, sources: Sources, state: State, room: Room, nodes: Floats, s: float
) -> None:
    """Set the sums to the integrals of sources without a closed form over a piece of duration s."""
    t, z, count = state.progress[0].time, state.z[_MOTION], nodes.shape[1]
    turned, node, pushed = s * sources.fastest, room.node.reshape(-1), room.pushed.reshape(-1)
    for p in range(room.sums.shape[0]):
        for j in range(z.shape[1] if sources.closed_from[p] > turned else 0):
            room.sums[p, Z1, j] = room.sums[p, Z2, j] = 0.0
    for i in range(count):
        set_propagator(flow, s * nodes[_PLACES, i], 0.0, room.nodes[i])
    for i in range(count):
        u, weight = s * nodes[_PLACES, i], s * nodes[_WEIGHTS, i]
        remains, back = s * nodes[_PLACES, count - 1 - i], room.nodes[count - 1 - i]
        propagate_state(flow, room.nodes[i], u, z, room.node)
        for p in range(room.sums.shape[0]):
            if sources.closed_from[p] <= turned or sources.of[p] == sources.of[p + 1]:
                continue
            pushed[:] = 0.0
            for row in range(sources.of[p], sources.of[p + 1]):
                _add_source(sources, row, t + u, node, pushed)
            propagate(flow, back, remains, room.pushed, room.moved)
            for j in range(z.shape[1]):
                room.sums[p, Z1, j] += weight * room.moved[Z1, j]
                room.sums[p, Z2, j] += weight * room.moved[Z2, j]


@inner
def _advance(flow: Flow, sources: Sources, state: State, room: Room, s: float) -> None:
    """Advance the motion and its rates by a piece of duration s, but not the time."""
    z = state.z
    turned = s * sources.fastest
    if sources.longest > turned:
        nodes = room.few if turned <= SHORT else room.many
        _integrate(flow, sources, state, room, nodes, s)
    set_propagator(flow, s, 0.0, room.propagator)
    if sources.constant.size > 0:
        _integrate_exactly(flow, sources, state, room, s)
    propagate_state(flow, room.propagator, s, z[_MOTION], room.moved)
    for j in range(z.shape[2]):
        z[_MOTION, Z1, j], z[_MOTION, Z2, j] = room.moved[Z1, j], room.moved[Z2, j]
    for p in range(room.sums.shape[0]):
        propagate(flow, room.propagator, s, z[p + 1], room.moved)
        driven = sources.of[p] < sources.of[p + 1]
        for j in range(z.shape[2]):
            z[p + 1, Z1, j] = room.moved[Z1, j] + (room.sums[p, Z1, j] if driven else 0.0)
            z[p + 1, Z2, j] = room.moved[Z2, j] + (room.sums[p, Z2, j] if driven else 0.0)


@inner
def _move(flow: Flow, sources: Sources, state: State, room: Room, s: float, noise: float) -> None:
    """Advance the motion, its rates and the time by a free motion of duration s."""
    now, z, pieces = state.progress[0], state.z, 1
    if sources.longest == math.inf:
        pieces = max(1, math.ceil(s * sources.fastest / PIECE))
    for _ in range(pieces):
        part = s / pieces
        _advance(flow, sources, state, room, part)
        now.time, lost = two_sum(now.time, part)
        now.time_rest += lost
    now.count += 1
    if noise == 0.0:
        return
    for p in range(z.shape[0]):
        row = random_row(now.count * 31 + p, room.signs.shape[0])
        for j in range(z.shape[2]):
            size = noise * EPS * (abs(z[p, Z1, j]) + abs(z[p, Z2, j]))
            z[p, Z1, j] += size * room.signs[row, Z1, j]
            z[p, Z2, j] += size * room.signs[row, Z2, j]


@inner
def _until(flow: Flow, stops: Stops, events: Events, state: State, room: Room) -> float:
    """Return the time from now to the next impact, put right by the place of its wall; or nan."""
    never_inlined()
    now, z = state.progress[0], state.z[_MOTION]
    i, side = events.constraint[now.impact], events.side[now.impact]
    wall = stops.walls[_UPPER if side > 0 else _LOWER, i]
    s = (events.time[now.impact] - now.time) - now.time_rest
    for _ in range(_CORRECTIONS):
        set_propagator(flow, s, 0.0, room.propagator)
        propagate_state(flow, room.propagator, s, z, room.node)
        set_rate(flow, room.node, room.moved)
        speed = product(stops.velocity[i], room.node)
        bend = product(stops.velocity[i], room.moved)
        late = (wall - product(stops.coordinate[i], room.node)) / speed
        if not abs(late * bend) <= _LATE * abs(speed) or not speed * side > 0.0:
            return math.nan
        s += late
    return float(max(s, 0.0))


@inner
def _strike(
    flow: Flow, stops: Stops, changes: Changes, events: Events, state: State, room: Room
) -> None:
    """Apply the next impact to the motion and to its rates, and write the rates of the impact."""
    never_inlined()
    now, z = state.progress[0], state.z
    i, side = events.constraint[now.impact], events.side[now.impact]
    moving = z[_MOTION]
    set_rate(flow, moving, room.moved)
    speed = product(stops.velocity[i], moving)
    bend = product(stops.velocity[i], room.moved)
    impulse = -stops.factor[i] * speed
    for p in range(room.sums.shape[0]):
        dz = z[p + 1]
        dy, dv = product(stops.coordinate[i], dz), product(stops.velocity[i], dz)
        factor, turned = 0.0, -1
        for row in range(changes.of[p], changes.of[p + 1]):
            if changes.constraint[row] != i:
                continue
            factor += changes.factor[row]
            dy += changes.level[row] - changes.walls[_UPPER if side > 0 else _LOWER, row]
            if changes.coordinate.shape[0] == changes.constraint.size:
                turned = row
                dy += product(changes.coordinate[row], moving)
                dv += product(changes.velocity[row], moving)
        later = -dy / speed
        dv += bend * later
        more = -stops.factor[i] * dv - factor * speed
        events.rates[_TIME, now.impact, p] = later
        events.rates[_VELOCITY, now.impact, p] = dv
        events.rates[_IMPULSE, now.impact, p] = more if impulse > 0.0 else -more
        late = impulse * later
        for j in range(z.shape[2]):
            dz[Z1, j] += stops.kick[i, Z1, j] * more - stops.kick_rate[i, Z1, j] * late
            dz[Z2, j] += stops.kick[i, Z2, j] * more - stops.kick_rate[i, Z2, j] * late
            if turned >= 0:
                dz[Z1, j] += changes.kick[turned, Z1, j] * impulse
                dz[Z2, j] += changes.kick[turned, Z2, j] * impulse
    for j in range(z.shape[2]):
        z[_MOTION, Z1, j] += stops.kick[i, Z1, j] * impulse
        z[_MOTION, Z2, j] += stops.kick[i, Z2, j] * impulse
    now.impact += 1


@bare
def follow(
    flow: Any, stops: Any, sources: Any, changes: Any, events: Any, state: Any, room: Any,
    noise: float,
) -> int:  # fmt: skip
    """Follow a motion and its rates until the room for samples is full, or to their end.

    Parameters
    ----------
    flow, stops, sources, changes, events, state, room : NamedTuple
        Of the classes above; the state goes on, and rates are written to it and to the events.
    noise : float
        Roundings that are added to all states, in units of 2^-52.

    Returns
    -------
    written : int
        Number of samples. At the end it is less than there is room for, or all are taken; the next
        impact of the progress is one whose wall is not reached, or their number.
    """
    now, written = state.progress[0], 0
    while True:
        until, ends = math.inf, now.impact >= events.time.size
        if not ends:
            until = _until(flow, stops, events, state, room)
            if math.isnan(until):
                ends = True
                until = (events.time[now.impact] - now.time) - now.time_rest
        first = now.sample
        while now.sample < state.times.size:
            left = (state.times[now.sample] - now.time) - now.time_rest
            if left > until:
                break
            if written >= state.states.shape[0]:
                return written
            left = max(left, 0.0)
            _move(flow, sources, state, room, left, noise)
            until -= left
            for p in range(state.z.shape[0]):
                for j in range(state.z.shape[2]):
                    state.states[written, p, Z1, j] = state.z[p, Z1, j]
                    state.states[written, p, Z2, j] = state.z[p, Z2, j]
            written += 1
            now.sample += 1
        if ends:
            return written
        if now.sample > first:  # of which roundings have moved the state
            until = _until(flow, stops, events, state, room)
            if math.isnan(until):
                return written
        _move(flow, sources, state, room, until, noise)
        _strike(flow, stops, changes, events, state, room)
