"""Existence bands: bands, rejected ranges, stability and what could not be decided."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Any, ClassVar, Final

from vibroimpact_solvers.arrays import Booleans, Floats, Group, Integers, Quantity
from vibroimpact_solvers.results.impact_modes import Reason
from vibroimpact_solvers.results.shared import NO_YES, Neglected, Statement


class Edge(IntEnum):
    """Why a band ends: the reason of the phantoms beyond its edge, or the end of the range."""

    RANGE = 0
    NEGATIVE_IMPULSE = Reason.NEGATIVE_IMPULSE
    WRONG_VELOCITY = Reason.WRONG_VELOCITY
    PENETRATION = Reason.PENETRATION
    SINGULAR = Reason.SINGULAR


EDGES: Final = tuple(edge.name.lower() for edge in Edge)


def _column(path: str, unit: str, long_name: str, **rest: Any) -> Quantity:
    """Return the declaration of a column of a table, such as ``"bands/start"``."""
    return Quantity((path.partition("/")[0],), unit, long_name, path=path, record=True, **rest)


def _error(of: str, unit: str, what: str, missing: str = "") -> Quantity:
    """Return the declaration of the error of a column, such as ``"bands/start"``."""
    dims, path = (of.partition("/")[0],), f"error/{of}"
    return Quantity(dims, unit, f"error of the {what}", path=path, missing=missing)


@dataclass(frozen=True, eq=False)
class Result:
    """Bands of existence, ascending in Omega; outputs that were not requested are absent."""

    GROUPS: ClassVar[Mapping[str, Group]] = {
        "bands": Group("Band", "A range of frequency in which solutions are admissible."),
        "rejected": Group(
            "RejectedRange",
            "A range whose solutions are phantoms though all impulses are positive.",
        ),
        "stability": Group(
            "StabilityRange", "A range inside a band, of stable or of unstable solutions."
        ),
        "unresolved": Group("UnresolvedRange", "A range that could not be decided; there are few."),
        "error": Group("BandError", "Errors of the bands."),
        "error/bands": Group("BandsError", "Absolute errors of the edges of bands."),
        "error/rejected": Group("RejectedError", "Absolute errors of the edges."),
        "error/stability": Group("StabilityError", "Absolute errors of edges and radii."),
    }

    band_start: Annotated[
        Floats | None,
        _column("bands/start", "time-1", "lower edge of a band, Omega", error="error/bands/start"),
    ]
    band_stop: Annotated[
        Floats | None,
        _column("bands/stop", "time-1", "upper edge of a band, Omega", error="error/bands/stop"),
    ]
    band_start_reason: Annotated[
        Integers | None,
        _column(
            "bands/start_reason",
            "1",
            "why solutions below are phantoms, or range at the end of the requested range",
            flags=EDGES,
        ),
    ]
    band_stop_reason: Annotated[
        Integers | None,
        _column("bands/stop_reason", "1", "the same of solutions above", flags=EDGES),
    ]
    band_edge_error: Annotated[
        Floats | None,
        _column("bands/edge_error", "time-1", "largest absolute error of the edges"),
    ]
    band_certified: Annotated[
        Booleans | None,
        _column("bands/certified", "1", "whether existence is proved throughout", flags=NO_YES),
    ]
    rejected_start: Annotated[
        Floats | None,
        _column(
            "rejected/start",
            "time-1",
            "lower edge of a rejected range, Omega",
            error="error/rejected/start",
        ),
    ]
    rejected_stop: Annotated[
        Floats | None,
        _column(
            "rejected/stop",
            "time-1",
            "upper edge of a rejected range, Omega",
            error="error/rejected/stop",
        ),
    ]
    rejected_reason: Annotated[
        Integers | None,
        _column("rejected/reason", "1", "why its solutions are phantoms", flags=EDGES),
    ]
    rejected_edge_error: Annotated[
        Floats | None,
        _column("rejected/edge_error", "time-1", "largest absolute error of the edges"),
    ]
    rejected_certified: Annotated[
        Booleans | None,
        _column("rejected/certified", "1", "whether that is proved throughout", flags=NO_YES),
    ]
    rejected_witness: Annotated[
        Floats | None,
        _column(
            "rejected/witness",
            "1",
            "triangle-wave time at which a limit is passed, somewhere in the range",
            missing="unknown",
        ),
    ]
    rejected_constraint: Annotated[
        Integers | None,
        _column(
            "rejected/constraint",
            "1",
            "constraint whose limit is passed, -1 where unknown",
            integers=(),
        ),
    ]
    stability_start: Annotated[
        Floats | None,
        _column(
            "stability/start",
            "time-1",
            "lower edge of a range, Omega",
            error="error/stability/start",
        ),
    ]
    stability_stop: Annotated[
        Floats | None,
        _column(
            "stability/stop",
            "time-1",
            "upper edge of a range, Omega",
            error="error/stability/stop",
        ),
    ]
    stability_stable: Annotated[
        Booleans | None,
        _column(
            "stability/stable",
            "1",
            "whether deviations from its solutions do not grow; nor do they decay",
            flags=NO_YES,
        ),
    ]
    stability_radius: Annotated[
        Floats | None,
        _column(
            "stability/radius",
            "1",
            "largest spectral radius of the half-period map at the frequencies examined",
            error="error/stability/radius",
        ),
    ]
    unresolved_start: Annotated[
        Floats, _column("unresolved/start", "time-1", "lower edge of an undecided range, Omega")
    ]
    unresolved_stop: Annotated[
        Floats, _column("unresolved/stop", "time-1", "upper edge of an undecided range, Omega")
    ]
    error_band_start: Annotated[Floats | None, _error("bands/start", "time-1", "lower edge")]
    error_band_stop: Annotated[Floats | None, _error("bands/stop", "time-1", "upper edge")]
    error_rejected_start: Annotated[Floats | None, _error("rejected/start", "time-1", "lower edge")]
    error_rejected_stop: Annotated[Floats | None, _error("rejected/stop", "time-1", "upper edge")]
    error_stability_start: Annotated[
        Floats | None, _error("stability/start", "time-1", "lower edge")
    ]
    error_stability_stop: Annotated[Floats | None, _error("stability/stop", "time-1", "upper edge")]
    error_stability_radius: Annotated[
        Floats | None, _error("stability/radius", "1", "largest radius", missing="unbounded")
    ]
    error_resolution: Annotated[
        float,
        Quantity(
            (),
            "1",
            "relative width below which a band or a gap between bands could be missed",
            path="error/resolution",
        ),
    ]
    error_complete: Annotated[
        bool,
        Quantity(
            (),
            "1",
            "whether all bands wider than that are proved to be listed",
            flags=NO_YES,
            path="error/complete",
        ),
    ]
    error_unresolved: Annotated[
        float,
        Quantity(
            (),
            "1",
            "fraction of the range that was not examined or could not be decided",
            path="error/unresolved",
        ),
    ]
    error_statement: Statement
    neglected: Neglected
