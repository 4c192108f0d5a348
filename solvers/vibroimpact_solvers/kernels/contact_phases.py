"""Contact phases: how long a stop pushes, how much, how deep, and what that costs.

A phase lasts from the instant at which a stop begins to push until its force is zero. What it sums
up on the way is in `kernels.contact_sums`. What the spring still holds when the force is lost is
given back to nobody: the stop comes back without the structure, and that is part of the loss, until
it is left or loaded again.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.deviations import EPS
from vibroimpact_solvers.kernels.flow import (
    Z1,
    Z2,
    magnitude,
    near_derivatives,
    product,
)
from vibroimpact_solvers.kernels.jit import inline, inner, record
from vibroimpact_solvers.kernels.rigid_state import Scratch, Structure
from vibroimpact_solvers.kernels.stopped_scenes import (
    LOADED,
    RELEASED,
    Scenes,
    side_of,
    wall_of,
)

SAMPLED: Final = 6.0
"""Errors of forms over what the largest of five samples of each pair makes of them."""
_ROUNDED = 8.0  # roundings of a velocity
_LARGEST = 1e150  # deviation that counts, beyond the horizon

PHASE: Final = record(
    [
        ("start", "f8"),
        ("stop", "f8"),
        ("impulse", "f8"),
        ("peak_force", "f8"),
        ("indentation", "f8"),
        ("energy_lost", "f8"),
        ("error_start", "f8"),
        ("error_stop", "f8"),
        ("error_impulse", "f8"),
        ("error_peak_force", "f8"),
        ("error_indentation", "f8"),
        ("error_energy_lost", "f8"),
        ("constraint", "i8"),
        ("side", "i8"),
        ("velocity", "f8"),  # of the coordinate at its start
        ("error_velocity", "f8"),
        # While it is summed up over a free motion: the integral of the squared rate, and what
        # polynomials leave out of the indentation and of its rate.
        ("square", "f8"),
        ("left_out", "f8"),
        ("rate_left_out", "f8"),
    ]
)
"""A contact phase, in the units of x; errors are absolute."""

NONE: Final = -1
LASTING: Final = 0
LAST: Final = 1
LEFT: Final = 2
MARKS: Final = 3
"""Rows of marks: the phase of each stop that lasts, its last one, and the one whose spring came
back without the structure; `NONE` where there is none."""


class Phases(NamedTuple):
    """The table of contact phases."""

    rows: Any  # of `PHASE`; none: they are not asked for
    marks: Integers  # (MARKS, stop)


@inline
def set_spread_of(deviations: Floats, rotations: int, spread: Floats) -> None:
    """Fill in the largest magnitudes of deviations, shape (2, pair).

    Of a pair that turns, both numbers are as large as their length.
    """
    for j in range(spread.shape[1]):
        spread[Z1, j] = spread[Z2, j] = 0.0
    for c in range(deviations.shape[0]):
        for j in range(rotations):
            a, b = deviations[c, Z1, j], deviations[c, Z2, j]
            spread[Z1, j] = max(spread[Z1, j], a * a + b * b)
        for j in range(rotations, spread.shape[1]):
            spread[Z1, j] = max(spread[Z1, j], abs(deviations[c, Z1, j]))
            spread[Z2, j] = max(spread[Z2, j], abs(deviations[c, Z2, j]))
    for j in range(rotations):
        spread[Z1, j] = spread[Z2, j] = min(math.sqrt(spread[Z1, j]), _LARGEST)
    for j in range(rotations, spread.shape[1]):
        spread[Z1, j] = min(spread[Z1, j], _LARGEST)
        spread[Z2, j] = min(spread[Z2, j], _LARGEST)


@inline
def error_of(form: Floats, spread: Floats) -> float:
    """Return the error of a linear form whose state has deviations of these sizes."""
    return SAMPLED * EPS * magnitude(form, spread)


@inline
def indentation_of(
    prepared: Scenes, structure: Structure, place: int, a: int, side: int, z: Floats
) -> float:
    """Return how far a coordinate is beyond one of its walls."""
    stop = prepared.stops[place, a]
    moved = side * product(structure.watched.coordinate[a], z)
    if abs(stop.state) == LOADED:
        return float(moved + stop.indentation)
    return float(moved + side * stop.level - wall_of(prepared.laws, a, side))


@inline
def begin_phase(
    prepared: Scenes, phases: Phases, a: int, side: int, time: tuple[float, float],
    velocity: tuple[float, float], late: float, row: int,
) -> None:  # fmt: skip
    """Begin a phase at a time of the basis, with a velocity; each is given with its error.

    late is the part of the velocity's error that comes from that of the time.
    """
    contact, scale = phases.rows[row], prepared.scale
    start, error_start = time
    speed, error_speed = velocity
    contact.constraint, contact.side = a, side
    contact.start, contact.error_start = start / scale, error_start / scale
    contact.stop, contact.error_stop = np.nan, 0.0
    contact.impulse = contact.peak_force = contact.indentation = contact.energy_lost = 0.0
    contact.error_impulse = contact.error_indentation = contact.error_energy_lost = 0.0
    contact.velocity, contact.error_velocity = speed * scale, error_speed * scale
    contact.error_peak_force = prepared.laws[a].damping * late * scale
    phases.marks[LASTING, a] = row


@inline
def end_phase(prepared: Scenes, phases: Phases, a: int, time: float, error: float) -> None:
    """End the phase of a stop, if there is one, at a time of the basis, known to an error."""
    row = phases.marks[LASTING, a]
    if row == NONE:
        return
    contact = phases.rows[row]
    phases.marks[LASTING, a], phases.marks[LAST, a] = NONE, row
    contact.stop, contact.error_stop = time / prepared.scale, error / prepared.scale
    if prepared.laws[a].damping > 0.0:
        # A dashpot pushes from the first instant on, a little earlier or later.
        more = contact.error_start * contact.peak_force
        contact.error_impulse += more
        contact.error_energy_lost += more * abs(contact.velocity)


@inline
def count_spring(
    prepared: Scenes, phases: Phases, a: int, indentation: float, error: float, lost: bool
) -> None:
    """Count what the spring of a stop holds as lost, or take that back.

    It is lost where its force is, and not where it is left or loaded again.
    """
    row = phases.marks[LAST if lost else LEFT, a]
    if row == NONE:
        return
    contact, k, sign = phases.rows[row], prepared.laws[a].stiffness, 1.0 if lost else -1.0
    contact.energy_lost += sign * 0.5 * k * indentation * indentation
    contact.error_energy_lost += k * (abs(indentation) + 0.5 * error) * error
    phases.marks[LEFT, a] = row if lost else NONE


@inner
def account(
    prepared: Scenes, structure: Structure, place: int, phases: Phases, scratch: Scratch,
    z: Floats, spread: Floats, given: tuple[int, int, int, float, float, int],
) -> None:  # fmt: skip
    """Enter a switching into the table.

    Parameters
    ----------
    given : tuple
        The stop, its state before and after, the time, its error, and the row of a new phase.
    """
    a, code, new, time, error, row = given
    form = structure.watched.coordinate[a]
    if abs(code) == RELEASED:
        beyond = indentation_of(prepared, structure, place, a, side_of(code), z)
        count_spring(prepared, phases, a, beyond, error_of(form, spread), False)
    if abs(code) == LOADED:
        end_phase(prepared, phases, a, time, error)
    if abs(new) == RELEASED:
        beyond = indentation_of(prepared, structure, place, a, side_of(new), z)
        count_spring(prepared, phases, a, beyond, error_of(form, spread), True)
    if abs(new) == LOADED:
        # As far as the time is unknown, the velocity is, and the first force of a dashpot with it.
        near_derivatives(structure.flow, form, z, scratch.low)
        rate, late = structure.watched.velocity[a], abs(scratch.low[2]) * error
        off = late + error_of(rate, spread) + _ROUNDED * EPS * magnitude(rate, z)
        begin_phase(
            prepared, phases, a, side_of(new), (time, error), (product(rate, z), off), late, row
        )


@inner
def begin_all(prepared: Scenes, structure: Structure, place: int, phases: Phases, z: Floats) -> int:
    """Begin phases of the stops that are loaded when a motion begins; return their number."""
    count = 0
    for a in range(phases.marks.shape[1]):
        code = prepared.stops[place, a].state
        if abs(code) == LOADED:
            rate = structure.watched.velocity[a]
            velocity = product(rate, z), _ROUNDED * EPS * magnitude(rate, z)
            begin_phase(prepared, phases, a, side_of(code), (0.0, 0.0), velocity, 0.0, count)
            count += 1
    return count


@inner
def end_all(
    prepared: Scenes, structure: Structure, place: int, phases: Phases, z: Floats, spread: Floats,
    time: float,
) -> None:  # fmt: skip
    """End what lasts at the end of a motion."""
    for a in range(phases.marks.shape[1]):
        code = prepared.stops[place, a].state
        if abs(code) == LOADED:
            end_phase(prepared, phases, a, time, 0.0)
        elif abs(code) == RELEASED:
            beyond = indentation_of(prepared, structure, place, a, side_of(code), z)
            error = error_of(structure.watched.coordinate[a], spread)
            count_spring(prepared, phases, a, beyond, error, False)
