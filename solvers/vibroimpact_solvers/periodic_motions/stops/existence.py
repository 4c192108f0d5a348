"""Which solutions are motions: no stop switches but at the two ends of the contact phase.

While the stop is loaded its force stays positive, and all other coordinates within their walls.
With a dashpot the force may be lost before the wall is left: until then the stop is released, and
must not be loaded again; afterwards its coordinate keeps off the wall until the period is over.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import EPS, Booleans, Floats, Integers
from vibroimpact_solvers.kernels.limit_check import (
    BEYOND,
    KEPT,
    LOWER,
    PASSED,
    UPPER,
    VERDICT,
    Coordinates,
    FreeMotions,
    check_limits,
)
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.periodic_motions.existence import Verdicts
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.problem import Problem
from vibroimpact_solvers.periodic_motions.stops import prescribed
from vibroimpact_solvers.periodic_motions.stops.phases import Phases, Side
from vibroimpact_solvers.periodic_motions.stops.prescribed import Cells
from vibroimpact_solvers.periodic_motions.stops.scenes import Scenes
from vibroimpact_solvers.periodic_motions.stops.solutions import Solutions
from vibroimpact_solvers.results.impact_modes import Reason

_PARTS: Final = 24  # of a turn of the fastest pair, in which the wall is looked for
_NODES: Final = 4000  # at most
_LATE: Final = 45  # halvings of what is left of a part, towards its end
_HALVINGS: Final = 80
_NONE: Final = -1


@dataclass(frozen=True, eq=False, slots=True)
class Forces:
    """Forms of forces, (force, 2 pair), their values at the zero of states, and sizes of these."""

    forms: Floats
    levels: Floats
    sizes: Floats


@dataclass(frozen=True, eq=False, slots=True)
class Leg:
    """A part of solutions in which one structure moves, and how it begins and ends.

    Parameters
    ----------
    side : Side
    steady : array, shape (solution, harmonic, 2 pair), complex
        The steady response, at the drive's phase 0.
    state : array, shape (solution, 2 pair)
    error : array, shape (solution, pair)
    phase : array, shape (solution,)
        Of the drive at its beginning.
    since, length : array, shape (solution,)
        When it begins after the contact phase does, and how long it lasts.
    walls : array, shape (2, constraint + force)
        Of all coordinates, and of the forces.
    first, last : array of int, shape (solution,)
        What is at a wall at the beginning and at the end: a constraint, the number of constraints
        for the first force, and so on, or -1.
    first_side, last_side : int
        Which of the walls.
    forces : Forces, optional
        Those that are watched; absent: the one of the side.
    """

    side: Side
    steady: Complexes
    state: Floats
    error: Floats
    phase: Floats
    since: Floats
    length: Floats
    walls: Floats
    first: Integers
    last: Integers
    first_side: int
    last_side: Integers
    forces: Forces | None = None


def verdicts(problem: Problem, phases: Phases, cells: Cells, solved: Solutions) -> Verdicts:
    """Decide which solutions are motions."""
    look()
    count = solved.index.size
    reason = np.full(count, int(Reason.OK))
    witness, constraint = np.full(count, np.nan), np.full(count, -1)
    certified: Booleans = np.isfinite(solved.phase_error) & np.isfinite(solved.d_error)
    a = phases.impact.constraint
    worst = np.full(count, KEPT)
    for leg, rows in legs(problem, phases, cells, solved):
        if not rows.size:
            continue
        decided = check(phases.harmonics, cells.Omega[solved.index[rows]], leg)
        kind, which = decided["kind"], decided["constraint"]
        certified[rows] &= (kind == KEPT) | (kind == PASSED)
        fails = (kind >= BEYOND) & (worst[rows] < BEYOND)
        at = rows[fails]
        worst[at] = kind[fails]
        force = which[fails] == phases.open.level.size
        pulls = force & (leg.side is phases.loaded)
        reason[at] = np.where(pulls, Reason.NEGATIVE_IMPULSE, Reason.PENETRATION)
        constraint[at] = np.where(force, a, which[fails])
        late = leg.since[fails] + decided["time"][fails]
        phase = solved.phase[at] + late * cells.Omega[solved.index[at]]
        witness[at] = np.mod(phase / (2.0 * math.pi * problem.periods), 1.0)
    return Verdicts(reason, witness, constraint, certified)


def legs(
    problem: Problem, phases: Phases, cells: Cells, solved: Solutions
) -> list[tuple[Leg, Integers]]:
    """Return the parts of solutions, each with the solutions that have it."""
    a, high = phases.impact.constraint, phases.impact.side > 0
    count, force = solved.index.size, phases.open.level.size
    own, other = (UPPER, LOWER) if high else (LOWER, UPPER)
    walls = walls_of(phases, mirrored=problem.symmetric)
    every, Omega = np.arange(count), cells.Omega[solved.index]
    damped = phases.damping > 0.0
    pushing = walls.copy()
    pushing[own, a] = math.inf if own == UPPER else -math.inf
    pushing[LOWER, force] = 0.0
    begins = np.where(solved.regained | (not damped), force, _NONE)
    contact = Leg(
        phases.loaded, cells.loaded[solved.index], solved.loaded, solved.loaded_error,
        solved.phase, np.zeros(count), solved.d, pushing, begins, np.full(count, force), LOWER,
        np.full(count, LOWER),
    )  # fmt: skip
    every_leg = [(contact, every)]
    leaves = np.zeros(count)
    if damped:
        leaves = _wall_left(phases, cells, solved)
        stays = ~np.isfinite(leaves)
        length = np.where(stays, solved.rest, leaves)
        beyond = walls.copy()
        beyond[other, a], beyond[own, a] = walls[own, a], math.inf if high else -math.inf
        beyond[UPPER, force] = 0.0
        ends, end_side = np.where(stays, force, a), np.where(stays, UPPER, other)
        # A phase that begins at the wall has left it before: the force is regained at once.
        released = Leg(
            phases.open, cells.opened[solved.index], solved.left, solved.left_error,
            solved.phase + Omega * solved.d, solved.d, length, beyond, np.full(count, force), ends,
            UPPER, end_side,
        )  # fmt: skip
        every_leg.append((released, every))
        leaves = np.where(stays, solved.rest, leaves)
    free = np.flatnonzero(leaves < solved.rest)
    state, error = solved.left[free], solved.left_error[free]
    if damped:
        state = prescribed.apply(phases.open.propagators(leaves[free]), state)
    since = solved.d[free] + leaves[free]
    index = solved.index[free]
    free_leg = Leg(
        phases.open, cells.opened[index], state, error, solved.phase[free] + Omega[free] * since,
        since, solved.rest[free] - leaves[free], walls, np.full(free.size, a),
        np.full(free.size, a), own,
        np.full(free.size, own if cells.sign > 0.0 else other),
    )  # fmt: skip
    every_leg.append((free_leg, free))
    return every_leg


def walls_of(phases: Phases | Scenes, *, mirrored: bool, forces: int = 1) -> Floats:
    """Return walls of all coordinates, and of forces, which have none, (2, constraint + force)."""
    lower, upper = phases.stopped.walls
    walls = np.full((2, lower.size + forces), math.inf)
    walls[LOWER] *= -1.0
    walls[LOWER, : lower.size], walls[UPPER, : lower.size] = -lower, upper
    if mirrored:  # the mirrored half keeps the mirrored limits
        upper = np.minimum(walls[UPPER], -walls[LOWER])
        walls = np.ascontiguousarray([-upper, upper])
    for a in range(lower.size):
        if not phases.stopped.acts(a):
            walls[:, a] = -math.inf, math.inf
    return walls


def check(harmonics: Floats, Omega: Floats, leg: Leg) -> NDArray[np.void]:
    """Return the verdicts of parts of solutions, of `limit_check.VERDICT`.

    Omega has a frequency for each part.
    """
    side, n, forces = leg.side, leg.side.size, leg.forces
    if forces is None:
        numbers = np.array([side.force_level]), np.array([side.force_size])
        forces = Forces(side.force[np.newaxis], *numbers)
    flat = np.concatenate([side.position, forces.forms])
    forms = np.ascontiguousarray(flat.reshape(len(flat), 2, n))
    rates = side.basis.rates_of(forms)
    level = np.append(side.level, forces.levels)
    watched = Coordinates(
        forms, rates, side.basis.rates_of(rates), side.pairs.third_derivatives(forms),
        np.maximum(side.growth, 0.0), level, leg.walls, np.zeros((2, level.size)),
    )  # fmt: skip
    turned = np.exp(1j * leg.phase[:, np.newaxis] * harmonics)
    amplitude = np.einsum("mhi,ci->mch", leg.steady, flat) * turned[:, np.newaxis]
    lengths = np.hypot(flat[:, :n], flat[:, n:])
    error = leg.error @ lengths.T
    shapes = side.shape_error + 8.0 * EPS
    error += shapes * (np.abs(amplitude).sum(axis=-1) + np.abs(leg.state) @ np.abs(flat).T)
    error += 8.0 * EPS * np.append(np.abs(side.level), forces.sizes)
    count = leg.length.size
    motions = FreeMotions(
        np.ascontiguousarray(leg.state.reshape(count, 2, n)), np.ascontiguousarray(leg.length),
        np.ascontiguousarray(Omega[:, np.newaxis] * harmonics),
        np.ascontiguousarray(amplitude.real), np.ascontiguousarray(amplitude.imag),
        leg.first, leg.last, np.full(count, leg.first_side), leg.last_side,
        np.ascontiguousarray(error),
    )  # fmt: skip
    decided = np.zeros(count, VERDICT)
    check_limits(side.pairs.flow, watched, motions, decided)
    return decided


def _wall_left(phases: Phases, cells: Cells, solved: Solutions) -> Floats:
    """Return how long after the contact phase coordinates first leave the wall, inf for never."""
    a, side = phases.impact.constraint, phases.impact.side
    count = solved.index.size
    leaves = np.full(count, np.inf)
    form, level = side * phases.open.position[a], side * phases.open.level[a] - phases.wall
    push = cells.opened[solved.index] @ form
    Omega = cells.Omega[solved.index]

    def indentation(k: int, times: Floats) -> Floats:
        moved = prescribed.apply(
            phases.open.propagators(times), np.broadcast_to(solved.left[k], (times.size, form.size))
        )
        phase = solved.phase[k] + Omega[k] * (solved.d[k] + times)
        turned = np.exp(1j * phase[:, np.newaxis] * phases.harmonics)
        return np.asarray(moved @ form + (turned * push[k]).real.sum(axis=1) + level)

    moving = phases.open.pairs.moving
    for k in range(count):
        look()
        rest = float(solved.rest[k])
        slow = phases.open.growth[moving] * rest > -prescribed.GONE * 8.0
        fastest = float(phases.open.rate[moving][slow].max(initial=Omega[k]))
        left = first_left(partial(indentation, k), rest, fastest, released=True)
        if left is not None:
            at_end = left > rest * (1.0 - 1e-12)
            leaves[k] = np.inf if at_end and solved.regained[k] else left
    return leaves


def first_left(
    beyond: Callable[[Floats], Floats], length: float, fastest: float, *, released: bool
) -> float | None:
    """Return the first time at which a coordinate is not beyond its wall; None if there is none.

    Parameters
    ----------
    beyond : callable
        Its distances beyond the wall at times from 0 to the length.
    length : float
    fastest : float
        Angular frequency of the fastest mode.
    released : bool
        Whether the stop loses its force at time 0, when it is beyond the wall or at it.
    """
    nodes = int(min(_NODES, 8 + _PARTS * fastest * length / (2.0 * math.pi)))
    # Close together at the beginning, where the force may have been lost just now, and at the end:
    # a stop that begins to push at its wall there has left it before, for however short a time.
    places = np.union1d(np.linspace(0.0, 1.0, nodes) ** 2, 1.0 - 0.5 ** np.arange(1, _LATE))
    times = length * places
    seen = beyond(times) <= 0.0
    seen[0] &= not released
    if not seen.any():
        return None
    high = int(np.argmax(seen))
    if high == 0:
        return 0.0
    low_time, high_time = float(times[high - 1]), float(times[high])
    for _ in range(_HALVINGS):
        middle = 0.5 * (low_time + high_time)
        if not low_time < middle < high_time:
            break
        if beyond(np.array([middle]))[0] <= 0.0:
            high_time = middle
        else:
            low_time = middle
    return min(high_time, length)
