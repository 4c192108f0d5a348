"""A checked request to the solver's problem and its plan."""

from __future__ import annotations

from typing import Any, NamedTuple

from vibroimpact_schema.sweeps import SweepRequest
from vibroimpact_schema.systems import SystemReference
from vibroimpact_service import problems
from vibroimpact_service.documents import limits, stored_systems
from vibroimpact_service.kinds import Kind
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store
from vibroimpact_solvers.errors import ModelError, SolverError
from vibroimpact_solvers.plan import Plan


class Planned(NamedTuple):
    """A problem of the kind's solver and the plan of its solution."""

    kind: Kind
    problem: Any
    plan: Plan
    seconds: float
    """Estimated time of the plan on one core."""


def plan(store: Store, kind: Kind, document: Any, settings: Settings | None = None) -> Planned:
    """Return the problem of a request's document, planned.

    With settings, the sizes in the document are compared with the limits before anything of
    that size is allocated.

    Raises
    ------
    ProblemError
        413 or 422 with the field that is wrong.
    """
    # The numerical libraries load at the first request.
    from vibroimpact_service.documents import decode, sweep_axes
    from vibroimpact_solvers import cost

    if isinstance(document.system, SystemReference):
        stored = stored_systems.resolve(store, document.system, *kind.structure)
        document = document.with_system(stored)
    if settings is not None:
        limits.check(document, settings)
    try:
        system = decode.system(document.system)
    except ModelError as error:
        raise problems.of(error.under(*kind.structure)) from None
    try:
        if isinstance(document, SweepRequest):
            problem: Any = sweep_axes.problem(document, system)
        else:
            problem = decode.problem(kind, document, system)
        planned = kind.solver.plan(problem)
    except SolverError as error:
        raise problems.of(error) from None
    if settings is not None:
        limits.check_plan(planned, settings)
    return Planned(kind, problem, planned, cost.seconds(planned))


def steps(planned: Plan) -> dict[str, Any]:
    """Return a plan as the content of its document, `vibroimpact_schema.plans.Steps`."""
    return {
        "steps": [
            {
                "stage": step.stage.value,
                "method": str(step.method),
                "reason": step.reason,
                "flops": float(step.flops),
                "bytes": float(step.bytes),
                "count": step.count,
            }
            for step in planned.steps
        ],
        "skips": [{"what": skip.what, "why": skip.why} for skip in planned.skips],
        "flops": float(planned.flops),
        "bytes": float(planned.bytes),
    }
