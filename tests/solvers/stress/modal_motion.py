"""Event-driven motion of natural modes in extended precision: rigid ones, many, and resonance.

Motions start by a blow along one constrained coordinate and are driven along it, so that no more
of the modes is needed than how constraints see them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mpmath

from tests.solvers.stress.extended import Modes
from vibroimpact_solvers.model import Constraint

Number = Any
Impact = tuple[Number, int, int, Number]


@dataclass(frozen=True)
class Drive:
    """A load ``amplitude cos(frequency t + phase)`` along the first constraint's coordinate."""

    amplitude: float
    frequency: float
    phase: float


class ModalMotion:
    """Modes ``q_j'' + lambda_j q_j = row_j F cos(Omega t + phase)`` between walls."""

    def __init__(
        self, modes: Modes, constraints: Sequence[Constraint], drive: Drive | None = None
    ) -> None:
        self.modes, self.constraints, self.drive = modes, constraints, drive
        self.rates = [mpmath.sqrt(value) for value in modes.eigenvalues]
        self.pieces: list[tuple[Number, list[Number], list[Number]]] = []

    def forced(self, j: int, t: Number) -> tuple[Number, Number]:
        """Return a particular motion of a mode and its rate; it may be in resonance."""
        if self.drive is None:
            return mpmath.mpf(0), mpmath.mpf(0)
        Omega, phase = mpmath.mpf(self.drive.frequency), mpmath.mpf(self.drive.phase)
        push = self.modes.seen[0][j] * mpmath.mpf(self.drive.amplitude)
        cosine, sine = mpmath.cos_sin(Omega * t + phase)
        apart = self.modes.eigenvalues[j] - Omega**2
        if apart == 0:
            grown = push / (2 * Omega)
            return grown * t * sine, grown * (sine + Omega * t * cosine)
        return push * cosine / apart, -push * Omega * sine / apart

    def begin(self, t: Number, q: list[Number], u: list[Number]) -> None:
        """Go on from modal coordinates and rates at a time."""
        own = [self.forced(j, t) for j in range(len(q))]
        self.start = t
        self.q = [a - f for a, (f, _) in zip(q, own, strict=True)]
        self.u = [a - f for a, (_, f) in zip(u, own, strict=True)]

    def state(self, t: Number) -> tuple[list[Number], list[Number]]:
        """Return modal coordinates and rates."""
        s, places, speeds = t - self.start, [], []
        for j, rate in enumerate(self.rates):
            a, b = self.q[j], self.u[j]
            f, g = self.forced(j, t)
            if rate == 0:
                places.append(a + b * s + f)
                speeds.append(b + g)
                continue
            cosine, sine = mpmath.cos_sin(rate * s)
            places.append(a * cosine + b * sine / rate + f)
            speeds.append(b * cosine - a * rate * sine + g)
        return places, speeds

    def seen(self, constraint: int, values: Sequence[Number]) -> Number:
        """Return what modal values are of a constrained coordinate."""
        return mpmath.fdot(self.modes.seen[constraint], values)

    def follow(self, blow: float, t_end: float, step: float) -> list[Impact]:
        """Return the impacts (time, constraint, side, velocity) after a blow to the first one.

        Steps must be shorter than what a coordinate takes to pass a wall and to come back.
        """
        zero = [mpmath.mpf(0)] * len(self.rates)
        t, end, found = mpmath.mpf(0), mpmath.mpf(t_end), list[Impact]()
        self.begin(t, zero, [row * mpmath.mpf(blow) for row in self.modes.seen[0]])
        while t < end:
            new = min(t + step, end)
            later = self.state(new)[0]
            first = None
            for i, c in enumerate(self.constraints):
                for side, wall in ((1, c.upper), (-1, c.lower)):
                    if wall is None or side * self.seen(i, later) <= wall:
                        continue
                    root = self._root(i, side, mpmath.mpf(wall), t + (new - t) / 1000, new)
                    if root is not None and (first is None or root < first[0]):
                        first = (root, i, side)
            if first is None:
                t = new
                continue
            t, i, side = first
            q, u = self.state(t)
            speed, row = self.seen(i, u), self.modes.seen[i]
            kick = (1 + mpmath.mpf(self.constraints[i].restitution)) * speed
            kick /= mpmath.fdot(row, row)
            self.begin(t, q, [a - kick * b for a, b in zip(u, row, strict=True)])
            found.append((t, i, side, speed))
        return found

    def _root(self, i: int, side: int, wall: Number, low: Number, high: Number) -> Number | None:
        def beyond(t: Number) -> Number:
            return side * self.seen(i, self.state(t)[0]) - wall

        if beyond(low) >= 0:
            return None
        tolerance = mpmath.mpf(10) ** (10 - mpmath.mp.dps)
        return mpmath.findroot(beyond, (low, high), "anderson", tol=tolerance, maxsteps=300)
