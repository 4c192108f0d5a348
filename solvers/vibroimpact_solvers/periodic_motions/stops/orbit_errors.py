"""Errors of motions with any sequence of contacts, and their multipliers.

Roundings and errors of modes count as independent of one another, at each switching and in each
part. What they make of the times of switchings is what Newton's method makes of a residue; of the
states it is what one period makes of them, again and again, and a later switching.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.stops import prescribed
from vibroimpact_solvers.periodic_motions.stops.orbits import Kind, Orbit
from vibroimpact_solvers.periodic_motions.stops.phases import Side
from vibroimpact_solvers.periodic_motions.stops.solutions import pair_squares, squares_after

_SAMPLED: Final = 4.0  # errors over the root of the sum of squares of independent ones
_ROUNDED: Final = 4.0  # roundings of a product with a matrix


@dataclass(frozen=True, eq=False, slots=True)
class Errors:
    """Errors of a motion.

    Parameters
    ----------
    times : array, shape (switching,)
    states : list of array, shape (pair,)
        Of both numbers of pairs, along each part.
    """

    times: Floats
    states: list[Floats]


def errors(one: Orbit) -> Errors:
    """Return the errors of a motion's times and states."""
    count = len(one.switchings)
    if not count:
        return Errors(one.times, [np.zeros(one.side(0).size)])
    entered = [_entered(one, k) for k in range(count)]
    flowed = [_flowed(one, k, np.zeros_like(one.states[k])) for k in range(count)]
    seen = one.seen()
    try:
        back = np.linalg.inv(one.jacobian(seen))
    except np.linalg.LinAlgError:
        unknown = [np.full(one.side(k).size, np.inf) for k in range(count)]
        return Errors(np.full(count, np.inf), unknown)
    squares = back**2 @ _read(one)
    for k in range(count):
        rows = seen[k]
        squares += (back @ rows) ** 2 @ entered[k]
        # What a part before a switching is off by is seen by it at once.
        early = rows @ one.through[k]
        early[k] += one.form(k)
        squares += (back @ early) ** 2 @ flowed[k - 1]
    return Errors(_SAMPLED * np.sqrt(squares), _states(one, entered, squares))


def _entered(one: Orbit, k: int) -> Floats:
    """Return squared errors of a state at the beginning of a part, by carrying over."""
    cell, before, after = one.cell, one.before[k], one.scenes[k]
    matrix, offset = cell.scenes.passage(before, after)
    sides = cell.scenes.side(before), cell.scenes.side(after)
    shapes = sides[0].shape_error + sides[1].shape_error + _ROUNDED * EPS
    size = np.abs(cell.steady(before)).sum(axis=0), np.abs(cell.steady(after)).sum(axis=0)
    sums = (one.ends[k - 1] ** 2 + size[0] ** 2) @ (matrix**2).T + offset**2 + size[1] ** 2
    return pair_squares(sides[1], shapes**2 * sums)


def _flowed(one: Orbit, k: int, squares: Floats) -> Floats:
    """Return squared errors at the end of a part, from those at its beginning."""
    given = one.lengths[k : k + 1], one.states[k][np.newaxis], squares[np.newaxis]
    return np.asarray(squares_after(one.side(k), *given)[0])


def _read(one: Orbit) -> Floats:
    """Return squared errors of what is zero at switchings, of given states."""
    squares = np.zeros(len(one.switchings))
    for k, switching in enumerate(one.switchings):
        cell, before = one.cell, one.before[k]
        side, form = cell.scenes.watching(before, *switching.stop), one.form(k)
        shapes = side.shape_error + _ROUNDED * EPS
        moved = np.abs(form) @ (np.abs(one.ends[k - 1]) + np.abs(cell.steady(before)).sum(axis=0))
        level = side.force_size
        if switching.kind is Kind.WALL:
            wall = cell.scenes.stop(*switching.stop).wall
            level = abs(float(side.level[switching.constraint])) + abs(wall)
        late = EPS * abs(one.times[k]) * abs(one.rates[k])
        squares[k] = (shapes * moved) ** 2 + (_ROUNDED * EPS * level) ** 2 + late**2
    return squares


def _states(one: Orbit, entered: list[Floats], times: Floats) -> list[Floats]:
    """Return errors of states along parts, from squares of errors of times."""
    count = len(one.switchings)
    # What one period makes of no error at its beginning.
    squares = entered[0]
    for k in range(count):
        squares = _flowed(one, k, squares)
        place = (k + 1) % count
        squares = squares @ (one.through[place] ** 2).T + entered[place]
    squares = pair_squares(one.side(0), squares @ (one.closing**2).T)
    kicks = _kicked(one)
    states = []
    for k in range(count):
        late = (kicks[k] ** 2 * times[np.newaxis]).sum(axis=1)
        both = pair_squares(one.side(k), squares + late)
        states.append(np.asarray(_SAMPLED * np.sqrt(both[: one.side(k).size])))
        squares = _flowed(one, k, squares)
        place = (k + 1) % count
        squares = pair_squares(
            one.side(place), squares @ (one.through[place] ** 2).T + entered[place]
        )
    return states


