"""Plans slow flows: the variant, the exact motion to compare it with, and what is skipped."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from vibroimpact_solvers.errors import PlanError
from vibroimpact_solvers.plan import Plan, Skip, Stage, Step
from vibroimpact_solvers.slow_flow.lossy_motion import MOST, too_many
from vibroimpact_solvers.slow_flow.problem import KIND, OUTPUTS, Problem

_EACH: Final = 300.0  # operations for one time
_IMPACT: Final = 2000.0  # operations for one impact of the exact motion, at most
_PATIENCE: Final = 1e11  # operations of an integration


def plan(problem: Problem) -> Plan:
    """Decide what is computed and what is left out."""
    return Plan(KIND, tuple(_steps(problem)), tuple(_skips(problem)))


def _steps(problem: Problem) -> Iterator[Step]:
    variant = problem.moving.VARIANTS[problem.variant]
    impacts = problem.moving.expected_impacts(float(problem.t.max()))
    if impacts > MOST:
        raise too_many(impacts)
    following = variant.impact_flops * impacts
    if following > _PATIENCE:
        message = f"{variant.about}: about {impacts:.3g} impacts would take too long"
        raise PlanError(message, ("t",))
    size, dofs = problem.t.size, problem.system.n
    columns = 4.0 + (1.0 + 2.0 * dofs) * len(problem.outputs & {"x", "v", "impulse"})
    columns += (7.0 + 3.0 * dofs) * ("error" in problem.outputs)
    flops = _EACH * size + following
    yield Step(
        Stage.SLOW_FLOW,
        variant.method,
        variant.about,
        flops,
        8.0 * columns * size,
        bounded=following == 0.0,
    )
    if problem.compares and problem.variant != "exact":
        exact = problem.moving.VARIANTS["exact"]
        yield Step(
            Stage.FREE_MOTION,
            exact.method,
            f"the exact motion, with which {problem.variant} is compared: {exact.about}",
            _EACH * size + _IMPACT * impacts,
            8.0 * dofs * size + 64.0 * impacts,
            bounded=False,
        )


def _skips(problem: Problem) -> Iterator[Skip]:
    for name in OUTPUTS:
        if name not in problem.outputs:
            yield Skip(name, "not requested")
    if problem.compares and problem.variant == "exact":
        yield Skip("a second solution for the error", "the variant is the exact one")
