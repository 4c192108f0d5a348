"""Time histories: a motion, its impacts and contacts, and their errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Final

from vibroimpact_solvers.arrays import Floats, Group, Integers, Quantity
from vibroimpact_solvers.results.shared import (
    DERIVATIVES,
    TIME,
    A,
    Dofs,
    Neglected,
    Parameters,
    ParameterUnits,
    Statement,
    V,
    X,
    derivative,
    derivative_error,
)


def _impact(unit: str, long_name: str, column: str, **rest: Any) -> Quantity:
    return Quantity(("impact",), unit, long_name, path=f"impacts/{column}", **rest)


def _contact(unit: str, long_name: str, column: str, **rest: Any) -> Quantity:
    return Quantity(("contact",), unit, long_name, path=f"contacts/{column}", **rest)


def _number(unit: str, long_name: str, path: str) -> Quantity:
    return Quantity((), unit, long_name, path=path)


def _error(
    of: str, dims: tuple[str, ...], unit: str, what: str, missing: str, *, sometimes: bool = False
) -> Quantity:
    return Quantity(
        dims, unit, f"error of the {what}", path=f"error/{of}", missing=missing, sometimes=sometimes
    )


_MOMENTUM: Final = "mass length time-1"
_ENERGY: Final = "mass length2 time-2"
REASONS: Final = ("ok", "event", "contact", "order", "grazing", "unpredictable", "start")
"""Why there is no derivative, in the order of `time_history.derivatives.Reason`."""
_WHY: Final = (
    "event: an impact happens at this time; contact: a coordinate has come to rest; order: coupled "
    "coordinates strike at one instant; grazing: a wall is touched; unpredictable: beyond the "
    "horizon; start: the motion starts with an impact"
)


def _rate_of_impacts(
    declare: Callable[[tuple[str, ...], str, str, str], Quantity], unit: str, of: str, output: str
) -> Quantity:
    """Return the declaration of derivatives of a column of the impacts, or of their errors."""
    return declare(("impact",), unit, of, output)


_BEYOND = "not estimated, or beyond the horizon"
_UNSURE = f"{_BEYOND}, or the impact may be missing"
_ROUNDING = "in units of the rounding 2^-52"
LAWS: Final = ("newton", "poisson", "moreau")
"""Laws of impact, in the order of `kernels.impact_law`."""
OF_STOPS: Final = ("contact_velocity", "peak_force", "indentation", "energy_lost")
"""Columns of contacts that stops of finite stiffness have, and rigid ones have not."""
_SIDE = "wall: 1 the upper, -1 the lower one"


@dataclass(eq=False, slots=True)  # not frozen: that takes as long as a short motion
class Result:
    """A motion; outputs that were not requested are absent."""

    GROUPS: ClassVar[Mapping[str, Group]] = {
        "impacts": Group("Impacts", "All impacts in order, one column each."),
        "contacts": Group(
            "Contacts",
            "Times at which coordinates rest at rigid walls, or stops push: one column each.",
        ),
        "count": Group("Count", "Numbers of events."),
        "error": Group("MotionError", "Errors of the motion."),
        "error/impacts": Group("ImpactsError", "Errors of columns of the impacts."),
        "error/contacts": Group("ContactsError", "Errors of columns of the contacts."),
        **DERIVATIVES,
        "derivative/impacts": Group(
            "ImpactDerivatives", "Derivatives of columns of the impacts by the parameters."
        ),
        "error/derivative/impacts": Group(
            "ImpactDerivativeErrors", "Absolute errors of these derivatives."
        ),
    }

    t: Annotated[Floats | None, TIME]
    dof: Dofs
    x: Annotated[Floats | None, replace(X, error="error/x")]
    v: Annotated[Floats | None, replace(V, error="error/v")]
    a: Annotated[
        Floats | None, replace(A, error="error/a", note="between impacts, without their impulses")
    ]
    energy: Annotated[
        Floats | None,
        Quantity(
            ("time",),
            "mass length2 time-2",
            "mechanical energy, that of the constant load and of compressed stops included",
            error="error/energy",
        ),
    ]
    force: Annotated[
        Floats | None,
        Quantity(
            ("time", "constraint"),
            "mass length time-2",
            "force between a stop and the structure",
            note="of stops of finite stiffness; it only pushes",
            error="error/force",
        ),
    ]
    impact_time: Annotated[
        Floats | None, _impact("time", "time of the impact", "time", error="error/impacts/time")
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
            error="error/impacts/velocity",
        ),
    ]
    impact_impulse: Annotated[
        Floats | None,
        _impact(
            "mass length time-1",
            "impulse on the structure",
            "impulse",
            error="error/impacts/impulse",
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
    impact_law: Annotated[
        Integers | None,
        _impact(
            "1",
            "law that the impulse follows",
            "law",
            flags=LAWS,
            note="newton: no other coordinate at its wall is coupled to it; of several at once "
            "poisson, or moreau where the restitution of all of them is 1",
        ),
    ]
    contact_start: Annotated[
        Floats | None,
        _contact(
            "time",
            "time at which the contact begins",
            "start",
            note="of a rigid stop the last impact listed before it: the infinitely many impacts "
            "from it to the rest are summed; of another one the time at which it begins to push",
            error="error/contacts/start",
        ),
    ]
    contact_rest: Annotated[
        Floats | None,
        _contact(
            "time",
            "time at which the coordinate comes to rest",
            "rest",
            note="of a stop of finite stiffness the start",
            error="error/contacts/rest",
        ),
    ]
    contact_stop: Annotated[
        Floats | None,
        _contact(
            "time",
            "time of release, or the end of the motion",
            "stop",
            note="of a stop of finite stiffness the time at which its force is zero",
            error="error/contacts/stop",
        ),
    ]
    contact_constraint: Annotated[
        Integers | None, _contact("1", "index of the constraint", "constraint")
    ]
    contact_side: Annotated[Integers | None, _contact("1", _SIDE, "side", integers=(-1, 1))]
    contact_velocity: Annotated[
        Floats | None,
        _contact(
            "length time-1",
            "velocity of the coordinate at the start",
            "velocity",
            note="of stops of finite stiffness; away from the wall where a dashpot pushes again "
            "before the wall is left",
            error="error/contacts/velocity",
            sometimes=True,
        ),
    ]
    contact_impulse: Annotated[
        Floats | None,
        _contact(
            "mass length time-1",
            "impulse of the wall on the structure, rest to stop",
            "impulse",
            note="the integral of the contact force",
            error="error/contacts/impulse",
        ),
    ]
    contact_peak_force: Annotated[
        Floats | None,
        _contact(
            "mass length time-2",
            "largest force",
            "peak_force",
            note="of stops of finite stiffness",
            error="error/contacts/peak_force",
            sometimes=True,
        ),
    ]
    contact_indentation: Annotated[
        Floats | None,
        _contact(
            "length",
            "largest distance of the coordinate beyond its wall",
            "indentation",
            note="of stops of finite stiffness",
            error="error/contacts/indentation",
            sometimes=True,
        ),
    ]
    contact_energy_lost: Annotated[
        Floats | None,
        _contact(
            "mass length2 time-2",
            "energy lost in the stop",
            "energy_lost",
            note="in its dashpot, and by what its spring still holds when the force is zero",
            error="error/contacts/energy_lost",
            sometimes=True,
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
    error_x: Annotated[
        Floats | None, _error("x", ("time", "dof"), "length", "displacement", _BEYOND)
    ]
    error_v: Annotated[
        Floats | None, _error("v", ("time", "dof"), "length time-1", "velocity", _BEYOND)
    ]
    error_a: Annotated[
        Floats | None, _error("a", ("time", "dof"), "length time-2", "acceleration", _BEYOND)
    ]
    error_energy: Annotated[
        Floats | None, _error("energy", ("time",), "mass length2 time-2", "energy", _BEYOND)
    ]
    error_force: Annotated[
        Floats | None,
        _error("force", ("time", "constraint"), "mass length time-2", "force", _BEYOND),
    ]
    error_impact_time: Annotated[
        Floats | None, _error("impacts/time", ("impact",), "time", "time of the impact", _UNSURE)
    ]
    error_impact_velocity: Annotated[
        Floats | None,
        _error("impacts/velocity", ("impact",), "length time-1", "velocity before it", _BEYOND),
    ]
    error_impact_impulse: Annotated[
        Floats | None,
        _error("impacts/impulse", ("impact",), "mass length time-1", "impulse", _BEYOND),
    ]
    error_contact_start: Annotated[
        Floats | None, _error("contacts/start", ("contact",), "time", "last impact", _UNSURE)
    ]
    error_contact_rest: Annotated[
        Floats | None, _error("contacts/rest", ("contact",), "time", "time of rest", _UNSURE)
    ]
    error_contact_stop: Annotated[
        Floats | None, _error("contacts/stop", ("contact",), "time", "time of release", _UNSURE)
    ]
    error_contact_velocity: Annotated[
        Floats | None,
        _error(
            "contacts/velocity", ("contact",), "length time-1", "velocity", _UNSURE, sometimes=True
        ),
    ]
    error_contact_impulse: Annotated[
        Floats | None,
        _error("contacts/impulse", ("contact",), "mass length time-1", "impulse", _UNSURE),
    ]
    error_contact_peak_force: Annotated[
        Floats | None,
        _error(
            "contacts/peak_force",
            ("contact",),
            "mass length time-2",
            "force",
            _UNSURE,
            sometimes=True,
        ),
    ]
    error_contact_indentation: Annotated[
        Floats | None,
        _error(
            "contacts/indentation", ("contact",), "length", "indentation", _UNSURE, sometimes=True
        ),
    ]
    error_contact_energy_lost: Annotated[
        Floats | None,
        _error(
            "contacts/energy_lost",
            ("contact",),
            "mass length2 time-2",
            "energy",
            _UNSURE,
            sometimes=True,
        ),
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
    neglected: Neglected = None
    parameter: Parameters = None
    parameter_unit: ParameterUnits = None
    derivative_reason: Annotated[
        Integers | None,
        Quantity(
            ("time",),
            "1",
            "why there is no derivative, or ok",
            flags=REASONS,
            path="derivative/reason",
            note=_WHY,
        ),
    ] = None
    derivative_distance: Annotated[
        Floats | None,
        Quantity(
            ("parameter",),
            "1",
            "change of the parameter to where there is no derivative, to first order",
            path="derivative/distance",
            missing="none is in sight",
            note="where the velocity of an impact is zero, or two coupled impacts meet; impacts "
            "that come into being are not looked for",
        ),
    ] = None
    derivative_x: Annotated[
        Floats | None, derivative(("time", "dof"), "length", "displacement", "x")
    ] = None
    derivative_x_error: Annotated[
        Floats | None, derivative_error(("time", "dof"), "length", "displacement", "x")
    ] = None
    derivative_v: Annotated[
        Floats | None, derivative(("time", "dof"), "length time-1", "velocity", "v")
    ] = None
    derivative_v_error: Annotated[
        Floats | None, derivative_error(("time", "dof"), "length time-1", "velocity", "v")
    ] = None
    derivative_a: Annotated[
        Floats | None, derivative(("time", "dof"), "length time-2", "acceleration", "a")
    ] = None
    derivative_a_error: Annotated[
        Floats | None, derivative_error(("time", "dof"), "length time-2", "acceleration", "a")
    ] = None
    derivative_energy: Annotated[
        Floats | None, derivative(("time",), _ENERGY, "energy", "energy")
    ] = None
    derivative_energy_error: Annotated[
        Floats | None, derivative_error(("time",), _ENERGY, "energy", "energy")
    ] = None
    derivative_impact_reason: Annotated[
        Integers | None,
        Quantity(
            ("impact",),
            "1",
            "why there is no derivative, or ok",
            flags=REASONS,
            path="derivative/impacts/reason",
        ),
    ] = None
    derivative_impact_time: Annotated[
        Floats | None, _rate_of_impacts(derivative, "time", "time of the impact", "impacts/time")
    ] = None
    derivative_impact_time_error: Annotated[
        Floats | None,
        _rate_of_impacts(derivative_error, "time", "time of the impact", "impacts/time"),
    ] = None
    derivative_impact_velocity: Annotated[
        Floats | None,
        _rate_of_impacts(
            derivative, "length time-1", "velocity before the impact", "impacts/velocity"
        ),
    ] = None
    derivative_impact_velocity_error: Annotated[
        Floats | None,
        _rate_of_impacts(
            derivative_error, "length time-1", "velocity before the impact", "impacts/velocity"
        ),
    ] = None
    derivative_impact_impulse: Annotated[
        Floats | None, _rate_of_impacts(derivative, _MOMENTUM, "impulse", "impacts/impulse")
    ] = None
    derivative_impact_impulse_error: Annotated[
        Floats | None, _rate_of_impacts(derivative_error, _MOMENTUM, "impulse", "impacts/impulse")
    ] = None
