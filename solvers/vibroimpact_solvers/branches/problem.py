"""The problem: periodic motions, the number of their problem that varies, and its range."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.laws import require
from vibroimpact_solvers.model import System
from vibroimpact_solvers.periodic_motions import Problem as Motions
from vibroimpact_solvers.results.branches import TYPES

KIND: Final = "branches"


@dataclass(frozen=True, eq=False)
class Problem:
    """Branches of periodic motions over a range of a parameter.

    Parameters
    ----------
    at : callable
        Returns the problem of periodic motions, at one frequency, for a value of the parameter;
        raises `ModelError` where there is none.
    start, stop : float
        Ends of the range, in any order. All solutions at the start, at the stop and at values
        between them begin branches.
    system : System
        The structure of the base, which has the units.
    frequency : bool
        Whether the parameter is the frequency of the drive, in any unit: the structure then stays
        the same.
    switch : int
        How many branches to follow that begin at flips and losses of symmetry.
    stop_at : frozenset of str
        Types of special points at which a branch ends, of `TYPES`.
    points : int
        Most points of a branch.
    step : float
        Longest step, as a part of the range, in rad of the phases, or of the impulses relative to
        the usual or, if they have grown, the largest ones.
    unit, long_name : str
        Of the parameter, see `vibroimpact_solvers.arrays.Quantity`.
    """

    at: Callable[[float], Motions]
    start: float
    stop: float
    system: System
    frequency: bool = False
    switch: int = 0
    stop_at: frozenset[str] = frozenset()
    points: int = 2000
    step: float = 0.02
    unit: str = "1"
    long_name: str = "parameter"

    @property
    def stopped(self) -> bool:
        """Whether stops have a finite stiffness."""
        return any(not constraint.law.rigid for constraint in self.system.constraints)

    def __post_init__(self) -> None:
        if not (math.isfinite(self.start) and math.isfinite(self.stop)):
            raise ModelError(("start",), "an end of the range is not finite", code="not_finite")
        if self.start == self.stop:
            raise ModelError(("stop",), "the range has no length", code="empty_grid")
        try:
            require(KIND, self.system.constraints)
        except ModelError as error:
            raise error.under("base") from None
        unknown = sorted(self.stop_at - set(TYPES))
        if unknown:
            message = f"special points are {', '.join(TYPES)}"
            raise ModelError(("stop_at",), message, code="unknown_choice")
        Omega = []
        for value in (self.start, self.stop):
            motions = self.at(value)
            if motions.Omega.size != 1:
                message = "branches are those of one frequency: give one value"
                raise ModelError(("base", "frequency"), message, code="shapes_differ")
            Omega.append(float(motions.Omega[0]))
        if self.frequency and not math.isclose(Omega[1] * self.start, Omega[0] * self.stop):
            message = "it is not the frequency of the drive"
            raise ModelError(("path",), message, code="unknown_choice")
