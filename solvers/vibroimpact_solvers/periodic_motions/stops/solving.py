"""Solution of problems with stops of finite stiffness, by their plans."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.periodic_motions.columns import merged, result_of
from vibroimpact_solvers.periodic_motions.problem import Problem
from vibroimpact_solvers.periodic_motions.stops import columns
from vibroimpact_solvers.periodic_motions.stops.linear import Linear
from vibroimpact_solvers.periodic_motions.stops.phases import Phases
from vibroimpact_solvers.periodic_motions.stops.prescribed import Cells
from vibroimpact_solvers.periodic_motions.stops.search import Search
from vibroimpact_solvers.plan import Plan, Stage, Tick, batches
from vibroimpact_solvers.results.periodic_motions import Result

_STATEMENT: Final = (
    "estimate: roundings and errors of the modes with the stop open and loaded, taken as "
    "independent and carried to first order through the equation of the period, four times the "
    "root of the sum of their squares; work and energy lost: by these errors and their "
    "difference, which is zero in exact arithmetic"
)
_TOGETHER: Final = 16  # frequencies


def solve(problem: Problem, plan: Plan, tick: Tick | None = None) -> list[Result]:
    """Return the results of ranges of frequencies."""
    step = plan.step(Stage.SPECTRUM)
    assert step is not None
    phases = Phases.of(problem, spectrum.Method(step.method))
    search = Search(problem, phases)
    return [
        _solve_block(problem.slice(first, last), phases, search)
        for first, last in batches(problem.Omega.size, _TOGETHER, tick)
    ]


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
