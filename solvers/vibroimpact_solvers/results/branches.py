"""Branches of periodic motions: the tables of motions with their branch, and special points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Any, ClassVar, Final

from vibroimpact_solvers.arrays import Booleans, Floats, Group, Integers, Quantity
from vibroimpact_solvers.results import periodic_motions
from vibroimpact_solvers.results.shared import EXISTS


class Type(IntEnum):
    """What happens at a special point."""

    FOLD = 0
    FLIP = 1
    TORUS = 2
    SYMMETRY = 3
    GRAZING = 4
    END = 5


TYPES: Final = tuple(kind.name.lower() for kind in Type)


def _point(column: str, unit: str, long_name: str, **rest: Any) -> Quantity:
    """Return the declaration of a column of the special points."""
    path = f"points/{column}"
    return Quantity(("point",), unit, long_name, path=path, record=True, **rest)


@dataclass(frozen=True, eq=False)
class Result(periodic_motions.Result):
    """Motions branch by branch, in their order along each; special points of all branches."""

    GROUPS: ClassVar[Mapping[str, Group]] = {
        **periodic_motions.Result.GROUPS,
        "points": Group("SpecialPoint", "A point of a branch at which its motions change."),
        "error/points": Group("SpecialPointsError", "Absolute errors of the special points."),
    }

    solution_branch: Annotated[
        Integers, Quantity(("solution",), "1", "index of the branch", path="solution/branch")
    ]
    solution_parameter: Annotated[
        Floats,
        Quantity(("solution",), "1", "value of the parameter", path="solution/parameter"),
    ]
    solution_periods: Annotated[
        Integers,
        Quantity(("solution",), "1", "periods of the drive in one", path="solution/periods"),
    ]
    point_branch: Annotated[Integers, _point("branch", "1", "index of the branch")]
    point_parameter: Annotated[
        Floats, _point("parameter", "1", "value of the parameter", error="error/points/parameter")
    ]
    point_type: Annotated[
        Integers,
        _point(
            "type", "1",
            "what happens: the branch turns (fold), period doubling (flip), two frequencies "
            "(torus), loss of symmetry, an impact without velocity, a first touch without any "
            "impact or a contact that begins or ends to be (grazing), or a limit that begins to be "
            "passed (end)",
            flags=TYPES,
        ),
    ]  # fmt: skip
    point_Omega: Annotated[Floats, _point("Omega", "time-1", "frequency of the drive")]
    point_exists: Annotated[
        Booleans,
        _point("exists", "1", "whether motions on one side of it are admissible", flags=EXISTS),
    ]
    point_leads_to: Annotated[
        Integers,
        _point("leads_to", "1", "branch that begins there and was followed, or -1", integers=()),
    ]
    point_solution: Annotated[
        Integers, _point("solution", "1", "row of the motion before it on its branch")
    ]
    point_along: Annotated[
        Floats,
        _point(
            "along", "1", "how far it lies on the way from that motion to the next one, 0 to 1",
            error="error/points/along",
        ),
    ]  # fmt: skip
    point_error: Annotated[Floats, _point("error", "1", "absolute error of the parameter")]
    error_point_parameter: Annotated[
        Floats,
        Quantity(("point",), "1", "absolute error of the parameter", path="error/points/parameter"),
    ]
    error_point_along: Annotated[
        Floats,
        Quantity(("point",), "1", "absolute error of that place", path="error/points/along"),
    ]
