"""Motion of a structure with stops of finite stiffness, from switching to switching.

While no stop changes its state the motion is exact (`kernels.flow`). The first zero of the watched
forms, coordinates at walls and forces of stops, is found with proof that none comes before
(`kernels.next_impact`), and the motion goes on in another scene (`kernels.stopped_scenes`). Sampled
deviations keep account of rounding (`kernels.deviations`, `kernels.scene_changes`), and contacts
are summed up on the way (`kernels.contact_phases`). One compiled loop does this. It returns to
Python for a scene that is not prepared, for room in its tables, and after a piece of work that is
counted, so that a stop signal is seen; the motion is the same to the last bit, whatever the pieces.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.contact_phases import (
    Passed,
    Phases,
    account,
    begin_all,
    end_all,
    set_spread_of,
    sum_up,
)
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
from vibroimpact_solvers.kernels.jit import bare, inline, inner, never_inlined, once
from vibroimpact_solvers.kernels.next_impact import AT_END, PAUSED, find_reach, next_event
from vibroimpact_solvers.kernels.rigid_state import (
    ANEW,
    NOT_GRAZING,
    SAMPLING,
    SEARCHING,
    Motion,
    Rows,
    Scratch,
    Structure,
)
from vibroimpact_solvers.kernels.scene_changes import (
    CONVERTED,
    add_deviations,
    carry_over,
    lose_loads,
    next_state,
    time_error,
    watch,
)
from vibroimpact_solvers.kernels.stopped_scenes import (
    LOADED,
    NOT_PREPARED,
    RELEASED,
    Scenes,
    scene_of,
    scratch_for,
)

SUMMING = SAMPLING + 1
SWITCHING = SAMPLING + 2
"""Where a motion goes on besides the stages of `rigid_state`: among sums over contacts; and at a
switching whose scene was not prepared, or for whose phase there was no room."""

_DRIFTED = 1.0 / 64.0  # of the tolerance, by errors of the frequencies in one free motion
_PROPAGATED = 4.0  # roundings of a sample
_SWITCHED = 200  # nanoseconds of a switching, beside its products
_MOST_STILL = 200  # switchings at one instant, more of which are taken for rounding
_MOST = 2_000_000  # switchings of a motion


class Stop(IntEnum):
    """Why the loop returned."""

    END = 0  # the end of the time was reached
    PAUSE = 1  # the work agreed on is done: another call goes on as if there had been none
    SAMPLES = 2  # as many samples are taken as there is room for
    SCENE = 3  # a stop switches to a state that is not prepared
    PHASES = 4  # the table of contact phases is full
    STILL = 5  # stops keep switching at one instant
    MANY = 6  # stops switch more often than any plan expects


_END, _PAUSE, _SAMPLES, _SCENE, _PHASES, _STILL, _MANY = range(7)
_FOUND = -1  # no reason to return


class Taken(NamedTuple):
    """Samples that are taken until Python fetches them; states of any scene."""

    states: Floats  # (row, 2 pair)
    spreads: Floats  # (row, 2 pair): the largest magnitudes of the deviations
    scenes: Integers  # (row,)


class Work(NamedTuple):
    """What the loop keeps from call to call, with room for any scene."""

    Z: Floats  # the state and its deviations, flat
    room: Floats  # of `rigid_state.workspace`, the marks flat
    marks: Integers
    struck: Rows
    piece: Rows
    spare: Floats  # (`spare_size`,)
    kept: Floats  # (8 pair,): four states; the magnitudes of the first state at the beginning


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
    return _FOUND


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
def _set_costs(structure: Structure, scratch: Scratch, columns: int) -> None:
    """Tell what parts of the work cost."""
    flow, m, piece = structure.flow, structure.walls.size, scratch.piece[0]
    pairs = flow.nu.size
    coordinate = 8 * pairs + 100 * flow.drives.size
    piece.expansion = m * (500 + 12 * pairs + coordinate) + 30 * pairs
    piece.motion = 500 + m * (100 + coordinate) + (60 + 20 * columns) * pairs
    piece.sample = 100 + (30 + 10 * columns) * pairs


@inner
def _begin(structure: Structure, motion: Motion, sizes: Floats) -> None:
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
def _free_motion(
    structure: Structure, motion: Motion, scratch: Scratch, taken: Taken, passed: Passed, at: Rows
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
    if stop != _FOUND:
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
    return _FOUND


@once
def _prepare_switch(
    prepared: Scenes, structure: Structure, motion: Motion, scratch: Scratch, at: Rows
) -> int:
    """Tell which stop switches to what; return why that has to wait."""
    stops, who = prepared.stops, scratch.piece[0].who
    count, forced = prepared.laws.size, who >= prepared.laws.size
    a = who
    for other in range(count if forced else 0):
        a = other if stops[at.scene, other].force == who else a
    at.a, at.code = a, stops[at.scene, a].state
    at.new = next_state(prepared, structure, at.scene, a, forced, motion.z)
    change = prepared.changes[at.scene, a, at.new + RELEASED]
    return _SCENE if change.scene == NOT_PREPARED else _FOUND


@once
def _account(
    prepared: Scenes, structure: Structure, motion: Motion, scratch: Scratch, phases: Phases,
    spread: Floats, at: Rows,
) -> None:  # fmt: skip
    """Enter a switching into the table of contacts."""
    now = motion.progress[0]
    set_spread_of(motion.deviations, structure.flow.rotations, spread)
    error = time_error(structure, scratch.piece[0].who, motion.z, spread, at.room)
    given = at.a, at.code, at.new, now.time + now.time_rest, error, at.phases
    account(prepared, structure, at.scene, phases, scratch, motion.z, spread, given)
    at.lasting -= abs(at.code) == LOADED
    at.lasting += abs(at.new) == LOADED
    at.phases += abs(at.new) == LOADED


@once
def _enter(prepared: Scenes, structure: Structure, motion: Motion, at: Rows, spare: Floats) -> None:
    """Conclude a switching in its new scene."""
    deviations, errors = motion.deviations, structure.errors
    at.entered = 0
    motion.progress[0].longest = prepared.scenes[at.scene].longest
    if deviations.shape[0] > 0:
        c, kick = prepared.laws[at.a].damping / prepared.scale, structure.watched.kick[at.a]
        add_deviations(c, kick, errors.signs, motion.z, deviations, at.switches, spare)
        if at.converted and errors.loads.size > 0:
            lose_loads(errors, motion.z, deviations)
    watch(prepared, structure, motion, at)


@inner
def _advance(
    prepared: Scenes, given: Motion, course: Rows, work: Work, taken: Taken, phases: Phases
) -> int:
    """Go on in a scene until a stop has switched; return why that was not reached.

    The structure, which is many arrays, has a name in here only: the compiler takes long for loops
    over it, and each call that it is given to stores them all.
    """
    never_inlined()
    Z, progress, at = work.Z, given.progress, course[0]
    now, piece = progress[0], work.piece[0]
    scene = prepared.scenes[at.scene]
    pairs, size = scene.pairs, 2 * scene.pairs
    structure = scene_of(prepared, at.scene)
    own = work.room, work.marks, work.struck, work.piece
    scratch = scratch_for(own, scene.watched, pairs, scene.modes)
    z = Z[:size].reshape(2, pairs)
    deviations = Z[size : (1 + at.columns) * size].reshape(at.columns, 2, pairs)
    motion = Motion(z, deviations, progress, given.impacts, given.output_times)
    kept = work.kept[: 4 * size].reshape(4, 2, pairs)
    passed = Passed(kept[0], kept[1], kept[2], kept[3])
    _set_costs(structure, scratch, at.columns)
    if not now.begun:
        _begin(structure, motion, passed.begin)
        if at.wanted:
            at.phases = at.lasting = begin_all(prepared, structure, at.scene, phases, z)
    if at.entered:
        _enter(prepared, structure, motion, at, work.spare)
    if piece.stage < SUMMING:
        stop = _free_motion(structure, motion, scratch, taken, passed, at)
        if stop != _FOUND:
            return stop
    if piece.stage == SUMMING:
        todo = at.summed, at.done, at.span, now.budget
        at.summed, at.done = sum_up(prepared, structure, at.scene, phases, scratch, passed, todo)
        if at.summed < prepared.laws.size:
            return _PAUSE
        piece.stage = SWITCHING
    if at.still > _MOST_STILL:
        return _STILL
    if piece.who < 0:
        piece.stage, at.switches = ANEW, at.switches + 1
        if piece.who == AT_END and at.last and at.wanted:
            set_spread_of(deviations, structure.flow.rotations, passed.after)
            end_all(prepared, structure, at.scene, phases, z, passed.after, now.end)
        return _END if piece.who == AT_END else _FOUND
    stop = _prepare_switch(prepared, structure, motion, scratch, at)
    if stop != _FOUND:
        return stop
    if at.wanted:
        if at.phases >= phases.rows.size:
            return _PHASES
        _account(prepared, structure, motion, scratch, phases, passed.after, at)
    change = prepared.changes[at.scene, at.a, at.new + RELEASED]
    to, passage = change.scene, change.passage
    carry_over(prepared, structure, motion, at, to, passage, Z, work.spare)
    piece.work += _SWITCHED + size * size * (2 + at.columns) // 4
    at.scene, at.entered, piece.stage, at.switches = to, 1, ANEW, at.switches + 1
    return _MANY if at.switches > _MOST else _FOUND


@bare
def follow(book: Any, motion: Any, work: Any, samples: Any, table: Any) -> int:
    """Follow a motion from its present state to its end, or to what Python has to do.

    NamedTuples arrive as plain tuples: numba looks at each field at every call.

    Parameters
    ----------
    book : tuple
        `Scenes`.
    motion : tuple
        `PROGRESS` and `COURSE` of a row each, a table of impacts, of no rows, and the output times.
    work : tuple
        `Work`.
    samples : tuple
        `Taken`.
    table : tuple
        `Phases`.

    Returns
    -------
    int
        A `Stop`; where it is not the end, another call goes on from there.
    """
    prepared, taken, phases, own = Scenes(*book), Taken(*samples), Phases(*table), Work(*work)
    progress, course, impacts, times = motion
    none = own.kept[:0]
    given = Motion(none.reshape(0, 0), none.reshape(0, 0, 0), progress, impacts, times)
    own.piece[0].work = 0
    stop = _FOUND
    while stop == _FOUND:
        stop = _advance(prepared, given, course, own, taken, phases)
    return stop
