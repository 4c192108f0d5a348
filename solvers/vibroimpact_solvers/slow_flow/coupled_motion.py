"""The exact motion of the two-oscillator system: linear between elastic impacts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.errors import PlanError
from vibroimpact_solvers.kernels import elastic_walls
from vibroimpact_solvers.slow_flow.coupled_rates import Coupled
from vibroimpact_solvers.slow_flow.free import FreeMotion

_MOST: Final = 2_000_000  # impacts
_STEPS: Final = 40.0  # of the search in a period of the fastest vibration


@dataclass(frozen=True, eq=False, slots=True)
class CoupledMotion:
    """Impacts and states after them."""

    free: FreeMotion  # the motion between them
    start: Floats  # (x1, x2, v1, v2) at t = 0, (4,)
    times: Floats  # (impact,)
    states: Floats  # (impact, 4)

    @classmethod
    def of(cls, parameters: Coupled, free: FreeMotion, start: Floats, until: float, size: int
           ) -> CoupledMotion:  # fmt: skip
        """Follow the motion until no wall can be reached, or to `until`.

        `size` is about how many impacts are expected.
        """
        stiffness = parameters.stiffness
        # The least energy with x1 at a wall, x2 giving way.
        give = stiffness[0, 0] - stiffness[0, 1] ** 2 / stiffness[1, 1]
        least = 0.5 * give * parameters.Delta**2
        step = 2.0 * math.pi / (_STEPS * float(np.abs(free.rates).max()))
        modes = np.ascontiguousarray(free.modes)
        inverse = np.ascontiguousarray(np.linalg.inv(modes))
        structure = elastic_walls.Structure(modes, inverse, free.rates, stiffness)
        walls = elastic_walls.Walls(0, parameters.Delta, least, step, until)
        while True:
            times, states = np.empty(size), np.empty((size, 4))
            count = elastic_walls.impacts(start, structure, walls, times, states)
            if count < size:
                return cls(free, start, times[:count].copy(), states[:count].copy())
            if size > _MOST:
                raise PlanError(f"more than {_MOST} impacts: ask for less time", ("t",))
            size *= 2

    def at(self, t: Floats) -> tuple[Floats, Integers]:
        """Return the states at some times, shape (time, 4), and the impacts before, (time,)."""
        n: Integers = np.searchsorted(self.times, t, side="right").astype(np.int64)
        starts = np.concatenate([[0.0], self.times])[n]
        states = np.concatenate([self.start[None, :], self.states])[n]
        return self.free.at(states, t - starts), n
