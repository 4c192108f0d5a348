r"""Periodic motions with any sequence of contacts: Newton's method in the times of switchings.

Between switchings a motion is linear, in each part with other stops loaded. With the times t_i of
the switchings as they please there is one periodic motion, whatever its forces are: deviations z
from the steady response carry over as ``z -> P z + shift(t_i)`` and flow in between, so that

    (1 - A) z_1 = what one period makes of no deviation,     A = P_1 F_m P_m ... P_2 F_1 .

Of m equations m times are the roots: at each switching a coordinate is at its wall, or a force is
zero. A later switching is an impulse more, or one less: ``dz/dt_i = +- force M^-1 w``. What a
change of the state makes of each equation is a row that is carried back through the period; the
same rows tell how roundings on the way change the times (`orbit_errors`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.periodic_motions.stops import prescribed
from vibroimpact_solvers.periodic_motions.stops.phases import Side
from vibroimpact_solvers.periodic_motions.stops.scenes import Cell, Loaded

_STEPS: Final = 30  # of Newton's method
_MOST: Final = 0.45  # of the distance of two switchings, of which each takes a part in one step
_CLOSE: Final = 1e-13  # of the period, steps of the last one
_STILL: Final = 1e-9  # of the period, of what rounding does not let come closer


Flow = tuple[Floats, Floats, Floats]


class Kind(IntEnum):
    """What a switching is."""

    WALL = 0  # the stop begins to push at its wall
    REGAINED = 1  # beyond its wall: its dashpot had lost the force
    LOST = 2  # the force is zero


@dataclass(frozen=True, slots=True)
class Switching:
    """A switching of a stop at one of its walls."""

    kind: Kind
    constraint: int
    side: int

    @property
    def stop(self) -> tuple[int, int]:
        """The constraint and the side."""
        return self.constraint, self.side


def scenes_of(before: Loaded, switchings: Sequence[Switching]) -> list[Loaded]:
    """Return which stops are loaded after each switching."""
    loaded, each = set(before), []
    for switching in switchings:
        loaded = loaded - {switching.stop}
        if switching.kind != Kind.LOST:
            loaded = loaded | {switching.stop}
        each.append(tuple(sorted(loaded)))
    return each


@dataclass(frozen=True, eq=False, slots=True)
class Orbit:
    """A periodic motion whose stops are loaded between given times, by the basis' time.

    Parameters
    ----------
    cell : Cell
    switchings : tuple of Switching
        In their order; none of a motion that is linear throughout.
    times : array, shape (switching,)
        Ascending, within one period.
    scenes : list of Loaded
        In the part after each switching; of a linear motion one.
    states, ends : list of array, shape (2 pair,)
        Deviations at the beginning and at the end of each part.
    values, rates : array, shape (switching,)
        What is zero at each switching, and its rate before that.
    forces : array, shape (switching,)
        Of the stops that switch.
    through : list of array, shape (2 pair after, 2 pair before)
        How deviations carry over at each switching.
    closing : array
        ``(1 - A)^-1`` at the beginning of the first part.
    lengths : array, shape (part,)
    flows : list of Flow
        Of each part, as of `phases.Side.propagators`.
    """

    cell: Cell
    switchings: tuple[Switching, ...]
    times: Floats
    scenes: list[Loaded]
    states: list[Floats]
    ends: list[Floats]
    values: Floats
    rates: Floats
    forces: Floats
    through: list[Floats]
    closing: Floats
    lengths: Floats
    flows: list[Flow]

    @property
    def starts(self) -> Floats:
        """Times of the beginnings of the parts."""
        return self.times if self.switchings else np.zeros(1)

    @property
    def before(self) -> list[Loaded]:
        """Which stops are loaded before each switching."""
        return [self.scenes[-1], *self.scenes[:-1]]

    def side(self, part: int) -> Side:
        """Return the structure in a part."""
        return self.cell.scenes.side(self.scenes[part])

    def flowed(self, part: int, z: Floats) -> Floats:
        """Return columns of states, (2 pair, column), at the end of a part."""
        return np.asarray(prescribed.apply(self.flows[part], z.T[np.newaxis])[0].T)

    def flowed_rows(self, part: int, rows: Floats) -> Floats:
        """Return forms (row, 2 pair) at the end of a part as forms of states at its beginning."""
        even, odd, back = self.flows[part]
        first, second = np.split(rows, 2, axis=1)
        both = first * even + second * back, first * odd + second * even
        return np.concatenate(both, axis=1)

    def form(self, k: int) -> Floats:
        """Return the form that is zero at a switching, of states before it."""
        switching = self.switchings[k]
        side = self.cell.scenes.watching(self.before[k], *switching.stop)
        if switching.kind is Kind.WALL:
            return np.asarray(switching.side * side.position[switching.constraint])
        return side.force

    def sources(self) -> list[Floats]:
        """Return changes of states after each switching by its time."""
        scenes, sources = self.cell.scenes, []
        for k, switching in enumerate(self.switchings):
            sign = -1.0 if switching.kind is Kind.LOST else 1.0
            push = sign * switching.side * scenes.unit * self.forces[k]
            sources.append(push * self.side(k).kick[switching.constraint])
        return sources

    def seen(self) -> list[Floats]:
        """Return what changes of states at the beginnings of parts make of each form.

        Of each part an array (switching, 2 pair).
        """
        look()
        count = len(self.switchings)
        forms = [self.form(j) for j in range(count)]
        seen = [np.zeros((count, state.size)) for state in self.states]
        # Back from each switching to the beginning of the period: the first one ends the last part.
        rows = np.zeros((count, forms[0].size))
        for k in range(count - 1, -1, -1):
            after = (k + 1) % count
            rows[after] = forms[after]
            rows = self.flowed_rows(k, rows)
            mine = [0, *range(k + 1, count)]
            seen[k][mine] = rows[mine]
            rows = rows @ self.through[k] if k else rows
        rows = (rows @ self.closing) @ self.through[0]
        for k in range(count - 1, -1, -1):
            rows = self.flowed_rows(k, rows)
            seen[k] += rows
            rows = rows @ self.through[k]
        return seen

    def jacobian(self, seen: list[Floats]) -> Floats:
        """Return the derivatives of what is zero at switchings by all times."""
        columns = [rows @ s for rows, s in zip(seen, self.sources(), strict=True)]
        return np.asarray(np.stack(columns, axis=1) + np.diag(self.rates))


def _closed(matrix: Floats, r: Floats) -> tuple[Floats, Floats]:
    """Return the inverse of ``1 - A``, and the state at the beginning."""
    inverse: Floats = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
    return inverse, np.asarray(inverse @ r)


def orbit(
    cell: Cell, before: Loaded, switchings: tuple[Switching, ...], times: Floats,
    close: Callable[[Floats, Floats], tuple[Floats, Floats]] = _closed,
) -> Orbit | None:  # fmt: skip
    """Return the motion of given times of switchings; None where there is none, or many.

    `close` solves the equations of the period for the state at its beginning.
    """
    scenes = scenes_of(before, switchings) or [before]
    if not switchings:
        zero = np.zeros(2 * cell.scenes.side(before).size)
        none, empty = np.zeros(0), list[Floats]()
        if not np.isfinite(cell.steady(before)).all():
            return None
        length = np.array([cell.length])
        flows = [cell.scenes.side(before).propagators(length)]
        return Orbit(
            cell, (), none, scenes, [zero], [zero], none, none, none, empty, np.eye(zero.size),
            length, flows,
        )  # fmt: skip
    came = [scenes[-1], *scenes[:-1]]
    through = [cell.scenes.passage(*pair)[0] for pair in zip(came, scenes, strict=True)]
    shifts = [
        cell.shift(one, other, t)
        for one, other, t in zip(came, scenes, times.tolist(), strict=True)
    ]
    lengths = np.diff(np.append(times, times[0] + cell.length))
    flows = [
        cell.scenes.side(each).propagators(lengths[k : k + 1]) for k, each in enumerate(scenes)
    ]
    size = 2 * cell.scenes.side(scenes[0]).size
    # A row for each unit deviation at the beginning, and one for none.
    rows = np.concatenate([np.eye(size), np.zeros((1, size))])
    for k in range(len(switchings)):
        moved = prescribed.apply(flows[k], rows[np.newaxis])[0]
        place = (k + 1) % len(switchings)
        rows = moved @ through[place].T
        rows[-1] += shifts[place]
    if not np.isfinite(rows).all():
        return None
    try:
        closing, z = close(np.eye(size) - rows[:-1].T, rows[-1])
    except np.linalg.LinAlgError:
        return None
    states, ends = list[Floats](), list[Floats]()
    for k in range(len(switchings)):
        states.append(z)
        ends.append(prescribed.apply(flows[k], z[np.newaxis])[0])
        place = (k + 1) % len(switchings)
        z = through[place] @ ends[-1] + shifts[place]
    whole = Orbit(
        cell, switchings, times, scenes, states, ends, *_seen(cell, switchings, times, came, ends),
        through, closing, lengths, flows,
    )  # fmt: skip
    return whole if np.isfinite(whole.values).all() else None


def _seen(
    cell: Cell, switchings: tuple[Switching, ...], times: Floats, came: list[Loaded],
    ends: list[Floats],
) -> tuple[Floats, Floats, Floats]:  # fmt: skip
    """Return what is zero at switchings, its rates, and the forces of the stops."""
    seen = np.zeros((3, times.size))
    for k, switching in enumerate(switchings):
        side = cell.scenes.watching(came[k], *switching.stop)
        z = ends[k - 1]
        steady, turning = cell.at(came[k], float(times[k]))
        rate = prescribed.drift(side, np.arange(z.size), z, form=False) + turning
        value = force = float(side.force @ (z + steady)) + side.force_level
        slope = float(side.force @ rate)
        if switching.kind is Kind.WALL:
            form = switching.side * side.position[switching.constraint]
            stop = cell.scenes.stop(*switching.stop)
            level = switching.side * float(side.level[switching.constraint]) - stop.wall
            value, slope = float(form @ (z + steady)) + level, float(form @ rate)
        seen[:, k] = value, slope, force
    return seen[0], seen[1], seen[2]


def newton(
    cell: Cell, before: Loaded, switchings: tuple[Switching, ...], times: Floats
) -> Orbit | None:
    """Return the motion that Newton's method reaches from times of switchings; None: it does not.

    At each of its switchings the force begins, or ends, as its kind says.
    """
    one = orbit(cell, before, switchings, times)
    if one is None or not switchings:
        return one
    for _ in range(_STEPS):
        look()
        try:
            step = -np.linalg.solve(one.jacobian(one.seen()), one.values)
        except np.linalg.LinAlgError:
            return None
        if not np.isfinite(step).all():
            return None
        gaps, closer = one.lengths, step - np.append(step[1:], step[0])
        part = float((_MOST * gaps / np.maximum(closer, 1e-300)).min(initial=1.0))
        largest = float(np.abs(step).max())
        moved = one.times + min(1.0, part) * step
        other = orbit(cell, before, switchings, moved)
        if other is None:
            return None
        if largest <= _CLOSE * cell.length:
            return as_they_say(other)
        if (
            largest <= _STILL * cell.length and (np.abs(other.values) >= np.abs(one.values)).all()
        ):  # pragma: no cover (rounding decides)
            return as_they_say(one)
        one = other
    return None


def as_they_say(one: Orbit) -> Orbit | None:
    """Return a motion if stops begin to push, and cease to, at its switchings."""
    for k, switching in enumerate(one.switchings):
        rises = one.rates[k] > 0.0
        if rises == (switching.kind is Kind.LOST):
            return None
        if switching.kind is Kind.REGAINED:
            side = one.cell.scenes.side(one.before[k])
            stop = one.cell.scenes.stop(*switching.stop)
            steady, _ = one.cell.at(one.before[k], float(one.times[k]))
            y = float(side.position[switching.constraint] @ (one.ends[k - 1] + steady))
            y += float(side.level[switching.constraint])
            if switching.side * y <= stop.wall:
                return None
    return one
