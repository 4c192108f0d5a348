"""A ball that bounces until it rests, eq. 10.124-10.149: exact, and two nonsmooth transformations.

With ``q = 1 - sqrt(g/2H) eps t/2`` and ``phi = -(2/eps) ln(q)`` the transformation of time gives

    z = H q^2 (1 - tau^2) (1 + eps tau e / 2),

and that of the coordinate, z = abs(s), the same without the term in eps: s is an oscillator in the
potential g abs(s), whose losses at s = 0 are averaged over a cycle. Both lag by a fixed part of
an interval between impacts once eps t is not small. The phase of the exact motion is known,
though: with kappa = -ln(k), T the time of rest and q = 1 - t/T,

    phi = -(2/kappa) ln(q (1+k) / (2 sqrt(k)))

is odd at every impact, and with it the same shape, kappa in place of eps, has an error of the
second order at all times.
"""

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
from vibroimpact_solvers.slow_flow.lossy_motion import MOST, too_many
from vibroimpact_solvers.slow_flow.motion import Impacts, Initial, Model, Motion, Variant


@dataclass(frozen=True)
class BouncingBall(Model):
    """The ball of eq. 10.124 and 10.125, released at rest."""

    g: float  # acceleration towards the floor
    height: float  # height of release over the floor
    k: float  # restitution
    floor: float  # where the floor is

    VARIANTS: ClassVar[Mapping[str, Variant]] = {
        "exact": Variant("parabolas", "piecewise parabolas, their number from a logarithm"),
        "nstt": Variant(
            "time transformation", "nonsmooth transformation of time, eq. 10.144-10.149"
        ),
        "corrected": Variant(
            "time transformation", "the same with the phase that is odd at every exact impact"
        ),
        "nsct": Variant(
            "coordinate transformation",
            "nonsmooth transformation of the coordinate, z = abs(s), averaged over a cycle",
        ),
    }
    INITIAL: ClassVar[tuple[str, ...]] = ("x",)

    @classmethod
    def of(cls, system: System, initial: Initial, variant: str, until: float) -> Self:
        """Take the parameters from a mass without spring over a floor, and its height x."""
        one = parameters.single(system, loaded=True)
        if one.stiffness != 0.0:
            raise parameters.refuse(("system", "K"), "a ball has no spring")
        if one.force >= 0.0:
            raise parameters.refuse(("system", "force"), "the load of a ball points down")
        limiter, where = one.limiter, ("system", "constraints", 0)
        if limiter.lower is None or limiter.upper is not None:
            message = "a ball has a floor and no ceiling: a lower wall only"
            raise parameters.refuse((*where, "gap"), message)
        if not 0.0 < limiter.restitution < 1.0:
            message = "the restitution of a ball that comes to rest lies between 0 and 1"
            raise parameters.refuse((*where, "restitution"), message)
        floor = -limiter.lower
        height = parameters.given(initial, "x") - floor
        if height <= 0.0:
            raise parameters.outside("x", "the ball is released above the floor")
        return cls(-one.force / one.mass, height, limiter.restitution, floor)

    @property
    def eps(self) -> float:
        """Loss of speed in one impact, 1 - k."""
        return 1.0 - self.k

    @property
    def fall(self) -> float:
        """Time of the first fall, sqrt(2H/g); its inverse is omega0(0) of eq. 10.146."""
        return math.sqrt(2.0 * self.height / self.g)

    def impulse(self, motion: Motion) -> None:
        """Return None: p of eq. 10.126 is constant, twice the weight."""

    def duration(self, variant: str) -> float:
        """Return the time of rest: (1+k)/(1-k) falls, or 2/eps of them (eq. 10.149)."""
        falls = 1.0 + self.k if variant in {"exact", "corrected"} else 2.0
        return self.fall * falls / self.eps

    def expected_impacts(self, until: float) -> float:
        """Return a bound on the impacts whose times are different numbers."""
        # What is left after n impacts is 2 k^n / (1 - k) falls.
        least = 1e-17 * (1.0 + self.k) / 2.0
        left = max(least, 1.0 - until / self.duration("exact"))
        return max(0.0, math.log(min(1.0, left)) / math.log(self.k)) + 2.0

    def impacts(self, until: float) -> Impacts:
        """Return the impacts of the exact motion, as far as they differ in double precision."""
        bound = self.expected_impacts(until)
        if bound > MOST:
            raise too_many(bound)
        n: Floats = np.arange(1.0, int(bound) + 2.0)
        time = self._start(n)
        # Times beyond the last that differs from the one before are one impact.
        there = (time <= until) & (np.diff(time, prepend=-1.0) > 0.0)
        speed = self.g * self.fall * np.power(self.k, n - 1.0)
        return Impacts(time[there], speed[there], 2.0 * n[there] - 1.0, None)

    def _start(self, n: Floats) -> Floats:
        """Return the time of impact n: ``1 + 2 (k + ... + k^(n-1))`` falls."""
        terms = np.expm1((n - 1) * math.log(self.k)) / -self.eps
        return self.fall * (1.0 + 2.0 * self.k * terms)

    def motion(self, variant: str, t: Floats, *, shapes: bool = True) -> Motion:
        """Return the motion at some times; at rest from its end on."""
        rest = t >= self.duration(variant)
        moving = np.where(rest, 0.0, t)
        if variant == "exact":
            omega, phi, z, v = self._parabolas(moving)
        elif variant == "corrected":
            rate = -math.log(self.k)
            root = math.sqrt(self.k)
            lead = math.log1p((1.0 - root) ** 2 / (2.0 * root))
            omega, phi, z, v = self._transformed(moving, variant, rate, rate, lead)
        else:
            bend = self.eps if variant == "nstt" else 0.0
            omega, phi, z, v = self._transformed(moving, variant, self.eps, bend)
        stage = np.where(rest, Stage.REST, Stage.IMPACTS)
        omega[rest], phi[rest] = np.nan, np.nan
        z[rest], v[rest] = 0.0, 0.0
        if not shapes:
            return Motion(stage, phi, omega=omega)
        return Motion(stage, phi, omega=omega, x=(self.floor + z)[:, None], v=v[:, None])

    def _parabolas(self, t: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return omega (2 over the time between impacts), phi, z and its rate; t before rest."""
        left = 1.0 - t / self.duration("exact")
        # Free motion n begins where left is 2 k^n / (1 + k); roundings of the logarithm are mended.
        n = np.floor(np.log(left * (1.0 + self.k) / 2.0) / math.log(self.k))
        n = np.maximum(n, 0.0)
        n -= (n > 0) & (t < self._start(n))
        n += t >= self._start(n + 1.0)
        half = self.fall * np.power(self.k, n)
        middle = np.where(n == 0, 0.0, self._start(n) + half)
        top = 0.5 * self.g * half**2
        z = np.maximum(0.0, top - 0.5 * self.g * (t - middle) ** 2)
        return 1.0 / half, 2.0 * n + (t - middle) / half, z, -self.g * (t - middle)

    def _transformed(
        self, t: Floats, variant: str, rate: float, bend: float, lead: float = 0.0
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Return omega, phi, z and its rate, eq. 10.144-10.148.

        `rate` is eps or kappa, `bend` the same or 0, `lead` the logarithm of (1+k)/(2 sqrt(k)).
        """
        whole = self.duration(variant)
        q = 1.0 - t / whole
        phi = -(2.0 / rate) * (np.log1p(-t / whole) + lead)
        omega = 2.0 / (rate * whole * q)
        tau, e = waves(phi)
        bow, skew = 1.0 - tau**2, 1.0 + 0.5 * bend * tau * e
        z = self.height * q**2 * bow * skew
        # The slow rate is q' = -1/whole, the fast one omega.
        slow = -2.0 * q / whole * bow * skew
        fast = q**2 * omega * (0.5 * bend * bow - 2.0 * tau * e * skew)
        return omega, phi, z, self.height * (slow + fast)
