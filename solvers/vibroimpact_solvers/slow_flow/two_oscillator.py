"""A damped oscillator between elastic walls coupled to a free one, eq. 10.41-10.46."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.model import System
from vibroimpact_solvers.results.slow_flow import Stage
from vibroimpact_solvers.slow_flow import parameters, soft_wall
from vibroimpact_solvers.slow_flow.coupled_motion import CoupledMotion
from vibroimpact_solvers.slow_flow.coupled_rates import Coupled
from vibroimpact_solvers.slow_flow.decaying import Decaying, given_gamma
from vibroimpact_solvers.slow_flow.free import FreeMotion
from vibroimpact_solvers.slow_flow.limits import waves
from vibroimpact_solvers.slow_flow.motion import Impacts, Initial, Motion, Variant
from vibroimpact_solvers.slow_flow.regular import Flow, integrate


@dataclass(frozen=True)
class TwoOscillator(Decaying):
    """The system of eq. 10.41 and 10.42; displacements of both masses are shape (time, 2)."""

    coupled: Coupled  # parameters of the equations
    # Amplitudes of the second mass at t = 0 (eq. 10.43)
    A0: float
    B0: float
    horizon: float  # time to which the motion is followed

    VARIANTS: ClassVar[Mapping[str, Variant]] = {
        "exact": Variant("exact between impacts", "complex modes, impacts bracketed"),
        "transformed": Variant("integration", "eq. 10.44, integrated from impact to impact", 6e6),
        "averaged": Variant("integration", "the averages of eq. 10.44 over the phase", 3e6),
        "truncated": Variant("integration", "eq. 10.46, the averages to low powers of gamma", 2e6),
        "soft_wall": Variant("integration", "walls of the force (x/(alpha Delta))^17", 6e6),
    }
    INITIAL: ClassVar[tuple[str, ...]] = ("gamma", "phi", "A", "B")

    @classmethod
    def of(cls, system: System, initial: Initial, variant: str, until: float) -> Self:
        """Take the parameters from two equal coupled oscillators, and gamma, phi, A, B."""
        mass, coupled = _coupled(system)
        model = cls(
            mass,
            coupled.Omega0,
            coupled.zeta,
            coupled.Delta,
            given_gamma(initial),
            initial.phi or 0.0,
            FreeMotion.of(system),
            coupled,
            initial.A or 0.0,
            initial.B or 0.0,
            1.01 * until,
        )
        # Impacts end near the time of eq. 10.21, unless the second mass brings energy back.
        return replace(model, horizon=max(4.0 * model._leading_end, model.horizon))

    def duration(self, variant: str) -> float:
        """Return the time of the last impact, or of gamma = pi/2; infinity within the horizon."""
        if variant == "soft_wall":
            return math.inf
        if variant == "exact":
            times = self._exact_motion.times
            return float(times[-1]) if times.size else 0.0
        return self._flow(variant).end

    def impacts(self, until: float) -> Impacts:
        """Return the impacts of the exact motion."""
        there = self._exact_motion.times <= until
        speeds = np.abs(self._exact_motion.states[there, 2])
        gamma = np.arctan2(self.Omega0 * self.Delta, speeds)
        n: Floats = np.arange(float(speeds.size))
        phi: Floats = 2.0 * (n + self._first_interval) + 1.0
        return Impacts(self._exact_motion.times[there], speeds, phi, gamma)

    def motion(self, variant: str, t: Floats, *, shapes: bool = True) -> Motion:
        """Return the motion at some times."""
        match variant:
            case "exact":
                return self._exact(t)
            case "soft_wall":
                alpha = soft_wall.matched(self.gamma0)
                states = soft_wall.motion(self.coupled, alpha, self._start, t)
                stage = np.full(t.size, Stage.IMPACTS, dtype=np.int64)
                return Motion(stage, x=states[:, :2], v=states[:, 2:])
            case _:
                return self._slow(variant, t)

    @cached_property
    def _start(self) -> Floats:
        state = np.array([[self.gamma0, self.phi0, self.A0, self.B0]])
        physical: Floats = self._physical(state)[0]
        return physical

    def _physical(self, state: Floats) -> Floats:
        """Return (x1, x2, v1, v2) of (gamma, phi, A, B), eq. 10.43; shapes (time, 4)."""
        gamma, phi, A, B = state.T
        tau, e = waves(phi)
        scale, Omega0 = self.Delta / np.sin(gamma), self.Omega0
        sine, cosine = np.sin(0.5 * np.pi * tau), np.cos(0.5 * np.pi * tau)
        return np.stack(
            [
                scale * np.sin(gamma * tau),
                A * sine + B * cosine * e,
                scale * Omega0 * np.cos(gamma * tau) * e,
                Omega0 * (A * cosine * e - B * sine),
            ],
            axis=1,
        )

    # -- slow flows ------------------------------------------------------------------------

    def _flow(self, variant: str) -> Flow:
        known: dict[str, Flow] = self.__dict__.setdefault("_flows", {})
        if variant not in known:
            rates = {
                "transformed": self.coupled.exact,
                "averaged": self.coupled.averaged,
                "truncated": self.coupled.truncated,
            }[variant]
            start = np.array([self.gamma0, self.phi0, self.A0, self.B0])
            jumps = variant == "transformed"
            known[variant] = integrate(rates, start, self.horizon, jumps_at_impacts=jumps)
        return known[variant]

    def _slow(self, variant: str, t: Floats) -> Motion:
        flow = self._flow(variant)
        free = t >= flow.end
        state = np.empty((t.size, 4))
        state[~free] = flow.at(t[~free])
        physical = np.empty((t.size, 4))
        physical[~free] = self._physical(state[~free])
        if free.any():
            last = self._physical(flow.last[None, :])[0]
            physical[free] = self.free.at(last, t[free] - flow.end)
        state[free] = np.nan
        gamma, phi, A, B = state.T
        stage = np.where(free, Stage.FREE, Stage.IMPACTS)
        omega = self.Omega0 / gamma
        return Motion(stage, phi, gamma, omega, A, B, physical[:, :2], physical[:, 2:])

    # -- exact -----------------------------------------------------------------------------

    @cached_property
    def _exact_motion(self) -> CoupledMotion:
        size = int(1.2 * self.expected_impacts(math.inf)) + 16
        return CoupledMotion.of(self.coupled, self.free, self._start, self.horizon, size)

    def _exact(self, t: Floats) -> Motion:
        physical, n = self._exact_motion.at(t)
        x1, x2, v1, v2 = physical.T
        Omega0 = self.Omega0
        number = n + self._first_interval
        e = np.where(number % 2 == 0, 1.0, -1.0)
        size = np.hypot(v1, Omega0 * x1)
        gamma = np.arcsin(np.minimum(1.0, Omega0 * self.Delta / size))
        tau = np.arctan2(Omega0 * x1, e * v1) / gamma
        phi = 2.0 * number + e * tau
        sine, cosine = np.sin(0.5 * np.pi * tau), np.cos(0.5 * np.pi * tau)
        A = x2 * sine + v2 / Omega0 * cosine * e
        B = x2 * cosine * e - v2 / Omega0 * sine
        over = n == self._exact_motion.times.size
        for values in (gamma, phi, A, B):
            values[over] = np.nan
        stage = np.where(over, Stage.FREE, Stage.IMPACTS)
        return Motion(stage, phi, gamma, Omega0 / gamma, A, B, physical[:, :2], physical[:, 2:])


def _coupled(system: System) -> tuple[float, Coupled]:
    """Return the mass and the parameters of two equal oscillators, the first damped."""
    if system.n != 2:
        message = f"the model has 2 degrees of freedom, the system has {system.n}"
        raise parameters.refuse(("system",), message)
    limiter = parameters.limiter(system, 0)
    parameters.elastic(limiter)
    M, K = system.M.to_dense(), system.K.to_dense()
    C = np.zeros((2, 2)) if system.C is None else system.C.to_dense()
    if M[0, 1] != 0.0 or M[0, 0] != M[1, 1]:
        raise parameters.refuse(("system", "M"), "both masses are equal")
    square, beta = float(K[0, 0] + K[0, 1]) / M[0, 0], -float(K[0, 1]) / M[0, 0]
    if not math.isclose(K[0, 0], K[1, 1], rel_tol=1e-12) or square <= 0.0:
        raise parameters.refuse(("system", "K"), "both springs to the ground are equal")
    if C[0, 1] != 0.0 or C[1, 1] != 0.0 or C[0, 0] <= 0.0:
        raise parameters.refuse(("system", "C"), "the first mass is damped, and only that")
    if system.loaded:
        raise parameters.refuse(("system", "force"), "the model has no load")
    Omega0 = math.sqrt(square)
    zeta = float(C[0, 0]) / (2.0 * M[0, 0] * Omega0)
    if zeta >= 1.0:
        raise parameters.refuse(("system", "C"), "the damping ratio is below 1")
    return float(M[0, 0]), Coupled(Omega0, zeta, beta, parameters.distance(limiter))
