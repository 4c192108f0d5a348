"""A damped oscillator between elastic walls, eq. 10.13-10.21, and what follows the last impact.

Every variant continues after its last impact, gamma = pi/2, as the free motion from the state
reached: one continuous solution for both stages.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Final, Self

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels import damped_walls
from vibroimpact_solvers.model import System
from vibroimpact_solvers.results.slow_flow import Stage
from vibroimpact_solvers.slow_flow import parameters
from vibroimpact_solvers.slow_flow.damped_average import Average
from vibroimpact_solvers.slow_flow.decaying import GRAZING, Decaying, given_gamma
from vibroimpact_solvers.slow_flow.free import FreeMotion
from vibroimpact_solvers.slow_flow.motion import Impacts, Initial, Motion, Variant
from vibroimpact_solvers.slow_flow.regular import Flow, integrate


def _hypergeometric(terms: int) -> Floats:
    """Return the coefficients of 2F1(-1/4, -1/4; 3/4; r)."""
    k = np.arange(terms - 1.0)
    ratios = (k - 0.25) ** 2 / ((k + 0.75) * (k + 1.0))
    return np.concatenate([[1.0], np.cumprod(ratios)])


_SERIES: Final = _hypergeometric(36)


@dataclass(frozen=True)
class Damped(Decaying):
    """The oscillator of eq. 10.13."""

    VARIANTS: ClassVar[Mapping[str, Variant]] = {
        "exact": Variant(
            "exact between impacts", "damped arcs from wall to wall, impacts by Newton's method"
        ),
        "transformed": Variant("integration", "eq. 10.15, integrated from impact to impact", 2e6),
        "averaged": Variant("quadrature", "eq. 10.16 without expansion, by quadrature"),
        "truncated": Variant("closed form", "eq. 10.17 and 10.18, to the fifth power of gamma"),
        "leading": Variant("closed form", "eq. 10.19, to the first power of gamma"),
    }
    INITIAL: ClassVar[tuple[str, ...]] = ("gamma", "phi")

    @classmethod
    def of(cls, system: System, initial: Initial, variant: str, until: float) -> Self:
        """Take the parameters from a damped oscillator, gamma and phi."""
        one = parameters.single(system, damped=True)
        parameters.elastic(one.limiter)
        if one.Omega == 0.0:
            raise parameters.refuse(("system", "K"), "the model has a spring")
        zeta = one.damping / (2.0 * one.mass * one.Omega)
        if not 0.0 < zeta < 1.0:
            raise parameters.refuse(("system", "C"), "the damping ratio lies between 0 and 1")
        gamma = given_gamma(initial)
        phi = initial.phi or 0.0
        Delta = parameters.distance(one.limiter)
        free = FreeMotion.of(system)
        return cls(one.mass, one.Omega, zeta, Delta, gamma, phi, free)

    def duration(self, variant: str) -> float:
        """Return the time of the last impact, or of gamma = pi/2 (eq. 10.21)."""
        match variant:
            case "exact":
                return float(self._exact_impacts[0][-1]) if self._exact_impacts[0].size else 0.0
            case "transformed":
                return self._transformed.end
            case "averaged":
                return self._average.end
            case "truncated":
                fourth = GRAZING**4
                growth = fourth / (fourth + 11.25) / self._r0
                return math.log(growth) / (8.0 * self.zeta * self.Omega0)
            case _:
                return self._leading_end

    def impacts(self, until: float) -> Impacts:
        """Return the impacts of the exact motion."""
        times, speeds = self._exact_impacts
        there = times <= until
        gamma = np.arctan2(self.Omega0 * self.Delta, speeds)
        phi: Floats = 2.0 * (np.arange(float(times.size)) + self._first_interval) + 1.0
        return Impacts(times[there], speeds[there], phi[there], gamma[there])

    def motion(self, variant: str, t: Floats, *, shapes: bool = True) -> Motion:
        """Return the motion at some times."""
        if variant == "exact":
            return self._exact(t)
        end = self.duration(variant)
        free = t >= end
        gamma, phi = self._state(variant, np.where(free, 0.0, t))
        gamma[free], phi[free] = np.nan, np.nan
        stage = np.where(free, Stage.FREE, Stage.IMPACTS)
        omega = self.Omega0 / gamma
        if not shapes:
            return Motion(stage, phi, gamma, omega)
        x, v = np.empty_like(t), np.empty_like(t)
        damped_walls.elastic_shapes(gamma[~free], phi[~free], *(impacts := _pair(~free)))
        x[~free], v[~free] = impacts
        if free.any():
            last = self._grazing_phase(variant, end)
            x[free], v[free] = self._decay(last, t[free] - end)
        scale = self.Delta
        return Motion(
            stage, phi, gamma, omega, x=scale * x[:, None], v=scale * self.Omega0 * v[:, None]
        )  # fmt: skip

    def _grazing_phase(self, variant: str, end: float) -> float:
        if variant == "transformed":
            return float(self._transformed.last[1])
        return float(self._state(variant, np.array([end]))[1][0])

    def _decay(self, phi: float, later: Floats) -> tuple[Floats, Floats]:
        """Return x/Delta and v/(Omega0 Delta) after grazing at a phase."""
        x, v = _pair(np.ones(1, dtype=bool))
        damped_walls.elastic_shapes(np.array([GRAZING]), np.array([phi]), x, v)
        states = self.free.at(np.array([x[0], self.Omega0 * v[0]]), later)
        return states[:, 0], states[:, 1] / self.Omega0

    def _state(self, variant: str, t: Floats) -> tuple[Floats, Floats]:
        """Return gamma and phi at times up to grazing."""
        match variant:
            case "transformed":
                flow_states = self._transformed.at(t)
                return flow_states[:, 0], flow_states[:, 1]
            case "averaged":
                gamma, phi = self._average.at(t)
            case "truncated":
                gamma, phi = np.empty_like(t), np.empty_like(t)
                damped_walls.truncated(self.Omega0 * t, self.zeta, self._r0, _SERIES, gamma, phi)
            case _:
                rate = 2.0 * self.zeta * self.Omega0
                gamma = self.gamma0 * np.exp(rate * t)
                phi = -np.expm1(-rate * t) / (2.0 * self.zeta * self.gamma0)
        return gamma, phi + self.phi0

    @property
    def _r0(self) -> float:
        fourth = self.gamma0**4
        return fourth / (fourth + 11.25)

    @cached_property
    def _average(self) -> Average:
        return Average.starting(self.gamma0, self.zeta, self.Omega0)

    @cached_property
    def _transformed(self) -> Flow:
        def rates(tau: float, e: float, y: Floats) -> tuple[float, float, float]:
            gamma = float(y[0])
            sine, cosine = math.sin(gamma), math.cos(gamma)
            square = math.cos(gamma * tau) ** 2
            bend = math.sin(2.0 * gamma * tau) * cosine - 2.0 * tau * square * sine
            return (
                2.0 * self.zeta * self.Omega0 * square * sine,
                self.Omega0 / gamma * (cosine + self.zeta * bend * e),
                cosine,
            )

        start = np.array([self.gamma0, self.phi0])
        return integrate(rates, start, math.inf, jumps_at_impacts=True)

    # -- exact -----------------------------------------------------------------------------

    @property
    def _constants(self) -> tuple[float, float, float]:
        delta = self.zeta * self.Omega0
        return delta, self.Omega0 * math.sqrt(1.0 - self.zeta**2), self.Omega0**2

    @cached_property
    def _start(self) -> tuple[float, float]:
        """Return x and v at t = 0, as if upwards."""
        tau = self.phi0 - 2.0 * self._first_interval
        angle, scale = self.gamma0 * tau, self.Delta / math.sin(self.gamma0)
        return scale * math.sin(angle), scale * self.Omega0 * math.cos(angle)

    @cached_property
    def _exact_impacts(self) -> tuple[Floats, Floats]:
        """Return times and speeds of all impacts."""
        size = int(1.2 * self.expected_impacts(math.inf)) + 10
        while True:
            times, speeds = np.empty(size), np.empty(size)
            count = damped_walls.impacts(
                *self._start, *self._constants, self.Delta, math.inf, times, speeds
            )  # fmt: skip
            if count >= 0:
                return times[:count], speeds[:count]
            size *= 2

    def _exact(self, t: Floats) -> Motion:
        times, speeds = self._exact_impacts
        n = np.searchsorted(times, t, side="right")
        starts = np.concatenate([[0.0], times])[n]
        x0 = np.concatenate([[self._start[0]], np.full(times.size, -self.Delta)])[n]
        v0 = np.concatenate([[self._start[1]], speeds])[n]
        x, v = _arcs(x0, v0, t - starts, *self._constants)
        number = n + self._first_interval
        e = np.where(number % 2 == 0, 1.0, -1.0)
        energy = np.hypot(v, self.Omega0 * x)
        gamma = np.arcsin(np.minimum(1.0, self.Omega0 * self.Delta / energy))
        phi = 2.0 * number + np.arctan2(self.Omega0 * x, v) / gamma
        over = n == times.size
        gamma[over], phi[over] = np.nan, np.nan
        stage = np.where(over, Stage.FREE, Stage.IMPACTS)
        return Motion(
            stage, phi, gamma, self.Omega0 / gamma, x=(e * x)[:, None], v=(e * v)[:, None]
        )  # fmt: skip


def _pair(chosen: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> tuple[Floats, Floats]:
    size = int(chosen.sum())
    return np.empty(size), np.empty(size)


def _arcs(
    x: Floats, v: Floats, s: Floats, delta: float, root: float, square: float
) -> tuple[Floats, Floats]:
    """Return damped arcs a time s after their states; all shapes (time,)."""
    decay, sine, cosine = np.exp(-delta * s), np.sin(root * s), np.cos(root * s)
    pull = (delta * v + square * x) / root
    return decay * (x * cosine + (v + delta * x) / root * sine), decay * (v * cosine - pull * sine)
