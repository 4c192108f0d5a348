"""From scene to scene: which state a stop goes to, how the motion carries over, what rounding does.

The state is continuous. Modes and loads of the scenes differ, so that states are converted. With a
dashpot the force jumps when the wall is reached, and deviations carry over by
``dv -= c (w dx) M^-1 w``: one that begins to push earlier has pushed by c times the way till then.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.contact_phases import SAMPLED
from vibroimpact_solvers.kernels.deviations import EPS
from vibroimpact_solvers.kernels.flow import Z1, Z2, magnitude, product
from vibroimpact_solvers.kernels.jit import inline, inner, never_inlined, once, record
from vibroimpact_solvers.kernels.next_impact import SIMULTANEOUS
from vibroimpact_solvers.kernels.rigid_state import Errors, Motion, Structure
from vibroimpact_solvers.kernels.stopped_scenes import (
    LOADED,
    OPEN,
    RELEASED,
    SAME_MODES,
    Scenes,
    side_of,
)

CONVERTED: Final = 2.0
"""Roundings of a state that goes on as another one."""
_FIRST = 0  # a pair, whose sign is as good as any
_STATE = 0  # the row of the state, before those of its deviations
_FOUND = 4.0  # roundings within which a form is zero
_CLEAR = 64.0  # roundings of a slope that has a sign
_APART = 7  # rows of signs between those of two deviations
_SLOWEST = 1e-300

COURSE: Final = record(
    [
        ("scene", "i8"),
        ("columns", "i8"),  # deviations
        ("wanted", "i8"),  # whether contacts are summed up
        ("last", "i8"),  # whether the motion ends where the progress does
        ("switches", "i8"),  # so far
        ("still", "i8"),  # switchings in a row at one instant
        ("room", "f8"),  # roundings that a form which was zero has been given
        # What goes on after the loop has returned.
        ("entered", "i8"),  # whether a switching is not concluded in its new scene
        ("converted", "i8"),  # whether that was between scenes of different modes
        ("a", "i8"),  # the stop that switches
        ("code", "i8"),  # its state before
        ("new", "i8"),  # and after
        ("lasting", "i8"),  # contact phases that last
        ("span", "f8"),  # of the free motion that contacts are summed up over
        ("summed", "i8"),  # the stop that is summed up, and how far
        ("done", "f8"),
        ("phases", "i8"),  # rows in the table of contact phases
    ]
)
"""How far a motion is from scene to scene."""


@inline
def next_state(
    prepared: Scenes, structure: Structure, place: int, a: int, forced: bool, z: Floats
) -> int:
    """Return the state of a stop after one of its forms became zero: its force, or its room."""
    stop, law = prepared.stops[place, a], prepared.laws[a]
    code = stop.state
    if code == OPEN:
        if law.lower == np.inf:
            return LOADED
        if law.upper == np.inf:
            return -LOADED
        y = product(structure.watched.coordinate[a], z) + stop.level
        return LOADED if abs(y - law.upper) <= abs(y + law.lower) else -LOADED
    side = side_of(code)
    if abs(code) == LOADED:
        # Without a dashpot the force is lost at the wall itself.
        return side * RELEASED if law.damping > 0.0 else OPEN
    return side * LOADED if forced else OPEN


@inline
def _rises(structure: Structure, who: int) -> float:
    """Return what constant loads on free bodies add to the rate of a watched form."""
    flow, form, total = structure.flow, structure.watched.coordinate[who], 0.0
    for j in range(flow.hyperbolas_end, flow.push.size):
        total += form[Z2, j] * flow.push[j]
    return total


@inline
def time_error(structure: Structure, who: int, z: Floats, spread: Floats, room: float) -> float:
    """Return the error of the time at which a watched form became zero, just now."""
    form = structure.watched.coordinate[who]
    slope = product(structure.watched.velocity[who], z) + _rises(structure, who)
    error = SAMPLED * EPS * magnitude(form, spread)
    error += (_FOUND + room) * EPS * (magnitude(form, z) + structure.walls[who].size)
    return float(error / max(abs(slope), _SLOWEST))


@inline
def _set_off(
    prepared: Scenes, structure: Structure, motion: Motion, given: tuple[int, int, float],
    off: Floats,
) -> None:  # fmt: skip
    """Fill in deviations of a coordinate whose dashpot begins to push; zero where none does."""
    a, code, room = given
    z, deviations, signs = motion.z, motion.deviations, structure.errors.signs
    for c in range(off.size):
        off[c] = 0.0
    if code == OPEN and prepared.laws[a].damping > 0.0:
        form = structure.watched.coordinate[a]
        place = (_FOUND + room) * (magnitude(form, z) + structure.walls[a].size)
        for c in range(off.size):
            off[c] = product(form, deviations[c]) + place * signs[c, Z1, _FIRST]


@inner
def _convert(numbers: Floats, first: int, before: Floats, after: Floats, sizes: Floats) -> None:
    """Fill in states (state, number) of another scene, and the magnitudes of the first.

    The first row is a state, the others are deviations. The matrix stands by columns: what each
    number before makes of all after.
    """
    never_inlined()
    n, m, count = before.shape[1], after.shape[1], before.shape[0]
    for k in range(count):
        for i in range(m):
            after[k, i] = 0.0
    for i in range(m):
        sizes[i] = 0.0
    for j in range(n):
        column = numbers[first + j * m : first + (j + 1) * m]
        value, size = before[_STATE, j], abs(before[_STATE, j])
        for i in range(m):
            after[_STATE, i] += column[i] * value
            sizes[i] += abs(column[i]) * size
        for k in range(1, count):
            value = before[k, j]
            if value != 0.0:
                for i in range(m):
                    after[k, i] += column[i] * value


@inner
def _mix(shares: Floats, z: Floats, fixed: Floats) -> None:
    """Add errors of complex modes: their shares of other pairs, in units of 2^-52."""
    never_inlined()
    pairs = z.shape[1]
    for j in range(pairs):
        total = 0.0
        for k in range(pairs):
            total += shares[j * pairs + k] * (abs(z[Z1, k]) + abs(z[Z2, k]))
        fixed[Z1, j] += total / EPS
        fixed[Z2, j] += total / EPS


@once
def carry_over(
    prepared: Scenes, structure: Structure, motion: Motion, at: Any, to: int, passage: int,
    Z: Floats, spare: Floats,
) -> None:  # fmt: skip
    """Let a motion go on in another scene; `add_deviations` concludes it there.

    Parameters
    ----------
    at : record
        Of `COURSE`.
    to, passage : int
        The scene, and how states carry over.
    Z : array
        The state and its deviations, flat, with room for those of any scene.
    spare : array
        Of `spare_size`.
    """
    scenes, numbers = prepared.scenes, prepared.numbers
    before, after = scenes[at.scene], scenes[to]
    n, m, count = 2 * before.pairs, 2 * after.pairs, 1 + at.columns
    off, size = spare[: at.columns], spare[count : count + m]
    fixed, missed = spare[count + m : count + 2 * m], spare[count + 2 * m : count + 2 * m + n]
    _set_off(prepared, structure, motion, (at.a, at.code, at.room), off)
    for i in range(m):
        fixed[i] = 0.0
    at.converted = passage != SAME_MODES
    if passage == SAME_MODES:
        for i in range(m):
            size[i] = 0.0
        return
    row = prepared.passages[passage]
    moved = spare[count + 2 * m + n : count + 2 * m + n + count * m].reshape(count, m)
    old = Z[: count * n].reshape(count, n)
    _convert(numbers, row.matrix, old, moved, size)
    if before.mixing >= 0 and at.columns > 0:
        for j in range(n):
            missed[j] = 0.0
        _mix(numbers[before.mixing :], motion.z, missed.reshape(2, before.pairs))
        for j in range(n):
            for i in range(m):
                fixed[i] += abs(numbers[row.matrix + j * m + i]) * missed[j]
    for i in range(m):
        moved[_STATE, i] += numbers[row.offset + i]
        size[i] = CONVERTED * (size[i] + numbers[row.terms + i])
        fixed[i] += CONVERTED * abs(moved[_STATE, i])
    for k in range(count):
        for i in range(m):
            Z[k * m + i] = moved[k, i]
    if after.mixing >= 0 and at.columns > 0:
        state = Z[:m].reshape(2, after.pairs)
        _mix(numbers[after.mixing :], state, fixed.reshape(2, after.pairs))


def spare_size(columns: int, pairs: int) -> int:
    """Return the room that `carry_over` needs for scenes of so many pairs at most."""
    return 2 * (1 + columns) + 2 * pairs * (4 + columns)


@inner
def lose_loads(errors: Errors, z: Floats, deviations: Floats) -> None:
    """Let the loads of deviations be unknown as a structure's responses to them are.

    Displacements and velocities stay what they are.
    """
    never_inlined()
    carried, signs = errors.carried, errors.signs
    for k in range(errors.loads.size):
        p = errors.loads[k]
        size = errors.doubts[p] * math.hypot(z[Z1, p], z[Z2, p])
        for c in range(deviations.shape[0]):
            dz, row = deviations[c], (c + 1) % signs.shape[0]
            first = size * signs[row, Z1, p] - dz[Z1, p]
            second = size * signs[row, Z2, p] - dz[Z2, p]
            for j in range(dz.shape[1]):
                dz[Z1, j] -= first * carried[1 + 2 * k, Z1, j] + second * carried[2 + 2 * k, Z1, j]
                dz[Z2, j] -= first * carried[1 + 2 * k, Z2, j] + second * carried[2 + 2 * k, Z2, j]
            dz[Z1, p] += first
            dz[Z2, p] += second


@inner
def add_deviations(
    c: float, kick: Floats, signs: Floats, z: Floats, deviations: Floats, switches: int,
    spare: Floats,
) -> None:  # fmt: skip
    """Add roundings of a switching to deviations, and what a jump of a force makes of them.

    Parameters
    ----------
    c : float
        Damping of the stop that has switched, by the basis' time.
    kick : array, shape (2, pair)
        Change of the state by a unit impulse at it.
    signs : array, shape (row, 2, pair)
    z, deviations : array
        In the new scene.
    switches : int
        So far.
    spare : array
        As `carry_over` left it.
    """
    never_inlined()
    columns, pairs = deviations.shape[0], z.shape[1]
    off, first = spare[:columns], 1 + columns
    size = spare[first : first + 2 * pairs].reshape(2, pairs)
    fixed = spare[first + 2 * pairs : first + 4 * pairs].reshape(2, pairs)
    for column in range(columns):
        dz = deviations[column]
        each = signs[(switches + _APART * (column + 1)) % signs.shape[0]]
        same, jump = signs[column + 1], c * off[column]
        for k in range(2):
            for j in range(pairs):
                more = size[k, j] * each[k, j] - jump * kick[k, j]
                dz[k, j] += more + math.copysign(fixed[k, j], z[k, j]) * same[k, j]


@once
def watch(prepared: Scenes, structure: Structure, motion: Motion, at: Any) -> None:
    """Watch the form that was zero: give it some room where it does not clearly move away.

    Otherwise the motion would not get on (`next_impact`).
    """
    place, z = at.a, motion.z
    if at.new != OPEN:
        place = prepared.stops[at.scene, at.a].force
    form, wall = structure.watched.velocity[place], structure.walls[place]
    rises = _rises(structure, place)
    slope = product(form, z) + rises
    if wall.lower < np.inf and wall.upper < np.inf:
        y = product(structure.watched.coordinate[place], z)
        slope = slope if abs(y - wall.upper) > abs(y + wall.lower) else -slope
    elif wall.upper < np.inf:
        slope = -slope
    leaves = slope > _CLEAR * EPS * (magnitude(form, z) + abs(rises))
    motion.progress[0].released = -1 if leaves else place
    at.room = 0.0 if leaves else 2.0 * SIMULTANEOUS
