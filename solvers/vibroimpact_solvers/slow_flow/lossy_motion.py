"""The exact motion of an oscillator between lossy walls: speeds and impact times in closed form."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.errors import PlanError

MOST: Final = 20_000_000
"""Impacts that are listed one by one."""


def too_many(impacts: float) -> PlanError:
    """Return the refusal of a motion with more impacts than `MOST`."""
    about = f"about {impacts:.3g} impacts" if math.isfinite(impacts) else "impacts beyond number"
    return PlanError(f"{about} are more than {MOST}: ask for less time", ("t",))


@dataclass(frozen=True, slots=True)
class LossyMotion:
    """Motion of ``x'' + Omega^2 x = 0`` between walls at +-Delta with restitution k.

    The interval n, after the impact n, begins and ends with the speed ``u k^n`` at the walls and
    lasts ``(2/Omega) arctan(Omega Delta / (u k^n))``.
    """

    Omega: float  # natural frequency, 1/time; may be 0
    Delta: float  # distance of the walls, length
    k: float  # restitution
    speed: float  # speed before the first impact, at +Delta
    first: float  # its time

    @classmethod
    def from_state(
        cls, Omega: float, Delta: float, k: float, x: float, v: float
    ) -> LossyMotion | None:
        """Return the motion from a state with v > 0 inside the walls; None if it reaches none."""
        square = v * v + Omega**2 * (x - Delta) * (x + Delta)
        if square <= 0.0:
            return None
        speed = math.sqrt(square)
        if Omega == 0.0:
            return cls(Omega, Delta, k, speed, (Delta - x) / speed)
        first = (math.atan2(Omega * Delta, speed) - math.atan2(Omega * x, v)) / Omega
        return cls(Omega, Delta, k, speed, first)

    def speeds(self, intervals: Integers | Floats) -> Floats:
        """Return the speeds at the walls in intervals with these numbers."""
        return self.speed * np.power(self.k, intervals)

    def frequencies(self, intervals: Integers) -> tuple[Floats, Floats]:
        """Return gamma and omega of intervals; omega is 2 over their durations."""
        speeds = self.speeds(intervals)
        if self.Omega == 0.0:
            return np.zeros(intervals.size), speeds / self.Delta
        gamma = np.arctan2(self.Omega * self.Delta, speeds)
        return gamma, self.Omega / gamma

    def expected(self, until: float) -> float:
        """Return a bound on the number of impacts: the intervals become longer and longer."""
        _, omega = self.frequencies(np.array([1]))
        return max(0.0, 0.5 * (until - self.first) * float(omega[0]) + 2.0)

    def times(self, until: float) -> Floats:
        """Return the times of all impacts to `until`, shape (impact,)."""
        bound = self.expected(until)
        if bound > MOST:
            raise too_many(bound)
        _, omega = self.frequencies(np.arange(1, int(bound) + 1))
        times = self.first + np.concatenate([[0.0], np.cumsum(2.0 / omega)])
        return times[times <= until]

    def at(self, t: Floats) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Return gamma, omega, phi, x and v at given times, each shape (time,)."""
        impacts = self.times(float(t.max()))
        n = np.searchsorted(impacts, t, side="right")
        gamma, omega = self.frequencies(n)
        # The motion is symmetric about the middle of an interval, where x = 0.
        middle = np.concatenate([[self.first], impacts])[n] + np.where(n == 0, -1.0, 1.0) / omega
        e = np.where(n % 2 == 0, 1.0, -1.0)
        angle = self.Omega * (t - middle)
        top = np.hypot(self.Omega * self.Delta, self.speeds(n))
        x = e * top * (t - middle) * np.sinc(angle / np.pi)
        return gamma, omega, 2.0 * n + omega * (t - middle), x, e * top * np.cos(angle)
