"""An oscillator between elastic walls, or below one, eq. 10.1-10.12: solutions and phantoms."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.model import System
from vibroimpact_solvers.results.slow_flow import Stage
from vibroimpact_solvers.slow_flow import parameters
from vibroimpact_solvers.slow_flow.limits import waves
from vibroimpact_solvers.slow_flow.motion import Impacts, Initial, Model, Motion, Variant


@dataclass(frozen=True)
class Oscillator(Model):
    """The oscillator of eq. 10.1 with one solution of its family."""

    # Mass and natural frequency
    mass: float
    Omega0: float
    Delta: float  # distance of the walls; with one wall x <= Delta of either sign
    both: bool  # whether there are two walls
    # Frequency ratio Omega0 / omega of the solution and its phase at t = 0
    gamma: float
    phi: float

    VARIANTS: ClassVar[Mapping[str, Variant]] = {
        "exact": Variant("reflection", "the motion from the same state, reflected at the walls"),
        "family": Variant("closed form", "the solution of the family, eq. 10.9 or 10.12"),
    }
    INITIAL: ClassVar[tuple[str, ...]] = ("gamma", "energy", "root", "phi")

    @classmethod
    def of(cls, system: System, initial: Initial, variant: str, until: float) -> Self:
        """Take the parameters from an undamped oscillator, and gamma or an energy and a root."""
        one = parameters.single(system)
        parameters.elastic(one.limiter)
        if one.Omega == 0.0:
            raise parameters.refuse(("system", "K"), "the model has a spring")
        limiter = one.limiter
        both = limiter.lower is not None
        if limiter.upper is None or limiter.upper == 0.0:
            message = "the model has an upper wall, not at rest"
            raise parameters.refuse(("system", "constraints", 0, "gap"), message)
        Delta = parameters.distance(limiter) if both else limiter.upper
        grazing = 0.5 * one.stiffness * Delta**2
        gamma = _gamma(initial, grazing, both)
        model = cls(one.mass, one.Omega, Delta, both, gamma, initial.phi or 0.0)
        if variant == "exact" and not model.starts_inside():
            raise parameters.outside("phi", "the phantom starts beyond a wall")
        return model

    def exists(self) -> bool:
        """Whether the solution is admissible: within the walls, which push it back."""
        if self.both:
            return 0.0 < self.gamma <= 0.5 * math.pi
        if self.Delta > 0.0:
            return 0.5 * math.pi < self.gamma <= math.pi
        return 0.0 < self.gamma < 0.5 * math.pi

    def starts_inside(self) -> bool:
        """Whether the solution is within the walls at t = 0."""
        x, _ = self._start()
        return x <= self.Delta * (1.0 + math.copysign(1e-12, self.Delta)) and (
            not self.both or x >= -self.Delta * (1.0 + 1e-12)
        )

    def impulse(self, motion: Motion) -> Floats:
        """Return p, eq. 10.8 and 10.11: positive where the wall pushes back."""
        omega = self.Omega0 / self.gamma
        slope = 1.0 / math.tan(self.gamma) if self.both else -math.tan(self.gamma)
        return np.full(motion.stage.size, self.mass * self.Delta * omega**2 * self.gamma * slope)

    def expected_impacts(self, until: float) -> float:
        """Return the number of impacts, within one."""
        admissible = self._admissible()
        return 0.5 * admissible.Omega0 / admissible.gamma * until + 1.0

    def impacts(self, until: float) -> Impacts:
        """Return the impacts of the motion that starts from the state of the solution."""
        admissible = self._admissible()
        omega = admissible.Omega0 / admissible.gamma
        first = math.floor(0.5 * (admissible.phi + 1.0))
        last = math.floor(0.5 * (admissible.phi + omega * until - 1.0))
        phi: Floats = 2.0 * np.arange(float(first), last + 1.0) + 1.0
        slope = 1.0 / math.tan(admissible.gamma) if self.both else -math.tan(admissible.gamma)
        speed = np.full(phi.size, admissible.Omega0 * admissible.Delta * slope)
        gamma = np.full(phi.size, admissible.gamma)
        return Impacts((phi - admissible.phi) / omega, speed, phi, gamma)

    def motion(self, variant: str, t: Floats, *, shapes: bool = True) -> Motion:
        """Return the solution of the family, or the motion from its state."""
        of = self if variant == "family" else self._admissible()
        omega = of.Omega0 / of.gamma
        phi = of.phi + omega * t
        stage = np.full(t.size, Stage.IMPACTS, dtype=np.int64)
        state = (stage, phi, np.full(t.size, of.gamma), np.full(t.size, omega))
        if not shapes:
            return Motion(*state)
        x, v = of._shape(phi)
        return Motion(*state, x=x[:, None], v=v[:, None])

    def _shape(self, phi: Floats) -> tuple[Floats, Floats]:
        tau, e = waves(phi)
        sine, cosine = np.sin(self.gamma * tau), np.cos(self.gamma * tau)
        if self.both:
            scale = self.Delta / math.sin(self.gamma)
            return scale * sine, scale * self.Omega0 * cosine * e
        scale = self.Delta / math.cos(self.gamma)
        return scale * cosine, -scale * self.Omega0 * sine * e

    def _start(self) -> tuple[float, float]:
        x, v = self._shape(np.array([self.phi]))
        return float(x[0]), float(v[0])

    def _admissible(self) -> Oscillator:
        """Return the admissible solution through the state at t = 0."""
        x, v = self._start()
        v /= self.Omega0
        radius = math.hypot(x, v)
        if self.both:
            gamma = math.asin(min(1.0, self.Delta / radius))
            tau = math.atan2(x, abs(v)) / gamma
            phi = tau if v >= 0.0 else 2.0 - tau
        else:
            gamma = math.acos(max(-1.0, min(1.0, -self.Delta / radius)))
            phi = math.atan2(v, -x) / gamma
        return Oscillator(self.mass, self.Omega0, self.Delta, self.both, gamma, phi)


def _gamma(start: Initial, grazing: float, both: bool) -> float:
    """Return gamma as given, or by energy and root, eq. 10.10 and its counterpart for one wall."""
    if start.gamma is not None:
        if start.energy is not None or start.root is not None:
            raise parameters.outside("gamma", "give either gamma, or energy and root")
        gamma = start.gamma
    else:
        energy = parameters.given(start, "energy")
        if energy < grazing:
            raise parameters.outside("energy", f"the walls are reached from {grazing!r} on")
        root = start.root or 0
        if root < 0:
            raise parameters.outside("root", "roots count from 0")
        half = math.asin(math.sqrt(grazing / energy))
        # Eq. 10.10: the energy is grazing / sin^2(gamma); with one wall / cos^2(gamma).
        least = half if both else 0.5 * math.pi - half
        gamma = (
            (root // 2) * math.pi + least if root % 2 == 0 else (root // 2 + 1) * math.pi - least
        )
    flat = math.sin(gamma) if both else math.cos(gamma)
    if gamma <= 0.0 or abs(flat) < 1e-15:
        raise parameters.outside("gamma", "no solution has this gamma")
    return gamma
