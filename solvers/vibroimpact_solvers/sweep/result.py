"""Results of sweeps: the arrays of all points, with the axes of the parameter grid first."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import Described, Quantity, declared
from vibroimpact_solvers.assembly import Array, Assembly
from vibroimpact_solvers.errors import STATUSES
from vibroimpact_solvers.sweep.problem import Problem

FAILED: Final = "failed"
"""Flag of points without a result."""
_RANGES: Final = {
    "rejected": "rejected ranges",
    "stability": "stability ranges",
    "unresolved": "undecided ranges",
}
"""Tables that are not called after their rows."""


@dataclass(frozen=True, eq=False)
class Result(Described):
    """Outputs over the parameter grid.

    Arrays are named as in the results of the points. There are also the values of the axes under
    their names, `status`, and ``<table>_count`` and ``<table>_offset`` of every table whose
    length differs from point to point.
    """


def assembly_of(problem: Problem) -> Assembly:
    """Return an empty assembly of the results of a sweep, or of a piece of one."""
    kind = problem.swept_kind
    return Assembly(
        kind.solver.Result,
        problem.shape,
        problem.label,
        kind.ragged,
        kind.absent,
        _changes(problem),
        {k for k, axis in enumerate(problem.axes) if axis.stage is None},
    )


def result_of(problem: Problem, assembly: Assembly) -> Result:
    """Return the result of all points in an assembly."""
    own: dict[str, Array] = {}
    labels: dict[str, Quantity] = {}
    for axis, (start, stop) in zip(problem.axes, problem.spans, strict=True):
        own[axis.name] = axis.values[start:stop]
        labels[axis.name] = Quantity(
            (axis.name,), axis.unit, axis.long_name, True, path=f"axes/{axis.name}"
        )
    arrays = assembly.arrays()
    plain: dict[str, Any] = {
        "of": problem.kind,
        "error/statement": assembly.statement,
        "error/failures": assembly.failures,
    }
    for sentences in problem.neglected():
        assembly.neglect(sentences)
    if assembly.neglected:
        plain["neglected"] = assembly.neglected
    return Result(own | arrays, labels | _meanings(problem, arrays), plain)


def _changes(problem: Problem) -> dict[str, tuple[int, ...]]:
    """Return the axes along which each coordinate of the results changes."""
    return {
        name: tuple(k for k, axis in enumerate(problem.axes) if name in axis.changes)
        for name in declared(problem.swept_kind.solver.Result)
    }


def _meanings(problem: Problem, arrays: dict[str, Array]) -> dict[str, Quantity]:
    """Return the declarations of the arrays over the grid."""
    fields, ragged = declared(problem.swept_kind.solver.Result), problem.swept_kind.ragged
    axes, changes = tuple(axis.name for axis in problem.axes), _changes(problem)
    status = Quantity(axes, "1", "whether there is a result, and if not why", flags=STATUSES)
    meanings = {"status": status}
    for dim in ragged:
        plural = dim if dim.endswith("s") or dim in _RANGES else f"{dim}s"
        rows = f"number of {_RANGES.get(dim, plural)} at each point"
        first = f"first row of {dim} of each point"
        meanings[f"{dim}_count"] = Quantity(axes, "1", rows, rows_of=dim)
        meanings[f"{dim}_offset"] = Quantity(axes, "1", first)
    for name, field in fields.items():
        quantity = field.quantity
        before = axes
        if quantity.dims and quantity.dims[0] in ragged:
            before = ()
        elif quantity.coordinate:
            before = tuple(axes[k] for k in changes[name])
        flags = quantity.flags
        if before == axes and flags and name in arrays and arrays[name].dtype != np.bool_:
            flags = (*flags, FAILED)
        meanings[name] = replace(quantity, dims=(*before, *quantity.dims), flags=flags)
    return {name: meanings[name] for name in arrays}
