"""A damped oscillator between elastic walls coupled to a free one, eq. 10.41-10.46."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import ClassVar, Final, Self

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.slow_flow import parameters, soft_wall
from vibroimpact_solvers.slow_flow.coupled_flights import CoupledFlights
from vibroimpact_solvers.slow_flow.coupled_rates import Coupled
from vibroimpact_solvers.slow_flow.free import FreeMotion
from vibroimpact_solvers.slow_flow.limits import waves
from vibroimpact_solvers.slow_flow.motion import Asked, Impacts, Motion, Stage, Variant
from vibroimpact_solvers.slow_flow.regular import Flow, integrate

VARIANTS: Final = MappingProxyType(
    {
        "exact": Variant("flights", "linear flights by complex modes, impacts bracketed"),
        "transformed": Variant("integration", "eq. 10.44, integrated from impact to impact", 6e6),
        "averaged": Variant("integration", "the averages of eq. 10.44 over the phase", 3e6),
        "truncated": Variant("integration", "eq. 10.46, the averages to low powers of gamma", 2e6),
        "soft_wall": Variant("integration", "walls of the force (x/(alpha Delta))^17", 6e6),
    }
)
_GRAZING: Final = 0.5 * math.pi


@dataclass(frozen=True)
class TwoOscillator:
    """The system of eq. 10.41 and 10.42; displacements of both masses are shape (time, 2).

    Parameters
    ----------
    mass : float
        Of each.
    coupled : Coupled
        Parameters of the equations.
    gamma0, phi0, A0, B0 : float
        The state at t = 0 (eq. 10.43).
    free : FreeMotion
        The motion without walls.
    horizon : float
        Time to which the motion is followed.
    """

    mass: float
    coupled: Coupled
    gamma0: float
    phi0: float
    A0: float
    B0: float
    free: FreeMotion
    horizon: float

    VARIANTS: ClassVar[Mapping[str, Variant]] = VARIANTS
    INITIAL: ClassVar[tuple[str, ...]] = ("gamma", "phi", "A", "B")

    @classmethod
    def of(cls, asked: Asked) -> Self:
        """Take the parameters from two equal coupled oscillators, and gamma, phi, A, B."""
        mass, coupled = _coupled(asked)
        start = asked.initial
        gamma = parameters.given(start, "gamma")
        if not 0.0 < gamma < _GRAZING:
            raise parameters.outside("gamma", "impacts need 0 < gamma < pi/2")
        # Impacts end near the time of eq. 10.21, unless the second mass brings energy back.
        lasting = math.log(_GRAZING / gamma) / (2.0 * coupled.zeta * coupled.Omega0)
        horizon = max(4.0 * lasting, 1.01 * float(asked.t.max()))
        rest = (start.phi or 0.0, start.A or 0.0, start.B or 0.0)
        return cls(mass, coupled, gamma, *rest, FreeMotion.of(asked.system), horizon)

    def exists(self) -> None:
        """There is no family."""

    def expected_impacts(self, until: float) -> float:
        """Return about how many impacts there are, however long one waits."""
        return 0.25 / (self.coupled.zeta * self.gamma0) + 2.0

    def impulse(self, motion: Motion) -> Floats | None:
        """Return p, eq. 10.45; 0 after the last impact, None for soft walls."""
        if motion.gamma is None or motion.omega is None:
            return None
        scale = self.mass * self.coupled.Omega0 * self.coupled.Delta
        p = scale * motion.omega / np.tan(motion.gamma)
        return np.where(motion.stage == Stage.FREE, 0.0, p)

    def duration(self, variant: str) -> float:
        """Return the time of the last impact, or of gamma = pi/2; infinity within the horizon."""
        if variant == "soft_wall":
            return math.inf
        if variant == "exact":
            times = self._flights.times
            return float(times[-1]) if times.size else 0.0
        return self._flow(variant).end

    def impacts(self, until: float) -> Impacts:
        """Return the impacts of the exact motion."""
        there = self._flights.times <= until
        speeds = np.abs(self._flights.states[there, 2])
        gamma = np.arctan2(self.coupled.Omega0 * self.coupled.Delta, speeds)
        n: Floats = np.arange(float(speeds.size))
        phi: Floats = 2.0 * (n + self._flight0) + 1.0
        return Impacts(self._flights.times[there], speeds, phi, gamma)

    def motion(self, variant: str, t: Floats, *, shapes: bool = True) -> Motion:
        """Return the motion at some times."""
        match variant:
            case "exact":
                return self._exact(t)
            case "soft_wall":
                alpha = soft_wall.matched(self.gamma0)
                found = soft_wall.motion(self.coupled, alpha, self._start, t)
                stage = np.full(t.size, Stage.IMPACTS, dtype=np.int64)
                return Motion(stage, x=found[:, :2], v=found[:, 2:])
            case _:
                return self._slow(variant, t)

    @cached_property
    def _start(self) -> Floats:
        state = np.array([[self.gamma0, self.phi0, self.A0, self.B0]])
        found: Floats = self._physical(state)[0]
        return found

    @property
    def _flight0(self) -> int:
        return math.floor(0.5 * (self.phi0 + 1.0))

    def _physical(self, state: Floats) -> Floats:
        """Return (x1, x2, v1, v2) of (gamma, phi, A, B), eq. 10.43; shapes (time, 4)."""
        gamma, phi, A, B = state.T
        tau, e = waves(phi)
        scale, Omega0 = self.coupled.Delta / np.sin(gamma), self.coupled.Omega0
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
            known[variant] = integrate(rates, start, self.horizon, by_flights=jumps)
        return known[variant]

    def _slow(self, variant: str, t: Floats) -> Motion:
        flow = self._flow(variant)
        free = t >= flow.end
        state = np.empty((t.size, 4))
        state[~free] = flow.at(t[~free])
        found = np.empty((t.size, 4))
        found[~free] = self._physical(state[~free])
        if free.any():
            last = self._physical(flow.last[None, :])[0]
            found[free] = self.free.at(last, t[free] - flow.end)
        state[free] = np.nan
        gamma, phi, A, B = state.T
        stage = np.where(free, Stage.FREE, Stage.IMPACTS)
        omega = self.coupled.Omega0 / gamma
        return Motion(stage, phi, gamma, omega, A, B, found[:, :2], found[:, 2:])

    # -- exact -----------------------------------------------------------------------------

    @cached_property
    def _flights(self) -> CoupledFlights:
        size = int(1.2 * self.expected_impacts(math.inf)) + 16
        return CoupledFlights.of(self.coupled, self.free, self._start, self.horizon, size)

    def _exact(self, t: Floats) -> Motion:
        found, n = self._flights.at(t)
        x1, x2, v1, v2 = found.T
        Omega0 = self.coupled.Omega0
        number = n + self._flight0
        e = np.where(number % 2 == 0, 1.0, -1.0)
        size = np.hypot(v1, Omega0 * x1)
        gamma = np.arcsin(np.minimum(1.0, Omega0 * self.coupled.Delta / size))
        tau = np.arctan2(Omega0 * x1, e * v1) / gamma
        phi = 2.0 * number + e * tau
        sine, cosine = np.sin(0.5 * np.pi * tau), np.cos(0.5 * np.pi * tau)
        A = x2 * sine + v2 / Omega0 * cosine * e
        B = x2 * cosine * e - v2 / Omega0 * sine
        over = n == self._flights.times.size
        for values in (gamma, phi, A, B):
            values[over] = np.nan
        stage = np.where(over, Stage.FREE, Stage.IMPACTS)
        return Motion(stage, phi, gamma, Omega0 / gamma, A, B, found[:, :2], found[:, 2:])


def _coupled(asked: Asked) -> tuple[float, Coupled]:
    """Return the mass and the parameters of two equal oscillators, the first damped."""
    system = asked.system
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
    if system.force is not None and system.force.any():
        raise ModelError(("system", "force"), "the model has no load", code="not_of_this_model")
    Omega0 = math.sqrt(square)
    zeta = float(C[0, 0]) / (2.0 * M[0, 0] * Omega0)
    if zeta >= 1.0:
        raise parameters.refuse(("system", "C"), "the damping ratio is below 1")
    return float(M[0, 0]), Coupled(Omega0, zeta, beta, parameters.distance(limiter))
