"""Linear motion of a structure until a stop of finite stiffness switches, and what contacts sum up.

The motion is exact (`kernels.flow`), and the first zero of the watched forms, coordinates at walls
and forces of stops, is found with proof that none comes before (`kernels.next_impact`). Sampled
deviations keep account of rounding (`kernels.deviations`).

Over a contact the indentation is followed by its Taylor polynomials, whose remainder is bounded:
they give the deepest indentation, the largest force, and the integral of the squared rate.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.deviations import (
    EPS,
    add_rounding,
    estimated_error,
    lose,
    lose_on_the_way,
    note_size_from_rest,
    note_what_decays,
    random_row,
    set_sizes,
    start_deviations,
)
from vibroimpact_solvers.kernels.flow import (
    Z1,
    Z2,
    advance,
    bound,
    derivatives,
    grows,
    propagate,
    propagate_state,
    set_lengths,
    set_propagator,
    two_sum,
)
from vibroimpact_solvers.kernels.jit import bare, inner, once
from vibroimpact_solvers.kernels.next_impact import (
    AT_END,
    PAUSED,
    find_reach,
    next_event,
)
from vibroimpact_solvers.kernels.passages import ORDER, horizon, remainder
from vibroimpact_solvers.kernels.rigid_state import (
    ANEW,
    NOT_GRAZING,
    SAMPLING,
    SEARCHING,
    Motion,
    Scratch,
    Structure,
    scratch_of,
    structure_of,
)

END: Final = 0
SWITCH: Final = 1
PAUSE: Final = 2
SAMPLES: Final = 3
STILL: Final = 4
"""Why the loop returned: at the end; a watched form is zero; the work agreed on is done; as many
samples are taken as there is room for; the search did not get on."""

_DRIFTED = 1.0 / 64.0  # of the tolerance, by errors of the frequencies in one free motion
_PROPAGATED = 4.0  # roundings of a sample
_FINE = 2.0**-54  # remainder of a polynomial of the indentation, relative to its largest value
_WORK = 5_000_000  # of a call, in nanoseconds of a usual processor, as it is counted
_NODES = 8  # parts of a step at whose ends a maximum is looked for
_NEWTON = 8  # steps towards it
DEEPEST: Final = 0
STRONGEST: Final = 1
SQUARE: Final = 2
IMPULSE: Final = 3
LEFT_OUT: Final = 4
RATE_LEFT_OUT: Final = 5
"""Places of the sums over a contact, and of what polynomials leave out."""


@once
def _take_samples(
    structure: Structure, motion: Motion, scratch: Scratch, states: Floats, spreads: Floats,
    until: float,
) -> bool:  # fmt: skip
    """Take samples of the state and of the sizes of its deviations; return whether these are all.

    The deviations are those at the beginning of the motion, carried along, and its rounding.
    """
    flow, times, moved = structure.flow, motion.output_times, scratch.rate
    now, piece = motion.progress[0], scratch.piece[0]
    while now.samples < times.size and times[now.samples] <= until:
        place = now.samples - now.written
        if place >= states.shape[0]:
            return False
        piece.work += piece.sample
        since, lost = two_sum(times[now.samples], -now.time)
        lost -= now.time_rest
        set_propagator(flow, since, lost, scratch.propagator)
        z, spread = states[place], spreads[place]
        propagate_state(flow, scratch.propagator, since + lost, motion.z, z)
        drift = _PROPAGATED + abs(since) * structure.errors.drift
        for j in range(z.shape[1]):
            spread[Z1, j] = spread[Z2, j] = drift * (abs(z[Z1, j]) + abs(z[Z2, j]))
        for c in range(motion.deviations.shape[0]):
            propagate(flow, scratch.propagator, since + lost, motion.deviations[c], moved)
            for j in range(z.shape[1]):
                # Of a rotation both numbers are as large, a little earlier or later.
                first, second = abs(moved[Z1, j]), abs(moved[Z2, j])
                if j < flow.rotations:
                    first = second = math.sqrt(first * first + second * second)
                spread[Z1, j] = max(spread[Z1, j], first)
                spread[Z2, j] = max(spread[Z2, j], second)
        now.samples += 1
    return True


@once
def _move(structure: Structure, motion: Motion, scratch: Scratch, s: float, ds: float) -> None:
    """Advance the state, its deviations and the time to the end of a free motion."""
    flow, z, deviations, moved = structure.flow, motion.z, motion.deviations, scratch.z
    now, signs = motion.progress[0], structure.errors.signs
    set_propagator(flow, s, ds, scratch.propagator)
    for j in range(z.shape[1]):
        scratch.rest[Z1, j] = scratch.rest[Z2, j] = 0.0
    advance(flow, scratch.propagator, s + ds, z, scratch.rest, moved)
    for c in range(deviations.shape[0]):
        propagate(flow, scratch.propagator, s + ds, deviations[c], moved)
        for j in range(z.shape[1]):
            deviations[c, Z1, j], deviations[c, Z2, j] = moved[Z1, j], moved[Z2, j]
    now.time, lost = two_sum(now.time, s)
    now.time_rest += lost + ds
    now.released = -1
    now.impacts += 1
    if deviations.shape[0] > 0:
        set_sizes(flow, s, z, scratch.sizes)
        row = random_row(now.impacts, signs.shape[0])
        add_rounding(flow, motion, structure.errors, row, s, scratch.sizes)


@inner
def _note_on_the_way(structure: Structure, motion: Motion, scratch: Scratch, s: float) -> None:
    """Note what the end of a free motion does not show."""
    now = motion.progress[0]
    if motion.deviations.shape[0] == 0:
        return
    drifted = structure.errors.drift * s * EPS > _DRIFTED * now.tolerance
    if now.known_until == np.inf and (drifted or grows(structure.flow)):
        lose_on_the_way(structure, motion, scratch, s)
    if structure.flow.damped:
        note_what_decays(structure, motion, scratch, s)


@inner
def _set_costs(structure: Structure, scratch: Scratch, columns: int) -> None:
    """Begin a piece of work, and tell what its parts cost."""
    flow, m, piece = structure.flow, structure.walls.size, scratch.piece[0]
    pairs = flow.nu.size
    coordinate = 8 * pairs + 100 * flow.drives.size
    piece.work = 0
    piece.expansion = m * (500 + 12 * pairs + coordinate) + 30 * pairs
    piece.motion = 500 + m * (100 + coordinate) + (60 + 20 * columns) * pairs
    piece.sample = 100 + (30 + 10 * columns) * pairs


@bare
def follow_until_switch(
    structure: Any, motion: Any, work: Any, modes: int, states: Floats, spreads: Floats
) -> tuple[int, int, int]:
    """Follow a motion in one state of its stops until one of them switches.

    Parameters
    ----------
    structure, motion, work : tuple
        As of `rigid_motion.follow`.
    modes : int
        As of `rigid_state.scratch_of`.
    states, spreads : array, shape (row, 2, pair)
        Samples of the state, and the largest magnitudes of its deviations, from the sample after
        those `written` on.

    Returns
    -------
    stop : int
        `END`, `SWITCH`, `PAUSE`, `SAMPLES` or `STILL`; after a pause and for more samples another
        call goes on from there.
    who : int
        The watched form that is zero.
    side : int
        At which wall.
    """
    named = structure_of(structure)
    z, deviations, progress, impacts, times = motion
    current = Motion(z, deviations, progress, impacts, times)
    scratch = scratch_of(work, z.shape[1], modes)
    now, piece, errors = progress[0], scratch.piece[0], named.errors
    _set_costs(named, scratch, deviations.shape[0])
    if not now.begun:
        start_deviations(named.flow, current, errors)
        now.growth = max(now.growth, estimated_error(deviations, errors, progress))
        now.begun = 1
    if piece.stage != SAMPLING:
        if piece.stage != SEARCHING:
            for i in range(named.walls.size):
                scratch.grazing[i] = NOT_GRAZING
            find_reach(named, current, scratch)
        s, ds, who, side = next_event(named, current, scratch)
        if who == PAUSED:
            piece.stage = SEARCHING
            return PAUSE, who, side
        piece.time, piece.time_rest, piece.who, piece.side = s, ds, who, side
        if who == AT_END:
            note_size_from_rest(named, current, scratch, s)
    s, ds, who, side = piece.time, piece.time_rest, piece.who, piece.side
    until = now.end if who == AT_END else (now.time + s) + (now.time_rest + ds)
    if not _take_samples(named, current, scratch, states, spreads, until):
        piece.stage = SAMPLING
        return SAMPLES, who, side
    piece.stage = ANEW
    _note_on_the_way(named, current, scratch, s)
    begun = now.time
    _move(named, current, scratch, s, ds)
    if deviations.shape[0] > 0:
        error = estimated_error(deviations, errors, progress)
        now.growth = max(now.growth, error)
        lose(progress, error, begun)
    if who == AT_END:
        return END, who, side
    return (SWITCH if who >= 0 else STILL), who, side


@inner
def _largest(c: Floats, order: int, h: float) -> float:
    """Return the largest value in [0, h] of the polynomial ``sum c_n t^n`` of some degree."""
    best, at = -np.inf, 0.0
    for part in range(_NODES + 1):
        t = h * part / _NODES
        value = 0.0
        for n in range(order, -1, -1):
            value = value * t + c[n]
        if value > best:
            best, at = value, t
    t = at
    for _ in range(_NEWTON):
        value, slope, bend = 0.0, 0.0, 0.0
        for n in range(order, -1, -1):
            bend = bend * t + 2.0 * slope
            slope = slope * t + value
            value = value * t + c[n]
        best = max(best, value)
        if bend >= 0.0:
            break
        t = min(max(t - slope / bend, 0.0), h)
    return best


@bare
def contact_sums(
    structure: Any, work: Any, modes: int, z: Floats, law: Floats, given: Any, sums: Floats
) -> float:
    """Add up a contact: its deepest indentation, largest force, integral of the squared rate.

    Parameters
    ----------
    structure, work, modes
        As of `follow_until_switch`.
    z : array, shape (2, pair)
        The state at the beginning.
    law : array, shape (2,)
        Stiffness, and damping by the basis' time.
    given : tuple
        Index of the coordinate, its side, what to add to the coordinate times its side so that it
        is the indentation, the time to begin at, the duration, the longest time of one step, and
        the size of the indentation.
    sums : array, shape (6,)
        `DEEPEST` and `STRONGEST`, which are raised; `SQUARE` and `IMPULSE`, the integrals of the
        squared rate and of the force, which are added to; and bounds of what polynomials leave out
        of the indentation and of its rate, `LEFT_OUT` and `RATE_LEFT_OUT`, which are raised.

    Returns
    -------
    float
        The time that is reached: where it is not the duration, another call goes on from there.
    """
    named = structure_of(structure)
    flow, watched = named.flow, named.watched
    scratch = scratch_of(work, z.shape[1], modes)
    i, side, level, t, span, longest, size = given
    stiffness, damping = law
    d, c = scratch.derivatives, scratch.roots[Z1]
    f = scratch.roots[Z2]
    left = 1 + _WORK // (1000 + 40 * z.shape[1])
    while t < span and left > 0:
        left -= 1
        set_propagator(flow, t, 0.0, scratch.propagator)
        propagate_state(flow, scratch.propagator, t, z, scratch.z)
        derivatives(flow, watched.coordinate[i], scratch.z, d)
        set_lengths(flow, scratch.z, scratch.lengths)
        ahead = min(span - t, longest)
        B = bound(flow, watched, i, scratch.z, scratch.lengths, True, ahead)
        h = min(horizon(B, _FINE * size), ahead)
        h = h if t + h > t else span - t
        power = 1.0
        for n in range(ORDER):
            c[n] = side * d[n] * power
            power /= n + 1.0
        c[0] += level
        for n in range(ORDER - 1):
            f[n] = stiffness * c[n] + damping * (n + 1.0) * c[n + 1]
        sums[DEEPEST] = max(sums[DEEPEST], _largest(c, ORDER - 1, h))
        sums[STRONGEST] = max(sums[STRONGEST], _largest(f, ORDER - 2, h))
        total = 0.0
        for m in range(ORDER - 1, 0, -1):
            inside = 0.0
            for n in range(ORDER - 1, 0, -1):
                inside = inside * h + n * c[n] / (m + n - 1.0)
            total = total * h + m * c[m] * inside
        sums[SQUARE] += h * total
        total = 0.0
        for n in range(ORDER - 2, -1, -1):
            total = total * h + f[n] / (n + 1.0)
        sums[IMPULSE] += h * total
        less = remainder(B, h)
        sums[LEFT_OUT] = max(sums[LEFT_OUT], less)
        sums[RATE_LEFT_OUT] = max(sums[RATE_LEFT_OUT], ORDER * less / h)
        t += h
    return float(t)
