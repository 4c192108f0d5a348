"""Solution of problems with stops of finite stiffness, by their plans."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.periodic_motions.columns import merged, result_of
from vibroimpact_solvers.periodic_motions.problem import Problem
from vibroimpact_solvers.periodic_motions.stops import columns, orbit_columns, sequences
from vibroimpact_solvers.periodic_motions.stops.linear import Linear
from vibroimpact_solvers.periodic_motions.stops.moving_walls import at_rest
from vibroimpact_solvers.periodic_motions.stops.phases import Phases, check_held
from vibroimpact_solvers.periodic_motions.stops.prescribed import Cells
from vibroimpact_solvers.periodic_motions.stops.scenes import Scenes
from vibroimpact_solvers.periodic_motions.stops.search import Search
from vibroimpact_solvers.plan import Plan, Stage, Tick, batches
from vibroimpact_solvers.results.periodic_motions import Result

_STATEMENT: Final = (
    "estimate: roundings and errors of the modes with stops open and loaded, taken as "
    "independent and carried to first order through the equations of the period, four times the "
    "root of the sum of their squares; work and energy lost: by these errors and their "
    "difference, which is zero in exact arithmetic"
)
_TOGETHER: Final = 16  # frequencies


def solve(problem: Problem, plan: Plan, tick: Tick | None = None) -> list[Result]:
    """Return the results of ranges of frequencies."""
    if problem.moving:
        each = batches(problem.Omega.size, 1, tick)
        return [solve(at_rest(problem.slice(*one)), plan)[0] for one in each]
    step = plan.step(Stage.SPECTRUM)
    assert step is not None
    if problem.searched:
        return _searched(problem, spectrum.Method(step.method), tick)
    phases = Phases.of(problem, spectrum.Method(step.method))
    search = Search(problem, phases)
    return [
        _solve_block(problem.slice(first, last), phases, search)
        for first, last in batches(problem.Omega.size, _TOGETHER, tick)
    ]


def _searched(problem: Problem, method: spectrum.Method, tick: Tick | None) -> list[Result]:
    """Return the results of all frequencies, each begun with the solutions of the one before."""
    longest = 2.0 * math.pi / float(problem.Omega[0])
    scenes = Scenes(problem.system, problem.forces(), longest, method, problem.frame)
    check_held(scenes.stopped, problem)
    each, results = sequences.solutions(problem, scenes), list[Result]()
    for first, last in batches(problem.Omega.size, 1, tick):
        motions = [(0, one) for one in next(each)]
        tables = orbit_columns.of(problem, scenes, motions) | columns.no_impacts()
        unproved = np.zeros(1, dtype=bool)  # from starts, some may be missed
        results.append(result_of(problem.slice(first, last), tables, unproved, _STATEMENT))
    return results


def _solve_block(problem: Problem, phases: Phases, search: Search) -> Result:
    cells = Cells.of(phases, problem)
    whole = replace(cells, length=2.0 * cells.length, sign=1.0) if problem.symmetric else cells
    parts = [columns.of_linear(problem, Linear(phases, whole, held=False))]
    if not problem.symmetric:
        parts.append(columns.of_linear(problem, Linear(phases, whole, held=True)))
    struck, complete = search.contacts(cells)
    parts.append(columns.of(problem, phases, cells, struck))
    tables = merged(parts, "contact") | columns.no_impacts()
    return result_of(problem, tables, complete, _STATEMENT)
