"""One mass between stops by shooting in many digits: an independent reference of special points.

``x'' + 2 d x' + x = a cos(Omega t)`` moves between impacts as the sum of its steady response and a
free vibration, whose constants follow from the state at the impact. The map from impact to impact
needs the next passage of a wall; its derivatives are differences.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import mpmath as mp

DIGITS = 40


@dataclass
class Oscillator:
    """One mass; `sides` are the walls struck in turn, `gap` their distance, k the restitution."""

    d: float
    a: float
    gap: float
    k: float

    def steady(self, Omega: Any, t: Any) -> tuple[Any, Any]:
        """Return displacement and velocity of the steady response."""
        H = self.a / (1 - Omega**2 + 2j * mp.mpf(self.d) * Omega)
        z = H * mp.exp(1j * Omega * t)
        return mp.re(z), mp.re(1j * Omega * z)

    def free(self, Omega: Any, t0: Any, x0: Any, v0: Any, t: Any) -> tuple[Any, Any]:
        """Return the state at t of the motion with a state at t0."""
        d, s = mp.mpf(self.d), t - t0
        w = mp.sqrt(1 - d**2)
        x1, v1 = self.steady(Omega, t0)
        A, B = x0 - x1, (v0 - v1 + d * (x0 - x1)) / w
        C, S, decay = mp.cos(w * s), mp.sin(w * s), mp.exp(-d * s)
        x, v = self.steady(Omega, t)
        return (
            x + decay * (A * C + B * S),
            v + decay * ((B * w - d * A) * C - (A * w + d * B) * S),
        )

    def step(self, Omega: Any, t0: Any, v0: Any, sides: tuple[int, int], length: Any) -> Any:
        """Return time and velocity after the impact that follows one at t0 after about `length`."""
        x0, x1 = sides[0] * mp.mpf(self.gap), sides[1] * mp.mpf(self.gap)
        t = t0 + length
        for _ in range(60):
            x, v = self.free(Omega, t0, x0, v0, t)
            change = (x - x1) / v
            t -= change
            if abs(change) < mp.mpf(10) ** (3 - DIGITS):
                break
        _, v = self.free(Omega, t0, x0, v0, t)
        return t, -mp.mpf(self.k) * v

    def special(
        self, Omega: float, times: list[float], period: float, mirror: int, multiplier: int
    ) -> Any:
        """Return the frequency near Omega at which a motion has a multiplier.

        Parameters
        ----------
        times : list of float
            Approximate times of the impacts, all at the upper wall.
        period : float
            Periods of the drive after which it is repeated; half of one where it is mirrored.
        mirror : int
            -1 where the cell ends with the mirrored motion at the lower wall.
        """
        mp.mp.dps = DIGITS
        first = mp.mpf(times[0])

        def cell(W: Any, t: Any, v: Any) -> tuple[Any, Any]:
            T = 2 * mp.pi * mp.mpf(period) / W
            lengths = [mp.mpf(b - a) for a, b in itertools.pairwise(times)]
            lengths.append(T - mp.mpf(times[-1] - times[0]))
            for number, length in enumerate(lengths):
                end = mirror if number == len(lengths) - 1 else 1
                t, v = self.step(W, t, v, (1, end), length)
            return t - T, mirror * v

        def slopes(W: Any, t: Any, v: Any) -> tuple[Any, ...]:
            h = mp.mpf(10) ** (-DIGITS // 3)
            p, q = cell(W, t + h, v), cell(W, t - h, v)
            r, s = cell(W, t, v + h), cell(W, t, v - h)
            return tuple(
                (a - b) / (2 * h)
                for one, two in ((p, q), (r, s))
                for a, b in zip(one, two, strict=True)
            )

        def equations(W: Any, t: Any, v: Any) -> list[Any]:
            after = cell(W, t, v)
            a, c, b, e = slopes(W, t, v)
            det = (a - multiplier) * (e - multiplier) - b * c
            return [after[0] - t, after[1] - v, det]

        guess = self._speed(mp.mpf(Omega), first, times, period, mirror)
        solution = mp.findroot(equations, (mp.mpf(Omega), first, guess), tol=1e-16, verify=False)
        assert max(abs(r) for r in equations(*solution)) < mp.mpf(10) ** (-10)
        return solution[0]

    def _speed(self, W: Any, t: Any, times: list[float], period: float, mirror: int) -> Any:
        """Return the velocity after the impact at t with which the next one is where it should."""
        T = 2 * mp.pi * mp.mpf(period) / W
        single = len(times) == 1
        t1 = t + T if single else mp.mpf(times[1])
        end = (mirror if single else 1) * mp.mpf(self.gap)
        low = self.free(W, t, mp.mpf(self.gap), mp.mpf(0), t1)[0] - end
        high = self.free(W, t, mp.mpf(self.gap), mp.mpf(1), t1)[0] - end
        return -low / (high - low)
