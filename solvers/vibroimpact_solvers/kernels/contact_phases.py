"""Contact phases: how long a stop pushes, how much, how deep, and what that costs.

A phase lasts from the instant at which a stop begins to push until its force is zero. Over it the
indentation is followed by its Taylor polynomials, whose remainder is bounded: they give the
deepest indentation, the largest force, the impulse, and the integral of the squared rate, which
times c is the loss in the dashpot. What the spring still holds when the force is lost is given back
to nobody: the stop comes back without the structure, and that is part of the loss, until it is left
or loaded again.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.deviations import EPS
from vibroimpact_solvers.kernels.flow import (
    Z1,
    Z2,
    bound,
    derivatives,
    magnitude,
    near_derivatives,
    product,
    propagate_state,
    set_lengths,
    set_propagator,
)
from vibroimpact_solvers.kernels.jit import inline, inner, never_inlined, once, record
from vibroimpact_solvers.kernels.passages import ORDER, horizon, remainder
from vibroimpact_solvers.kernels.rigid_state import Rows, Scratch, Structure
from vibroimpact_solvers.kernels.stopped_scenes import (
    LOADED,
    RELEASED,
    Scenes,
    side_of,
    wall_of,
)

SAMPLED: Final = 6.0
"""Errors of forms over what the largest of five samples of each pair makes of them."""
_ROUNDED = 8.0  # roundings of sums over a contact
_LARGEST = 1e150  # deviation that counts, beyond the horizon
_FINE = 2.0**-54  # remainder of a polynomial of the indentation, relative to its largest value
_LONGEST = 1e300
_NODES = 8  # parts of a step at whose ends a maximum is looked for
_NEWTON = 8  # steps towards it
_STEP = 1000  # nanoseconds of a step, and
_STEP_OF_PAIR = 40

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
        ("speed", "f8"),  # at its start
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

    rows: Rows  # of `PHASE`; none: they are not asked for
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
    prepared: Scenes, phases: Phases, a: int, side: int, time: float, error: float,
    speed: float, speed_error: float, row: int,
) -> None:  # fmt: skip
    """Begin a phase at a time of the basis, at some speed, both known to an error."""
    contact, scale = phases.rows[row], prepared.scale
    contact.constraint, contact.side = a, side
    contact.start, contact.error_start = time / scale, error / scale
    contact.stop, contact.error_stop = np.nan, 0.0
    contact.impulse = contact.peak_force = contact.indentation = contact.energy_lost = 0.0
    contact.error_impulse = contact.error_indentation = contact.error_energy_lost = 0.0
    contact.speed = abs(speed) * scale
    contact.error_peak_force = prepared.laws[a].damping * speed_error * scale
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
        contact.error_energy_lost += more * contact.speed


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
        speed, bends = product(structure.watched.velocity[a], z), 0.0
        if prepared.laws[a].damping > 0.0:
            # As far as the time is unknown, the speed is, and the first force with it.
            near_derivatives(structure.flow, form, z, scratch.low)
            bends = abs(scratch.low[2])
        begin_phase(prepared, phases, a, side_of(new), time, error, speed, bends * error, row)


@inner
def begin_all(prepared: Scenes, structure: Structure, place: int, phases: Phases, z: Floats) -> int:
    """Begin phases of the stops that are loaded when a motion begins; return their number."""
    count = 0
    for a in range(phases.marks.shape[1]):
        code = prepared.stops[place, a].state
        if abs(code) == LOADED:
            speed = product(structure.watched.velocity[a], z)
            begin_phase(prepared, phases, a, side_of(code), 0.0, 0.0, speed, 0.0, count)
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


@inner
def _largest(c: Floats, order: int, r: float) -> float:
    """Return the largest value in [-r, r] of the polynomial ``sum c_n t^n`` of some degree."""
    never_inlined()
    first, last, bends, power = 0.0, 0.0, 0.0, 1.0
    for n in range(order, -1, -1):
        first, last = c[n] - first * r, c[n] + last * r
    for n in range(2, order + 1):
        power *= r
        bends += n * abs(c[n]) * power
    best = max(first, last)
    if bends < abs(c[1]):
        return best  # it rises or falls all the way
    at = -r if first > last else r
    for part in range(1, _NODES):
        t, value = r * (2 * part - _NODES) / _NODES, 0.0
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
        t = min(max(t - slope / bend, -r), r)
    return best


@inline
def _square(c: Floats, r: float) -> float:
    """Return the integral over [-r, r] of the square of the rate of ``sum c_n t^n``."""
    total = 0.0
    for m in range(ORDER - 1, 0, -1):
        inside = 0.0
        for n in range(ORDER - 1, 0, -1):
            odd = (m + n) % 2 == 1  # powers that cancel
            inside = inside * r + (0.0 if odd else n * c[n] / (m + n - 1.0))
        total = total * r + m * c[m] * inside
    return 2.0 * r * total


@inline
def _add_step(contact: Rows, c: Floats, law: tuple[float, float], r: float, scale: float) -> None:
    """Add a polynomial of the indentation over [-r, r] to a phase; damping by the basis' time."""
    stiffness, damping = law
    contact.indentation = max(contact.indentation, _largest(c, ORDER - 1, r))
    if damping == 0.0:
        contact.peak_force = max(contact.peak_force, stiffness * contact.indentation)
    total, square = 0.0, r * r
    for n in range(ORDER - 2, -1, -2):
        total = total * square + stiffness * c[n] / (n + 1.0)
    if damping > 0.0:
        rise = 0.0
        for n in range(ORDER - 1, 0, -2):
            rise = rise * square + c[n]
        total += damping * rise  # the change of the indentation, over 2 r
        contact.square += _square(c, r)
    contact.impulse += 2.0 * r * total / scale


