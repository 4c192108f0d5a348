"""Ensembles: the motions from many initial states in one result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Final

from vibroimpact_solvers.arrays import Floats, Group, Integers, Quantity, declared
from vibroimpact_solvers.errors import STATUSES
from vibroimpact_solvers.results import time_history
from vibroimpact_solvers.results.shared import Neglected

_MEMBER: Final = ("member",)
_MOTION: Final = {field.name: field.quantity for field in declared(time_history.Result).values()}
"""Declarations of the results of one motion; axes and tables have them in ensembles as well."""


_BEYOND: Final = "the member has no motion, beyond its horizon, or not estimated"


def _each(name: str, missing: str = "the member has no motion") -> Quantity:
    """Return the declaration of a field with a value or an array for each member."""
    return replace(_MOTION[name], dims=_MEMBER + _MOTION[name].dims, missing=missing)


@dataclass(frozen=True, eq=False)
class Result:
    """The motions from many initial states; outputs that were not requested are absent.

    The tables of all members follow one another in their order: member i has the rows
    ``offset[i]`` to ``offset[i] + count[i]`` of ``<table>_offset`` and ``<table>_count``. A
    member without a motion has no rows, and null (nan in files) in the arrays.
    """

    GROUPS: ClassVar[Mapping[str, Group]] = {
        **{
            path: group
            for path, group in time_history.Result.GROUPS.items()
            if "derivative" not in path  # of single motions only
        },
        "count": Group("MemberCounts", "Numbers of events of each member."),
        "error": Group("EnsembleError", "Errors of each motion; null where a member has none."),
    }

    member: Annotated[Integers, Quantity(_MEMBER, "1", "index of the initial state", True)]
    status: Annotated[
        Integers,
        Quantity(_MEMBER, "1", "whether there is a motion, and if not why", flags=STATUSES),
    ]
    t: Annotated[Floats | None, _MOTION["t"]]
    dof: Annotated[Integers | None, _MOTION["dof"]]
    x: Annotated[Floats | None, _each("x")]
    v: Annotated[Floats | None, _each("v")]
    a: Annotated[Floats | None, _each("a")]
    energy: Annotated[Floats | None, _each("energy")]
    force: Annotated[Floats | None, _each("force")]
    impact_count: Annotated[
        Integers | None, Quantity(_MEMBER, "1", "rows of impacts of each member", rows_of="impact")
    ]
    impact_offset: Annotated[
        Integers | None, Quantity(_MEMBER, "1", "first row of impacts of each member")
    ]
    impact_time: Annotated[Floats | None, _MOTION["impact_time"]]
    impact_constraint: Annotated[Integers | None, _MOTION["impact_constraint"]]
    impact_side: Annotated[Integers | None, _MOTION["impact_side"]]
    impact_velocity: Annotated[Floats | None, _MOTION["impact_velocity"]]
    impact_impulse: Annotated[Floats | None, _MOTION["impact_impulse"]]
    impact_condition: Annotated[Floats | None, _MOTION["impact_condition"]]
    impact_law: Annotated[Integers | None, _MOTION["impact_law"]]
    contact_count: Annotated[
        Integers | None,
        Quantity(_MEMBER, "1", "rows of contacts of each member", rows_of="contact"),
    ]
    contact_offset: Annotated[
        Integers | None, Quantity(_MEMBER, "1", "first row of contacts of each member")
    ]
    contact_start: Annotated[Floats | None, _MOTION["contact_start"]]
    contact_rest: Annotated[Floats | None, _MOTION["contact_rest"]]
    contact_stop: Annotated[Floats | None, _MOTION["contact_stop"]]
    contact_constraint: Annotated[Integers | None, _MOTION["contact_constraint"]]
    contact_side: Annotated[Integers | None, _MOTION["contact_side"]]
    contact_velocity: Annotated[Floats | None, _MOTION["contact_velocity"]]
    contact_impulse: Annotated[Floats | None, _MOTION["contact_impulse"]]
    contact_peak_force: Annotated[Floats | None, _MOTION["contact_peak_force"]]
    contact_indentation: Annotated[Floats | None, _MOTION["contact_indentation"]]
    contact_energy_lost: Annotated[Floats | None, _MOTION["contact_energy_lost"]]
    count_impacts: Annotated[Integers, _each("count_impacts", missing="")]
    count_grazings: Annotated[Integers, _each("count_grazings", missing="")]
    count_expansions: Annotated[Integers, _each("count_expansions", missing="")]
    error_x: Annotated[Floats | None, _each("error_x", _BEYOND)]
    error_v: Annotated[Floats | None, _each("error_v", _BEYOND)]
    error_a: Annotated[Floats | None, _each("error_a", _BEYOND)]
    error_energy: Annotated[Floats | None, _each("error_energy", _BEYOND)]
    error_force: Annotated[Floats | None, _each("error_force", _BEYOND)]
    error_impact_time: Annotated[Floats | None, _MOTION["error_impact_time"]]
    error_impact_velocity: Annotated[Floats | None, _MOTION["error_impact_velocity"]]
    error_impact_impulse: Annotated[Floats | None, _MOTION["error_impact_impulse"]]
    error_contact_start: Annotated[Floats | None, _MOTION["error_contact_start"]]
    error_contact_rest: Annotated[Floats | None, _MOTION["error_contact_rest"]]
    error_contact_stop: Annotated[Floats | None, _MOTION["error_contact_stop"]]
    error_contact_velocity: Annotated[Floats | None, _MOTION["error_contact_velocity"]]
    error_contact_impulse: Annotated[Floats | None, _MOTION["error_contact_impulse"]]
    error_contact_peak_force: Annotated[Floats | None, _MOTION["error_contact_peak_force"]]
    error_contact_indentation: Annotated[Floats | None, _MOTION["error_contact_indentation"]]
    error_contact_energy_lost: Annotated[Floats | None, _MOTION["error_contact_energy_lost"]]
    error_condition: Annotated[Floats, _each("error_condition")]
    error_penetration: Annotated[Floats, _each("error_penetration")]
    error_predictable_until: Annotated[Floats, _each("error_predictable_until")]
    error_energy_drift: Annotated[Floats | None, _each("error_energy_drift")]
    error_difference: Annotated[Floats | None, _each("error_difference")]
    error_tolerance: Annotated[float, _MOTION["error_tolerance"]]
    error_statement: Annotated[str, _MOTION["error_statement"]]
    error_failures: Annotated[
        list[str],
        Quantity((), "1", "why members have no motion, the first of them", path="error/failures"),
    ]
    neglected: Neglected
