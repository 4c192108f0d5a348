"""Frequency ranges: existence bands, rejected ranges, and undecided ones."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from vibroimpact_solvers.results.existence_bands import Edge


@dataclass(frozen=True, slots=True)
class Band:
    """A range in which impact modes exist; its fields are the columns ``bands/…`` of results."""

    # Edges, as Omega
    start: float
    stop: float
    # Why no impact modes exist beyond them
    start_reason: Edge
    stop_reason: Edge
    edge_error: float  # largest absolute error of the edges
    certified: bool  # whether existence is proved throughout


@dataclass(frozen=True, slots=True)
class Rejected:
    """A range in which impulses are positive but the solutions are phantoms."""

    # Edges, as Omega
    start: float
    stop: float
    reason: Edge
    edge_error: float  # largest absolute error of the edges
    certified: bool  # whether the reason is proved throughout
    # A triangle-wave time at which a limit is exceeded; nan where unknown
    witness: float = math.nan
    constraint: int = -1  # the limit that is exceeded; -1 where unknown


@dataclass(slots=True)
class FrequencyRanges:
    """All frequency ranges of one family."""

    # In any order; unresolved ones as pairs (start, stop)
    bands: list[Band] = field(default_factory=list)
    rejected: list[Rejected] = field(default_factory=list)
    unresolved: list[tuple[float, float]] = field(default_factory=list)
    resolution: float = 0.0  # relative width below which a band or a gap could hide
    statement: str = ""  # how they were computed
    complete: bool = False  # whether all bands wider than that are proved to be listed
    decided: float = 1.0  # fraction of the range that is examined, beside unresolved ranges
