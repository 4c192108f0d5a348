"""Motions with a sequence of several contacts: Newton's method from many starts.

Starts are the solutions of the frequency before, contacts at the phases that are asked for or at
random ones, each about as long as that of a free mass, and what time histories from random initial
states go through. None is proved to be there, and some may be missed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from vibroimpact_solvers import time_history
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import SolverError, attempt
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.periodic_motions.problem import Impact, Problem
from vibroimpact_solvers.periodic_motions.stops.orbit_columns import Checked
from vibroimpact_solvers.periodic_motions.stops.orbits import (
    Kind,
    Orbit,
    Switching,
    newton,
    orbit,
    scenes_of,
)
from vibroimpact_solvers.periodic_motions.stops.scenes import Cell, Loaded, Scenes

STARTS: Final = 12
"""Random phases at each frequency."""
HISTORIES: Final = 6
"""Time histories at each frequency, and their lengths in periods of the drive: what is left out,
and what is looked at, of which each period of motions is a start."""
SETTLED, OBSERVED = 60, 12
_SAME: Final = 1e-6  # of the period, between times of one motion
_NEAR: Final = 1e-4  # of the period, between times of a start and of what it leads to
_SHORT: Final = 0.4  # of the distance of contacts, the longest ones to begin with


class Start(NamedTuple):
    """Where Newton's method begins: what is loaded first, and switchings at their times."""

    before: Loaded
    switchings: tuple[Switching, ...]
    times: Floats


class Contact(NamedTuple):
    """A contact phase of a motion, by the basis' time."""

    constraint: int
    side: int
    start: float
    stop: float
    velocity: float


def start_of(contacts: Sequence[Contact], first: float, length: float) -> Start | None:
    """Return the switchings of a motion from a time on, for a period.

    Times are those of the motion. None where stops are not loaded at its end as at its beginning.
    """
    marks, before = list[tuple[float, Switching]](), list[tuple[int, int]]()
    for each in contacts:
        stop = each.constraint, each.side
        if first <= each.start < first + length:
            presses = each.velocity * each.side > 0.0
            kind = Kind.WALL if presses else Kind.REGAINED
            marks.append((each.start, Switching(kind, *stop)))
        if first <= each.stop < first + length:
            marks.append((each.stop, Switching(Kind.LOST, *stop)))
        if each.start < first <= each.stop:
            before.append(stop)
    marks.sort(key=lambda pair: pair[0])
    loaded, switchings = tuple(sorted(before)), tuple(switching for _, switching in marks)
    scenes = scenes_of(loaded, switchings)
    if scenes and scenes[-1] != loaded:
        return None
    return Start(loaded, switchings, np.array([time for time, _ in marks], dtype=np.float64))


def solutions(problem: Problem, scenes: Scenes) -> Iterator[list[Checked]]:
    """Yield the motions at each frequency: the one without contacts, and those that are found."""
    before = list[Orbit]()
    for f in range(problem.Omega.size):
        cell = Cell(scenes, float(problem.Omega[f]), problem.periods)
        orbits = list[Orbit]()
        for start in _starts(problem, cell, before):
            if any(_near(start, other, problem.turn, _NEAR) for other in orbits):
                continue
            one = newton(cell, *start)
            one = None if one is None else _in_order(problem, one)
            if one is not None and not any(_same(problem, one, other) for other in orbits):
                orbits.append(one)
        orbits.sort(key=lambda one: tuple(one.times.tolist()))
        before, linear = orbits, orbit(cell, (), (), np.zeros(0))
        yield [Checked.of(one) for one in (([] if linear is None else [linear]) + orbits)]


def _starts(problem: Problem, cell: Cell, before: Sequence[Orbit]) -> Iterator[Start]:
    for one in before:
        times = one.times * (cell.length / one.cell.length)
        yield Start(one.before[0], one.switchings, times)
    impacts = problem.impacts
    if problem.phases is not None:
        phases = np.asarray(problem.phases, np.float64) / cell.Omega
    else:
        rng = np.random.default_rng(0)
        phases = np.sort(rng.uniform(0.0, cell.length, (STARTS, len(impacts))), axis=1)
        first = rng.uniform(0.0, 2.0 * math.pi / cell.Omega, (STARTS, 1))
        phases = phases - phases[:, :1] + first
    for row in phases:
        start = _free_contacts(cell, impacts, row)
        if start is not None:
            yield start
    yield from _of_histories(problem, cell)


def _free_contacts(cell: Cell, impacts: Sequence[Impact], begins: Floats) -> Start | None:
    """Return contacts that begin at some times, each as long as that of a free mass."""
    stopped, contacts = cell.scenes.stopped, list[Contact]()
    room = _SHORT * np.diff(np.append(begins, begins[0] + cell.length)).min(initial=cell.length)
    for impact, begin in zip(impacts, begins.tolist(), strict=True):
        a = impact.constraint
        fast = math.sqrt(float(stopped.stiffness[a] * stopped.mobility[a])) / cell.scenes.scale
        long = min(room, math.pi / fast if fast > 0.0 else room)
        if not long > 0.0:
            return None
        contacts.append(Contact(a, impact.side, begin, begin + long, float(impact.side)))
    return start_of(contacts, float(begins[0]), cell.length)