class Passed(NamedTuple):
    """A free motion that phases are summed up over; arrays have shape (2, pair)."""

    begin: Floats  # the state at its beginning
    largest: Floats  # magnitudes at its beginning or its end, the larger ones
    spread: Floats  # the same of its deviations
    after: Floats  # those at its end


@once
def _follow_indentation(
    prepared: Scenes, structure: Structure, place: int, contact: Rows, scratch: Scratch,
    passed: Passed, given: tuple[float, float, float, int],
) -> float:  # fmt: skip
    """Follow an indentation from a time of the free motion on; return the time that is reached.

    Parameters
    ----------
    given : tuple
        That time, the duration of the motion, the magnitude of the indentation, and the work after
        which another call goes on.
    """
    t, span, size, budget = given
    flow, watched, a, side = structure.flow, structure.watched, contact.constraint, contact.side
    scale, piece = prepared.scale, scratch.piece[0]
    law = prepared.laws[a].stiffness, prepared.laws[a].damping * scale
    level = prepared.stops[place, a].indentation
    longest = min(prepared.scenes[place].longest, _LONGEST)
    d, c, f = scratch.derivatives, scratch.roots[Z1], scratch.roots[Z2]
    begun = t
    while t < span and (t == begun or piece.work < budget):
        piece.work += _STEP + _STEP_OF_PAIR * scratch.z.shape[1]
        set_propagator(flow, t, 0.0, scratch.propagator)
        propagate_state(flow, scratch.propagator, t, passed.begin, scratch.z)
        set_lengths(flow, scratch.z, scratch.lengths)
        ahead = min(span - t, longest)
        B = bound(flow, watched, a, scratch.z, scratch.lengths, True, ahead)
        h = min(2.0 * horizon(B, _FINE * size), ahead)
        h = h if t + h > t else span - t
        # Expanded in the middle, a polynomial lasts twice as long.
        r = 0.5 * h
        set_propagator(flow, t + r, 0.0, scratch.propagator)
        propagate_state(flow, scratch.propagator, t + r, passed.begin, scratch.z)
        derivatives(flow, watched.coordinate[a], scratch.z, d)
        power = 1.0
        for n in range(ORDER):
            c[n] = side * d[n] * power
            power /= n + 1.0
        c[0] += level
        _add_step(contact, c, law, r, scale)
        if law[1] > 0.0:
            for n in range(ORDER - 1):
                f[n] = law[0] * c[n] + law[1] * (n + 1.0) * c[n + 1]
            contact.peak_force = max(contact.peak_force, _largest(f, ORDER - 2, r))
        less = remainder(B, r)
        contact.left_out = max(contact.left_out, less)
        contact.rate_left_out = max(contact.rate_left_out, ORDER * less / r)
        t += h
    return float(t)


@inline
def _add_errors(
    prepared: Scenes, structure: Structure, place: int, contact: Rows, passed: Passed, span: float
) -> None:
    """Add what a phase loses in a free motion that is summed up, and the errors of its sums."""
    a, scale = contact.constraint, prepared.scale
    k, c, stop = prepared.laws[a].stiffness, prepared.laws[a].damping, prepared.stops[place, a]
    forms, slopes = structure.watched.coordinate, structure.watched.velocity
    contact.energy_lost += c * scale * contact.square
    off = error_of(forms[a], passed.spread) + _ROUNDED * EPS * magnitude(forms[a], passed.largest)
    fast = error_of(slopes[a], passed.spread)
    fast += _ROUNDED * EPS * magnitude(slopes[a], passed.largest)
    force = error_of(forms[stop.force], passed.spread)
    force += _ROUNDED * EPS * magnitude(forms[stop.force], passed.largest)
    off, force = off + _ROUNDED * EPS * stop.still, force + _ROUNDED * EPS * k * stop.still
    less, slower = contact.left_out, contact.rate_left_out
    contact.error_impulse += (force + k * less) * span / scale + 2.0 * c * less
    contact.error_impulse += _ROUNDED * EPS * abs(contact.impulse)
    fast += slower
    contact.error_indentation = max(contact.error_indentation, off + less)
    contact.error_peak_force = max(contact.error_peak_force, force + k * less + c * scale * slower)
    rates = 2.0 * fast * math.sqrt(max(contact.square * span, 0.0)) + fast * fast * span
    contact.error_energy_lost += c * scale * (rates + _ROUNDED * EPS * contact.square)


@inner
def sum_up(
    prepared: Scenes, structure: Structure, place: int, phases: Phases, scratch: Scratch,
    passed: Passed, given: tuple[int, float, float, int],
) -> tuple[int, float]:  # fmt: skip
    """Add a free motion to the phases that last.

    Parameters
    ----------
    given : tuple
        The stop and the time to begin at, the duration, and the work after which it pauses.

    Returns
    -------
    tuple
        The stop and the time to go on from; the number of stops where nothing is left.
    """
    first, done, span, budget = given
    for a in range(first, phases.marks.shape[1] if span > 0.0 else 0):
        row = phases.marks[LASTING, a]
        if row == NONE:
            continue
        contact = phases.rows[row]
        if done == 0.0:
            contact.square = contact.left_out = contact.rate_left_out = 0.0
        size = magnitude(structure.watched.coordinate[a], passed.largest)
        size += abs(prepared.stops[place, a].indentation)
        while size > 0.0 and done < span:
            if done > 0.0 and scratch.piece[0].work >= budget:
                return a, done
            done = _follow_indentation(
                prepared, structure, place, contact, scratch, passed, (done, span, size, budget)
            )
        _add_errors(prepared, structure, place, contact, passed, span)
        done = 0.0
    return phases.marks.shape[1], 0.0
