"""Motion between elastic walls that decays until it grazes them: what two models share."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.results.slow_flow import Stage
from vibroimpact_solvers.slow_flow import parameters
from vibroimpact_solvers.slow_flow.free import FreeMotion
from vibroimpact_solvers.slow_flow.motion import Initial, Model, Motion

GRAZING: Final = 0.5 * math.pi
"""Frequency ratio of the last impact."""


@dataclass(frozen=True)
class Decaying(Model):
    """A damped mass on a spring between elastic walls."""

    # Mass, natural frequency, damping ratio and distance of the walls
    mass: float
    Omega0: float
    zeta: float
    Delta: float
    # Frequency ratio and phase at t = 0
    gamma0: float
    phi0: float
    free: FreeMotion  # the motion without walls

    def expected_impacts(self, until: float) -> float:
        """Return about how many impacts there are in all (eq. 10.19)."""
        return 0.25 / (self.zeta * self.gamma0) + 2.0

    def impulse(self, motion: Motion) -> Floats | None:
        """Return p, eq. 10.8 and 10.45; 0 after the last impact, None for soft walls."""
        if motion.gamma is None or motion.omega is None:
            return None
        p = self.mass * self.Omega0 * self.Delta * motion.omega / np.tan(motion.gamma)
        return np.where(motion.stage == Stage.FREE, 0.0, p)

    @property
    def _leading_end(self) -> float:
        """Time at which gamma = pi/2 to the first power of gamma, eq. 10.21."""
        return math.log(GRAZING / self.gamma0) / (2.0 * self.zeta * self.Omega0)

    @property
    def _first_interval(self) -> int:
        """Number of the interval between impacts at t = 0; the motion is upwards in even ones."""
        return math.floor(0.5 * (self.phi0 + 1.0))


def given_gamma(initial: Initial) -> float:
    """Return the initial frequency ratio of a motion with impacts."""
    gamma = parameters.given(initial, "gamma")
    if not 0.0 < gamma < GRAZING:
        raise parameters.outside("gamma", "impacts need 0 < gamma < pi/2")
    return gamma
