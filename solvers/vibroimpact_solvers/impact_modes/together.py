"""Solves many problems of impact modes with the same natural modes, as if each were alone.

Problems that differ only in the places of walls share their responses; those that differ only
in frequencies are put one after the other. Neither changes a bit of any of them: members do not
depend on the frequencies and walls beside them.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import Cancelled, SolverError
from vibroimpact_solvers.impact_modes.family import Family
from vibroimpact_solvers.impact_modes.planning import ALWAYS_MODAL, plan
from vibroimpact_solvers.impact_modes.problem import Problem
from vibroimpact_solvers.impact_modes.result import Result, part
from vibroimpact_solvers.impact_modes.solving import Members, Tick, solve, solve_alike
from vibroimpact_solvers.plan import Stage

Outcome = Result | SolverError
Item = TypeVar("Item")


def members(problem: Problem) -> int:
    """Return how many responses a problem asks for: one for each frequency."""
    return problem.omega.size


def together(problems: Sequence[Problem], tell: Callable[[], None] = lambda: None) -> list[Outcome]:
    """Return the result of each problem, to the last bit what `solve` returns, or its error.

    `tell` is called now and then and may raise to stop it.
    """

    def tick(done: int, total: int) -> None:
        tell()

    found: dict[int, Outcome] = {}
    for group in _groups(range(len(problems)), lambda i: _structure(problems[i])):
        if problems[group[0]].system.n > ALWAYS_MODAL:
            # The method may depend on the frequencies: each by the plan that it has alone.
            found |= {i: _attempt(_alone, problems[i], tick) for i in group}
        else:
            found |= _shared({i: problems[i] for i in group}, tick)
    return [found[i] for i in range(len(problems))]


def _alone(problem: Problem, tick: Tick) -> Result:
    return solve(problem, plan(problem), tick)


def _attempt(work: Callable[..., Any], *args: Any) -> Any:
    """Return what some work returns, or the error that it ends in."""
    try:
        return work(*args)
    except Cancelled:
        raise
    except SolverError as error:
        return error


def _groups(items: Iterable[Item], key: Callable[[Item], Hashable]) -> list[list[Item]]:
    found: dict[Hashable, list[Item]] = {}
    for item in items:
        found.setdefault(key(item), []).append(item)
    return list(found.values())


def _structure(problem: Problem) -> Hashable:
    """Return what problems must have in common to share responses."""
    system, family = problem.system, Family.of(problem)
    force = b"" if system.force is None else system.force.tobytes()
    lines = tuple(c.coordinate for c in system.constraints)
    places = problem.wanted_dofs.tobytes(), problem.times.tobytes()
    asked = problem.active, problem.outputs, problem.highest_harmonic, problem.tolerance
    return id(system.M), id(system.K), force, lines, family, asked, places


def _walls(problem: Problem) -> Hashable:
    return tuple((c.lower, c.upper, c.restitution) for c in problem.system.constraints)


def _grid(problem: Problem) -> bytes:
    assert problem.rests is not None
    grid = (problem.omega, problem.fundamental, problem.rests)
    return b"".join(array.tobytes() for array in grid)


def _shared(problems: dict[int, Problem], tick: Tick) -> dict[int, Outcome]:
    """Solve problems of one structure."""
    first = next(iter(problems.values()))
    agreed = _attempt(plan, first)
    if isinstance(agreed, SolverError):
        return dict.fromkeys(problems, agreed)
    step = agreed.step(Stage.SPECTRUM)
    natural = spectrum.spectrum(first.system, spectrum.Method(step.method))
    found: dict[int, Outcome] = {}
    ready: list[tuple[Members, list[list[int]]]] = []
    for same in _groups(problems, lambda i: _walls(problems[i])):
        one = _attempt(Members, problems[same[0]], agreed, natural)
        if isinstance(one, SolverError):
            found |= dict.fromkeys(same, one)
        else:
            grids = _groups(same, lambda i: _grid(problems[i]))
            ready.append((one, grids))
    for alike in _groups(ready, lambda pair: tuple(_grid(problems[g[0]]) for g in pair[1])):
        places = [[grid[0] for grid in grids] for _, grids in alike]
        found |= _product(problems, [m for m, _ in alike], places, tick)
    # Problems that are equal have one result.
    equal = {i: grid[0] for _, grids in ready for grid in grids for i in grid}
    return {i: found[equal.get(i, i)] for i in problems}


def _product(
    problems: dict[int, Problem],
    members: Sequence[Members],
    places: Sequence[Sequence[int]],
    tick: Tick,
) -> dict[int, Outcome]:
    """Solve all combinations of some walls and some grids of frequencies.

    `places` names the problems, shape (walls, grid).
    """
    whole = [_merged([problems[i] for i in row]) for row in places]
    bounds = np.cumsum([0, *(problems[i].omega.size for i in places[0])]).tolist()
    found: dict[int, Outcome] = {}
    for row, result in zip(places, solve_alike(whole, members, tick), strict=True):
        for k, i in enumerate(row):
            found[i] = part(result, bounds[k], bounds[k + 1])
    return found


def _merged(problems: Sequence[Problem]) -> Problem:
    """Return one problem with the frequencies of all."""

    def put(arrays: Iterable[Floats | None]) -> Floats:
        return np.concatenate([array for array in arrays if array is not None])

    if len(problems) == 1:
        return problems[0]
    return replace(
        problems[0],
        omega=put(p.omega for p in problems),
        Omega=put(p.Omega for p in problems),
        rests=put(p.rests for p in problems),
    )
