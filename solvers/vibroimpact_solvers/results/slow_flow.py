"""Slow flows: state and displacement along the motion, and their distance from the exact one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Annotated, Any, ClassVar, Final

from vibroimpact_solvers.arrays import Booleans, Floats, Group, Integers, Quantity
from vibroimpact_solvers.results.shared import EXISTS, TIME, WITHIN, Dofs, Statement, V, X


class Stage(IntEnum):
    """Stage of a motion."""

    IMPACTS = 0
    FREE = 1
    REST = 2


STAGES: Final = tuple(stage.name.lower() for stage in Stage)


def _slow(unit: str, long_name: str, **rest: Any) -> Quantity:
    """Return the declaration of a variable that is defined as long as there are impacts."""
    return Quantity(("time",), unit, long_name, missing="after the last impact", **rest)


def _at_impact(unit: str, long_name: str, path: str, missing: str = "") -> Quantity:
    return Quantity(("impact",), unit, long_name, path=path, missing=missing)


def _number(unit: str, long_name: str, **rest: Any) -> Quantity:
    return Quantity((), unit, long_name, **rest)


@dataclass(frozen=True, eq=False)
class Result:
    """A motion by one of its descriptions; outputs that were not requested are absent."""

    GROUPS: ClassVar[Mapping[str, Group]] = {
        "impacts": Group("SlowFlowImpacts", "The impacts of the exact motion."),
        "error": Group(
            "SlowFlowError", "Differences of this variant from the exact motion, and times taken."
        ),
    }

    t: Annotated[Floats, TIME]
    dof: Dofs
    impact: Annotated[
        Integers | None,
        Quantity(("impact",), "1", "number of the impact of the exact motion, from 1", True),
    ]
    stage: Annotated[Integers, Quantity(("time",), "1", "stage of the motion", flags=STAGES)]
    gamma: Annotated[
        Floats | None,
        _slow("1", "frequency ratio Omega0/omega (lambda of eq. 10.110)", error="error/gamma"),
    ]
    omega: Annotated[Floats | None, _slow("time-1", "triangle-wave frequency")]
    phi: Annotated[Floats | None, _slow("1", "phase of the triangle wave", error="error/phi")]
    A: Annotated[Floats | None, _slow("length", "sine amplitude of the second mass")]
    B: Annotated[Floats | None, _slow("length", "cosine amplitude of the second mass")]
    x: Annotated[Floats | None, replace(X, error="error/x")]
    v: Annotated[Floats | None, V]
    impulse: Annotated[Floats | None, _slow("mass length time-2", "impulse parameter p")]
    momentum: Annotated[
        Floats | None,
        _slow("mass length time-1", "momentum exchanged at an impact", note="2 p/omega"),
    ]
    t_max: Annotated[
        Floats, _number("time", "end of the impacts by this variant", missing="they never end")
    ]
    t_max_exact: Annotated[
        Floats, _number("time", "end of the impacts of the exact motion", missing="they never end")
    ]
    exists: Annotated[
        Booleans | None,
        _number("1", "whether the solution of a family is admissible", flags=EXISTS),
    ]
    impact_time: Annotated[
        Floats | None, _at_impact("time", "time of the exact impact", "impacts/time")
    ]
    impact_velocity: Annotated[
        Floats | None,
        _at_impact("length time-1", "speed before the exact impact", "impacts/velocity"),
    ]
    error_x: Annotated[
        Floats | None,
        Quantity(
            ("time", "dof"), "length", "displacement minus that of the exact motion", path="error/x"
        ),
    ]
    error_gamma: Annotated[
        Floats | None,
        _at_impact(
            "1",
            "frequency ratio minus that of the exact motion, at its impacts",
            "error/gamma",
            "after the variant's last impact",
        ),
    ]
    error_phi: Annotated[
        Floats | None,
        _at_impact(
            "1",
            "phase minus that of the exact motion, at its impacts",
            "error/phi",
            "after the variant's last impact",
        ),
    ]
    seconds: Annotated[Floats, _number("s", "computing time of this variant", path="error/seconds")]
    seconds_exact: Annotated[
        Floats | None,
        _number("s", "computing time of the exact motion", path="error/seconds_exact"),
    ]
    within_tolerance: Annotated[
        Booleans | None,
        _number(
            "1",
            "whether the largest error of the displacement, relative to the largest displacement, "
            "is within the requested tolerance",
            flags=WITHIN,
            path="error/within_tolerance",
        ),
    ]
    error_statement: Statement
