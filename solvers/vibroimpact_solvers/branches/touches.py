"""Where a stop is touched, or a force vanishes, between the switchings of a motion.

A form of the state has an extremum there: how far a coordinate is beyond its wall, how far a force
that only pushes would pull, or push where the stop is released. It is negative in motions that
exist; where it is zero contacts begin, or end to be.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.periodic_motions.stops import prescribed
from vibroimpact_solvers.periodic_motions.stops.orbit_columns import Checked, parts
from vibroimpact_solvers.periodic_motions.stops.orbit_existence import Verdict
from vibroimpact_solvers.periodic_motions.stops.orbits import Kind, Orbit, Switching
from vibroimpact_solvers.periodic_motions.stops.phases import Side

_NODES: Final = 1000  # at most, in which an extremum is looked for
_TURN: Final = 16  # of them in a turn of what turns fastest
_STEPS: Final = 30  # of Newton's method


class Touch(NamedTuple):
    """A form that has an extremum in a part of a motion.

    Parameters
    ----------
    part : int
    constraint, side : int
        The stop.
    wall : bool
        Whether it is the coordinate beyond the wall; else the force.
    sign : int
        1 where it must not be positive: -1 of the force of a loaded stop.
    """

    part: int
    constraint: int
    side: int
    wall: bool
    sign: int

    def switchings(self, *, damped: bool) -> tuple[Switching, Switching]:
        """Return what happens around the extremum where it is positive."""
        stop = self.constraint, self.side
        if self.wall:
            return Switching(Kind.WALL, *stop), Switching(Kind.LOST, *stop)
        again = Switching(Kind.REGAINED if damped else Kind.WALL, *stop)
        if self.sign < 0:
            return Switching(Kind.LOST, *stop), again
        return again, Switching(Kind.LOST, *stop)


class Peak(NamedTuple):
    """An extremum: the time after the beginning of its part, and the form."""

    time: float
    height: float
    error: float


def _form(one: Orbit, touch: Touch) -> tuple[Side, Floats, float]:
    """Return the structure, the form and its value at the zero of the state."""
    scenes, stop = one.cell.scenes, (touch.constraint, touch.side)
    side = scenes.watching(one.scenes[touch.part], *stop)
    if not touch.wall:
        return side, touch.sign * side.force, touch.sign * side.force_level
    level = touch.side * float(side.level[touch.constraint]) - scenes.stop(*stop).wall
    return side, np.asarray(touch.side * side.position[touch.constraint]), level


def heights(one: Orbit, touch: Touch, times: Floats) -> Floats:
    """Return the form, its rate and the rate of that, (3, time)."""
    side, form, level = _form(one, touch)
    cell, k = one.cell, touch.part
    every = np.arange(form.size)
    z = np.broadcast_to(one.states[k], (times.size, form.size))
    moved = prescribed.apply(side.propagators(times), z)
    push = cell.steady(one.scenes[k]) @ form * cell.turned(float(one.starts[k]))
    seen = np.empty((3, times.size))
    for order in range(3):
        turned = np.exp(1j * times[:, np.newaxis] * cell.rates) * (1j * cell.rates) ** order
        seen[order] = moved @ form + (turned @ push).real + (level if order == 0 else 0.0)
        moved = prescribed.drift(side, every, moved, form=False)
    return seen


def peak(one: Orbit, touch: Touch, near: float) -> Peak:
    """Return the extremum near a time after the beginning of the part.

    Raises
    ------
    ConvergenceError
        Where there is none.
    """
    length, time = float(one.lengths[touch.part]), near
    for _ in range(_STEPS):
        height, rate, bend = heights(one, touch, np.array([time]))[:, 0].tolist()
        step = -rate / bend if bend != 0.0 else math.inf
        if not (math.isfinite(step) and 0.0 <= time + step <= length):
            break
        time += step
        if abs(step) <= 4.0 * EPS * one.cell.length:
            height, _, bend = heights(one, touch, np.array([time]))[:, 0].tolist()
            if not bend < 0.0:
                break
            return Peak(time, height, math.inf)
    message = "the form has no extremum there"
    raise ConvergenceError(message)


def with_error(checked: Checked, touch: Touch, at: Peak) -> Peak:
    """Return an extremum with its error."""
    _, form, level = _form(checked.orbit, touch)
    part = parts(*checked)[touch.part]
    error = float(part.error_of(form[np.newaxis])[0]) + 8.0 * EPS * abs(level)
    return at._replace(error=error)


def touch_of(one: Orbit, decided: Verdict) -> tuple[Touch, float]:
    """Return what is passed in a motion that fails, and about when, after the part's beginning."""
    a, time = decided.constraint, decided.witness * one.cell.length
    since = np.mod(time - one.starts, one.cell.length)
    part = int(np.argmin(since))
    late = float(since[part])
    loaded = [stop for stop in one.scenes[part] if stop[0] == a]
    pulls = [Touch(part, *stop, wall=False, sign=-1) for stop in loaded]
    touch = pulls[0] if pulls else _open(one, part, a, late)
    return touch, _highest(one, touch, late)


def _open(one: Orbit, part: int, a: int, late: float) -> Touch:
    """Return which wall of a constraint is passed, or which released force pushes."""
    stopped = one.cell.scenes.stopped
    sides = [s for s in (1, -1) if math.isfinite(stopped.wall(a, s))]
    walls = [Touch(part, a, side, wall=True, sign=1) for side in sides]
    beyond = [float(heights(one, each, np.array([late]))[0, 0]) for each in walls]
    touch = walls[int(np.argmax(beyond))]
    count, stop = len(one.switchings), (a, touch.side)
    for further in range(count):  # back to what this stop did last
        k = (part - further) % count
        if one.switchings[k].stop != stop:
            continue
        damped = one.cell.scenes.stop(*stop).damping > 0.0
        if one.switchings[k].kind is Kind.LOST and damped and _released(one, k, part, touch, late):
            return touch._replace(wall=False)
        break
    return touch


def _released(one: Orbit, lost: int, part: int, touch: Touch, late: float) -> bool:
    """Whether a coordinate has stayed beyond its wall since the force was lost."""
    count, k = len(one.switchings), lost
    while True:
        end = late if k == part else float(one.lengths[k])
        times = np.linspace(0.0, end, 200)[1:]
        if (heights(one, touch._replace(part=k), times)[0] <= 0.0).any():
            return False
        if k == part:
            return True
        k = (k + 1) % count


def _highest(one: Orbit, touch: Touch, late: float) -> float:
    """Return where the form is about highest in the time around another in which it is positive."""
    side, length = one.side(touch.part), float(one.lengths[touch.part])
    fastest = float(side.rate[side.pairs.moving].max(initial=one.cell.Omega))
    nodes = int(min(_NODES, 32 + _TURN * fastest * length / (2.0 * math.pi)))
    times = np.linspace(0.0, length, nodes)
    near = min(max(late, 0.0), length)
    first = int(np.searchsorted(times, near))
    times = np.insert(times, first, near)
    seen = heights(one, touch, times)[0]
    low = high = min(first, times.size - 1)
    while low > 0 and seen[low - 1] > 0.0:
        low -= 1
    while high < times.size - 1 and seen[high + 1] > 0.0:
        high += 1
    # Neighbours count, too: an extremum may lie between two nodes.
    low, high = max(low - 1, 0), min(high + 1, times.size - 1)
    return float(times[low + int(np.argmax(seen[low : high + 1]))])
