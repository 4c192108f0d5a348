"""Motion of a structure with stops of finite stiffness, from switching to switching.

While no stop changes its state the motion is that of one scene (`kernels.scene_motion`); then it
goes on in another one (`kernels.stopped_scenes`, `kernels.scene_changes`), and contacts are summed
up on the way (`kernels.contact_phases`). One compiled loop does this. It returns to Python for a
scene that is not prepared, for room in its tables, and after a piece of work that is counted, so
that a stop signal is seen; the motion is the same to the last bit, whatever the pieces.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.contact_phases import (
    Phases,
    account,
    begin_all,
    end_all,
    set_spread_of,
)
from vibroimpact_solvers.kernels.contact_sums import Passed, sum_up
from vibroimpact_solvers.kernels.jit import bare, inner, never_inlined, once
from vibroimpact_solvers.kernels.next_impact import AT_END
from vibroimpact_solvers.kernels.rigid_state import ANEW, Motion, Rows, Scratch, Structure
from vibroimpact_solvers.kernels.scene_changes import (
    add_deviations,
    carry_over,
    lose_loads,
    next_state,
    time_error,
    watch,
)
from vibroimpact_solvers.kernels.scene_motion import (
    GOES_ON,
    SUMMING,
    SWITCHING,
    Stop,
    Taken,
    begin,
    free_motion,
    set_costs,
)
from vibroimpact_solvers.kernels.stopped_scenes import (
    LOADED,
    NOT_PREPARED,
    RELEASED,
    Scenes,
    scene_of,
    scratch_for,
)

__all__ = ["Stop", "follow"]

_BEGIN, _LARGEST, _SPREAD, _AFTER = range(4)  # the states that `Work` keeps, as in `Passed`
_SWITCHED = 200  # nanoseconds of a switching, beside its products
_MOST_STILL = 200  # switchings at one instant, more of which are taken for rounding
_MOST = 2_000_000  # switchings of a motion

_END, _PAUSE, _SAMPLES, _SCENE, _PHASES, _STILL, _MANY = range(7)


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
def _prepare_switch(
    prepared: Scenes, structure: Structure, motion: Motion, scratch: Scratch, at: Any
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
    return _SCENE if change.scene == NOT_PREPARED else GOES_ON


@once
def _account(
    prepared: Scenes, structure: Structure, motion: Motion, scratch: Scratch, phases: Phases,
    spread: Floats, at: Any,
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
def _enter(prepared: Scenes, structure: Structure, motion: Motion, at: Any, spare: Floats) -> None:
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
    prepared: Scenes, given: Motion, course: Any, work: Work, taken: Taken, phases: Phases
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
    passed = Passed(kept[_BEGIN], kept[_LARGEST], kept[_SPREAD], kept[_AFTER])
    set_costs(structure, scratch, at.columns)
    if not now.begun:
        begin(structure, motion, passed.begin)
        if at.wanted:
            at.phases = at.lasting = begin_all(prepared, structure, at.scene, phases, z)
    if at.entered:
        _enter(prepared, structure, motion, at, work.spare)
    if piece.stage < SUMMING:
        stop = free_motion(structure, motion, scratch, taken, passed, at)
        if stop != GOES_ON:
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
        return _END if piece.who == AT_END else GOES_ON
    stop = _prepare_switch(prepared, structure, motion, scratch, at)
    if stop != GOES_ON:
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
    return _MANY if at.switches > _MOST else GOES_ON


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
    stop = GOES_ON
    while stop == GOES_ON:
        stop = _advance(prepared, given, course, own, taken, phases)
    return stop
