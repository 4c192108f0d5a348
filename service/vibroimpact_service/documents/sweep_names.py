"""The names of the axes of a sweep, which are those of the dimensions of its results."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, Protocol

from vibroimpact_schema import sweeps
from vibroimpact_service.documents.varying import Path
from vibroimpact_solvers import sweep
from vibroimpact_solvers.arrays import declared
from vibroimpact_solvers.errors import ModelError

_RESERVED: Final = frozenset(
    {"kind", "digest", "plan", "provenance", "error", "axes", "of", "dimensions", "status"}
)
_VAGUE: Final = frozenset(
    {"lower", "upper", "values", "start", "stop", "step", "num"}
    | {"diagonal", "bands", "data", "scalar", "weights"}
)
"""Names that tell nothing without the one before."""


class Named(Protocol):
    """An axis: a number of a request that varies."""

    @property
    def path(self) -> Path:
        """Path of the number."""

    @property
    def document(self) -> sweeps.AnyAxis:
        """What was sent."""


def names(kind: str, axes: Sequence[Named]) -> list[str]:
    """Return the names of the dimensions of a sweep of a kind.

    Raises
    ------
    ModelError
        Where a given one is that of something else.
    """
    taken = _taken(kind)
    given = [axis.document.name for axis in axes]
    for place, name in enumerate(given):
        if name is not None and (name in taken or name in given[:place]):
            message = f"the results have another {name!r}: choose another name"
            raise ModelError(("axes", place, "name"), message, code="duplicate_name")
    choices = [list(_endings(axis.path)) for axis in axes]
    chosen: list[str] = []
    for place, name in enumerate(given):
        others = {e for k, endings in enumerate(choices) if k != place for e in endings}
        barred = taken | others | {g for g in given if g is not None}
        longest = choices[place][-1]
        free = (ending for ending in choices[place] if ending not in barred)
        chosen.append(name if name is not None else next(free, f"{longest}_axis"))
    return chosen


def _taken(kind: str) -> frozenset[str]:
    """Return the names that results of a kind use themselves."""
    swept = sweep.KINDS[kind]
    names = set(_RESERVED)
    for name, field in declared(swept.solver.Result).items():
        if field.array:
            names |= {name, *field.quantity.dims, *field.path.split("/")}
    for dim in swept.ragged:
        names |= {f"{dim}_count", f"{dim}_offset"}
    return frozenset(names)


def _endings(path: Path) -> Iterator[str]:
    """Yield the ends of a path that start with a telling name, the shortest first."""
    for start in range(len(path) - 1, -1, -1):
        if not str(path[start])[0].isdigit() and (path[start] not in _VAGUE or start == 0):
            yield "_".join(str(part) for part in path[start:])
