"""Structures that fall between impacts with one wall, from impact to impact.

In as many digits as the caller's precision of mpmath has, 30 or so.

The state, one and the cosine and sine of the drive's phase obey one linear equation, of which
free motions are matrix exponentials; impacts are zeros of the distance. Nothing of it knows modes
or periodic responses.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mpmath as mp
import numpy as np


class Falling:
    """A structure above a wall at zero of one coordinate.

    Parameters
    ----------
    M, K, C : array, shape (dof, dof)
    force : array, shape (dof,)
        Constant load.
    drive : array, shape (dof,)
        Amplitude of the load times ``cos(Omega t)``.
    Omega : float
    w : array, shape (dof,)
        The coordinate.
    k : float
    """

    def __init__(
        self, M: Any, K: Any, C: Any, force: Any, drive: Any, Omega: float, w: Any, k: float
    ) -> None:
        n = self.n = len(M)
        inverse = mp.matrix(np.asarray(M).tolist()) ** -1
        rows = inverse * mp.matrix(np.hstack([-np.asarray(K), -np.asarray(C)]).tolist())
        loads = inverse * mp.matrix(np.stack([force, drive], axis=1).tolist())
        A = self.A = mp.zeros(2 * n + 3)
        for i in range(n):
            A[i, n + i] = 1
            for j in range(2 * n):
                A[n + i, j] = rows[i, j]
            A[n + i, 2 * n], A[n + i, 2 * n + 1] = loads[i, 0], loads[i, 1]
        self.Omega, self.k = mp.mpf(Omega), mp.mpf(k)
        A[2 * n + 1, 2 * n + 2], A[2 * n + 2, 2 * n + 1] = -self.Omega, self.Omega
        self.w = mp.matrix(np.asarray(w, dtype=float).tolist())
        self.kick = inverse * self.w
        self.mu = (self.w.T * self.kick)[0]

    def moved(self, z: Any, t: Any, duration: Any) -> Any:
        """Return the state (2 dof, 1) after a free motion that begins at the time t."""
        whole = mp.matrix(
            [*z, 1, mp.cos(self.Omega * t), mp.sin(self.Omega * t)]  # both turn with the drive
        )
        return (mp.expm(self.A * duration) * whole)[: 2 * self.n, 0]

    def place(self, z: Any) -> Any:
        """Return the distance from the wall."""
        return (self.w.T * z[: self.n, 0])[0]

    def speed(self, z: Any) -> Any:
        return (self.w.T * z[self.n :, 0])[0]

    def pushed(self, z: Any, p: Any) -> Any:
        """Return the state after an impulse along the coordinate."""
        return mp.matrix([*z[: self.n, 0], *(z[self.n :, 0] + p * self.kick)])

    def struck(self, z: Any) -> Any:
        """Return the state after an impact."""
        return self.pushed(z, -(1 + self.k) * self.speed(z) / self.mu)

    def to_impact(self, z: Any, t: Any, guess: Any) -> Any:
        """Return how long the free motion is until the impact near a guess, by Newton's method."""
        for _ in range(20):
            there = self.moved(z, t, guess)
            step = self.place(there) / self.speed(there)
            guess -= step
            if abs(step) < 1e-18:  # the next one is its square
                return guess
        raise ValueError(step)

    def periodic(self, times: Sequence[float], momenta: Sequence[float], period: float) -> Any:
        """Return the state after the first impact of the motion with these impulses, in `period`.

        By least squares: of a free body, whose place the first impact tells, one equation is left.
        """
        n, T = self.n, mp.mpf(period)
        columns = [mp.zeros(2 * n, 1), *(mp.eye(2 * n)[:, j] for j in range(2 * n))]
        ends = []
        for column in columns:
            z, t = mp.matrix(column), mp.mpf(times[0])
            for j in range(1, len(times) + 1):
                last = j == len(times)
                later = mp.mpf(times[0]) + T if last else mp.mpf(times[j])
                z = self.moved(z, t, later - t)
                z, t = self.pushed(z, mp.mpf(momenta[0 if last else j])), later
            ends.append(z)
        rows, values = mp.zeros(2 * n + 1, 2 * n), mp.zeros(2 * n + 1, 1)
        for j in range(2 * n):
            for i in range(2 * n):
                rows[i, j] = (ends[j + 1][i] - ends[0][i]) - (1 if i == j else 0)
        for i in range(2 * n):
            values[i] = -ends[0][i]
        for j in range(n):
            rows[2 * n, j] = self.w[j]
        return mp.lu_solve(rows, values)

    def followed(self, z: Any, times: Sequence[float], period: float) -> tuple[Any, list[Any], Any]:
        """Return the state after the impacts of a period, their times, and the least distance.

        z is the state just after the first one, which is the last one again.
        """
        later = [*times[1:], times[0] + period]
        t, struck, least = mp.mpf(times[0]), [], mp.inf
        for before, after in zip(times, later, strict=True):
            duration = self.to_impact(z, t, mp.mpf(after) - mp.mpf(before))
            parts = [mp.mpf(j) / 20 for j in range(1, 20)]
            least = min([least, *(self.place(self.moved(z, t, duration * s)) for s in parts)])
            z, t = self.struck(self.moved(z, t, duration)), t + duration
            struck.append(t)
        return z, struck, least

    def multipliers(self, z: Any, times: Sequence[float], period: float) -> np.ndarray:
        """Return the multipliers by differences of the map from impact to impact.

        Its section is the impact; the phase of the drive is one of its coordinates.
        """
        n, step = self.n, mp.mpf(10) ** -12
        wall = int(np.argmax([abs(float(each)) for each in self.w]))
        kept = [j for j in range(2 * n) if j != wall]

        def mapped(change: dict[int, Any]) -> Any:
            moved, late = mp.matrix(z), change.get(-1, mp.mpf(0))
            for j, by in change.items():
                if j >= 0:
                    moved[j] += by
            rest = sum(self.w[j] * moved[j] for j in range(n) if j != wall)
            moved[wall] = -rest / self.w[wall]
            t, begun = mp.mpf(times[0]) + late, moved
            later = [*times[1:], times[0] + period]
            for before, after in zip(times, later, strict=True):
                duration = self.to_impact(begun, t, mp.mpf(after) - mp.mpf(before))
                begun, t = self.struck(self.moved(begun, t, duration)), t + duration
            return mp.matrix([begun[j] for j in kept] + [t])

        jacobian = mp.zeros(2 * n)
        for column, j in enumerate([*kept, -1]):
            apart = (mapped({j: step}) - mapped({j: -step})) / (2 * step)
            for i in range(2 * n):
                jacobian[i, column] = apart[i]
        return np.array([complex(each) for each in mp.eig(jacobian, left=False, right=False)])
