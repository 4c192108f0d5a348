"""What is answered: bands, what was rejected, and what stayed undecided."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Final

from vibroimpact_solvers.arrays import Booleans, Floats, Integers, Quantity
from vibroimpact_solvers.impact_modes import Reason


class Edge(IntEnum):
    """Why a band ends: what members beyond its edge are, or that nothing was asked there."""

    RANGE = 0
    NEGATIVE_IMPULSE = Reason.NEGATIVE_IMPULSE
    WRONG_VELOCITY = Reason.WRONG_VELOCITY
    PENETRATION = Reason.PENETRATION
    SINGULAR = Reason.SINGULAR


EDGES: Final = tuple(edge.name.lower() for edge in Edge)


def _record(group: str, unit: str, long_name: str, flags: tuple[str, ...] = ()) -> Quantity:
    """Return the meaning of one column of a table."""
    table, _ = group.split("/")
    return Quantity((table,), unit, long_name, flags=flags, path=group, record=True)


@dataclass(frozen=True, eq=False)
class Result:
    """Bands along the fundamental frequency Omega, ascending; None stands for what was not asked.

    Rejected ranges are those in which all impulses are positive and the members are phantoms
    all the same. Unresolved ones could not be decided.
    """

    band_start: Annotated[Floats | None, _record("bands/start", "time-1", "lower edge of a band")]
    band_stop: Annotated[Floats | None, _record("bands/stop", "time-1", "upper edge of a band")]
    band_start_reason: Annotated[
        Integers | None, _record("bands/start_reason", "1", "what members below are", EDGES)
    ]
    band_stop_reason: Annotated[
        Integers | None, _record("bands/stop_reason", "1", "what members above are", EDGES)
    ]
    band_edge_error: Annotated[
        Floats | None, _record("bands/edge_error", "time-1", "largest error of the edges")
    ]
    band_certified: Annotated[
        Booleans | None,
        _record("bands/certified", "1", "whether existence is proved throughout", ("no", "yes")),
    ]
    rejected_start: Annotated[
        Floats | None, _record("rejected/start", "time-1", "lower edge of a rejected range")
    ]
    rejected_stop: Annotated[
        Floats | None, _record("rejected/stop", "time-1", "upper edge of a rejected range")
    ]
    rejected_reason: Annotated[
        Integers | None, _record("rejected/reason", "1", "why its members are phantoms", EDGES)
    ]
    rejected_certified: Annotated[
        Booleans | None,
        _record("rejected/certified", "1", "whether that is proved throughout", ("no", "yes")),
    ]
    rejected_witness: Annotated[
        Floats | None,
        _record("rejected/witness", "1", "triangle-wave time at which a limit is passed"),
    ]
    rejected_constraint: Annotated[
        Integers | None,
        _record("rejected/constraint", "1", "the constraint that is passed, -1 where unknown"),
    ]
    stability_start: Annotated[
        Floats | None, _record("stability/start", "time-1", "lower edge of a range")
    ]
    stability_stop: Annotated[
        Floats | None, _record("stability/stop", "time-1", "upper edge of a range")
    ]
    stability_stable: Annotated[
        Booleans | None,
        _record("stability/stable", "1", "whether its members are stable", ("no", "yes")),
    ]
    stability_radius: Annotated[
        Floats | None,
        _record("stability/radius", "1", "largest spectral radius found of the half-period map"),
    ]
    unresolved_start: Annotated[
        Floats, _record("unresolved/start", "time-1", "lower edge of an undecided range")
    ]
    unresolved_stop: Annotated[
        Floats, _record("unresolved/stop", "time-1", "upper edge of an undecided range")
    ]

    #: Relative width below which a band or a gap between bands could hide.
    error_resolution: float
    #: How the bands were obtained.
    error_statement: str
