"""A checked request to the solver's problem and its plan."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

from vibroimpact_schema.branches import BranchesRequest
from vibroimpact_schema.problems import Fault
from vibroimpact_schema.sweeps import SweepRequest
from vibroimpact_schema.systems import SystemReference
from vibroimpact_service import problems
from vibroimpact_service.documents import limits, stored_systems
from vibroimpact_service.jobs.work import Tick
from vibroimpact_service.kinds import Kind
from vibroimpact_service.problems import ProblemError
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


def _used() -> float:
    """Return the processor time of this thread, without that of the system for it if possible.

    Where a virtual machine touches memory for the first time, that takes ten times as long as what
    is computed in it; memory is limited by sizes.
    """
    if sys.platform != "linux":
        return time.thread_time()
    import resource

    return resource.getrusage(resource.RUSAGE_THREAD).ru_utime


class _Meter:
    """Ends a plan that takes too much processor time, or that nobody waits for any more.

    `where` is the path of the field that is blamed.
    """

    def __init__(
        self, settings: Settings | None, tick: Tick | None, where: tuple[str, ...]
    ) -> None:
        self._tick, self._where = tick, where
        self._seconds = math.inf if settings is None else settings.plan_seconds
        self._end = math.inf

    def begin(self) -> None:
        """Begin to count."""
        self._end = _used() + self._seconds

    def __call__(self) -> None:
        """Raise where the plan is to end.

        Raises
        ------
        ProblemError
            413 where it took too long.
        StoppedError
            Where its caller went away.
        """
        if self._tick is not None:
            self._tick(0, 1)
        if _used() > self._end:
            message = f"The plan alone takes more than {self._seconds:g} s: ask for less at once."
            where = problems.pointer(self._where)
            fault = Fault(pointer=where, code="plan_too_long", message=message)
            raise ProblemError(problems.TOO_COSTLY, message, [fault])


def plan(
    store: Store,
    kind: Kind,
    document: Any,
    settings: Settings | None = None,
    tick: Tick | None = None,
) -> Planned:
    """Return the problem of a request's document, planned.

    With settings, the sizes in the document are compared with the limits before anything of
    that size is allocated, and the time that a plan may take is limited too; that for the
    matrices goes with the size of the body that brought them.

    Raises
    ------
    ProblemError
        413 or 422 with the field that is wrong.
    StoppedError
        Where the tick raises it.
    """
    sent = kind.extent in getattr(document, "root", document).model_fields_set
    meter = _Meter(settings, tick, (kind.extent,) if sent else kind.structure)
    # The numerical libraries load at the first request.
    from vibroimpact_service.documents import branch_paths, decode, sweep_axes
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
    solver = kind.solver
    meter.begin()
    meter()
    try:
        if isinstance(document, SweepRequest):
            problem: Any = sweep_axes.problem(document, system, meter)
            planned = _plan_of_sweep(problem, meter)
        elif isinstance(document, BranchesRequest):
            problem = branch_paths.problem(document, system)
            planned = solver.plan(problem)
        else:
            problem = decode.problem(kind, document, system, meter)
            meter()
            planned = solver.plan(problem)
        meter()
    except SolverError as error:
        raise problems.of(error) from None
    if settings is not None:
        limits.check_plan(planned, settings, joined_in_files=hasattr(solver, "follow"))
    return Planned(kind, problem, planned, cost.seconds(planned))


def _plan_of_sweep(problem: Any, meter: Callable[[], None]) -> Plan:
    """Return the plan of a sweep, which looks for a point that is possible."""
    from vibroimpact_solvers import sweep

    def at(index: tuple[int, ...]) -> Any:
        meter()
        return problem.at(index)

    try:
        return sweep.plan(replace(problem, at=at))
    except ModelError as error:
        message = f"at all points that were tried: {error.message}"
        raise ModelError(error.pointer, message, code=error.code) from None


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
                "bounded": bool(step.bounded),
            }
            for step in planned.steps
        ],
        "skips": [{"what": skip.what, "why": skip.why} for skip in planned.skips],
        "flops": float(planned.flops),
        "bytes": float(planned.bytes),
        "bounded": planned.bounded,
    }
