"""Time histories: a motion, its impacts and contacts, and their errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar

from vibroimpact_solvers.arrays import Floats, Group, Integers, Quantity
from vibroimpact_solvers.results.shared import TIME, Dofs, Statement, V, X


def _impact(unit: str, long_name: str, column: str, **rest: Any) -> Quantity:
    return Quantity(("impact",), unit, long_name, path=f"impacts/{column}", **rest)


def _contact(unit: str, long_name: str, column: str, **rest: Any) -> Quantity:
    return Quantity(("contact",), unit, long_name, path=f"contacts/{column}", **rest)


def _number(unit: str, long_name: str, path: str) -> Quantity:
    return Quantity((), unit, long_name, path=path)


_ROUNDING = "in units of the rounding 2^-52"
_SIDE = "wall: 1 the upper, -1 the lower one"


@dataclass(eq=False, slots=True)  # not frozen: that takes as long as a short motion
class Result:
    """A motion; outputs that were not requested are absent."""

    GROUPS: ClassVar[Mapping[str, Group]] = {
        "impacts": Group("Impacts", "All impacts in order, one column each."),
        "contacts": Group(
            "Contacts",
            "Times at which constrained coordinates rest at their walls, one column each.",
        ),
        "count": Group("Count", "Numbers of events."),
        "error": Group("MotionError", "Errors of the motion."),
    }

    t: Annotated[Floats | None, TIME]
    dof: Dofs
    x: Annotated[Floats | None, replace(X, error="error/condition")]
    v: Annotated[Floats | None, replace(V, error="error/condition")]
    energy: Annotated[
        Floats | None,
        Quantity(
            ("time",),
            "mass length2 time-2",
            "mechanical energy, that of the constant load included",
            error="error/energy_drift",
        ),
    ]
    impact_time: Annotated[
        Floats | None, _impact("time", "time of the impact", "time", error="impacts/condition")
    ]
    impact_constraint: Annotated[
        Integers | None, _impact("1", "index of the constraint", "constraint")
    ]
    impact_side: Annotated[Integers | None, _impact("1", _SIDE, "side", integers=(-1, 1))]
    impact_velocity: Annotated[
        Floats | None,
        _impact(
            "length time-1",
            "velocity of the coordinate before the impact",
            "velocity",
            error="impacts/condition",
        ),
    ]
    impact_impulse: Annotated[
        Floats | None,
        _impact(
            "mass length time-1", "impulse on the structure", "impulse", error="impacts/condition"
        ),
    ]
    impact_condition: Annotated[
        Floats | None,
        _impact(
            "1",
            f"estimated relative error of the state, {_ROUNDING}",
            "condition",
            missing="not estimated",
        ),
    ]
    contact_start: Annotated[
        Floats | None,
        _contact(
            "time",
            "time of the last impact listed before it",
            "start",
            note="the infinitely many impacts from it to the rest are summed",
        ),
    ]
    contact_rest: Annotated[
        Floats | None, _contact("time", "time at which the coordinate comes to rest", "rest")
    ]
    contact_stop: Annotated[
        Floats | None, _contact("time", "time of release, or the end of the motion", "stop")
    ]
    contact_constraint: Annotated[
        Integers | None, _contact("1", "index of the constraint", "constraint")
    ]
    contact_side: Annotated[Integers | None, _contact("1", _SIDE, "side", integers=(-1, 1))]
    contact_impulse: Annotated[
        Floats | None,
        _contact(
            "mass length time-1",
            "impulse of the wall on the structure, rest to stop",
            "impulse",
            note="the integral of the contact force",
        ),
    ]
    count_impacts: Annotated[
        int, _number("1", "number of impacts, without those summed in a chatter", "count/impacts")
    ]
    count_grazings: Annotated[
        int, _number("1", "number of touches of a wall without an impulse", "count/grazings")
    ]
    count_expansions: Annotated[
        int,
        _number("1", "number of series expansions in the search for impacts", "count/expansions"),
    ]
    error_condition: Annotated[
        float, _number("1", f"largest relative error of the state, {_ROUNDING}", "error/condition")
    ]
    error_penetration: Annotated[
        float,
        _number(
            "length",
            "largest distance between a wall and the place of an impact at it",
            "error/penetration",
        ),
    ]
    error_predictable_until: Annotated[
        float,
        _number(
            "time",
            "time until which the tolerance can hold with the digits of the computation, "
            "at most the end of the motion",
            "error/predictable_until",
        ),
    ]
    error_tolerance: Annotated[
        float,
        _number("1", "tolerance on the error of the state, relative to it", "error/tolerance"),
    ]
    error_energy_drift: Annotated[
        float | None,
        Quantity(
            (),
            "1",
            "largest relative change of the energy",
            path="error/energy_drift",
            note="absent where loads or losses change it, or it was not requested",
        ),
    ]
    error_difference: Annotated[
        float | None,
        Quantity(
            (),
            "1",
            "largest difference to a run of Taylor steps 32 times less accurate, whose "
            "initial state, frequencies and limiters are off by their roundings, relative to the "
            "largest state",
            path="error/difference",
            note="absent where no Taylor steps are taken",
        ),
    ]
    error_statement: Statement
    error_digits: Annotated[
        int | None,
        Quantity(
            (),
            "1",
            "decimal digits of the arithmetic",
            path="error/digits",
            note="absent for double precision",
        ),
    ] = None
