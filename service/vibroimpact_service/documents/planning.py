"""A checked request to the solver's problem and its plan."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Final, NamedTuple

from vibroimpact_schema.branches import BranchesRequest
from vibroimpact_schema.calibrations import CalibrationRequest
from vibroimpact_schema.sweeps import SweepRequest
from vibroimpact_schema.systems import StructuralDamping, SystemReference
from vibroimpact_service import problems
from vibroimpact_service.documents import limits, parse, stored_systems
from vibroimpact_service.kinds import Kind
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store
from vibroimpact_solvers.errors import ModelError, PlanError, SolverError
from vibroimpact_solvers.plan import Plan, Skip, Stage, Tick


class Planned(NamedTuple):
    """A problem of the kind's solver and the plan of its solution."""

    kind: Kind
    problem: Any
    plan: Plan
    seconds: float
    """Estimated time of the plan on one core."""


def _used() -> tuple[float, float]:
    """Return the processor time of this thread, without that of the system if possible, and all.

    Where a virtual machine touches memory for the first time, the system takes ten times as long as
    what is computed in it; memory is limited by sizes. But it samples whom it computes for: of a
    thread that has run for long, the first number may jump by more than a plan takes.
    """
    whole = time.thread_time()
    if sys.platform != "linux":
        return whole, whole
    import resource

    return resource.getrusage(resource.RUSAGE_THREAD).ru_utime, whole


class _Meter:
    """Ends a plan that takes too much processor time, or that nobody waits for any more.

    `where` is the path of the field that is blamed.
    """

    def __init__(
        self, settings: Settings | None, tick: Tick | None, where: tuple[str, ...]
    ) -> None:
        self._tick, self._where = tick, where
        self._seconds = math.inf if settings is None else settings.plan_seconds
        self._begun = math.inf, math.inf

    def begin(self, more: float) -> None:
        """Begin to count; so many seconds more are allowed."""
        self._seconds += more
        self._begun = _used()

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
        if math.isinf(self._seconds):
            return
        used = min(now - then for now, then in zip(_used(), self._begun, strict=True))
        if used > self._seconds:
            message = f"The plan alone takes more than {self._seconds:g} s: ask for less at once."
            raise limits.too_costly(problems.pointer(self._where), "plan_too_long", message)


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
    from vibroimpact_service.documents import branch_paths, damped, decode, sweep_axes, unknowns

    sent_system = document.system
    if isinstance(document.system, SystemReference):
        stored = stored_systems.resolve(store, document.system, *kind.structure)
        document = document.with_system(stored)
    if settings is not None:
        limits.check(document, settings)
    limits.check_grids(document)
    try:
        system = decode.system(document.system)
    except ModelError as error:
        raise problems.of(error.under(*kind.structure)) from None
    solver = kind.solver
    try:
        # Garbage of others, which any thread may be made to collect, is no work of this plan.
        with parse.uncollected():
            meter.begin(_for_factors(system))
            meter()
            if isinstance(document, SweepRequest):
                problem: Any = sweep_axes.problem(document, system, meter)
                planned = _plan_of_sweep(problem, meter)
            elif isinstance(document, BranchesRequest):
                problem = branch_paths.problem(document, system)
                planned = solver.plan(problem)
            elif isinstance(document, CalibrationRequest):
                problem = unknowns.problem(document, system)
                planned = solver.plan(problem)
            else:
                problem = decode.problem(kind, document, system, meter)
                meter()
                planned = solver.plan(problem)
            meter()
    except SolverError as error:
        raise problems.of(_as_sent(error, kind, sent_system)) from None
    if isinstance(document.system.damping, StructuralDamping):
        remark = Skip(*damped.remark(document.system.damping))
        planned = replace(planned, skips=(*planned.skips, remark))
    if settings is not None:
        joined = hasattr(solver, "follow")
        large = _large(document, planned, settings.max_result_bytes)
        long = partial(costly, kind, document)
        limits.check_plan(planned, settings, joined_in_files=joined, long=long, large=large)
    return Planned(kind, problem, planned, planned.seconds)


_FACTORS_SECONDS: Final = 0.4
_SECONDS_OF_ROWS: Final = 2e-9
"""Time for factors of full and sparse matrices in a plan: of their rows cubed, and at most."""


def _for_factors(system: Any) -> float:
    """Return the time that a plan may take for factors, beside its own: bounds of the modes."""
    from vibroimpact_solvers.matrices import Form

    scattered = any(each.form in {Form.DENSE, Form.SPARSE} for each in (system.M, system.K))
    return min(_FACTORS_SECONDS, _SECONDS_OF_ROWS * system.n**3) if scattered else 0.0


def _as_sent(error: SolverError, kind: Kind, system: Any) -> SolverError:
    """Return an error with a pointer to what was sent for a part of the structure, if it has one.

    A preset has parameters instead, a stored system none of its parts.
    """
    from vibroimpact_solvers import presets

    place = len(kind.structure)
    if not isinstance(error, ModelError | PlanError) or error.pointer[:place] != kind.structure:
        return error
    part = error.pointer[place] if len(error.pointer) > place else None
    if part not in {"M", "K", "C", "force"}:
        return error
    if isinstance(system, SystemReference):
        pointer = kind.structure
    elif (preset := getattr(system, "preset", None)) is not None:
        pointer = (*kind.structure, presets.PARAMETERS[preset].get(str(part), "preset"))
    else:
        return error
    if isinstance(error, PlanError):
        return PlanError(error.message, pointer)
    return ModelError(pointer, error.message, code=error.code)


_LARGE: Final[Mapping[type, str]] = {
    SweepRequest: "/axes",
    BranchesRequest: "/points",
    CalibrationRequest: "/data",
}
"""Documents that do not grow with their outputs -> the field with which their results grow."""


def _large(document: Any, planned: Plan, most: int) -> str:
    """Return the pointer to the field with which the size of a result grows most."""
    motion = planned.step(Stage.FREE_MOTION)
    if motion is not None and motion.bytes > most and "t_end" in type(document).model_fields:
        return "/t_end"  # of its impacts, however many outputs there are beside them
    return _LARGE.get(type(document), "/outputs")


def costly(kind: Kind, document: Any) -> str:
    """Return the pointer to the field of a request with which its computation grows most."""
    own = getattr(document, "root", document)
    name = "t_end" if "t_end" in type(own).model_fields else kind.extent
    return problems.pointer((name,) if name in own.model_fields_set else kind.structure)


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
