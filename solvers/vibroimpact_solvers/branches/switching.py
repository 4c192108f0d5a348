"""Where other branches begin: at flips, and where symmetric motions lose their symmetry.

The motion of a special point, repeated, is also one that lasts twice as long: two periods of it, or
its two halves. There the equations have two null vectors: the tangent of the branch itself, and the
direction in which the new branch leaves it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.branches.curve import Curve

_STEPS = 1e-2, 3e-3, 1e-3, 1e-4  # lengths of the first step onto a new branch


def outwards(new: Curve, x: Floats, tangent: Floats) -> tuple[Floats, Floats] | None:
    """Return a point of the new branch near a special point, and the direction away from it."""
    tangent = tangent / np.linalg.norm(tangent)
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

    The difference of the two halves of its motions then turns round from one point to the next.
    """
    last: list[Floats] = []

    def finished(x: Floats) -> bool:
        last.append(curve.unlike(x))
        return bool(last[-1] @ last[max(len(last) - 2, 0)] < 0.0)

    return finished
