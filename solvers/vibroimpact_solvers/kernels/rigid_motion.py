"""Motion of a structure with rigid limiters, from impact to impact, in one compiled loop.

Between impacts the motion is exact; the next impact is found by certified expansions
(`kernels.next_impact`) and applied by Newton's law (`kernels.impact_law`), while sampled
deviations keep account of rounding (`kernels.deviations`). The history at the output times is
written as the motion goes on (`kernels.modal`). Many motions are followed in one call, one after
the other; the loop returns to Python where the equations change: contacts begin and end. It also
returns after a piece of work that is counted, so that a stop signal is seen; what it then goes on
with is kept, and the motion is the same to the last bit, whatever the pieces.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.deviations import (
    EPS,
    add_rounding,
    estimated_error,
    estimated_length,
    length,
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
    product,
    propagate,
    propagate_state,
    set_changes,
    set_propagator,
    set_rate,
    two_sum,
)
from vibroimpact_solvers.kernels.impact_law import BOUNCES, RESTS, graze, room_at, strike
from vibroimpact_solvers.kernels.jit import bare, inner, once
from vibroimpact_solvers.kernels.modal import (
    Modal,
    coordinates_of,
    displacements_of,
    energy_of,
    keep_coordinates,
    modal_of,
    state_of,
)
from vibroimpact_solvers.kernels.next_impact import (
    AT_END,
    PAUSED,
    ROUNDING,
    SIMULTANEOUS,
    UNDECIDED,
    find_reach,
    has_one_undamped_mode,
    next_crossing,
    next_event,
)
from vibroimpact_solvers.kernels.rigid_state import (
    ANEW,
    BETWEEN,
    MAY_GRAZE,
    NOT_GRAZING,
    SAMPLING,
    SEARCHING,
    STRIKES,
    History,
    Motion,
    Scratch,
    Structure,
    begin_piece,
    scratch_of,
    structure_of,
)

_NONE = -9  # no coordinate
_DRIFTED = 1.0 / 64.0  # of the tolerance, by errors of the frequencies in one free motion
_MOST_STILL = 10_000  # free motions in a row in which nothing happens


class Stop(IntEnum):
    """Why the loop returned."""

    REFUSED = -1  # the initial state is not finite, out of range, or outside of its limits
    END = 0  # the end of the time was reached
    TABLE = 1  # the table of impacts is full
    PAUSE = 2  # the work agreed on is done: another call goes on as if there had been none
    CONTACT = 3  # a constraint came to rest at its wall, after its impulse
    RELEASE = 4  # a contact force vanished
    IMPACT_IN_CONTACT = 5  # a wall is reached, and others may open by that: no impulse as yet
    STILL = 6  # the motion does not get on: the caller checks whether it has, since it began


_REFUSED, _END, _TABLE, _PAUSE, _CONTACT, _RELEASE, _IMPACT_IN_CONTACT, _STILL = range(-1, 7)


@once
def _take_samples(
    structure: Structure,
    motion: Motion,
    scratch: Scratch,
    modal: Modal,
    history: History,
    until: float,
) -> bool:
    """Take the samples of a free motion, and write the history of all whose block is full.

    Returns whether these are all.
    """
    flow, times, energy = structure.flow, motion.output_times, history.energy
    now, piece = motion.progress[0], scratch.piece[0]
    while now.samples < times.size and times[now.samples] <= until:
        if piece.work >= now.budget:
            return False
        piece.work += piece.sample
        since, lost = two_sum(times[now.samples], -now.time)
        lost -= now.time_rest
        set_propagator(flow, since, lost, scratch.propagator)
        propagate_state(flow, scratch.propagator, since + lost, motion.z, scratch.z)
        coordinates_of(modal, scratch.z, scratch.rate)
        if energy.size > 0:
            energy[now.samples] = energy_of(modal, scratch.rate)
        x, v, a = history.x.size > 0, history.v.size > 0, history.a.size > 0
        row = (int(x) + int(v) + int(a)) * (now.samples - now.written)
        keep_coordinates(scratch.rate, scratch.block, row, x, v)
        if a:
            # The rate of a state has the velocities as coordinates, and accelerations as rates.
            set_rate(flow, scratch.z, scratch.propagator)
            coordinates_of(modal, scratch.propagator, scratch.rate)
            keep_coordinates(scratch.rate, scratch.block, row + int(x) + int(v), False, True)
        now.samples += 1
        taken = now.samples - now.written
        if (3 * (taken + 1) if a else 2 * (taken + 1)) > scratch.block.shape[0]:
            _write_history(motion, scratch, modal, history)
    return True


@inner
def _write_history(motion: Motion, scratch: Scratch, modal: Modal, history: History) -> None:
    """Write displacements and their derivatives, of the samples taken since the last time."""
    now = motion.progress[0]
    x, v = history.x[now.written : now.samples], history.v[now.written : now.samples]
    a, count = history.a[now.written : now.samples], now.samples - now.written
    displacements_of(modal, scratch.block, scratch.sums, count, x, v, a)
    now.written = now.samples


@once
def _move(
    structure: Structure, motion: Motion, scratch: Scratch, s: float, ds: float, hops: bool
) -> None:
    """Advance the state, its deviations and the time to the end of a free motion.

    Of a coordinate that hops, its passage was found by one expansion, from its wall.
    """
    flow, z, deviations, moved = structure.flow, motion.z, motion.deviations, scratch.z
    now, signs = motion.progress[0], structure.errors.signs
    set_propagator(flow, s, ds, scratch.propagator)
    if hops:
        set_changes(flow, scratch.propagator, s + ds, z, scratch.sizes)
    advance(flow, scratch.propagator, s + ds, z, scratch.rest, moved)
    for c in range(deviations.shape[0]):
        propagate(flow, scratch.propagator, s + ds, deviations[c], moved)
        for j in range(z.shape[1]):
            deviations[c, Z1, j], deviations[c, Z2, j] = moved[Z1, j], moved[Z2, j]
    for i in range(structure.walls.size):
        scratch.margin[i] += s * scratch.margin_rate[i]
    now.time, lost = two_sum(now.time, s)
    now.time_rest += lost + ds
    now.released = -1
    if deviations.shape[0] > 0:
        if not hops:
            set_sizes(flow, s, z, scratch.sizes)
        row = random_row(now.impacts + 1, signs.shape[0])
        add_rounding(flow, motion, structure.errors, row, s, scratch.sizes)


@inner
def _note_errors(
    structure: Structure, motion: Motion, history: History, first: int, largest: float
) -> None:
    """Write the errors of the samples of a free motion, from one on: all the largest."""
    deviations, now = motion.deviations, motion.progress[0]
    largest = max(largest, estimated_length(deviations, structure.errors, motion.progress))
    for k in range(first, now.samples):
        history.error[k] = largest


@once
def _free_motion(
    structure: Structure, motion: Motion, scratch: Scratch, circular: bool
) -> tuple[float, float, int, int, bool]:
    """Return what `next_event` does, and whether a coordinate hops, or go on with its search."""
    walls, now, piece = structure.walls, motion.progress[0], scratch.piece[0]
    s, ds, who, side = 0.0, 0.0, UNDECIDED, 0
    begins = piece.stage != SEARCHING
    if begins:
        find_reach(structure, motion, scratch)
        if circular:
            s, ds, who, side = next_crossing(structure, motion, scratch)
    expanded, hops = now.expansions, False
    if who == UNDECIDED:
        s, ds, who, side = next_event(structure, motion, scratch)
        hops = begins and who >= 0 and who == piece.bounced and side == now.side
        hops = hops and walls[who].restitution < 1.0 and now.expansions == expanded + 1
        if hops:
            y = product(structure.watched.coordinate[who], motion.z)
            hops = room_at(walls, who, side, y) <= scratch.rounding[who]
    return s, ds, who, side, hops


@once
def _note_on_the_way(structure: Structure, motion: Motion, scratch: Scratch, s: float) -> float:
    """Note what the end of a free motion does not show; return the length of the largest error."""
    now, error = motion.progress[0], 0.0
    if motion.deviations.shape[0] > 0 and now.known_until == np.inf:
        drifted = structure.errors.drift * s * EPS > _DRIFTED * now.tolerance
        if drifted or grows(structure.flow):
            lose_on_the_way(structure, motion, scratch, s)
    if motion.deviations.shape[0] > 0 and structure.flow.damped:
        error = note_what_decays(structure, motion, scratch, s)
    return error


@once
def _advance(
    structure: Structure, motion: Motion, scratch: Scratch, modal: Modal, history: History
) -> int:
    """Advance a motion to its end, or to an event that the caller has to handle (`Stop`).

    A pause leaves in the piece where it goes on.
    """
    walls, now, piece = structure.walls, motion.progress[0], scratch.piece[0]
    circular = has_one_undamped_mode(structure)
    while True:
        s, ds, who, side, hops = piece.time, piece.time_rest, piece.who, piece.side, piece.hops
        if piece.stage != SAMPLING:
            if piece.stage != SEARCHING:
                if now.rows + walls.size > motion.impacts.size:
                    return _TABLE
                if piece.still >= _MOST_STILL:
                    return _STILL
                if piece.work >= now.budget:
                    piece.stage = BETWEEN
                    return _PAUSE  # however short the free motions are
                piece.work += piece.motion
            s, ds, who, side, hops = _free_motion(structure, motion, scratch, circular)
            if who == PAUSED:
                piece.stage = SEARCHING
                return _PAUSE
            piece.first = now.samples
            if who == AT_END:
                note_size_from_rest(structure, motion, scratch, s)
        until = np.inf if who == AT_END else (now.time + s) + (now.time_rest + ds)
        error = 0.0
        if not _take_samples(structure, motion, scratch, modal, history, until):
            piece.stage, piece.time, piece.time_rest = SAMPLING, s, ds
            piece.who, piece.side, piece.hops = who, side, hops
            return _PAUSE
        piece.stage, first = BETWEEN, piece.first
        sampled = history.error.size > 0 and now.samples > first
        if sampled:
            error = estimated_length(motion.deviations, structure.errors, motion.progress)
        error = max(error, _note_on_the_way(structure, motion, scratch, s))
        begun, begun_rest = now.time, now.time_rest
        _move(structure, motion, scratch, s, ds, hops)
        piece.bounced = _NONE
        stands = now.time == begun and now.time_rest == begun_rest
        piece.still = piece.still + 1 if stands else 0
        if sampled:
            _note_errors(structure, motion, history, first, error)
        if who < 0:
            if motion.deviations.shape[0] > 0:
                error = estimated_error(motion.deviations, structure.errors, motion.progress)
                lose(motion.progress, error, begun)
            return _END if who == AT_END else _STILL
        if scratch.grazing[who] == MAY_GRAZE:
            graze(structure, motion, scratch, who, side)
            continue
        now.coordinate, now.side, now.hop = who, side, s if hops else 0.0
        if walls[who].restitution < 0.0:
            return _RELEASE
        rows = now.rows
        outcome = strike(structure, motion, scratch)
        if outcome != BOUNCES:
            return _CONTACT if outcome == RESTS else _IMPACT_IN_CONTACT
        if now.rows > rows:
            piece.still = 0
        alone = now.rows == rows + 1 and motion.deviations.shape[0] > 0
        piece.bounced = who if alone else _NONE  # a hop matters to the deviations only


@once
def _finish(structure: Structure, motion: Motion, modal: Modal, first: int, ended: bool) -> None:
    """Give impacts from a row on in the units of x, and find the largest of the errors."""
    now = motion.progress[0]
    for place in range(first, now.rows):
        row = motion.impacts[place]
        row.time = (row.time + row.time_rest) / modal.scale
        row.velocity *= modal.scale
        row.impulse *= modal.scale
        row.acceleration *= modal.scale * modal.scale
        if not row.deviation <= now.growth:
            now.growth = row.deviation
    if ended:
        error = estimated_error(motion.deviations, structure.errors, motion.progress)
        now.growth = max(now.growth, error)


@inner
def _mark_struck(
    structure: Structure, modal: Modal, x: Floats, v: Floats, z: Floats, scratch: Scratch
) -> None:
    """Mark the coordinates that start at a wall, to the last bit, and move into it."""
    largest = length(z, structure.errors.own)
    for i in range(structure.walls.size):
        y, velocity = 0.0, 0.0
        for k in range(x.size):
            y += modal.W[i, k] * x[k]
            velocity += modal.W[i, k] * v[k]
        towards = velocity if y == modal.upper[i] else (-velocity if -y == modal.lower[i] else 0.0)
        slight = ROUNDING * largest * math.sqrt(structure.mobility[i, i])
        if towards > SIMULTANEOUS * slight * modal.scale:
            scratch.grazing[i] = STRIKES


@bare
def follow(
    structure: Any, motion: Any, work: Any, modal: Any, x: Floats, v: Floats, history: Any
) -> tuple[int, int]:
    """Follow motions from displacements and velocities, or one from its present state, to the end.

    NamedTuples arrive as plain tuples of few arrays: numba looks at each at every call.

    Parameters
    ----------
    structure : tuple
        `Structure`, as `structure_of` takes it.
    motion : tuple
        `Motion`; what it refers to is changed. The progress has a row for each motion; rows of
        impacts follow one another, in the units of x.
    work : tuple
        Of `rigid_state.workspace`.
    modal : tuple
        `Modal`, as `modal_of` takes it.
    x, v : array, shape (motion, dof)
        Initial displacements and velocities, without contacts, of motions whose progress is new;
        none: one motion goes on from its state.
    history : tuple
        `History`, with arrays of one more axis, in front, for the motions.

    Returns
    -------
    stop : int
        A `Stop`; where it is not the end, another call goes on from there. After a pause it needs
        the same work arrays, and the motion's row of the progress first.
    place : int
        Which motion is the last that was followed: all before reached their ends.
    """
    z, deviations, progress, impacts, output_times = motion
    named, conversion = structure_of(structure), modal_of(modal)
    scratch = scratch_of(work, z.shape[1], conversion.place.size)
    xs, vs, accelerations, energies, lengths = history
    place, rows, piece = 0, progress[0].rows, scratch.piece[0]
    begin_piece(named, deviations.shape[0], conversion, scratch.piece)
    while True:
        current = Motion(z, deviations, progress[place : place + 1], impacts, output_times)
        written = History(
            xs[place], vs[place], accelerations[place], energies[place], lengths[place]
        )
        now = progress[place]
        now.rows, begins = rows, piece.stage == ANEW
        if begins:
            piece.bounced, piece.still = _NONE, 0
            for j in range(z.shape[1]):
                scratch.rest[Z1, j] = scratch.rest[Z2, j] = 0.0
        if begins and x.shape[0] > 0:
            now.first_row = rows
            piece.work += x.shape[1] * conversion.place.size
            if not state_of(conversion, x[place], v[place], z, scratch.rate):
                return _REFUSED, place
        if not now.begun:
            start_deviations(named.flow, current, named.errors)
            now.growth = max(
                now.growth, estimated_error(deviations, named.errors, current.progress)
            )
            now.begun = 1
            for i in range(named.walls.size):
                scratch.grazing[i] = NOT_GRAZING
            if x.shape[0] > 0:
                _mark_struck(named, conversion, x[place], v[place], z, scratch)
        stop = _advance(named, current, scratch, conversion, written)
        if stop != _PAUSE:
            # Blocks of samples are the same with and without pauses: so are roundings of products.
            _write_history(current, scratch, conversion, written)
            piece.stage = ANEW
        _finish(named, current, conversion, rows, stop == _END)
        rows = now.rows
        if stop != _END or place + 1 >= x.shape[0] or piece.work >= now.budget:
            return stop, place
        place += 1
