"""Motion from impact to impact in extended precision, by means independent of the solvers.

First-order equations z' = A z + b(t) are solved by the eigenvalues of A; impacts are bracketed
by a scan in steps far below the shortest period and then refined by bisection and secants.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mpmath as mp

DIGITS = 40
TOLERANCE = mp.mpf(10) ** (8 - DIGITS)


@dataclass(frozen=True)
class Stop:
    """A constraint of one coordinate."""

    weights: Sequence[float]
    lower: Any
    upper: Any
    restitution: float


class ReferenceMotion:
    """Motion of M x'' + C x' + K x = f + sum F cos(Omega t + phase) between its stops.

    The static and harmonic parts are particular solutions; K must be regular, and no load in
    resonance.
    """

    def __init__(
        self,
        M: Any,
        K: Any,
        stops: Sequence[Stop],
        C: Any = None,
        force: Any = None,
        loads: Sequence[tuple[Any, float, float]] = (),
    ) -> None:
        mp.mp.dps = DIGITS
        self.n = n = len(M)
        self.M, self.K = mp.matrix(M), mp.matrix(K)
        self.C = mp.zeros(n) if C is None else mp.matrix(C)
        self.inverse = self.M**-1
        A = mp.zeros(2 * n)
        A[:n, n:] = mp.eye(n)
        A[n:, :n] = -self.inverse * self.K
        A[n:, n:] = -self.inverse * self.C
        self.values, self.vectors = mp.eig(A)
        self.left = self.vectors**-1
        self.still = mp.zeros(n, 1) if force is None else mp.lu_solve(self.K, mp.matrix(force))
        self.loads = []
        for amplitude, Omega, phase in loads:
            Om = mp.mpf(Omega)
            D = self.K - Om**2 * self.M + mp.mpc(0, 1) * Om * self.C
            self.loads.append((mp.lu_solve(D, mp.matrix(amplitude)), Om, mp.mpf(phase)))
        self.rows = [mp.matrix([list(map(mp.mpf, s.weights))]) for s in stops]
        self.stops = stops

    def particular(self, t: Any) -> Any:
        z = mp.zeros(2 * self.n, 1)
        for i in range(self.n):
            z[i] = self.still[i]
        for H, Om, phase in self.loads:
            turn = mp.expj(Om * t + phase)
            for i in range(self.n):
                z[i] += mp.re(H[i] * turn)
                z[self.n + i] += mp.re(mp.mpc(0, 1) * Om * H[i] * turn)
        return z

    def start(self, z: Any, t: Any) -> Any:
        return self.left * (z - self.particular(t))

    def at(self, c: Any, t0: Any, t: Any) -> Any:
        turned = mp.matrix([c[k] * mp.exp(self.values[k] * (t - t0)) for k in range(2 * self.n)])
        z = self.vectors * turned
        return mp.matrix([mp.re(v) for v in z]) + self.particular(t)

    def follow(
        self, x: Sequence[float], v: Sequence[float], t_end: float, step: float
    ) -> tuple[list[tuple[Any, int, int, Any]], Any]:
        """Return impacts (time, constraint, side, velocity before) and the final state."""
        n, t = self.n, mp.mpf(0)
        z = mp.matrix([mp.mpf(a) for a in (*x, *v)])
        end, impacts = mp.mpf(t_end), []
        c, t0 = self.start(z, t), t
        while t < end:
            new = min(t + step, end)
            later = self.at(c, t0, new)
            first = None
            for i, (stop, row) in enumerate(zip(self.stops, self.rows, strict=True)):
                for side, wall in ((1, stop.upper), (-1, stop.lower)):
                    if wall is None:
                        continue

                    def beyond(
                        s: Any, row: Any = row, side: int = side, wall: Any = wall, c: Any = c,
                        t0: Any = t0,
                    ) -> Any:  # fmt: skip
                        return side * (row * self.at(c, t0, s)[:n, 0])[0] - mp.mpf(wall)

                    if side * (row * later[:n, 0])[0] > wall and beyond(t + step / 1000) < 0:
                        root = mp.findroot(
                            beyond, (t + step / 1000, new), "anderson", tol=TOLERANCE, maxsteps=200
                        )
                        if first is None or root < first[0]:
                            first = (root, i, side)
            if first is None:
                t = new
                continue
            t, i, side = first
            z = self.at(c, t0, t)
            row, speeds = self.rows[i], z[n:, 0]
            speed = (row * speeds)[0]
            impacts.append((t, i, side, speed))
            mass = (row * self.inverse * row.T)[0]
            factor = (1 + mp.mpf(self.stops[i].restitution)) * speed / mass
            speeds = speeds - factor * (self.inverse * row.T)
            for k in range(n):
                z[n + k] = speeds[k]
            c, t0 = self.start(z, t), t
        return impacts, self.at(c, t0, end)
