"""Motions with soft limiters in extended precision: Taylor series in mpmath, step by step."""

from __future__ import annotations

from typing import Any, Final

import mpmath as mp
import numpy as np

from benchmarks.peers.scene import Scene
from vibroimpact_solvers.arrays import Floats

DIGITS: Final = 30
_ORDER: Final = 36


def followed(scene: Scene) -> Floats:
    """Return the final state of an undamped motion with one soft limiter, rounded.

    The power of the displacement is a product of series, by repeated squaring: the exponent is
    odd and whole.
    """
    with mp.workdps(DIGITS):
        n, K = scene.n, mp.matrix(scene.stiffness.tolist())
        x = [mp.mpf(a) for a in scene.state[:n].tolist()]
        v = [mp.mpf(a) for a in scene.state[n:].tolist()]
        t, end = mp.mpf(0), mp.mpf(scene.t_end)
        small = mp.mpf(10) ** (3 - DIGITS)
        while t < end:
            terms = _series(scene, K, x, v)
            # The last two terms tell how far the series reaches.
            reach = min(
                (small / max(abs(one[k]) for one in terms)) ** (mp.mpf(1) / k)
                for k in (_ORDER - 1, _ORDER)
                if any(one[k] for one in terms)
            )
            h = min(reach, end - t)
            x = [_sum(one, h) for one in terms]
            v = [_sum([k * one[k] for k in range(1, _ORDER + 1)], h) for one in terms]
            t += h
        return np.array([float(a) for a in (*x, *v)])


def _sum(terms: list[Any], h: Any) -> Any:
    """Return the sum of a power series, by Horner's rule."""
    total = mp.mpf(0)
    for term in reversed(terms):
        total = total * h + term
    return total


def _series(scene: Scene, K: Any, x: list[Any], v: list[Any]) -> list[list[Any]]:
    """Return the Taylor coefficients of all displacements."""
    law, n = scene.limiter, scene.n
    assert law is not None
    (limiter,) = scene.system.constraints
    assert limiter.symmetric
    dof, power = limiter.dofs[0], int(law.exponent)
    size = mp.mpf(law.scale) * mp.mpf(limiter.upper)
    terms = [[x[i], v[i]] for i in range(n)]
    neighbours = [[j for j in range(n) if K[i, j]] for i in range(n)]
    powers = _chain_of_squares(power)
    series: dict[int, list[Any]] = {p: [] for p in (1, *powers)}
    for k in range(_ORDER - 1):
        series[1].append(terms[dof][k] / size)
        for p, (a, b) in powers.items():
            series[p].append(mp.fsum(series[a][i] * series[b][k - i] for i in range(k + 1)))
        for i in range(n):
            force = -mp.fsum(K[i, j] * terms[j][k] for j in neighbours[i])
            if i == dof:
                force -= mp.mpf(law.stiffness) * series[power][k]
            terms[i].append(force / ((k + 1) * (k + 2)))
    return terms


def _chain_of_squares(power: int) -> dict[int, tuple[int, int]]:
    """Return the powers on the way to one, each as a sum of two smaller ones."""
    factors: dict[int, tuple[int, int]] = {}
    while power > 1:
        factors[power] = (power // 2, power // 2) if power % 2 == 0 else (power - 1, 1)
        power = factors[power][0]
    return dict(sorted(factors.items()))
