"""One mass with one stop, from impact to impact: a reference that shares nothing with the solver.

``x'' + 2 a x' + x = F cos(omega t)``, x at most the gap, velocities times -k at impacts. Between
impacts the motion is its closed form; impacts are looked for on a fine grid and found by bisection.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

_STEPS = 400  # per period of the drive


@dataclass(frozen=True)
class Bouncing:
    """The oscillator."""

    omega: float
    a: float = 0.05
    k: float = 0.8
    gap: float = 0.0
    F: float = 1.0

    @property
    def period(self) -> float:
        """Period of the drive."""
        return 2.0 * math.pi / self.omega

    def flow(self, t0: float, x: float, v: float, t: float) -> tuple[float, float]:
        """Return the state at t of the motion without impacts from the state at t0."""
        size = self.F / math.hypot(1.0 - self.omega**2, 2.0 * self.a * self.omega)
        lag = math.atan2(2.0 * self.a * self.omega, 1.0 - self.omega**2)
        px, pv = (
            size * math.cos(self.omega * t0 - lag),
            -size * self.omega * math.sin(self.omega * t0 - lag),
        )
        w, s = math.sqrt(1.0 - self.a**2), t - t0
        c0, c1 = x - px, (v - pv + self.a * (x - px)) / w
        e, c, n = math.exp(-self.a * s), math.cos(w * s), math.sin(w * s)
        free = e * (c0 * c + c1 * n)
        rate = -self.a * free + e * w * (c1 * c - c0 * n)
        turn = self.omega * t - lag
        return free + size * math.cos(turn), rate - size * self.omega * math.sin(turn)

    def after(self, x: float, v: float, periods: int, start: int = 0) -> tuple[float, float, int]:
        """Return the state after periods of the drive from its phase 0, and the impacts."""
        t, end, count = start * self.period, (start + periods) * self.period, 0
        h = self.period / _STEPS
        while t < end - 1e-12:
            to = min(t + h, end)
            nx, nv = self.flow(t, x, v, to)
            if nx <= self.gap:
                t, x, v = to, nx, nv
                continue
            low, high = t, to
            while high - low > 1e-15 * max(1.0, high):
                middle = 0.5 * (low + high)
                if not low < middle < high:
                    break
                low, high = (
                    (middle, high) if self.flow(t, x, v, middle)[0] <= self.gap else (low, middle)
                )
            _, nv = self.flow(t, x, v, low)
            if low == t and v <= 0.0:  # it has just left the wall
                t, x, v = to, nx, nv
                continue
            t, x, v, count = low, self.gap, -self.k * abs(nv), count + 1
        return x, v, count

    def exponent(self, x: float, v: float, periods: int) -> float:
        """Return the largest exponent by two neighbouring motions, brought close each period."""
        x, v, _ = self.after(x, v, 200)
        close, total = 1e-8, 0.0
        dx, dv = close, 0.0
        for _ in range(periods):
            nx, nv, _ = self.after(x + dx, v + dv, 1)
            x, v, _ = self.after(x, v, 1)
            dx, dv = nx - x, nv - v
            far = math.hypot(dx, dv)
            total += math.log(far / close)
            dx, dv = dx * close / far, dv * close / far
        return total / (periods * self.period)
