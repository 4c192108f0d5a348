"""Solution of impact-mode problems by their plans."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vibroimpact_solvers.arrays import Booleans
from vibroimpact_solvers.impact_modes.family import Impulses
from vibroimpact_solvers.impact_modes.family_solver import (
    FamilyEvaluator,
    FamilySolver,
    PathMotions,
)
from vibroimpact_solvers.impact_modes.modal import ModalFamily
from vibroimpact_solvers.impact_modes.modal import solutions as modal_solutions
from vibroimpact_solvers.impact_modes.problem import Frequencies, Problem
from vibroimpact_solvers.meter import look, metered
from vibroimpact_solvers.plan import Plan, Stage, Tick, batches
from vibroimpact_solvers.results.impact_modes import Result, concatenate


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
    return solve_alike((problem,), (FamilySolver(problem, plan),), tick)[0]


def solve_alike(
    problems: Sequence[Problem], solvers: Sequence[FamilySolver], tick: Tick | None = None
) -> list[Result]:
    """Solve problems that differ only in the positions of walls.

    Their responses are computed once; otherwise each result is that of `solve`.
    """
    total = problems[0].omega.size
    block = max(1, solvers[0].block(problems[0]) // len(problems))
    pieces = []
    for start, stop in batches(total, block, tick):
        look()
        pieces.append(_solve_block(solvers, [p.slice(start, stop) for p in problems]))
    if len(pieces) == 1:
        return pieces[0]
    return [concatenate(results) for results in zip(*pieces, strict=True)]


def join(problem: Problem, plan: Plan, results: Sequence[Result]) -> Result:
    """Concatenate the results of all pieces."""
    return concatenate(results)


def _solve_block(solvers: Sequence[FamilySolver], problems: Sequence[Problem]) -> list[Result]:
    """Solve problems that differ only in the positions of walls, all frequencies at once."""
    evaluators = [solver.evaluator for solver in solvers]
    at, needs_motion = problems[0].frequencies, solvers[0].needs_motion
    solutions = _evaluate(evaluators, at, with_motion=needs_motion)
    impulses, motions = [one[0] for one in solutions], [one[1] for one in solutions]
    look()
    reasons = [np.zeros(at.size, dtype=np.int64)] * len(solvers)
    paths = [PathMotions(np.zeros(at.size, dtype=np.bool_))] * len(solvers)
    if Stage.EXISTENCE in solvers[0].stages:
        reasons = list(map(FamilySolver.reasons, solvers, problems, impulses))
        where = list(map(FamilySolver.needs_path_check, solvers, problems, reasons))
        look()
        paths = _path_motions(evaluators, at, motions if needs_motion else None, where)
    return list(map(FamilySolver.result, solvers, problems, impulses, motions, reasons, paths))


def _path_motions(
    evaluators: Sequence[FamilyEvaluator],
    at: Frequencies,
    motions: Sequence[Any] | None,
    where: Sequence[Booleans],
) -> list[PathMotions]:
    """Return the motions whose paths are checked; they are computed if they are not known."""
    anywhere = np.ones(at.size, dtype=np.bool_)
    if motions is None:
        anywhere = np.logical_or.reduce(where)
        if not anywhere.any():
            return [PathMotions(w) for w in where]
        solutions = _evaluate(evaluators, at[anywhere], with_motion=True)
        motions = [motion for _, motion in solutions]
    return [
        PathMotions(w, motion.at(w[anywhere])) for w, motion in zip(where, motions, strict=True)
    ]


def _evaluate(
    evaluators: Sequence[FamilyEvaluator], at: Frequencies, *, with_motion: bool
) -> list[tuple[Impulses, Any]]:
    """Return impulses and motions, by common responses where there are natural modes."""
    modal = [one for one in evaluators if isinstance(one, ModalFamily)]
    if len(modal) == len(evaluators):
        return modal_solutions(modal, at, with_motion=with_motion)
    return [one.solutions(at, with_motion=with_motion) for one in evaluators]
