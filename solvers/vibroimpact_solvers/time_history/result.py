"""What is answered: a history, its impacts and contacts, and how far the numbers hold."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from vibroimpact_solvers.arrays import Floats, Integers, Quantity


def _impact(unit: str, name: str, column: str) -> Quantity:
    return Quantity(("impact",), unit, name, path=f"impacts/{column}")


def _contact(unit: str, name: str, column: str) -> Quantity:
    return Quantity(("contact",), unit, name, path=f"contacts/{column}")


@dataclass(frozen=True, eq=False)
class Result:
    """One motion; None stands for what was not asked."""

    t: Annotated[Floats | None, Quantity(("time",), "time", "time", True)]
    dof: Annotated[Integers | None, Quantity(("dof",), "1", "index of the degree of freedom", True)]
    x: Annotated[Floats | None, Quantity(("time", "dof"), "length", "displacement")]
    v: Annotated[Floats | None, Quantity(("time", "dof"), "length time-1", "velocity")]
    energy: Annotated[
        Floats | None,
        Quantity(("time",), "mass length2 time-2", "mechanical energy, static load included"),
    ]
    impact_time: Annotated[Floats | None, _impact("time", "time of the impact", "time")]
    impact_constraint: Annotated[
        Integers | None, _impact("1", "index of the constraint", "constraint")
    ]
    impact_side: Annotated[
        Integers | None, _impact("1", "wall: 1 the upper, -1 the lower one", "side")
    ]
    impact_velocity: Annotated[
        Floats | None,
        _impact("length time-1", "velocity of the coordinate before the impact", "velocity"),
    ]
    impact_impulse: Annotated[
        Floats | None, _impact("mass length time-1", "impulse on the structure", "impulse")
    ]
    impact_condition: Annotated[
        Floats | None,
        _impact(
            "1", "error of the state relative to it, in units of the rounding 2^-52", "condition"
        ),
    ]
    contact_start: Annotated[
        Floats | None, _contact("time", "time of the last impact listed before it", "start")
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
    contact_side: Annotated[
        Integers | None, _contact("1", "wall: 1 the upper, -1 the lower one", "side")
    ]
    contact_impulse: Annotated[
        Floats | None,
        _contact(
            "mass length time-1", "impulse of the wall on the structure, rest to stop", "impulse"
        ),
    ]
    count_impacts: int
    count_grazings: int
    count_expansions: int
    #: Largest estimated error of the state relative to it, in units of the rounding 2^-52.
    error_condition: float
    #: Largest distance between a wall and the place of an impact at it.
    error_penetration: float
    #: Time until which the tolerance can hold in double precision.
    error_predictable_until: float
    #: The tolerance meant.
    error_tolerance: float
    #: Largest change of the energy where it is conserved, relative to the largest kinetic or
    #: potential part; None where loads or losses change it or it was not asked for.
    error_energy_drift: float | None
    #: Difference to the same motion with steps of twice the length; None where nothing steps.
    error_difference: float | None
    #: How the errors were obtained.
    error_statement: str
    #: Decimal digits of the arithmetic behind the numbers; None where doubles held them.
    error_digits: int | None = None

    @classmethod
    def of(cls, values: dict[str, Any]) -> Result:
        """Return the result with these values of all its fields; takes the dictionary over."""
        found = object.__new__(cls)
        found.__dict__.update(values)
        return found


def empty() -> dict[str, Any]:
    """Return all fields of a result as not asked."""
    from dataclasses import fields

    return dict.fromkeys(field.name for field in fields(Result))
