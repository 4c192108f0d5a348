"""Motions of large structures without impacts, by their modes in ball arithmetic (Arb).

Eigenpairs of LAPACK are refined by Newton's method until nothing is left, all products being those
of balls; every mode then moves by the formula of one oscillator. Structures have modes of their
own, no two of one frequency, and damping that couples none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from flint import arb, arb_mat, ctx

from tests.reference.balls import column, matrix

BITS = 200
_ROUNDS = 3


@dataclass(frozen=True, slots=True)
class Modes:
    """Natural modes, and all that moves them."""

    shapes: Any  # (dof, mode)
    weighted: Any  # (mode, dof), ``E^T M``
    values: list[Any]
    damping: list[Any]

    @classmethod
    def of(cls, M: np.ndarray, K: np.ndarray, C: np.ndarray | None) -> Modes:
        """Return those of exact matrices of doubles."""
        ctx.prec = BITS
        n, mass, stiffness = len(M), matrix(M), matrix(K)
        E = matrix(scipy.linalg.eigh(K, M)[1])
        for _ in range(_ROUNDS):
            S, G = E.transpose() * (stiffness * E), E.transpose() * (mass * E)
            values = [(S[j, j] / G[j, j]).mid() for j in range(n)]
            step = arb_mat(
                [
                    [
                        (1 - G[j, j]).mid() / 2
                        if i == j
                        else ((S[i, j] - values[j] * G[i, j]) / (values[j] - values[i])).mid()
                        for j in range(n)
                    ]
                    for i in range(n)
                ]
            )
            E = _middle(E + E * step)
        assert max(abs(float(entry)) for entry in step.entries()) < 1e-25
        damping = [arb(0)] * n
        if C is not None:
            CE = matrix(C) * E
            damping = [sum((E[i, j] * CE[i, j] for i in range(n)), arb(0)) for j in range(n)]
        return cls(E, E.transpose() * mass, values, damping)

    def motion(
        self, x: np.ndarray, v: np.ndarray, times: np.ndarray, load: tuple[int, float, float]
    ) -> tuple[list[Any], list[Any]]:
        """Return displacements and velocities, columns of balls, at some times.

        The load is amplitude cos(frequency t) on a degree of freedom.
        """
        ctx.prec = BITS
        q, rate = self.weighted * column(x), self.weighted * column(v)
        dof, amplitude, frequency = load[0], arb(load[1]), arb(load[2])
        states = [
            [
                oscillator(
                    (value, damping),
                    (q[j, 0], rate[j, 0]),
                    (self.shapes[dof, j] * amplitude, frequency),
                    arb(float(t)),
                )
                for j, (value, damping) in enumerate(zip(self.values, self.damping, strict=True))
            ]
            for t in times
        ]
        xs = [self.shapes * arb_mat([[state[0]] for state in each]) for each in states]
        return xs, [self.shapes * arb_mat([[state[1]] for state in each]) for each in states]


def oscillator(
    own: tuple[Any, Any], start: tuple[Any, Any], load: tuple[Any, Any], t: Any
) -> tuple[Any, Any]:
    """Return q and q' of ``q'' + d q' + s q = f cos(w t)`` at a time."""
    (s, d), (a, b), (f, w) = own, start, load
    size = (s - w * w) ** 2 + (d * w) ** 2
    along, behind = f * (s - w * w) / size, f * d * w / size
    c, z = (w * t).cos(), (w * t).sin()
    steady, speed = along * c + behind * z, w * (behind * c - along * z)
    a, b, half = a - along, b - behind * w, d / 2
    square = s - half * half
    if square > 0:
        nu = square.sqrt()
        turn, back, decay = (nu * t).cos(), (nu * t).sin() / nu, (-half * t).exp()
        free = decay * (a * turn + (b + half * a) * back)
        return steady + free, speed + decay * (b * turn - (half * b + s * a) * back)
    fast = -half - (-square).sqrt()
    slow = s / fast
    first, second = (b - fast * a) / (slow - fast), (slow * a - b) / (slow - fast)
    first, second = first * (slow * t).exp(), second * (fast * t).exp()
    return steady + first + second, speed + slow * first + fast * second


def distances(balls: Any, doubles: np.ndarray) -> np.ndarray:
    """Return how far doubles are from a column of balls."""
    return np.array([abs(float(balls[i, 0] - arb(float(y)))) for i, y in enumerate(doubles)])


def _middle(A: Any) -> Any:
    return arb_mat([[A[i, j].mid() for j in range(A.ncols())] for i in range(A.nrows())])
