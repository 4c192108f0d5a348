"""What a request claims to be as large as, judged before anything of that size is allocated."""

from __future__ import annotations

from typing import Any

from vibroimpact_schema import systems
from vibroimpact_service import problems
from vibroimpact_service.settings import Settings
from vibroimpact_solvers.plan import Plan, Stage


def dofs(system: systems.AnySystem) -> int:
    """Return the number of degrees of freedom that a system claims."""
    match system:
        case systems.MatrixSystem():
            matrices = [m for m in (system.M, system.K, system.C) if m is not None]
            return max(_rows(matrix) for matrix in matrices)
        case systems.Chain():
            return system.n
        case systems.TwoMass() | systems.DoublePendulum():
            return 2
        case systems.Oscillator() | systems.BouncingBall():
            return 1


def _rows(matrix: Any) -> int:
    match matrix:
        case systems.DiagonalMatrix():
            return len(matrix.diagonal)
        case systems.BandedMatrix():
            return max(len(v) + int(k) for k, v in matrix.bands.items())
        case systems.CoordinateMatrix():
            return max(matrix.shape)
        case systems.ScalarMatrix():
            return matrix.n
        case _:
            return max(len(matrix), *(len(row) for row in matrix))


def check(request: Any, settings: Settings) -> None:
    """Refuse a request that claims more than the service accepts.

    Raises
    ------
    ProblemError
        413 with the field that claims too much.
    """
    check_system(request.system, settings, "/system")
    grid = getattr(request, "frequency", None)
    if grid is not None and grid.count > settings.max_points:
        message = f"{grid.count} frequencies are more than {settings.max_points}"
        raise problems.too_large("/frequency", "too_many_points", message)


def check_plan(plan: Plan, settings: Settings) -> None:
    """Refuse a computation whose result would be larger than the service keeps."""
    size = sum(step.bytes for step in plan.steps if step.stage is not Stage.SPECTRUM)
    if size > settings.max_result_bytes:
        message = f"about {size:.3g} bytes of results are more than {settings.max_result_bytes}"
        raise problems.too_large("/outputs", "result_too_large", message)


def check_system(system: systems.AnySystem, settings: Settings, where: str = "") -> None:
    """Refuse a system that claims more degrees of freedom than the service accepts."""
    n = dofs(system)
    if n > settings.max_dofs:
        message = f"{n} degrees of freedom are more than {settings.max_dofs}"
        raise problems.too_large(where, "too_many_dofs", message)