def _kicked(one: Orbit) -> list[Floats]:
    """Return changes of states at the beginnings of parts by all times, (2 pair, switching)."""
    count, sources = len(one.switchings), one.sources()
    columns = np.zeros((sources[0].size, count))
    columns[:, 0] = sources[0]
    for k in range(count):
        columns = one.flowed(k, columns)
        place = (k + 1) % count
        columns = one.through[place] @ columns
        if place:
            columns[:, place] += sources[place]
    columns = one.closing @ columns
    every = []
    for k in range(count):
        if k == 0:
            columns[:, 0] += sources[0]
        every.append(columns)
        columns = one.flowed(k, columns)
        place = (k + 1) % count
        columns = one.through[place] @ columns
        if place:
            columns[:, place] += sources[place]
    return every


# -- multipliers --


def multipliers(one: Orbit, times: Floats) -> tuple[Complexes, Floats]:
    """Return all multipliers over a period by descending modulus, and their errors.

    A deviation flows in each part; switchings make of it what `Scenes.jump` says.

    Parameters
    ----------
    one : Orbit
    times : array, shape (switching,)
        Errors of its times.
    """
    look()
    count, first = max(len(one.switchings), 1), one.side(0)
    moving = first.pairs.moving
    live = np.concatenate([moving, moving + first.size])
    jumps = [_jump(one, k) for k in range(len(one.switchings))] or [np.eye(2 * first.size)]
    right = np.eye(2 * first.size)[:, live]
    for k in range(count):
        right = jumps[(k + 1) % count] @ one.flowed(k, right)
    values, vectors = np.linalg.eig(right[live])
    order = np.lexsort((-values.imag, -np.round(np.abs(values), 14)))
    values, vectors = values[order], vectors[:, order]
    try:
        left = np.linalg.inv(vectors)
    except np.linalg.LinAlgError:
        return values, np.full(values.size, np.inf)
    return values, _off(one, jumps, live, left, vectors, times)


def _jump(one: Orbit, k: int) -> Floats:
    """Return what a switching makes of deviations."""
    switching = one.switchings[k]
    at_wall = switching.kind is Kind.WALL
    return one.cell.scenes.jump(one.before[k], one.scenes[k], switching.stop, at_wall=at_wall)


def _off(
    one: Orbit, jumps: list[Floats], live: Integers, left: Complexes, right: Complexes,
    times: Floats,
) -> Floats:  # fmt: skip
    """Return errors of multipliers by roundings of all products, and by times of switchings."""
    count = len(jumps)
    shape = 2 * one.side(0).size, live.size
    ends, columns = list[Complexes](), np.zeros(shape, np.complex128)
    columns[live] = right
    begins: list[Complexes] = [columns]
    for k in range(count):
        ends.append(_flowed_complex(one, k, begins[-1]))
        begins.append(jumps[(k + 1) % count] @ ends[-1])
    rows: Complexes = np.zeros(shape[::-1], np.complex128)
    rows[:, live] = left
    squares, late = np.zeros(live.size), np.zeros(live.size)
    for k in range(count - 1, -1, -1):
        place = (k + 1) % count
        after, before = one.side(place), one.side(k)
        each = after.shape_error + before.shape_error + 2.0 * _ROUNDED * EPS
        ended = np.abs(ends[k]) ** 2
        squares += each**2 * (np.abs(rows) ** 2 @ (jumps[place] ** 2 @ ended)).diagonal()
        if one.switchings:
            turned = _rate_rows(after, rows) @ begins[k + 1]
            came = _rate_rows(before, rows @ jumps[place]) @ ends[k]
            late += np.abs((came - turned).diagonal()) * times[place]
        rows = rows @ jumps[place]
        drift = np.tile(before.pairs.drift * one.lengths[k] + _ROUNDED * EPS, 2)
        both = np.array([pair_squares(before, column) for column in ended.T]).T
        squares += (np.abs(rows) ** 2 @ (drift[:, np.newaxis] ** 2 * both)).diagonal()
        rows = _rows_before(one, k, rows)
    return np.asarray(_SAMPLED * np.sqrt(squares) + late)


def _flowed_complex(one: Orbit, k: int, z: Complexes) -> Complexes:
    return np.asarray(one.flowed(k, z.real) + 1j * one.flowed(k, z.imag))


def _rows_before(one: Orbit, k: int, rows: Complexes) -> Complexes:
    return np.asarray(one.flowed_rows(k, rows.real) + 1j * one.flowed_rows(k, rows.imag))


def _rate_rows(side: Side, rows: Complexes) -> Complexes:
    """Return forms of the rates of deviations as forms of these."""
    every = np.arange(rows.shape[1])
    real = prescribed.drift(side, every, rows.real, form=True)
    return np.asarray(real + 1j * prescribed.drift(side, every, rows.imag, form=True))
