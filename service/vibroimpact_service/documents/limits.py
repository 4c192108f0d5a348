"""Limits on sizes, checked on the documents before anything of that size is allocated."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, Final

from vibroimpact_schema import systems
from vibroimpact_schema.branches import BranchesRequest
from vibroimpact_schema.calibrations import CalibrationRequest
from vibroimpact_schema.problems import Fault
from vibroimpact_schema.sweeps import SweepRequest
from vibroimpact_service import problems
from vibroimpact_service.jobs import process_limits
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings
from vibroimpact_solvers.plan import Plan, Stage

_LIBRARIES: Final = 3e8
"""Memory of a worker that computes nothing."""
_MOST_VALUES: Final = 2**30
"""Of a grid: 8 GiB of doubles."""
_COPIES: Final = 4.0
"""How often a worker holds a result while it joins its chunks and packs it."""
_MOST_FOR_FACTORS: Final = 5e9
"""Operations of the factors of a matrix that is accepted: half a second to one. Finite elements of
5000 degrees of freedom take up to half of it."""


def dofs(system: systems.AnySystem) -> int:
    """Return the number of degrees of freedom of a system's document."""
    match system:
        case systems.MatrixSystem():
            matrices = [m for m in (system.M, system.K, system.C) if m is not None]
            return max(_rows(matrix) for matrix in matrices)
        case systems.Chain():
            return system.n
        case systems.Beam():
            return 2 * system.elements
        case systems.TwoMass() | systems.DoublePendulum() | systems.Absorber():
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
    """Refuse a request that is larger than the service accepts.

    Raises
    ------
    ProblemError
        413 with the field that is too large.
    """
    where = ""
    if isinstance(request, SweepRequest):
        _check_parameter_grid(request, settings)
        request, where = request.base, "/base"
    elif isinstance(request, BranchesRequest | CalibrationRequest):
        request, where = request.base, "/base"
    check_system(request.system, settings, f"{where}/system")
    for name, points in (("frequency", "frequencies"), ("t", "times")):
        count = _points(getattr(request, name, None))
        if count > settings.max_points:
            message = f"{count} {points} are more than {settings.max_points}"
            raise problems.too_large(f"{where}/{name}", "too_many_points", message)


def check_grids(request: Any) -> None:
    """Refuse grids whose values no memory holds, whatever the settings are, if there are any.

    Raises
    ------
    ProblemError
        413 with the grid.
    """
    grids = dict[str, Any]()
    if isinstance(request, SweepRequest):
        grids |= {f"/axes/{place}": axis for place, axis in enumerate(request.root.axes)}
    varied = isinstance(request, SweepRequest | BranchesRequest | CalibrationRequest)
    base, where = (request.base, "/base") if varied else (request, "")
    grids |= {f"{where}/{name}": getattr(base, name, None) for name in ("frequency", "t")}
    for pointer, grid in grids.items():
        if (count := _points(grid)) > _MOST_VALUES:
            message = f"{count} values are more than {_MOST_VALUES}"
            raise problems.too_large(pointer, "too_many_points", message)


def _points(grid: Any) -> int:
    """Return the number of points of a grid; 0 for an interval, as of existence bands."""
    if isinstance(grid, list):
        return len(grid)
    return int(getattr(grid, "count", getattr(grid, "num", 0)))


def _check_parameter_grid(request: SweepRequest, settings: Settings) -> None:
    if request.points > settings.max_sweep_points:
        product = " x ".join(str(axis.count) for axis in request.root.axes)
        message = f"{product} = {request.points} points are more than {settings.max_sweep_points}"
        raise problems.too_large("/axes", "too_many_points", message)
    frequencies = _points(getattr(request.base, "frequency", None))
    if request.points * frequencies > settings.max_result_bytes:  # a byte each at the least
        message = (
            f"{request.points} points of {frequencies} frequencies have a result of more than "
            f"{settings.max_result_bytes} bytes"
        )
        raise problems.too_large("/axes", "result_too_large", message)


def check_plan(
    plan: Plan,
    settings: Settings,
    *,
    joined_in_files: bool = False,
    long: Callable[[], str] = str,
    large: str = "/outputs",
) -> None:
    """Refuse a computation without end, or whose result is larger than the service keeps.

    And one that needs more memory than a worker has; `joined_in_files` tells that no worker holds
    the whole result. `long` returns the pointer to the field that is blamed for the time, `large`
    is that of the field which is blamed for the size.
    """
    if not math.isfinite(plan.flops):
        raise too_costly(long(), "not_finite", "The estimated number of operations is not finite.")
    size = result_bytes(plan)
    if size > settings.max_result_bytes:
        message = f"about {size:.3g} bytes of results are more than {settings.max_result_bytes}"
        raise problems.too_large(large, "result_too_large", message)
    most = settings.worker_memory_bytes
    held = plan.bytes - size + (0.0 if joined_in_files else _COPIES * size)
    if most is None and settings.scheduler is None and held > process_limits.LEAST_MEMORY:
        most = process_limits.worker_memory(None, settings.workers)
    if most is not None and _LIBRARIES + held > most:
        message = f"about {_LIBRARIES + held:.3g} bytes of memory are more than {most} of a worker"
        raise problems.too_large(large, "too_much_memory", message)


