"""Stability of impact modes: the multipliers of the half-period map.

A motion that is its own mirror image after half a period (equal gaps, no load) has the
half-period map ``P = -S Phi(2/omega)``, with the transition matrix Phi of the free motion and the
saltation matrices S of the impacts. Any other motion has the map of the whole period,
``S_lower Phi S_upper Phi``; the square roots of its multipliers are taken. Two multipliers are
always 1: a shift in time does not change the motion, and a change of energy leads to a
neighbouring impact mode.

Where one constraint is struck once a half-period, or once a period, the multipliers are the zeros
of a sum over the modes (`one_impact`), else the eigenvalues of the map (`period_map`).

Examples
--------
>>> import numpy as np
>>> from vibroimpact_solvers import impact_modes
>>> from vibroimpact_solvers.model import Constraint
>>> from vibroimpact_solvers.presets import chain
>>> Omega = np.array([2.1, 4.0])  # near grazing, and far above the spectrum
>>> system = chain(13, [Constraint.at(5, gap=1.0)])
>>> problem = impact_modes.Problem(system, Omega * 2 / np.pi, outputs=frozenset({"stability"}))
>>> impact_modes.solve(problem, impact_modes.plan(problem)).stability.round(2)
array([6.92, 1.  ])
"""

from __future__ import annotations

from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Booleans, Floats
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.stability import one_impact, period_map
from vibroimpact_solvers.stability.costs import Method, choose, flops, reason
from vibroimpact_solvers.stability.orbits import Orbits, Radius, Side

__all__ = [
    "DIRECTION_DEPENDENT", "LARGEST", "Method", "Orbits", "Side", "choose", "commutes", "flops",
    "growth", "neutral", "reason",
]  # fmt: skip

DIRECTION_DEPENDENT: Final = (
    "direction-dependent: the outcome of simultaneous impacts at coupled constraints depends on "
    "which of them comes first"
)

LARGEST: Final = 3000
"""Degrees of freedom up to which multipliers are computed: a map of more takes hours."""

_DENSE: Final = 300
"""Modes up to which the map replaces a sum over the modes that tells little."""
_POOR: Final = 1e-6  # relative error of the radius from which the map may do better
_COUPLED: Final = 1e-12  # cosine of the angle between two constraints from which they are coupled


def commutes(mobility: Floats) -> bool:
    """Whether the order of simultaneous impacts at constraints with this mobility is irrelevant.

    It is ``W M^(-1) W^T``, shape (constraint, constraint).
    """
    size = np.sqrt(np.diagonal(mobility))
    coupling = np.abs(mobility - np.diag(np.diagonal(mobility)))
    return bool((coupling <= _COUPLED * np.outer(size, size)).all())


def neutral(modulus: Floats, error: Floats) -> Booleans:
    """Whether the largest modulus of multipliers is 1 within its error, shapes (motion,).

    As far as can be told, deviations then neither grow nor decay. Nothing is told where there is
    no modulus or its error is not bounded.
    """
    with np.errstate(invalid="ignore"):
        return np.asarray((np.abs(modulus - 1.0) <= error) & np.isfinite(error))


def growth(orbits: Orbits) -> tuple[Floats, Floats]:
    """Return the spectral radius of the half-period map and its relative error, (frequency,).

    It is 1 for stable motions, nan where a motion grazes a wall, and nan everywhere if
    simultaneous impacts do not commute. The error is infinite where the multipliers cannot be
    computed.
    """
    count = orbits.omega.size
    if not all(commutes(side.rows @ side.rows.T) for side in (orbits.upper, orbits.lower)):
        return np.full(count, np.nan), np.full(count, np.nan)
    free = one_impact.FreeMotion.of(orbits) if one_impact.applies(orbits) else None
    radii = np.empty((count, len(Radius._fields)))
    for f in range(count):
        look()
        radii[f] = _radius(orbits, free, f)
    value, low, high = radii.T
    fastest = np.maximum(0.0, -orbits.other_roots).max(initial=0.0)
    with np.errstate(over="ignore", invalid="ignore"):
        others = np.minimum(np.exp(fastest * 2.0 / orbits.omega), np.finfo(np.float64).max)
        radius = np.maximum(value, others)
        above = np.maximum(high, others) / radius - 1.0
        # The largest multiplier is at least this large; 1 is always among them.
        least = np.maximum(low, others)
        return radius, np.maximum(np.maximum(above, 1.0 - least / radius), 4.0 * EPS)


def _radius(orbits: Orbits, free: one_impact.FreeMotion | None, f: int) -> Radius:
    if free is None:
        return period_map.radius(orbits, f)
    by_sum = free.radius(f)
    if by_sum.high - by_sum.low <= _POOR * by_sum.value or orbits.roots.size > _DENSE:
        return by_sum
    by_map = period_map.radius(orbits, f)
    return by_map if by_map.high - by_map.low < by_sum.high - by_sum.low else by_sum
