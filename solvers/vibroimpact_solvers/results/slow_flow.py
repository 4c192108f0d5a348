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
    return Quantity(("time",), unit, long_name, missing="after the last impact, or unknown", **rest)


def _at_impact(
    unit: str, long_name: str, path: str, missing: str = "", error: str = ""
) -> Quantity:
    return Quantity(("impact",), unit, long_name, path=path, missing=missing, error=error)


def _error(output: str, unit: str, of: str) -> Quantity:
    """Return the declaration of the error of a variable that changes slowly."""
    return _slow(unit, f"error of the {of}", path=f"error/{output}")


def _number(unit: str, long_name: str, **rest: Any) -> Quantity:
    return Quantity((), unit, long_name, **rest)


@dataclass(frozen=True, eq=False)
class Result:
    """A motion by one of its descriptions; outputs that were not requested are absent."""

    GROUPS: ClassVar[Mapping[str, Group]] = {
        "impacts": Group("SlowFlowImpacts", "The impacts of the exact motion."),
        "error": Group(
            "SlowFlowError", "Absolute errors of the outputs of this variant, and times taken."
        ),
        "error/impacts": Group("SlowFlowImpactsError", "Errors of columns of the impacts."),
        "error/difference": Group(
            "SlowFlowDifference", "Differences of this variant from the exact motion.", False
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
    omega: Annotated[Floats | None, _slow("time-1", "triangle-wave frequency", error="error/omega")]
    phi: Annotated[Floats | None, _slow("1", "phase of the triangle wave", error="error/phi")]
    A: Annotated[
        Floats | None, _slow("length", "sine amplitude of the second mass", error="error/A")
    ]
    B: Annotated[
        Floats | None, _slow("length", "cosine amplitude of the second mass", error="error/B")
    ]
    x: Annotated[Floats | None, replace(X, error="error/x")]
    v: Annotated[Floats | None, replace(V, error="error/v")]
    impulse: Annotated[
        Floats | None, _slow("mass length time-2", "impulse parameter p", error="error/impulse")
    ]
    momentum: Annotated[
        Floats | None,
        _slow(
            "mass length time-1",
            "momentum exchanged at an impact",
            note="2 p/omega",
            error="error/momentum",
        ),
    ]
    t_max: Annotated[
        Floats,
        _number(
            "time",
            "end of the impacts by this variant",
            missing="they never end",
            error="error/t_max",
        ),
    ]
    t_max_exact: Annotated[
        Floats,
        _number(
            "time",
            "end of the impacts of the exact motion",
            missing="they never end",
            error="error/t_max_exact",
        ),
    ]
    exists: Annotated[
        Booleans | None,
        _number("1", "whether the solution of a family is admissible", flags=EXISTS),
    ]
    impact_time: Annotated[
        Floats | None,
        _at_impact("time", "time of the exact impact", "impacts/time", error="error/impacts/time"),
    ]
    impact_velocity: Annotated[
        Floats | None,
        _at_impact(
            "length time-1",
            "speed before the exact impact",
            "impacts/velocity",
            error="error/impacts/velocity",
        ),
    ]
    error_gamma: Annotated[Floats | None, _error("gamma", "1", "frequency ratio")]
    error_omega: Annotated[Floats | None, _error("omega", "time-1", "triangle-wave frequency")]
    error_phi: Annotated[Floats | None, _error("phi", "1", "phase")]
    error_A: Annotated[Floats | None, _error("A", "length", "sine amplitude")]
    error_B: Annotated[Floats | None, _error("B", "length", "cosine amplitude")]
    error_x: Annotated[
        Floats | None,
        Quantity(("time", "dof"), "length", "error of the displacement", path="error/x"),
    ]
    error_v: Annotated[
        Floats | None,
        Quantity(("time", "dof"), "length time-1", "error of the velocity", path="error/v"),
    ]
    error_impulse: Annotated[
        Floats | None, _error("impulse", "mass length time-2", "impulse parameter p")
    ]
    error_momentum: Annotated[
        Floats | None, _error("momentum", "mass length time-1", "momentum exchanged")
    ]
    error_t_max: Annotated[
        Floats,
        _number(
            "time",
            "difference of the ends of the impacts",
            path="error/t_max",
            missing="one of them never ends",
        ),
    ]
    error_t_max_exact: Annotated[
        Floats,
        _number("time", "error of the end of the exact impacts", path="error/t_max_exact"),
    ]
    error_impact_time: Annotated[
        Floats | None, _at_impact("time", "error of the time", "error/impacts/time")
    ]
    error_impact_velocity: Annotated[
        Floats | None,
        _at_impact("length time-1", "error of the speed", "error/impacts/velocity"),
    ]
    difference_x: Annotated[
        Floats | None,
        Quantity(
            ("time", "dof"),
            "length",
            "displacement minus that of the exact motion",
            path="error/difference/x",
        ),
    ]
    difference_gamma: Annotated[
        Floats | None,
        _at_impact(
            "1",
            "frequency ratio minus that of the exact motion, at its impacts",
            "error/difference/gamma",
            "after the variant's last impact",
        ),
    ]
    difference_phi: Annotated[
        Floats | None,
        _at_impact(
            "1",
            "phase minus that of the exact motion, at its impacts",
            "error/difference/phi",
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
