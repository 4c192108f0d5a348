"""Which orbits are motions: no stop switches but where they say.

Along each part the forces of loaded stops stay positive, released ones stay without force until
their coordinate has left the wall, and all others within their walls.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.limit_check import BEYOND, KEPT, LOWER, PASSED, UPPER
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.periodic_motions.stops import prescribed
from vibroimpact_solvers.periodic_motions.stops.existence import (
    Forces,
    Leg,
    check,
    first_left,
    walls_of,
)
from vibroimpact_solvers.periodic_motions.stops.orbit_errors import Errors
from vibroimpact_solvers.periodic_motions.stops.orbits import Kind, Orbit
from vibroimpact_solvers.results.impact_modes import Reason

_NONE: Final = -1


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether an orbit is a motion: why not, where (a part of the period), and at which stop."""

    reason: int = int(Reason.OK)
    witness: float = math.nan
    constraint: int = -1
    certified: bool = True


@dataclass(frozen=True, slots=True)
class _Mark:
    """An end of a leg: a switching of the orbit, or the wall being left after the force is lost.

    Parameters
    ----------
    time : float
    part : int
        The part that begins there, or goes on.
    kind : Kind, optional
        None: the wall is left.
    constraint, side : int
    """

    time: float
    part: int
    kind: Kind | None
    constraint: int
    side: int


def verdict(one: Orbit, off: Errors) -> Verdict:
    """Decide whether an orbit is a motion, for all motions within its errors where certified."""
    certified = bool(np.isfinite(off.times).all())
    for leg, mark, names in _legs(one, off):
        look()
        decided = check(one.cell.scenes.harmonics, np.array([one.cell.Omega]), leg)[0]
        kind, which = int(decided["kind"]), int(decided["constraint"])
        certified &= kind in {KEPT, PASSED}
        if kind < BEYOND:
            continue
        stops = one.cell.scenes.open.level.size
        reason, constraint = Reason.PENETRATION, which
        if which >= stops:
            constraint, pulls = names[which - stops]
            reason = Reason.NEGATIVE_IMPULSE if pulls else Reason.PENETRATION
        at = math.fmod((mark.time + float(decided["time"])) / one.cell.length, 1.0)
        return Verdict(int(reason), at % 1.0, constraint, certified)
    return Verdict(certified=certified)


def _marks(one: Orbit) -> list[_Mark]:
    """Return the ends of all legs in their order."""
    marks = [
        _Mark(float(t), k, each.kind, *each.stop)
        for k, (t, each) in enumerate(zip(one.times, one.switchings, strict=True))
    ]
    for k, each in enumerate(one.switchings):
        if each.kind is Kind.LOST and one.cell.scenes.stop(*each.stop).damping > 0.0:
            left = _wall_left(one, k)
            if left is not None:
                marks.append(_Mark(left[1], left[0], None, *each.stop))
    return sorted(marks, key=lambda mark: mark.time)


def _wall_left(one: Orbit, k: int) -> tuple[int, float] | None:
    """Return the part and the time at which the coordinate of a stop leaves its wall.

    After the stop has lost its force; None where it is loaded again before.
    """
    switching, count = one.switchings[k], len(one.switchings)
    for further in range(count):
        part = (k + further) % count
        late = _left_in(one, part, *switching.stop, at_begin=further == 0)
        if late is not None:
            return part, float(one.times[part]) + late
        next_one = one.switchings[(part + 1) % count]
        if next_one.stop == switching.stop:
            return None
    return None


def _left_in(one: Orbit, part: int, a: int, sign: int, *, at_begin: bool) -> float | None:
    """Return how long after the beginning of a part a coordinate is back at its wall, if ever."""
    cell, loaded, side = one.cell, one.scenes[part], one.side(part)
    length, start = float(one.lengths[part]), float(one.starts[part])
    form = sign * side.position[a]
    level = sign * float(side.level[a]) - cell.scenes.stop(a, sign).wall
    push = (cell.steady(loaded) * cell.turned(start)[:, np.newaxis]) @ form

    def beyond(times: Floats) -> Floats:
        z = np.broadcast_to(one.states[part], (times.size, form.size))
        moved = prescribed.apply(side.propagators(times), z) @ form
        turned = np.exp(1j * times[:, np.newaxis] * cell.rates)
        return np.asarray(moved + (turned @ push).real + level)

    moving = side.pairs.moving
    fastest = float(side.rate[moving].max(initial=cell.Omega))
    left = first_left(beyond, length, fastest, released=at_begin)
    if left is None:
        return None
    # One that begins at the wall has left it before.
    ends = one.switchings[(part + 1) % len(one.switchings)]
    again = ends.kind is Kind.REGAINED and ends.stop == (a, sign)
    return None if again and left > length * (1.0 - 1e-12) else left


