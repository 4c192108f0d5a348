"""Where other branches begin: at flips, and where symmetric motions lose their symmetry.

The motion of a special point, repeated, is also one with twice as many impacts: two periods of it,
or its two halves. There the equations have two null vectors: the tangent of the branch itself, and
the direction in which the new branch leaves it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.branches.curve import Curve
from vibroimpact_solvers.branches.special import Special
from vibroimpact_solvers.periodic_motions import Impact
from vibroimpact_solvers.periodic_motions import Problem as Motions
from vibroimpact_solvers.results.branches import Type

_MOST = 64  # impacts of a period
_STEPS = 1e-2, 3e-3, 1e-3, 1e-4  # lengths of the first step onto a new branch


def doubled(curve: Curve, kind: Type) -> Callable[[float], Motions] | None:
    """Return the problems of motions that repeat after twice as many impacts; None: too many."""
    before = curve.motions
    symmetric = curve.base.symmetric
    if 2 * curve.m > _MOST or (kind is Type.SYMMETRY and not symmetric):
        return None

    def motions(value: float) -> Motions:
        base = before(value)
        if symmetric:
            both = Impact(base.constraint, 1), Impact(base.constraint, -1)
            return replace(base, sequence=both, phases=None)
        return replace(base, sequence=base.impacts * 2, periods=2 * base.periods, phases=None)

    return motions


def outwards(old: Curve, new: Curve, point: Special) -> tuple[Floats, Floats] | None:
    """Return a point of the new branch near a special point, and the direction away from it."""
    base = old.motions(old.value(point.x))
    mirrored = base.symmetric
    turn = np.pi * base.periods * (1.0 if mirrored else 2.0)
    new.impulse, new.largest_seed = old.impulse, old.largest_seed
    m = old.m
    phases, impulses = point.x[:m], point.x[m:-1]
    x = np.concatenate(
        [phases, phases + turn, impulses, -impulses if mirrored else impulses, point.x[-1:]]
    )
    sign = -1.0 if mirrored else 1.0
    tangent = np.concatenate(
        [np.tile(point.tangent[:m], 2), point.tangent[m:-1], sign * point.tangent[m:-1],
         point.tangent[-1:]]
    )  # fmt: skip
    tangent /= np.linalg.norm(tangent)
    null = np.linalg.svd(new.slopes(x))[2][-2:]
    away = null - np.outer(null @ tangent, tangent)
    away = away[np.argmax(np.linalg.norm(away, axis=1))]
    away = away / np.linalg.norm(away)
    # Of two mirrored branches the same one comes first whatever the roundings of the vectors are.
    first = np.flatnonzero(np.abs(away) > 0.1 * np.abs(away).max())[0]
    away = away if away[first] > 0.0 else -away
    for length in _STEPS:
        near = new.onto(x + length * away, away)
        if near is not None and np.linalg.norm(near - x) < 3.0 * length and 0.0 <= near[-1] <= 1.0:
            return near, near - x
    return None


def halves(curve: Curve) -> Callable[[Floats], bool]:
    """Return the test of whether a branch has come back to the motions that it began at.

    The difference of the two halves of its impulses then changes sign.
    """
    m, sides = curve.m, [impact.side for impact in curve.base.impacts]
    signs = np.array(sides, dtype=np.float64)
    begun: list[tuple[int, float]] = []

    def finished(x: Floats) -> bool:
        push = -signs * x[m:-1]
        apart = push[: m // 2] - push[m // 2 :]
        if not begun:
            which = int(np.argmax(np.abs(apart)))
            begun.append((which, float(apart[which])))
        which, first = begun[0]
        return bool(apart[which] * first <= 0.0)

    return finished
