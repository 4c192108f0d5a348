"""Ensembles: the motions from many initial states in one result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Final

from vibroimpact_solvers.arrays import Floats, Group, Integers, Quantity, stacked
from vibroimpact_solvers.errors import STATUSES
from vibroimpact_solvers.results import time_history

_MEMBER: Final = ("member",)


@stacked(time_history.Result, "member", "the member has no motion")
@dataclass(frozen=True, eq=False)
class Result:
    """The motions from many initial states; outputs that were not requested are absent.

    The tables of all members follow one another in their order: member i has the rows
    ``offset[i]`` to ``offset[i] + count[i]`` of ``<table>_offset`` and ``<table>_count``. A
    member without a motion has no rows, and null (nan in files) in the arrays.
    """

    GROUPS: ClassVar[Mapping[str, Group]] = {
        **time_history.Result.GROUPS,
        "count": Group("MemberCounts", "Numbers of events of each member."),
        "error": Group("EnsembleError", "Errors of each motion; null where a member has none."),
    }

    member: Annotated[Integers, Quantity(_MEMBER, "1", "index of the initial state", True)]
    status: Annotated[
        Integers,
        Quantity(_MEMBER, "1", "whether there is a motion, and if not why", flags=STATUSES),
    ]
    t: Floats | None
    dof: Integers | None
    x: Floats | None
    v: Floats | None
    energy: Floats | None
    impact_count: Annotated[
        Integers | None, Quantity(_MEMBER, "1", "rows of impacts of each member", rows_of="impact")
    ]
    impact_offset: Annotated[
        Integers | None, Quantity(_MEMBER, "1", "first row of impacts of each member")
    ]
    impact_time: Floats | None
    impact_constraint: Integers | None
    impact_side: Integers | None
    impact_velocity: Floats | None
    impact_impulse: Floats | None
    impact_condition: Floats | None
    contact_count: Annotated[
        Integers | None,
        Quantity(_MEMBER, "1", "rows of contacts of each member", rows_of="contact"),
    ]
    contact_offset: Annotated[
        Integers | None, Quantity(_MEMBER, "1", "first row of contacts of each member")
    ]
    contact_start: Floats | None
    contact_rest: Floats | None
    contact_stop: Floats | None
    contact_constraint: Integers | None
    contact_side: Integers | None
    contact_impulse: Floats | None
    count_impacts: Integers
    count_grazings: Integers
    count_expansions: Integers
    error_condition: Floats
    error_penetration: Floats
    error_predictable_until: Floats
    error_energy_drift: Floats | None
    error_difference: Floats | None
    error_tolerance: float
    error_statement: str
    error_failures: Annotated[
        list[str],
        Quantity((), "1", "why members have no motion, the first of them", path="error/failures"),
    ]
