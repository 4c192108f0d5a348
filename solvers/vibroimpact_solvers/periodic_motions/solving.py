"""Solution of problems of periodic motions by their plans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import along
from vibroimpact_solvers.meter import metered
from vibroimpact_solvers.periodic_motions import columns, free_bodies, sequences, single, stops
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.planning import Method
from vibroimpact_solvers.periodic_motions.problem import Problem
from vibroimpact_solvers.periodic_motions.solutions import Cells, without_impacts
from vibroimpact_solvers.plan import Plan, Stage, Tick, batches
from vibroimpact_solvers.results.periodic_motions import Result

_STATEMENT: Final = (
    "estimate: roundings and errors of natural modes, counted in every sum and carried to first "
    "order through the equations of the impacts; work and energy lost: by these errors and their "
    "difference, which is zero in exact arithmetic; extremes and multipliers: to first order"
)
_BLOCK = 2e6  # numbers in the states of a block of frequencies


@metered
def solve(problem: Problem, plan: Plan, tick: Tick | None = None) -> Result:
    """Compute what the plan lists.

    Parameters
    ----------
    problem : Problem
    plan : Plan
        From `plan(problem)`.
    tick : callable, optional
        Called with (done, total) frequencies; may raise `Cancelled`.
    """
    if problem.stopped:
        return join(problem, plan, stops.solve(problem, plan, tick))
    step = plan.step(Stage.SPECTRUM)
    assert step is not None
    driven = Driven.of(problem, spectrum.Method(step.method))
    free_bodies.sentence(problem, driven)
    numbers = 2 * driven.pairs.alpha.size * (4 + driven.harmonics.size)
    most = driven.harmonics.max(initial=1.0)  # there may be twice as many solutions at each
    block = max(1, int(_BLOCK / (numbers * most)))
    pieces = []
    for start, stop in batches(problem.Omega.size, block, tick):
        pieces.append(_solve_block(problem.slice(start, stop), plan, driven))
    return join(problem, plan, pieces)


def join(problem: Problem, plan: Plan, results: Sequence[Result]) -> Result:
    """Concatenate the results of all pieces."""
    if len(results) == 1:
        return results[0]
    frequencies, rows, shifted = 0, 0, []
    for result in results:
        index = result.solution_frequency_index + frequencies
        of = result.impact_solution + rows
        touching = result.contact_solution
        touching = None if touching is None else touching + rows
        changed: dict[str, Any] = {"solution_frequency_index": index, "impact_solution": of}
        shifted.append(replace(result, **changed, contact_solution=touching))
        frequencies, rows = frequencies + result.Omega.size, rows + index.size
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(result, name) for result in shifted])
        for name in along(Result, "frequency", "solution", "impact", "contact")
        if getattr(shifted[0], name) is not None
    }
    return replace(shifted[0], **joined)


def split(problem: Problem, plan: Plan, seconds: float) -> list[Problem]:
    """Cut a problem into ranges of frequency of about that cost.

    Searches from many starts are not cut: each frequency begins with the solutions of the one
    before.
    """
    if problem.searched:
        return [problem]
    each = plan.seconds / problem.Omega.size
    size = max(1, int(seconds / each))
    total = problem.Omega.size
    return [problem.slice(k, min(k + size, total)) for k in range(0, total, size)]


def _solve_block(problem: Problem, plan: Plan, driven: Driven) -> Result:
    """Solve a problem at some frequencies."""
    cells = Cells.of(driven, problem)
    step = plan.step(Stage.IMPULSE)
    assert step is not None
    if step.method == Method.CLOSED_FORM:
        struck, complete = single.solutions(driven, cells, problem)
    else:
        struck = sequences.solutions(driven, cells, problem)
        complete = np.zeros(cells.Omega.size, dtype=bool)  # from starts, they may be missed
    parts = [columns.of(problem, driven, cells, struck)]
    if driven.harmonics.size and not driven.balance.loaded:
        # Without impacts, half of a period says nothing that the whole does not.
        whole = cells if cells.sign > 0.0 else cells.doubled()
        parts.insert(0, columns.of(problem, driven, whole, without_impacts(whole)))
    return columns.result_of(problem, columns.merged(parts), complete, _STATEMENT)
