"""The problem: a family of impact modes and a range of frequencies."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers import impact_modes as modes
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.checks import check_outputs
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.laws import require
from vibroimpact_solvers.model import System

KIND: Final = "existence-bands"
OUTPUTS: Final = ("bands", "rejected", "stability")

FINEST: Final = 1e-15
"""Smallest relative tolerance of edges that double precision allows."""
USUAL: Final = 1e-12
"""Default relative tolerance of edges."""
SHARPEST: Final = 1e-6
"""Smallest resolution: a million of frequencies are looked at."""
COARSEST: Final = 0.1
"""Largest resolution."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Existence of the impact modes of one family in a range of frequencies.

    Parameters
    ----------
    system : System
    start, stop : float
        Range of the fundamental frequency Omega, rad per unit of time, 0 < start < stop.
    active : tuple of int
        The constraints with impacts; empty for all.
    outputs : frozenset of str
        The requested ones of `OUTPUTS`.
    tolerance : float, optional
        Relative width to which edges are enclosed.
    resolution : float, optional
        Width, relative to that of the range, from which on all bands and gaps are found; absent:
        all of them, however narrow.
    """

    system: System
    start: float
    stop: float
    active: tuple[int, ...] = ()
    outputs: frozenset[str] = frozenset({"bands", "rejected"})
    tolerance: float | None = None
    resolution: float | None = None

    def __post_init__(self) -> None:
        count = len(self.system.constraints)
        object.__setattr__(self, "active", tuple(self.active) or tuple(range(count)))
        object.__setattr__(self, "outputs", frozenset(self.outputs))
        for name in ("start", "stop"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                message = f"the frequency is {value!r}, not positive and finite"
                raise ModelError(("frequency", name), message, code="frequency_not_positive")
        if not self.start < self.stop:
            message = "the range is empty: stop must be above start"
            raise ModelError(("frequency", "stop"), message, code="empty_grid")
        check_outputs(self.outputs, OUTPUTS)
        require(KIND, self.system.constraints)
        if self.tolerance is not None and not FINEST <= self.tolerance < 0.1:
            message = f"the tolerance of edges is {self.tolerance!r}, not in [{FINEST:g}, 0.1)"
            raise ModelError(("tolerance",), message, code="out_of_range")
        if self.resolution is not None and not COARSEST >= self.resolution >= SHARPEST:
            message = f"the resolution is {self.resolution!r}, not in [{SHARPEST:g}, {COARSEST:g}]"
            raise ModelError(("resolution",), message, code="out_of_range")
        # Constraints are checked as for impact modes.
        self.impact_modes_at(np.array([self.start]), frozenset({"exists"}))

    @property
    def neglected(self) -> list[str]:
        """A sentence about each part of the structure that has no effect."""
        return self.system.losses(self.active)

    @property
    def edge_width(self) -> float:
        """Relative width to which edges are enclosed."""
        return USUAL if self.tolerance is None else self.tolerance

    @property
    def grid(self) -> Floats:
        """Frequencies Omega so dense that all that is as wide as the resolution contains one."""
        assert self.resolution is not None
        return np.linspace(self.start, self.stop, math.ceil(1.0 / self.resolution) + 1)

    def impact_modes_at(self, Omega: Floats, outputs: frozenset[str]) -> modes.Problem:
        """Return the problem of the impact modes at some frequencies."""
        omega = Omega * (2.0 / np.pi)
        return modes.Problem(self.system, omega, self.active, outputs, Omega=Omega)
