"""Solution of many impact-mode problems with common responses, each as if it were alone.

Problems that differ only in the positions of walls share their responses; those that differ only
in frequencies are concatenated. The results are the same to the last bit, as solutions do not
depend on other frequencies and walls.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import SolverError, attempt
from vibroimpact_solvers.impact_modes.family import Family
from vibroimpact_solvers.impact_modes.family_solver import FamilySolver
from vibroimpact_solvers.impact_modes.pieces import content
from vibroimpact_solvers.impact_modes.planning import (
    decides_in_balls,
    method_depends_on_frequencies,
    plan,
)
from vibroimpact_solvers.impact_modes.problem import Problem
from vibroimpact_solvers.impact_modes.solving import solve, solve_alike
from vibroimpact_solvers.plan import Stage, Tick
from vibroimpact_solvers.results.impact_modes import Result, part

Outcome = Result | SolverError
Item = TypeVar("Item")


def response_count(problem: Problem) -> int:
    """Return the number of responses of a problem: one for each frequency."""
    return problem.omega.size


def solve_many(
    problems: Sequence[Problem], tell: Callable[[], None] = lambda: None
) -> list[Outcome]:
    """Return the result of each problem, to the last bit that of `solve`, or its error.

    `tell` is called while it runs and may raise to stop it.
    """

    def tick(done: int, total: int) -> None:
        tell()

    outcomes: dict[int, Outcome] = {}
    for group in _groups(range(len(problems)), lambda i: _structure(problems[i])):
        if method_depends_on_frequencies(problems[group[0]]):
            outcomes |= {i: attempt(_alone, problems[i], tick) for i in group}
        else:
            outcomes |= _shared({i: problems[i] for i in group}, tick)
    return [outcomes[i] for i in range(len(problems))]


def _alone(problem: Problem, tick: Tick) -> Result:
    return solve(problem, plan(problem), tick)


def _groups(items: Iterable[Item], key: Callable[[Item], Hashable]) -> list[list[Item]]:
    groups: dict[Hashable, list[Item]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return list(groups.values())


def _structure(problem: Problem) -> Hashable:
    """Return all that must be equal for problems to share responses."""
    system, family = problem.system, Family.of(problem)
    force = b"" if system.force is None else system.force.tobytes()
    lines = tuple(c.coordinate for c in system.constraints)
    places = problem.output_dofs.tobytes(), problem.times.tobytes()
    in_balls = decides_in_balls(problem)
    options = in_balls, problem.active, problem.outputs, problem.highest_harmonic, problem.tolerance
    return id(system.M), id(system.K), force, lines, family, options, places


def _walls(problem: Problem) -> Hashable:
    return tuple((c.lower, c.upper, c.restitution) for c in problem.system.constraints)


def _shared(problems: dict[int, Problem], tick: Tick) -> dict[int, Outcome]:
    """Solve problems of one structure."""
    first = next(iter(problems.values()))
    common = attempt(plan, first)
    if isinstance(common, SolverError):
        return dict.fromkeys(problems, common)
    step = common.step(Stage.SPECTRUM)
    natural = spectrum.spectrum(first.system, spectrum.Method(step.method))
    outcomes: dict[int, Outcome] = {}
    ready: list[tuple[FamilySolver, list[list[int]]]] = []
    for same_walls in _groups(problems, lambda i: _walls(problems[i])):
        solver = attempt(FamilySolver, problems[same_walls[0]], common, natural)
        if isinstance(solver, SolverError):
            outcomes |= dict.fromkeys(same_walls, solver)
        else:
            ready.append((solver, _groups(same_walls, lambda i: content(problems[i]))))
    for alike in _groups(ready, lambda pair: tuple(content(problems[g[0]]) for g in pair[1])):
        places = [[grid[0] for grid in grids] for _, grids in alike]
        outcomes |= _product(problems, [solver for solver, _ in alike], places, tick)
    # Problems that are equal have one result.
    equal = {i: grid[0] for _, grids in ready for grid in grids for i in grid}
    return {i: outcomes[equal.get(i, i)] for i in problems}


def _product(
    problems: dict[int, Problem],
    solvers: Sequence[FamilySolver],
    places: Sequence[Sequence[int]],
    tick: Tick,
) -> dict[int, Outcome]:
    """Solve all combinations of some walls and some grids of frequencies.

    `places` are the keys of the problems, shape (walls, grid).
    """
    whole = [_merged([problems[i] for i in row]) for row in places]
    bounds = np.cumsum([0, *(problems[i].omega.size for i in places[0])]).tolist()
    outcomes: dict[int, Outcome] = {}
    for row, result in zip(places, solve_alike(whole, solvers, tick), strict=True):
        for k, i in enumerate(row):
            outcomes[i] = part(result, bounds[k], bounds[k + 1])
    return outcomes


def _merged(problems: Sequence[Problem]) -> Problem:
    """Return one problem with the frequencies of all."""

    def concatenated(arrays: Iterable[Floats | None]) -> Floats:
        return np.concatenate([array for array in arrays if array is not None])

    if len(problems) == 1:
        return problems[0]
    return replace(
        problems[0],
        omega=concatenated(p.omega for p in problems),
        Omega=concatenated(p.Omega for p in problems),
        rounding=concatenated(p.rounding for p in problems),
    )
