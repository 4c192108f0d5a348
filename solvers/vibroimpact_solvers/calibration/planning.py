"""Plans of calibrations: how the base is differentiated, how many searches there are, the price."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from vibroimpact_solvers.calibration.fitting import CANDIDATES
from vibroimpact_solvers.calibration.problem import KIND, Point, Problem
from vibroimpact_solvers.errors import ModelError, PlanError
from vibroimpact_solvers.plan import Plan, Skip, Stage, Step

_EACH_SEARCH: Final = 12
"""Evaluations that a search takes on the average of the tests."""
_EACH_END: Final = 12
"""Evaluations for an end of an interval."""
_SEARCHES: Final = 2
"""Searches after which two agree, where the model can be right."""


@dataclass(frozen=True, slots=True)
class Search:
    """Decisions of the searches."""

    starts: int
    evaluations: int
    differences: bool


def plan(problem: Problem) -> Plan:
    """Choose how the base is differentiated and what is left out."""
    base, refusal = _base(problem)
    try:
        of_base = problem.base_kind.solver.plan(base.problem)
    except (ModelError, PlanError) as error:
        raise error.under("base") from None
    unknowns = len(problem.unknowns)
    searches = min(_SEARCHES, problem.starts)
    steps_each = _EACH_SEARCH * searches
    screened = CANDIDATES * (problem.starts - 1)
    profile = "interval" in problem.outputs
    profiled = 2 * unknowns * _EACH_END if profile else 0
    times = 1 + 2 * unknowns if refusal else 1
    evaluations = screened + times * (steps_each + profiled)
    steps = [
        replace(
            step,
            flops=step.flops * (evaluations - (screened if step.stage is Stage.DERIVATIVES else 0)),
            count=evaluations,
            bounded=False,
        )
        for step in of_base.steps  # whose bytes stay: one answer is kept at a time
    ]
    size = float(problem.count * unknowns)
    work = 4.0 * size * unknowns
    kept = 8.0 * (8.0 * problem.count + 6.0 * unknowns * unknowns + 4.0 * unknowns * problem.starts)
    method = "trust region, derivatives" if refusal is None else "trust region, central differences"
    search = Search(problem.starts, problem.evaluations, refusal is not None)
    steps.append(
        Step(
            Stage.FIT, method, _why(problem, refusal), work * steps_each, kept + 32.0 * size,
            steps_each, bounded=False, settings=search,
        )
    )  # fmt: skip
    if profile:
        reason = (
            "least squares over all other unknowns, 3.84 above the minimum; secant for each end"
        )
        steps.append(
            Step(
                Stage.PROFILE, "profile likelihood", reason, work * profiled, 32.0 * unknowns,
                2 * unknowns, bounded=False,
            )
        )  # fmt: skip
    skips = () if profile else (Skip("interval", "not requested"),)
    return Plan(KIND, tuple(steps), (*skips, *_own(of_base.skips)), evaluations, of=problem.kind)


def _own(skips: tuple[Skip, ...]) -> tuple[Skip, ...]:
    """Return what bases leave out by themselves, not what measurements do not need."""
    return tuple(skip for skip in skips if skip.why not in {"not requested", "not asked"})


def _base(problem: Problem) -> tuple[Point, str | None]:
    """Return the base at the starts, and why it has no derivatives, None where it has."""
    if problem.base_kind.without_derivatives:
        return problem.at(problem.start, False), f"{problem.kind} have none"
    try:
        return problem.at(problem.start, True), None
    except ModelError as error:
        if error.pointer[:2] != ("base", "derivatives"):
            raise
        return problem.at(problem.start, False), error.message


def _why(problem: Problem, refusal: str | None) -> str:
    searches = f"{problem.starts} starts" if problem.starts > 1 else "one start"
    ends = "; ends when two searches agree on a fit that the data permits"
    text = f"sum of squared residuals, {searches}{ends if problem.starts > 1 else ''}"
    if refusal is None:
        return f"{text}; derivatives with those of the base"
    return f"{text}; central differences, as the base has no derivatives: {refusal}"
