"""The chapter's soft limiters: forces ``beta (y / (alpha Delta))^(2 n - 1)`` in place of walls.

The linear structure is carried exactly from step to step and the force acts as kicks in between,
composed to the fourth order: a symplectic method whose energy does not drift.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_THIRD = 2.0 ** (1.0 / 3.0)
_PARTS = (1.0 / (2.0 - _THIRD), -_THIRD / (2.0 - _THIRD), 1.0 / (2.0 - _THIRD))


@dataclass(frozen=True)
class Motion:
    """Times (time,), displacements (time, dof), limiter forces (time, limiter), energy drift."""

    t: np.ndarray
    x: np.ndarray
    force: np.ndarray
    drift: float


def integrate(M, K, stops, start, t_end, power=17, beta=1.0, steps=6_000) -> Motion:
    """Integrate M x'' + K x = -force from (x, v); `stops` is degree of freedom -> alpha Delta."""
    M, K = np.asarray(M, dtype=float), np.asarray(K, dtype=float)
    lower = np.linalg.cholesky(M)
    inverse = np.linalg.inv(lower)
    squares, turned = np.linalg.eigh(inverse @ K @ inverse.T)
    modes, Omega = inverse.T @ turned, np.sqrt(squares)
    dofs, walls = list(stops), np.array(list(stops.values()))
    rows = modes[dofs]
    h = t_end / steps
    carry = [(np.cos(Omega * h * part), np.sin(Omega * h * part)) for part in _PARTS]
    q, r = modes.T @ M @ np.asarray(start[0]), modes.T @ M @ np.asarray(start[1]) / Omega

    def energy() -> float:
        potential = beta * walls / (power + 1) * ((rows @ q) / walls) ** (power + 1)
        return float(0.5 * np.sum(squares * (q**2 + r**2)) + potential.sum())

    first, x, force = energy(), np.empty((steps + 1, M.shape[0])), np.empty((steps + 1, len(dofs)))
    for n in range(steps + 1):
        x[n] = modes @ q
        force[n] = beta * (x[n, dofs] / walls) ** power
        for part, (c, s) in zip(_PARTS, carry, strict=True):
            for half in (True, False):
                push = beta * ((rows @ q) / walls) ** power
                r = r - 0.5 * h * part * (rows.T @ push) / Omega
                if half:
                    q, r = c * q + s * r, c * r - s * q
    return Motion(np.arange(steps + 1) * h, x, force, energy() / first - 1.0)


def turning(motion: Motion, dof: int, around: float) -> int:
    """Return the index at which a degree of freedom is farthest within 30 % of a time."""
    near = np.abs(motion.t / around - 1.0) < 0.3
    return int(np.flatnonzero(near)[np.argmax(motion.x[near, dof])])
