"""Ranges of frequency: bands, rejected ones, and those that stayed undecided."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from vibroimpact_solvers.existence_bands.result import Edge


@dataclass(frozen=True, slots=True)
class Band:
    """A range in which members exist.

    Parameters
    ----------
    start, stop : float
        Edges, as Omega.
    below, above : Edge
        What members beyond them are.
    error : float
        Largest absolute error of the edges.
    certified : bool
        Whether existence is proved throughout.
    """

    start: float
    stop: float
    below: Edge
    above: Edge
    error: float
    certified: bool


@dataclass(frozen=True, slots=True)
class Rejected:
    """A range in which impulses are positive and yet members are phantoms.

    Parameters
    ----------
    start, stop : float
        Edges, as Omega.
    reason : Edge
    certified : bool
        Whether that is proved throughout.
    witness : float
        A triangle-wave time at which a limit is passed; nan where unknown.
    constraint : int
        The limit that is passed; -1 where unknown.
    """

    start: float
    stop: float
    reason: Edge
    certified: bool
    witness: float = math.nan
    constraint: int = -1


@dataclass(slots=True)
class Findings:
    """All ranges along one family.

    Parameters
    ----------
    bands, rejected, unresolved : list
        In any order; unresolved ones as pairs (start, stop).
    resolution : float
        Relative width below which a band or a gap could hide.
    statement : str
        How they were found.
    """

    bands: list[Band] = field(default_factory=list)
    rejected: list[Rejected] = field(default_factory=list)
    unresolved: list[tuple[float, float]] = field(default_factory=list)
    resolution: float = 0.0
    statement: str = ""