Names = list[tuple[int, bool]]
"""Constraints of the forces that are watched, and whether these must not pull."""


def _legs(one: Orbit, off: Errors) -> Iterator[tuple[Leg, _Mark, Names]]:
    """Yield the parts of an orbit, those cut in which a wall is left."""
    marks = _marks(one)
    if not marks:
        mark = _Mark(0.0, 0, None, -1, 1)
        yield _leg(one, off, mark, None, {}), mark, _names(one, 0, {})
        return
    released: dict[int, int] = {}
    for mark in marks * 2:  # once to learn what is released where the period begins
        _release(one, released, mark)
    for place, mark in enumerate(marks):
        _release(one, released, mark)
        after = marks[(place + 1) % len(marks)]
        yield _leg(one, off, mark, after, released), mark, _names(one, mark.part, released)


def _release(one: Orbit, released: dict[int, int], mark: _Mark) -> None:
    """Enter a mark into the stops that are released, constraints -> sides."""
    if mark.kind is Kind.LOST and one.cell.scenes.stop(mark.constraint, mark.side).damping > 0.0:
        released[mark.constraint] = mark.side
    else:
        released.pop(mark.constraint, None)


def _names(one: Orbit, part: int, released: dict[int, int]) -> Names:
    return [(a, True) for a, _ in one.scenes[part]] + [(a, False) for a in released]


def _leg(
    one: Orbit, off: Errors, mark: _Mark, after: _Mark | None, released: dict[int, int]
) -> Leg:
    """Return what happens from a mark to the one after it."""
    cell, part = one.cell, mark.part
    scenes, loaded, side = cell.scenes, one.scenes[part], one.side(part)
    watched = [*loaded, *released.items()]
    sides = [scenes.watching(loaded, *each) for each in watched]
    forces = Forces(
        np.array([each.force for each in sides]).reshape(len(sides), 2 * side.size),
        np.array([each.force_level for each in sides]),
        np.array([each.force_size for each in sides]),
    )
    stops = side.level.size
    walls = walls_of(scenes, mirrored=False, forces=len(watched))
    for place, (a, sign) in enumerate(watched):
        own = UPPER if sign > 0 else LOWER
        if place < len(loaded):
            walls[LOWER, stops + place] = 0.0
        else:
            walls[UPPER, stops + place] = 0.0
            walls[1 - own, a] = walls[own, a]
        walls[own, a] = math.inf if own == UPPER else -math.inf
    places = {each: stops + k for k, each in enumerate(watched)}
    first, first_side = _at_wall(one, mark, places, begins=True)
    last, last_side = (_NONE, LOWER)
    until = float(one.starts[part]) + cell.length
    if after is not None:
        last, last_side = _at_wall(one, after, places, begins=False)
        until = after.time + (cell.length if after.time <= mark.time else 0.0)
    start = mark.time - float(one.starts[part])
    start += cell.length if start < -0.5 * cell.length else 0.0
    state = one.states[part]
    if start > 0.0:
        state = prescribed.apply(side.propagators(np.array([start])), state[np.newaxis])[0]
    return Leg(
        side, cell.steady(loaded)[np.newaxis], np.ascontiguousarray(state[np.newaxis]),
        off.states[part][np.newaxis], np.array([cell.Omega * mark.time]), np.zeros(1),
        np.array([max(until - mark.time, 0.0)]), np.ascontiguousarray(walls), np.array([first]),
        np.array([last]), first_side, np.array([last_side]), forces,
    )  # fmt: skip


def _at_wall(
    one: Orbit, mark: _Mark, places: dict[tuple[int, int], int], *, begins: bool
) -> tuple[int, int]:
    """Return which form is zero where a leg begins, or ends, and which of its walls that is."""
    own, other = (UPPER, LOWER) if mark.side > 0 else (LOWER, UPPER)
    stop = mark.constraint, mark.side
    damped = mark.constraint >= 0 and one.cell.scenes.stop(*stop).damping > 0.0
    if mark.kind is None:
        return (mark.constraint, own if begins else other)
    if mark.kind is Kind.WALL:
        if not begins:
            return mark.constraint, own
        return (_NONE, LOWER) if damped else (places[stop], LOWER)
    if mark.kind is Kind.REGAINED:
        return places[stop], LOWER if begins else UPPER
    if not begins:
        return places[stop], LOWER
    return (places[stop], UPPER) if damped else (mark.constraint, own)