def too_costly(where: str, code: str, message: str) -> ProblemError:
    """Return the refusal of a request that takes too long, with the field that is blamed."""
    fault = Fault(pointer=where, code=code, message=message)
    return ProblemError(problems.TOO_COSTLY, message, [fault])


def result_bytes(plan: Plan) -> float:
    """Return the planned size of a result; modes are not part of it."""
    return sum(step.bytes for step in plan.steps if step.stage is not Stage.SPECTRUM)


def least_bytes(plan: Plan) -> float:
    """Return what the size of a result is not expected to fall below.

    Sizes that are no bounds count a tenth: the number of impacts may turn out that much smaller.
    """
    steps = (step for step in plan.steps if step.stage is not Stage.SPECTRUM)
    return sum(step.bytes if step.bounded else 0.1 * step.bytes for step in steps)


def check_system(system: systems.AnySystem, settings: Settings, where: str = "") -> None:
    """Refuse a system with more degrees of freedom, or of longer factors, than are accepted."""
    check_dofs(dofs(system), settings, where)
    if not isinstance(system, systems.MatrixSystem):
        return
    for name, matrix in _factorized(system):
        if (work := _factor_work(matrix)) > _MOST_FOR_FACTORS:
            message = (
                f"its factors take about {work:.2g} operations, more than {_MOST_FOR_FACTORS:.0e}: "
                "its entries lie anywhere, and not near those of neighbours as in a structure"
            )
            raise problems.too_large(f"{where}/{name}", "too_many_operations", message)


def _factorized(system: systems.MatrixSystem) -> Iterator[tuple[str, systems.CoordinateMatrix]]:
    """Yield the names and matrices whose factors are computed while a request is planned.

    The mass matrix has to be positive definite, and so has the stiffness matrix of what has no
    mass. Only lists of entries are told: the factors of others go with the size of the body.
    """
    if isinstance(system.M, systems.CoordinateMatrix):
        yield "M", system.M
    if isinstance(system.K, systems.CoordinateMatrix) and _lacks_mass(system.M):
        yield "K", system.K


def _lacks_mass(M: Any) -> bool:
    """Whether a mass is zero."""
    match M:
        case systems.DiagonalMatrix():
            return 0.0 in M.diagonal
        case systems.BandedMatrix():
            return 0.0 in M.bands.get("0", ())
        case systems.CoordinateMatrix():
            triples = zip(M.row, M.col, M.data, strict=False)
            masses = {i for i, j, value in triples if i == j and value}
            return len(masses) < max(M.shape)
        case systems.ScalarMatrix():
            return M.scalar == 0.0
        case _:
            return any(k >= len(row) or row[k] == 0.0 for k, row in enumerate(M))


def _factor_work(matrix: systems.CoordinateMatrix) -> float:
    """Return about how many operations the factors take, 0 for a matrix that is none.

    Each row, from its first entry on, is filled if rows and columns are ordered so that entries
    are near the diagonal (Cuthill and McKee). Other orders leave less, though not by much where
    entries are anywhere.
    """
    # The numerical libraries load at the first request.
    import numpy as np
    import scipy.sparse.csgraph

    rows, columns = np.array(matrix.row), np.array(matrix.col)
    n = max(matrix.shape)
    if not rows.size or rows.shape != columns.shape:
        return 0.0
    if min(rows.min(), columns.min()) < 0 or max(rows.max(), columns.max()) >= n:
        return 0.0
    pattern = scipy.sparse.csr_array((np.ones(rows.size), (rows, columns)), shape=(n, n))
    order = scipy.sparse.csgraph.reverse_cuthill_mckee(pattern, symmetric_mode=True)
    place = np.empty(n, dtype=np.int64)
    place[order] = np.arange(n)
    widths = np.zeros(n)
    np.maximum.at(widths, place[rows], place[rows] - place[columns])
    return float(widths @ widths)


def check_dofs(n: int, settings: Settings, where: str = "") -> None:
    """Refuse a number of degrees of freedom that the service does not accept."""
    if n > settings.max_dofs:
        message = f"{n} degrees of freedom are more than {settings.max_dofs}"
        raise problems.too_large(where, "too_many_dofs", message)