def _of_histories(problem: Problem, cell: Cell) -> Iterator[Start]:
    """Yield what time histories go through that strike in the order asked for."""
    system, scale = problem.system, cell.scenes.scale
    Omega = cell.Omega * scale
    rng, drive = np.random.default_rng(1), 2.0 * math.pi / Omega
    end = (SETTLED + OBSERVED + problem.periods) * drive
    load = tuple(
        time_history.Harmonic(dof, force.amplitude * weight, force.harmonic * Omega, force.phase)
        for force in (each.at(Omega) for each in problem.load)
        for dof, weight in zip(force.dofs, force.weights, strict=True)
        if force.amplitude * weight != 0.0
    )
    linear = orbit(cell, (), (), np.zeros(0))
    swing = 1.0 if linear is None else _swing(cell)
    walls = [abs(w) for c in system.constraints for w in (c.lower, c.upper) if w]
    size = max([swing, *walls])
    for _ in range(HISTORIES):
        look()
        x, v = size * rng.uniform(-1.0, 1.0, (2, system.n))
        x[system.massless] = v[system.massless] = 0.0
        history = attempt(
            lambda x=x, v=v: _history(system, time_history.State(x, Omega * v), end, load)
        )
        if isinstance(history, SolverError):
            continue
        contacts = contacts_of(history, scale)
        for k in range(OBSERVED):
            first = (SETTLED + k) * drive * scale
            start = start_of(contacts, first, cell.length)
            if start is not None and _order(start.switchings, problem.impacts) is not None:
                yield start._replace(times=start.times - SETTLED * drive * scale)


def _history(system: Any, state: time_history.State, end: float, load: Any) -> Any:
    given = time_history.Problem(
        system, state, end, outputs=frozenset({"contacts"}), load=load, estimate=False
    )
    return time_history.solve(given, time_history.plan(given))


def contacts_of(history: time_history.Result, scale: float) -> list[Contact]:
    """Return the contacts of a motion, by a basis' time."""
    assert history.contact_start is not None
    assert history.contact_stop is not None
    assert history.contact_velocity is not None
    assert history.contact_constraint is not None
    assert history.contact_side is not None
    columns = (
        history.contact_constraint.tolist(), history.contact_side.tolist(),
        (scale * history.contact_start).tolist(), (scale * history.contact_stop).tolist(),
        history.contact_velocity.tolist(),
    )  # fmt: skip
    return [Contact(*row) for row in zip(*columns, strict=True)]


def _swing(cell: Cell) -> float:
    """Return the largest amplitude of the response without contacts."""
    side = cell.scenes.open
    modes = side.basis.modes
    moved = side.basis.displacement(modes.shapes).reshape(len(modes.shapes), -1)
    return float(np.abs(cell.steady(()) @ moved.T).sum(axis=0).max(initial=0.0))


def _order(switchings: Sequence[Switching], impacts: Sequence[Impact]) -> int | None:
    """Return which beginning of a contact is the first of a sequence; None: it is another one."""
    begins = [k for k, each in enumerate(switchings) if each.kind is not Kind.LOST]
    struck = [Impact(*switchings[k].stop) for k in begins]
    for shift in range(len(struck) if len(struck) == len(impacts) else 0):
        if struck[shift:] + struck[:shift] == list(impacts):
            return begins[shift]
    return None


def _near(start: Start, other: Orbit, turn: float, close: float) -> bool:
    """Whether switchings are those of a motion, up to whole periods of the load.

    Parameters
    ----------
    turn : float
        Phase of the drive after which the load repeats itself.
    close : float
        Part of the period by which times may differ.
    """
    count, turn = len(start.switchings), turn / other.cell.Omega
    for first in range(count if count == len(other.switchings) else 0):
        if other.switchings[first:] + other.switchings[:first] == start.switchings:
            late = np.concatenate([other.times[first:], other.times[:first] + other.cell.length])
            apart = start.times - late
            apart -= turn * np.round(apart[0] / turn)
            if np.abs(apart).max(initial=0.0) <= close * other.cell.length:
                return True
    return False


def _in_order(problem: Problem, one: Orbit) -> Orbit | None:
    """Return a motion from the beginning of the first contact on, in the first period."""
    first = _order(one.switchings, problem.impacts)
    if first is None:
        return None
    return _turned(problem, one, first)


def _turned(problem: Problem, one: Orbit, first: int) -> Orbit | None:
    """Return a motion from another switching on."""
    times = np.concatenate([one.times[first:], one.times[:first] + one.cell.length])
    turn = problem.turn / one.cell.Omega
    times -= turn * math.floor(float(times[0]) / turn)
    switchings = one.switchings[first:] + one.switchings[:first]
    return orbit(one.cell, one.before[first], switchings, times)


def _same(problem: Problem, one: Orbit, other: Orbit) -> bool:
    """Whether two motions are one, whichever contact and whichever period is the first."""
    start = Start(one.before[0], one.switchings, one.times)
    return _near(start, other, problem.turn, _SAME)
