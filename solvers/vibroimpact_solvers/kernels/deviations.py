"""Deviations that stand for roundings, carried along by the linearised motion.

A motion computed in double precision is the exact motion of slightly other data: after a free
motion every pair is known to two units in the last place of its length, every frequency to its own
error, and an impact adds the rounding of its impulse and of the place of its wall. Samples of such
errors, of random sign, obey the linearised flow and the saltation of impacts

    dz+ = dz- + kick dP - kick_rate (1 + k) m dy ,    dP = (1 + k) m (y'' dy / y' - dy') ,

m being the mass that is struck. Four times the largest of three samples is the error estimate.
"""

from __future__ import annotations

import math
from typing import Final

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.flow import Z1, Z2, Flow
from vibroimpact_solvers.kernels.jit import inline, inner, once
from vibroimpact_solvers.kernels.rigid_state import Errors, Motion, Rows

SAFETY: Final = 4.0
"""Factor on the largest of the sampled deviations: errors do not exceed the product."""
_PROPAGATED = 2.0  # rounding of a pair by the free motion from one impact to the next


@inline
def random_row(count: int, rows: int) -> int:
    """Return a row of the signs that seems drawn at random (multiplicative hashing)."""
    return (count * 2654435761 % 4294967296 >> 8) % rows


@inline
def length(z: Floats, own: Floats) -> float:
    """Return the root of the sum of squares of a state, loads apart."""
    s1, s2 = 0.0, 0.0
    for j in range(own.size):
        s1 += own[j] * z[Z1, j] * z[Z1, j]
        s2 += own[j] * z[Z2, j] * z[Z2, j]
    return math.sqrt(s1 + s2)


@inner
def start_deviations(motion: Motion, errors: Errors) -> None:
    """Set the deviations that a motion starts with, and the length of its state."""
    z, deviations, signs, own = motion.z, motion.deviations, errors.signs, errors.own
    largest = length(z, own)
    motion.progress[0].largest = largest
    rounding = _PROPAGATED * largest / math.sqrt(2.0 * own.size)
    for c in range(deviations.shape[0]):
        for j in range(own.size):
            deviations[c, Z1, j] = rounding * own[j] * signs[c + 1, Z1, j]
            deviations[c, Z2, j] = rounding * own[j] * signs[c + 1, Z2, j]


@once
def add_rounding(flow: Flow, motion: Motion, errors: Errors, row: int, s: float) -> None:
    """Add the rounding of a free motion of duration s to the deviations.

    That of a pair has any sign, that of a frequency the same one from impact to impact: it turns
    rotations, ``dz = s dnu (z2, -z1)``, and stretches hyperbolas, ``dz = s dnu (z2, z1)``.
    """
    z, deviations, signs, drifts = motion.z, motion.deviations, errors.signs, errors.drifts
    progress = motion.progress[0]
    progress.largest = max(progress.largest, length(z, errors.own))
    for c in range(deviations.shape[0]):
        at = (row + 7 * (c + 1)) % signs.shape[0]
        for j in range(z.shape[1]):
            a, b = z[Z1, j], z[Z2, j]
            rounding = _PROPAGATED * (abs(a) + abs(b))
            turned = s * drifts[c, j]
            deviations[c, Z1, j] += rounding * signs[at, Z1, j] + turned * b
            deviations[c, Z2, j] += rounding * signs[at, Z2, j] - turned * a
        for j in range(flow.rotations, flow.hyperbolas_end):
            deviations[c, Z2, j] += 2.0 * s * drifts[c, j] * z[Z1, j]


@inline
def estimated_error(deviations: Floats, own: Floats, progress: Rows) -> float:
    """Return the error estimated from the deviations, relative to the length of the motion."""
    largest, size = 0.0, progress[0].largest
    for c in range(deviations.shape[0]):
        longest = length(deviations[c], own)
        if longest > largest or math.isnan(longest):  # after which nothing is larger
            largest = longest
    return SAFETY * largest / size if size > 0.0 else 0.0
