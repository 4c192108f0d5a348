"""What is answered: the arrays of all members, and their tables one after the other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from vibroimpact_solvers.arrays import Floats, Integers, Quantity
from vibroimpact_solvers.sweep import STATUSES
from vibroimpact_solvers.time_history import tables


def _member(unit: str, name: str, path: str = "") -> Quantity:
    return Quantity(("member",), unit, name, path=path)


@dataclass(frozen=True, eq=False)
class Result:
    """Many motions; None stands for what was not asked.

    Rows of tables stand one after the other in the order of the members, as contiguous ragged
    arrays of the CF conventions: member i has the rows ``offset[i]`` to
    ``offset[i] + count[i]``. A member without a motion has no rows, and nan in the arrays.
    """

    member: Annotated[Integers, Quantity(("member",), "1", "index of the initial state", True)]
    status: Annotated[
        Integers,
        Quantity(("member",), "1", "whether there is a motion, and if not why", flags=STATUSES),
    ]
    t: Annotated[Floats | None, Quantity(("time",), "time", "time", True)]
    dof: Annotated[Integers | None, Quantity(("dof",), "1", "index of the degree of freedom", True)]
    x: Annotated[Floats | None, Quantity(("member", "time", "dof"), "length", "displacement")]
    v: Annotated[Floats | None, Quantity(("member", "time", "dof"), "length time-1", "velocity")]
    energy: Annotated[
        Floats | None,
        Quantity(
            ("member", "time"), "mass length2 time-2", "mechanical energy, static load included"
        ),
    ]
    impact_count: Annotated[
        Integers | None,
        Quantity(("member",), "1", "rows of impacts of each member", rows_of="impact"),
    ]
    impact_offset: Annotated[Integers | None, _member("1", "first row of impacts of each member")]
    impact_time: tables.ImpactTime
    impact_constraint: tables.ImpactConstraint
    impact_side: tables.ImpactSide
    impact_velocity: tables.ImpactVelocity
    impact_impulse: tables.ImpactImpulse
    impact_condition: tables.ImpactCondition
    contact_count: Annotated[
        Integers | None,
        Quantity(("member",), "1", "rows of contacts of each member", rows_of="contact"),
    ]
    contact_offset: Annotated[Integers | None, _member("1", "first row of contacts of each member")]
    contact_start: tables.ContactStart
    contact_rest: tables.ContactRest
    contact_stop: tables.ContactStop
    contact_constraint: tables.ContactConstraint
    contact_side: tables.ContactSide
    contact_impulse: tables.ContactImpulse
    count_impacts: Annotated[Integers, _member("1", "number of impacts", "count/impacts")]
    count_grazings: Annotated[
        Integers, _member("1", "touches of a wall without an impulse", "count/grazings")
    ]
    count_expansions: Annotated[
        Integers, _member("1", "expansions that the search took", "count/expansions")
    ]
    error_condition: Annotated[
        Floats,
        _member(
            "1",
            "largest error of the state relative to it, in units of the rounding 2^-52",
            "error/condition",
        ),
    ]
    error_penetration: Annotated[
        Floats,
        _member(
            "length",
            "largest distance between a wall and the place of an impact at it",
            "error/penetration",
        ),
    ]
    error_predictable_until: Annotated[
        Floats,
        _member(
            "time",
            "time until which the tolerance can hold in double precision",
            "error/predictable_until",
        ),
    ]
    error_energy_drift: Annotated[
        Floats | None,
        _member("1", "largest relative change of the energy", "error/energy_drift"),
    ]
    error_difference: Annotated[
        Floats | None,
        _member("1", "difference to longer steps, over the largest", "error/difference"),
    ]
    #: The tolerance meant.
    error_tolerance: float
    #: How the errors were obtained.
    error_statement: str
    #: Why members have no motion: the first of them in words.
    error_failures: list[str]


TABLES = ("impact", "contact")
"""Dimensions of tables whose length differs from member to member."""
