"""Frequency ranges: existence bands, rejected ranges, and undecided ones."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from vibroimpact_solvers.results.existence_bands import Edge


@dataclass(frozen=True, slots=True)
class Band:
    """A range in which impact modes exist.

    Parameters
    ----------
    start, stop : float
        Edges, as Omega.
    start_reason, stop_reason : Edge
        Why no impact modes exist beyond them.
    edge_error : float
        Largest absolute error of the edges.
    certified : bool
        Whether existence is proved throughout.
    """

    start: float
    stop: float
    start_reason: Edge
    stop_reason: Edge
    edge_error: float
    certified: bool


@dataclass(frozen=True, slots=True)
class Rejected:
    """A range in which impulses are positive but the solutions are phantoms.

    Parameters
    ----------
    start, stop : float
        Edges, as Omega.
    reason : Edge
    certified : bool
        Whether the reason is proved throughout.
    witness : float
        A triangle-wave time at which a limit is exceeded; nan where unknown.
    constraint : int
        The limit that is exceeded; -1 where unknown.
    """

    start: float
    stop: float
    reason: Edge
    certified: bool
    witness: float = math.nan
    constraint: int = -1


@dataclass(slots=True)
class FrequencyRanges:
    """All frequency ranges of one family.

    Parameters
    ----------
    bands, rejected, unresolved : list
        In any order; unresolved ones as pairs (start, stop).
    resolution : float
        Relative width below which a band or a gap could hide.
    statement : str
        How they were computed.
    """

    bands: list[Band] = field(default_factory=list)
    rejected: list[Rejected] = field(default_factory=list)
    unresolved: list[tuple[float, float]] = field(default_factory=list)
    resolution: float = 0.0
    statement: str = ""
