"""What describes a motion with rigid limiters in kernels: the structure, the motion and scratch.

Everything is in units of the structure's own time (`time_history.basis`), in which powers of its
frequencies stay within the range of double precision.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.flow import Z1, Z2, Flow, Watched
from vibroimpact_solvers.kernels.jit import once, record
from vibroimpact_solvers.kernels.modal import MANY, SAMPLES, Modal
from vibroimpact_solvers.kernels.passages import DEPTH, LOW, ORDER

Rows = NDArray[np.void]

NOT_GRAZING: Final = 0
MAY_GRAZE: Final = 1
HAS_GRAZED: Final = 2
"""Whether a coordinate turns so near to a wall that its error decides whether it strikes: not as
far as is known, as it seems, and accounted for in the deviations on this approach."""
STRIKES: Final = 3
"""At the start: the coordinate is at its wall to the last bit and moves into it, however slowly."""

NEVER: Final = 0
BY_FORCE: Final = 1
MAYBE: Final = 2
"""Whether an impact opens contacts of others: not; where a contact force is negative after it; or
what it does to them is not known here."""

WALL: Final = record(
    [
        # Distances to the lower and the upper wall from the zero of the coordinate, infinite
        # where there is none.
        ("lower", "f8"),
        ("upper", "f8"),
        # Negative for a contact force: where it vanishes, a contact ends.
        ("restitution", "f8"),
        # Magnitude of the numbers that make the place of the wall: its error is relative to it.
        ("size", "f8"),
        # (1 + restitution) over the diagonal of the mobility, as the sum of two doubles.
        ("factor", "f8"),
        ("factor_rest", "f8"),
        # Change of the coordinate's acceleration by a unit impulse.
        ("acceleration", "f8"),
        # Whether an impact opens contacts of others: `NEVER`, `BY_FORCE` or `MAYBE`.
        ("opens_lower", "i8"),
        ("opens_upper", "i8"),
    ]
)
"""The walls of a watched coordinate."""

IMPACT: Final = record(
    [
        ("time", "f8"),
        ("time_rest", "f8"),
        ("velocity", "f8"),  # of the coordinate before the impact, with its sign
        ("impulse", "f8"),  # its magnitude
        ("acceleration", "f8"),  # of the coordinate before the impact, with its sign
        ("deviation", "f8"),  # estimated error relative to the motion, in units of 2^-52
        ("before", "f8"),  # length of that before the impact, in units of 2^-52
        ("constraint", "i8"),
        ("side", "i8"),
        ("law", "i8"),  # `impact_law.NEWTON`, `POISSON` or `MOREAU`
    ]
)
"""An impact; its time is the sum of two doubles."""

PROGRESS: Final = record(
    [
        # Given, and never changed by the loop.
        ("end", "f8"),
        ("longest", "f8"),  # of an expansion
        ("chatter", "f8"),  # remaining time of a chatter that is not followed impact by impact
        ("tolerance", "f8"),  # of the error of the state, relative to it
        ("scale", "f8"),  # times of the basis over those of x
        ("budget", "i8"),  # work after which the loop pauses, see `PIECE`
        # Kept from call to call.
        ("begun", "i8"),  # whether the deviations are set
        ("time", "f8"),
        ("time_rest", "f8"),
        ("largest", "f8"),  # length of the state so far
        ("unresolved", "f8"),  # error by bounces lower than rounding that do not end, relative
        ("penetration", "f8"),  # largest distance between a wall and the place of an impact at it
        ("growth", "f8"),  # largest of the estimated errors, in units of 2^-52, at least 1
        ("known_until", "f8"),  # time (of x) at which the tolerance is exceeded, or infinite
        ("first_row", "i8"),  # of the motion in the table of impacts
        ("rows", "i8"),  # in the table of impacts, those of motions before it included
        ("samples", "i8"),
        ("written", "i8"),  # samples in the history
        ("expansions", "i8"),
        ("grazings", "i8"),
        ("impacts", "i8"),  # of all
        ("hop", "f8"),  # duration of the hop that has ended, from a wall back to it; or 0
        ("released", "i8"),  # the watched coordinate that was just released, or -1
        # Returned: what ended the loop.
        ("coordinate", "i8"),
        ("side", "i8"),
        ("chatter_left", "f8"),  # remaining time of a chatter that ends at its wall
        ("chatter_late", "f8"),  # by which it is early or late; infinite where that is not known
    ]
)
"""How far a motion is; an array of a row for each motion."""

ANEW: Final = 0
BETWEEN: Final = 1
SEARCHING: Final = 2
SAMPLING: Final = 3
"""Where a motion goes on: from its state; and, after a pause, which nothing shows, between two free
motions, in the search for the next impact, or among the samples of a free motion."""

PIECE: Final = record(
    [
        # Work, in nanoseconds of a usual processor, which is counted and not measured.
        ("work", "i8"),  # of this call
        ("expansion", "i8"),
        ("motion", "i8"),  # a free motion, besides its expansions
        ("sample", "i8"),
        # What goes on after a pause.
        ("stage", "i8"),  # `ANEW`, `BETWEEN`, `SEARCHING` or `SAMPLING`
        ("bounced", "i8"),  # the coordinate that has just bounced alone
        ("still", "i8"),  # free motions without duration and without an impact, in a row
        ("time", "f8"),  # of the free motion, as far as it is known, as the sum of two doubles
        ("time_rest", "f8"),
        ("close", "i8"),  # the coordinate close to its wall, of the search
        ("who", "i8"),  # what ends the free motion, and at which wall
        ("side", "i8"),
        ("hops", "b1"),
        ("first", "i8"),  # of the samples of the free motion
    ]
)
"""A piece of the work on a motion, and how the next one goes on with the same bits."""

STRUCK: Final = record(
    [
        ("coordinate", "i8"),
        ("side", "f8"),
        ("restitution", "f8"),
        ("speed", "f8"),  # towards the wall, before the impact
        ("speed_rest", "f8"),  # what rounding took from it
        ("impulse", "f8"),  # away from the wall
        ("reflected", "f8"),  # that of the last pass of Moreau's law
        ("room", "f8"),  # distance to the wall
        ("hop_error", "f8"),  # of its place after a hop, in units of 2^-52; 0: there was none
        ("group", "i8"),  # the first one that impulses on it reach, directly or not
        ("law", "i8"),  # `impact_law.NEWTON`, `POISSON` or `MOREAU`
    ]
)
"""A coordinate at a wall."""


class Errors(NamedTuple):
    """Sizes of the errors that deviations stand for, in units of 2^-52."""

    signs: Floats  # (row, 2, pair): 1 or -1, at random
    drifts: Floats  # (column, pair): of the frequencies
    kicks: Floats  # (column, watched, 2, pair): of the changes of state by unit impulses
    coordinates: Floats  # (column, watched, 2, pair): of the watched coordinates
    velocities: Floats  # (column, watched, 2, pair): and of their velocities
    own: Floats  # (2, pair): 0 for the pairs of loads, 1 for the others
    measure: Floats  # (2, pair): of deviations, weights of the squares in their lengths
    doubts: Floats  # (pair,): of the loads, relative to them, by the responses to them
    # What constant loads and then each of the numbers of the pairs of loads make of the other
    # pairs, (1 + 2 load, 2, pair); none where there are no loads.
    carried: Floats
    loads: Integers  # (load,): the pairs of loads
    still: float  # of what constant loads make, relative to it
    drift: float  # the largest of the drifts


class Structure(NamedTuple):
    """A structure with rigid limiters, some constraints possibly in contact."""

    flow: Flow
    watched: Watched
    walls: Rows  # (watched,), of `WALL`
    mobility: Floats  # (watched, watched): W M^-1 W^T
    errors: Errors


class Motion(NamedTuple):
    """A motion: its present state, and where its impacts are written."""

    z: Floats  # (2, pair)
    deviations: Floats  # (column, 2, pair), in units of 2^-52; none: no errors are estimated
    progress: Rows  # (1,), of `PROGRESS`
    impacts: Rows  # (row,), of `IMPACT`
    output_times: Floats  # (sample,), ascending


class History(NamedTuple):
    """What is written at the output times; arrays that are not asked for are empty."""

    x: Floats  # (time, dof)
    v: Floats  # (time, dof)
    a: Floats  # (time, dof)
    energy: Floats  # (time,)
    error: Floats  # (time,): estimated lengths of the errors of states, in units of 2^-52


class Scratch(NamedTuple):
    """Arrays that functions overwrite."""

    z: Floats  # (2, pair): the state at which a coordinate is expanded
    rest: Floats  # (2, pair): what rounding took from the state of the motion
    rate: Floats  # (2, pair)
    sizes: Floats  # (2, pair): what a free motion is rounded relative to
    propagator: Floats  # (2, pair)
    lengths: Floats  # (pair,)
    spread: Floats  # (pair,): lengths of the deviations, the largest of all columns
    rounding: Floats  # (watched,): of the coordinates
    margin: Floats  # (watched,): their errors, and how fast these grow
    margin_rate: Floats  # (watched,)
    unknown: Floats  # (watched,): impulses that an unknown order of impacts gives or does not
    right: Floats  # (watched,): right-hand side of `equations`, and their solution
    solution: Floats  # (watched,)
    in_reach: Integers  # (watched,)
    grazing: Integers  # (watched,): `NOT_GRAZING`, `MAY_GRAZE` or `HAS_GRAZED`
    basic: Integers  # (watched,)
    derivatives: Floats  # (ORDER,)
    low: Floats  # (LOW,)
    roots: Floats  # (DEPTH + 5, DEPTH + 2), of `passages.first_passage`
    struck: Rows  # (watched,), of `STRUCK`
    equations: Floats  # (2 watched, watched + 1)
    block: Floats  # (row, mode): of `modal.displacements_of`
    sums: Floats  # (row output dof,)
    piece: Rows  # (1,), of `PIECE`


_ALPHA, _NU, _REST, _PUSH, _DOUBTS, _OWN, _MEASURE, _RATES = 0, 1, 2, 3, 4, 5, 7, 9
_COORDINATE, _VELOCITY, _KICK, _KICK_RATE, _FORMS = range(5)
_SIZE, _HIGH, _LOW_BOUND, _SIZES = range(4)
"""Rows of what `handed_over` returns, and how many there are."""
_Z, _REST_OF_Z, _RATE, _ROUNDED, _PROPAGATOR, _LENGTHS, _STATES = range(7)
_ROUNDING, _MARGIN, _MARGIN_RATE, _UNKNOWN, _RIGHT, _SOLUTION, _NUMBERS = range(7)
_IN_REACH, _GRAZING, _BASIC, _MARKS = range(4)
_DERIVATIVES, _LOW, _SEARCH = -2, -1, DEPTH + 7


def handed_over(structure: Structure) -> tuple[Any, ...]:
    """Return what `structure_of` gives names to: few arrays, as each takes time to hand over."""
    flow, watched, walls, mobility, errors = structure
    pairs = flow.nu.size
    parts = (
        np.array([
            flow.alpha, flow.nu, flow.rest, flow.push, errors.doubts, *errors.own, *errors.measure
        ]),
        errors.drifts, *watched, errors.kicks, errors.coordinates, errors.velocities,
        errors.carried, errors.signs,
    )  # fmt: skip
    table = np.concatenate([part.reshape(math.prod(part.shape[:-1]), pairs) for part in parts])
    kinds = flow.rotations, flow.hyperbolas_end, flow.damped, flow.growth
    sizes = errors.drifts.shape[0], errors.carried.shape[0], errors.still, errors.drift
    return table, kinds, sizes, errors.loads, flow.drives, walls, mobility


def between(given: tuple[Any, ...], walls: Rows) -> tuple[Any, ...]:
    """Return the same as `handed_over` of a structure with other walls."""
    *others, _, mobility = given
    return *others, walls, mobility


@once
def structure_of(given: tuple[Any, ...]) -> Structure:
    """Give names to what `handed_over` returns."""
    table, kinds, (columns, carrying, still, drift), loads, drives, walls, mobility = given
    w, pairs, first = walls.size, table.shape[1], _RATES + columns
    drifts = table[_RATES:first]
    last = first + _FORMS * 2 * w
    forms = table[first:last].reshape(_FORMS, w, 2, pairs)
    first, last = last, last + _SIZES * w
    sizes = table[first:last].reshape(_SIZES, w, pairs)
    first, last = last, last + columns * w * 2
    kicks = table[first:last].reshape(columns, w, 2, pairs)
    first, last = last, last + columns * w * 2
    coordinates = table[first:last].reshape(columns, w, 2, pairs)
    first, last = last, last + columns * w * 2
    velocities = table[first:last].reshape(columns, w, 2, pairs)
    first, last = last, last + 2 * carrying
    carried = table[first:last].reshape(carrying, 2, pairs)
    signs = table[last:].reshape((table.shape[0] - last) // 2, 2, pairs)
    flow = Flow(table[_ALPHA], table[_NU], table[_REST], table[_PUSH], drives, *kinds)
    watched = Watched(
        forms[_COORDINATE], forms[_VELOCITY], forms[_KICK], forms[_KICK_RATE], sizes[_SIZE],
        sizes[_HIGH], sizes[_LOW_BOUND],
    )  # fmt: skip
    doubts, own, measure = table[_DOUBTS], table[_OWN:_MEASURE], table[_MEASURE:_RATES]
    errors = Errors(
        signs, drifts, kicks, coordinates, velocities, own, measure, doubts, carried, loads,
        still, drift,
    )  # fmt: skip
    return Structure(flow, watched, walls, mobility, errors)


def workspace(pairs: int, watched: int, modes: int, dofs: int) -> tuple[Any, ...]:
    """Return what `scratch_of` gives names to: few arrays, as each takes time to hand over."""
    size = _STATES * 2 * pairs + _NUMBERS * watched + _SEARCH * (DEPTH + 2)
    size += 2 * watched * (watched + 1)
    size += (2 * SAMPLES if modes <= MANY else SAMPLES) * (modes + dofs)
    marks = np.zeros((_MARKS, watched), dtype=np.int64)
    return np.empty(size), marks, np.empty(watched, STRUCK), np.zeros(1, PIECE)


@once
def scratch_of(given: tuple[Any, ...], pairs: int, modes: int) -> Scratch:
    """Give names to parts of the arrays of `workspace`."""
    room, marks, struck, piece = given
    w, last = struck.size, _STATES * 2 * pairs
    states = room[:last].reshape(_STATES, 2, pairs)
    first, last = last, last + _NUMBERS * w
    numbers = room[first:last].reshape(_NUMBERS, w)
    first, last = last, last + _SEARCH * (DEPTH + 2)
    search = room[first:last].reshape(_SEARCH, DEPTH + 2)
    first, last = last, last + 2 * w * (w + 1)
    equations = room[first:last].reshape(2 * w, w + 1)
    rows = 2 * SAMPLES if modes <= MANY else SAMPLES
    first, last = last, last + rows * modes
    block = room[first:last].reshape(rows, modes)
    return Scratch(
        states[_Z], states[_REST_OF_Z], states[_RATE], states[_ROUNDED], states[_PROPAGATOR],
        states[_LENGTHS, Z1], states[_LENGTHS, Z2], numbers[_ROUNDING], numbers[_MARGIN],
        numbers[_MARGIN_RATE], numbers[_UNKNOWN], numbers[_RIGHT], numbers[_SOLUTION],
        marks[_IN_REACH], marks[_GRAZING], marks[_BASIC], search[_DERIVATIVES, :ORDER],
        search[_LOW, :LOW], search[:_DERIVATIVES], struck, equations, block, room[last:], piece,
    )  # fmt: skip


@once
def begin_piece(structure: Structure, columns: int, modal: Modal, piece: Rows) -> None:
    """Begin a piece of work, and tell what its parts cost."""
    flow, m, now = structure.flow, structure.walls.size, piece[0]
    pairs, drives = flow.nu.size, flow.drives.size
    coordinate = 8 * pairs + 100 * drives
    now.work = 0
    now.expansion = m * (500 + 12 * pairs + coordinate) + 30 * pairs
    now.motion = 500 + m * (100 + coordinate) + (60 + 20 * columns) * pairs
    now.sample = 100 + 30 * pairs + modal.shapes.size
