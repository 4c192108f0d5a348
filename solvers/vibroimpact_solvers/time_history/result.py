"""What is answered: a history, its impacts and contacts, and how far the numbers hold."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from vibroimpact_solvers.arrays import Floats, Integers, Quantity
from vibroimpact_solvers.time_history import tables


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
    impact_time: tables.ImpactTime
    impact_constraint: tables.ImpactConstraint
    impact_side: tables.ImpactSide
    impact_velocity: tables.ImpactVelocity
    impact_impulse: tables.ImpactImpulse
    impact_condition: tables.ImpactCondition
    contact_start: tables.ContactStart
    contact_rest: tables.ContactRest
    contact_stop: tables.ContactStop
    contact_constraint: tables.ContactConstraint
    contact_side: tables.ContactSide
    contact_impulse: tables.ContactImpulse
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
    #: Difference to the same motion in longer steps, with roundings, relative to the largest
    #: state; None where nothing steps or errors are not estimated.
    error_difference: float | None
    #: How the errors were obtained.
    error_statement: str
    #: Decimal digits of the arithmetic behind the numbers; None where doubles held them.
    error_digits: int | None = None

    @classmethod
    def of(cls, values: dict[str, Any]) -> Result:
        """Return the result with these values of all its fields; takes the dictionary over."""
        found = object.__new__(cls)
        object.__setattr__(found, "__dict__", values)
        return found


def empty() -> dict[str, Any]:
    """Return all fields of a result as not asked."""
    from dataclasses import fields

    return dict.fromkeys(field.name for field in fields(Result))
