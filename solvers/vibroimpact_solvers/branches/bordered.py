r"""Periodic motions of given times of switchings and a given velocity at the first of them.

Without dashpots the equations of a period, ``(1 - A) z = r`` for the state z at the first switching
(`stops.orbits`), are singular at folds: A is then what the period makes of deviations. They are
bordered: the velocity of the stop that switches first, a form c of the state, is one more number,
and an impulse on the stop there, of the kick b, one more that is zero in motions:

    [ 1 - A  b ] [ z    ]   [ r        ]
    [ c      0 ] [ beta ] = [ velocity ] .

These are singular elsewhere; a branch takes the one or the other, whichever is farther from that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.periodic_motions.stops import prescribed
from vibroimpact_solvers.periodic_motions.stops.orbits import Orbit, Switching, orbit, scenes_of
from vibroimpact_solvers.periodic_motions.stops.scenes import Cell, Loaded


@dataclass(eq=False, slots=True)
class _Border:
    """The border of the equations of a period, and their solution."""

    form: Floats
    kick: Floats
    velocity: float
    inverse: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    impulse: float = math.nan

    def __call__(self, matrix: Floats, r: Floats) -> tuple[Floats, Floats]:
        size = r.size
        whole = _framed(matrix, self.kick, self.form)
        self.inverse = np.asarray(np.linalg.inv(whole), dtype=np.float64)
        solved = self.inverse @ np.append(r, self.velocity)
        self.impulse = float(solved[size])
        return self.inverse[:size, :size], solved[:size]


class Bordered(NamedTuple):
    """A motion of given times and velocity, which needs an impulse."""

    orbit: Orbit
    form: Floats
    inverse: Floats
    impulse: float  # relative to that of a unit velocity

    def jacobian(self) -> Floats:
        """Return derivatives of what is zero at switchings, and of the impulse.

        By the times and by the velocity, shape (switching + 1, switching + 1).
        """
        one, count = self.orbit, len(self.orbit.switchings)
        size = one.states[0].size
        sources, along = one.sources(), self.inverse[:size, size]
        both = np.zeros((count + 1, count + 1))
        both[:count, :count] = one.jacobian(one.seen())
        # What the velocity makes of the states, and these of the forms.
        column = along[:, np.newaxis]
        for k in range(count):
            column, after = one.flowed(k, column), (k + 1) % count
            both[after, count] = float(one.form(after) @ column[:, 0])
            column = one.through[after] @ column
        both[count, count] = self.inverse[size, size]
        row = self.inverse[size : size + 1, :size]
        both[count, 0] = float(row[0] @ sources[0])
        row = row @ one.through[0]
        for k in range(count - 1, 0, -1):
            row = one.flowed_rows(k, row)
            both[count, k] = float(row[0] @ sources[k])
            row = row @ one.through[k]
        # The velocity is that at the first switching, which comes later.
        every = np.arange(size)
        drift = prescribed.drift(one.side(0), every, one.states[0], form=False)
        rate = float(self.form @ drift)
        both[:count, 0] -= both[:count, count] * (rate + float(self.form @ sources[0]))
        both[count, 0] -= both[count, count] * rate
        # The impulse relative to what it makes of the velocity.
        both[count] *= float(self.form @ self.kick)
        return both

    @property
    def kick(self) -> Floats:
        """What a unit impulse on the stop makes of states."""
        one = self.orbit
        return np.asarray(one.side(0).kick[one.switchings[0].constraint])


def bordered(
    cell: Cell, before: Loaded, switchings: tuple[Switching, ...], times: Floats, velocity: float
) -> Bordered:
    """Return the motion of given times of switchings and velocity at the first of them.

    Raises
    ------
    ConvergenceError
        Where there is none.
    """
    side, a = cell.scenes.side(scenes_of(before, switchings)[0]), switchings[0].constraint
    form = velocity_form(cell, scenes_of(before, switchings)[0], a)
    border = _Border(form, side.kick[a], velocity)
    one = orbit(cell, before, switchings, times, border)
    if one is None:
        raise ConvergenceError("there is no motion with these switchings")
    return Bordered(one, form, border.inverse, border.impulse * float(form @ side.kick[a]))


def better_bordered(one: Orbit, constraint: int) -> float:
    """Return how much farther from being singular the equations of a period are with their border.

    The ratio of the condition numbers without and with it.
    """
    size = one.states[0].size
    period = np.eye(size)
    for k in range(len(one.switchings)):
        period = one.through[(k + 1) % len(one.switchings)] @ one.flowed(k, period)
    matrix, side = np.eye(size) - period, one.side(0)
    form, kick = side.velocity[constraint], side.kick[constraint]
    form, kick = form / (np.linalg.norm(form) or 1.0), kick / (np.linalg.norm(kick) or 1.0)
    with_border = np.linalg.svd(_framed(matrix, kick, form), compute_uv=False)
    without = np.linalg.svd(matrix, compute_uv=False)
    tiny = np.finfo(float).tiny
    return float((without[0] / (without[-1] + tiny)) / (with_border[0] / (with_border[-1] + tiny)))


def _framed(matrix: Floats, kick: Floats, form: Floats) -> Floats:
    size = kick.size
    whole = np.zeros((size + 1, size + 1))
    whole[:size, :size], whole[:size, size], whole[size, :size] = matrix, kick, form
    return whole


def velocity_form(cell: Cell, loaded: Loaded, constraint: int) -> Floats:
    """Return the form of the velocity of a constraint, of deviations, in the units of the drive."""
    scenes = cell.scenes
    return np.asarray(scenes.side(loaded).velocity[constraint] * scenes.scale)


def velocity_in(one: Orbit, time: float, loaded: Loaded, constraint: int) -> float:
    """Return the velocity of a constraint at a time of a motion, as that of another scene."""
    cell = one.cell
    since = np.mod(time - one.starts, cell.length)
    part = int(np.argmin(since))
    flow = one.side(part).propagators(since[part : part + 1])
    z = prescribed.apply(flow, one.states[part][np.newaxis])[0]
    if one.scenes[part] != loaded:
        matrix, _ = cell.scenes.passage(one.scenes[part], loaded)
        z = matrix @ z + cell.shift(one.scenes[part], loaded, time)
    return float(velocity_form(cell, loaded, constraint) @ z)
