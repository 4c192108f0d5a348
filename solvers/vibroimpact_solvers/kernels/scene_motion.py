"""The motion of a structure in one scene, until a stop switches: exact, and none is missed.

The motion is exact (`kernels.flow`). The first zero of the watched forms, coordinates at walls and
forces of stops, is found with proof that none comes before (`kernels.next_impact`). Sampled
deviations keep account of rounding (`kernels.deviations`).
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any, Final, NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.contact_phases import set_spread_of
from vibroimpact_solvers.kernels.contact_sums import Passed
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
    grows,
    propagate,
    propagate_state,
    set_propagator,
    two_sum,
)
from vibroimpact_solvers.kernels.jit import inline, inner, once
from vibroimpact_solvers.kernels.next_impact import AT_END, PAUSED, find_reach, next_event
from vibroimpact_solvers.kernels.rigid_state import (
    NOT_GRAZING,
    SAMPLING,
    SEARCHING,
    Motion,
    Scratch,
    Structure,
)
from vibroimpact_solvers.kernels.scene_changes import CONVERTED

SUMMING = SAMPLING + 1
SWITCHING = SAMPLING + 2
"""Where a motion goes on besides the stages of `rigid_state`: among sums over contacts; and at a
switching whose scene was not prepared, or for whose phase there was no room."""

_DRIFTED = 1.0 / 64.0  # of the tolerance, by errors of the frequencies in one free motion
_PROPAGATED = 4.0  # roundings of a sample


class Stop(IntEnum):
    """Why the loop returned."""

    END = 0  # the end of the time was reached
    PAUSE = 1  # the work agreed on is done: another call goes on as if there had been none
    SAMPLES = 2  # as many samples are taken as there is room for
    SCENE = 3  # a stop switches to a state that is not prepared
    PHASES = 4  # the table of contact phases is full
    STILL = 5  # stops keep switching at one instant
    MANY = 6  # stops switch more often than any plan expects


_PAUSE, _SAMPLES = 1, 2
GOES_ON: Final = -1
"""There is no reason to return."""


class Taken(NamedTuple):
    """Samples that are taken until Python fetches them; states of any scene."""

    states: Floats  # (row, 2 pair)
    spreads: Floats  # (row, 2 pair): the largest magnitudes of the deviations
    scenes: Integers  # (row,)


@once
def _take_samples(
    structure: Structure, motion: Motion, scratch: Scratch, taken: Taken, scene: int, until: float
) -> int:
    """Take samples of the state and of the sizes of its deviations; return why that ended.

    The deviations are those at the beginning of the motion, carried along, and its rounding.
    """
    flow, times, moved = structure.flow, motion.output_times, scratch.rate
    now, piece, pairs = motion.progress[0], scratch.piece[0], motion.z.shape[1]
    while now.samples < times.size and times[now.samples] <= until:
        place = now.samples - now.written
        if place >= taken.scenes.size:
            return _SAMPLES
        if piece.work >= now.budget:
            return _PAUSE
        piece.work += piece.sample
        since, lost = two_sum(times[now.samples], -now.time)
        lost -= now.time_rest
        set_propagator(flow, since, lost, scratch.propagator)
        z = taken.states[place, : 2 * pairs].reshape(2, pairs)
        spread = taken.spreads[place, : 2 * pairs].reshape(2, pairs)
        taken.scenes[place] = scene
        propagate_state(flow, scratch.propagator, since + lost, motion.z, z)
        drift = _PROPAGATED + abs(since) * structure.errors.drift
        for j in range(pairs):
            spread[Z1, j] = spread[Z2, j] = drift * (abs(z[Z1, j]) + abs(z[Z2, j]))
        for c in range(motion.deviations.shape[0]):
            propagate(flow, scratch.propagator, since + lost, motion.deviations[c], moved)
            for j in range(pairs):
                # Of a rotation both numbers are as large, a little earlier or later.
                first, second = abs(moved[Z1, j]), abs(moved[Z2, j])
                if j < flow.rotations:
                    first = second = math.sqrt(first * first + second * second)
                spread[Z1, j] = max(spread[Z1, j], first)
                spread[Z2, j] = max(spread[Z2, j], second)
        now.samples += 1
    return GOES_ON


@once
def _move(structure: Structure, motion: Motion, scratch: Scratch, s: float, ds: float) -> bool:
    """Advance the state, its deviations and the time to the end of a free motion.

    Returns whether the time has moved.
    """
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
    begun = now.time + now.time_rest
    now.time, lost = two_sum(now.time, s)
    now.time_rest += lost + ds
    now.released = -1
    now.impacts += 1
    if deviations.shape[0] > 0:
        set_sizes(flow, s, z, scratch.sizes)
        row = random_row(now.impacts, signs.shape[0])
        add_rounding(flow, motion, structure.errors, row, s, scratch.sizes)
    return bool(now.time + now.time_rest != begun)


@inline
def _fades(alpha: Floats, s: float) -> bool:
    """Return whether anything decays to 1/e or less in a time s."""
    fastest = 0.0
    for j in range(alpha.size):
        fastest = max(fastest, -alpha[j])
    return fastest * s > 1.0


@once
def _note_on_the_way(structure: Structure, motion: Motion, scratch: Scratch, s: float) -> None:
    """Note what the end of a free motion does not show."""
    now = motion.progress[0]
    drifted = structure.errors.drift * s * EPS > _DRIFTED * now.tolerance
    if now.known_until == np.inf and (drifted or grows(structure.flow)):
        lose_on_the_way(structure, motion, scratch, s)
    if structure.flow.damped and _fades(structure.flow.alpha, s):
        note_what_decays(structure, motion, scratch, s)


@inline
def set_costs(structure: Structure, scratch: Scratch, columns: int) -> None:
    """Tell what parts of the work cost."""
    flow, m, piece = structure.flow, structure.walls.size, scratch.piece[0]
    pairs = flow.nu.size
    coordinate = 8 * pairs + 100 * flow.drives.size
    piece.expansion = m * (500 + 12 * pairs + coordinate) + 30 * pairs
    piece.motion = 500 + m * (100 + coordinate) + (60 + 20 * columns) * pairs
    piece.sample = 100 + (30 + 10 * columns) * pairs


@inner
def begin(structure: Structure, motion: Motion, sizes: Floats) -> None:
    """Start the deviations of a motion; sizes are those of its state, shape (2, pair)."""
    deviations, errors, progress = motion.deviations, structure.errors, motion.progress
    start_deviations(structure.flow, motion, errors)
    for c in range(deviations.shape[0]):
        signs = errors.signs[3 * (c + 1) % errors.signs.shape[0]]
        for j in range(sizes.shape[1]):
            deviations[c, Z1, j] += CONVERTED * sizes[Z1, j] * signs[Z1, j]
            deviations[c, Z2, j] += CONVERTED * sizes[Z2, j] * signs[Z2, j]
    progress[0].growth = max(progress[0].growth, estimated_error(deviations, errors, progress))
    progress[0].begun = 1


@inner
def _keep(motion: Motion, flow_rotations: int, passed: Passed, ends: bool) -> None:
    """Keep a state and its deviations for the sums over contacts: at the beginning, at the end."""
    z, largest, spread = motion.z, passed.largest, passed.spread
    if not ends:
        set_spread_of(motion.deviations, flow_rotations, spread)
        for j in range(z.shape[1]):
            passed.begin[Z1, j], passed.begin[Z2, j] = z[Z1, j], z[Z2, j]
            largest[Z1, j], largest[Z2, j] = abs(z[Z1, j]), abs(z[Z2, j])
        return
    set_spread_of(motion.deviations, flow_rotations, passed.after)
    for j in range(z.shape[1]):
        largest[Z1, j] = max(largest[Z1, j], abs(z[Z1, j]))
        largest[Z2, j] = max(largest[Z2, j], abs(z[Z2, j]))
        spread[Z1, j] = max(spread[Z1, j], passed.after[Z1, j])
        spread[Z2, j] = max(spread[Z2, j], passed.after[Z2, j])


@once
def free_motion(
    structure: Structure, motion: Motion, scratch: Scratch, taken: Taken, passed: Passed, at: Any
) -> int:
    """Follow the motion in one scene until a form is zero, or to its end; return why that paused.

    The piece holds what ended it.
    """
    now, piece, errors = motion.progress[0], scratch.piece[0], structure.errors
    if piece.stage != SAMPLING:
        if piece.stage != SEARCHING:
            if piece.work >= now.budget:
                return _PAUSE  # however short the free motions are
            for i in range(structure.walls.size):
                scratch.grazing[i] = NOT_GRAZING
            piece.work += piece.motion
            find_reach(structure, motion, scratch)
        s, ds, who, side = next_event(structure, motion, scratch)
        if who == PAUSED:
            piece.stage = SEARCHING
            return _PAUSE
        piece.time, piece.time_rest, piece.who, piece.side = s, ds, who, side
        if who == AT_END:
            note_size_from_rest(structure, motion, scratch, s)
    s, ds, who = piece.time, piece.time_rest, piece.who
    until = now.end if who == AT_END else (now.time + s) + (now.time_rest + ds)
    stop = _take_samples(structure, motion, scratch, taken, at.scene, until)
    if stop != GOES_ON:
        piece.stage = SAMPLING
        return stop
    if motion.deviations.shape[0] > 0:
        _note_on_the_way(structure, motion, scratch, s)
    begun, sums = now.time, at.lasting > 0
    if sums:
        _keep(motion, structure.flow.rotations, passed, False)
    moved = _move(structure, motion, scratch, s, ds)
    at.still = 0 if moved else at.still + 1
    if sums:
        _keep(motion, structure.flow.rotations, passed, True)
    at.span, at.summed, at.done = s + ds, 0, 0.0
    if motion.deviations.shape[0] > 0:
        error = estimated_error(motion.deviations, errors, motion.progress)
        now.growth = max(now.growth, error)
        lose(motion.progress, error, begun)
    piece.stage = SUMMING if sums else SWITCHING
    return GOES_ON
