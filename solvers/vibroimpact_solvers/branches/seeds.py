"""Where branches begin: all motions that exist at a value of the parameter."""

from __future__ import annotations

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.branches.changes import Changing
from vibroimpact_solvers.branches.curve import Curve
from vibroimpact_solvers.branches.impacts import Impacts
from vibroimpact_solvers.branches.problem import Problem
from vibroimpact_solvers.branches.structures import Structures
from vibroimpact_solvers.errors import SolverError, attempt
from vibroimpact_solvers.periodic_motions import Problem as Motions
from vibroimpact_solvers.periodic_motions.stops import sequences
from vibroimpact_solvers.periodic_motions.stops.orbit_columns import Checked
from vibroimpact_solvers.periodic_motions.stops.orbit_existence import verdict
from vibroimpact_solvers.periodic_motions.stops.orbits import (
    Kind,
    Orbit,
    Switching,
    newton,
    orbit,
)
from vibroimpact_solvers.periodic_motions.stops.phases import Phases
from vibroimpact_solvers.periodic_motions.stops.prescribed import Cells
from vibroimpact_solvers.periodic_motions.stops.scenes import Cell, Scenes
from vibroimpact_solvers.periodic_motions.stops.search import Search
from vibroimpact_solvers.plan import Tick
from vibroimpact_solvers.results.impact_modes import Reason

Seed = tuple[Curve, Floats]
"""A curve and a point of it."""


def with_impacts(problem: Problem, starts: tuple[float, ...], tick: Tick, total: int) -> list[Seed]:
    """Return the motions with impacts at values of the parameter, as parts of its range."""
    curve, groups = Impacts(problem, problem.at), list[list[Floats]]()
    for k, x in enumerate(starts):
        tick(k, total)
        some = attempt(curve.start, x)
        groups.append([] if isinstance(some, SolverError) else some)
    return [(curve, x) for group in curve.scaled(groups) for x in group]


def with_contacts(
    problem: Problem, starts: tuple[float, ...], tick: Tick, total: int, structures: Structures
) -> list[Seed]:
    """Return the motions with stops of finite stiffness that exist, at values of the parameter."""
    seeds = list[Seed]()
    for k, x in enumerate(starts):
        tick(k, total)
        orbits = attempt(_orbits, problem, structures, x)
        for one in () if isinstance(orbits, SolverError) else orbits:
            curve = Changing(problem, problem.at, structures, one.before[0], one.switchings)
            seeds.append((curve, curve.begin(one, x)))
    return seeds


def _orbits(problem: Problem, structures: Structures, x: float) -> list[Orbit]:
    """Return the motions at a value of the parameter that exist."""
    value = float(problem.start + x * (problem.stop - problem.start))
    motions, scenes = problem.at(value), structures.at(value)
    cell = Cell(scenes, float(motions.Omega[0]), motions.periods)
    if motions.searched:
        each = [one.orbit for one in next(sequences.solutions(motions, scenes))]
    else:
        each = _isolated(motions, scenes, cell)
    held = [] if motions.symmetric else [((i.constraint, i.side),) for i in motions.impacts]
    still = [orbit(cell, before, (), np.zeros(0)) for before in ((), *dict.fromkeys(held))]
    every = [one for one in still if one is not None]
    every += [one for one in each if one.switchings]
    return [one for one in every if verdict(one, Checked.of(one).errors).reason == Reason.OK]


def _isolated(motions: Motions, scenes: Scenes, cell: Cell) -> list[Orbit]:
    """Return the motions with one contact in a period, or in half of it, that are isolated."""
    phases = Phases.of(motions, spectrum.choose(motions.system))
    cells = Cells.of(phases, motions)
    solved, _ = Search(motions, phases).contacts(cells)
    impact, orbits = phases.impact, list[Orbit]()
    stretch = scenes.scale / phases.scale
    for k in range(solved.index.size):
        kind = Kind.REGAINED if solved.regained[k] else Kind.WALL
        pair = [Switching(each, impact.constraint, impact.side) for each in (kind, Kind.LOST)]
        begin = float(solved.phase[k]) / cell.Omega
        times = [begin, begin + stretch * float(solved.d[k])]
        if motions.symmetric:
            pair += [Switching(each.kind, each.constraint, -each.side) for each in pair]
            times += [time + 0.5 * cell.length for time in times]
        one = newton(cell, (), tuple(pair), np.array(times))
        if one is not None:
            orbits.append(one)
    return orbits
