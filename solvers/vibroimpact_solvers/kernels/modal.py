"""Conversion between displacements and states, for structures with uncoupled modes.

The same as matrix products over the modal matrix, in one call: in small structures calls would
last longer than a motion with its impacts.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.flow import Z1, Z2
from vibroimpact_solvers.kernels.jit import inner, once

SMALLEST, LARGEST = 1e-100, 1e100
"""Range of magnitudes whose squares double precision can represent."""


class Modal(NamedTuple):
    """Modes that are a pair each, and the limits of the constrained coordinates."""

    scale: float  # velocities of x over those of the pairs
    weighted: Floats  # (dof, mode): M E
    shapes: Floats  # (dof, mode): E
    still: Floats  # (mode,): coordinates at rest
    stretch: Floats  # (mode,): z1 over the coordinate
    delta: Floats  # (mode,): half the damping
    place: Integers  # (mode,): the pair of every mode
    W: Floats  # (constraint, dof)
    lower: Floats  # (constraint,): distances, infinite where there is no wall
    upper: Floats  # (constraint,)


_STILL, _STRETCH, _DELTA = range(3)
_LOWER, _UPPER = range(2)


def handed_over(modal: Modal) -> tuple[Any, ...]:
    """Return what `modal_of` gives names to: few arrays, as each takes time to hand over."""
    scale, weighted, shapes, still, stretch, delta, place, W, lower, upper = modal
    normal, limits = np.array([still, stretch, delta]), np.array([lower, upper])
    return scale, weighted, shapes, normal, place, W, limits


@once
def modal_of(given: tuple[Any, ...]) -> Modal:
    """Give names to what `handed_over` returns."""
    scale, weighted, shapes, normal, place, W, limits = given
    still, stretch, delta = normal[_STILL], normal[_STRETCH], normal[_DELTA]
    lower, upper = limits[_LOWER], limits[_UPPER]
    return Modal(scale, weighted, shapes, still, stretch, delta, place, W, lower, upper)


_NUMBERS, _TABLE, _INDICES = np.zeros(0), np.zeros((0, 0)), np.zeros(0, np.int64)
_NO_MODES = 1.0, _TABLE, _TABLE, np.zeros((3, 0)), _INDICES, _TABLE, np.zeros((2, 0))
NOTHING: Final = (_NO_MODES, _NUMBERS, _NUMBERS, (_INDICES, _TABLE, _TABLE))
"""In place of modes, displacements, velocities and a history: the motion goes on from its state."""


@inner
def state_of(modal: Modal, x: Floats, v: Floats, z: Floats, scratch: Floats) -> bool:
    """Fill in the state of displacements and velocities, each (dof,).

    Returns whether these are finite, and within the range of double precision and the limits. The
    scratch has room for (2, mode).
    """
    weighted, W = modal.weighted, modal.W
    n, modes = weighted.shape
    q, rate, checked, unit = scratch[Z1], scratch[Z2], 0.0, 1.0 / modal.scale
    far, fast = 0.0, 0.0
    for j in range(modes):
        q[j] = rate[j] = 0.0
    for i in range(n):
        a, b = x[i], unit * v[i]
        checked += 0.0 * a + 0.0 * b
        far, fast = max(far, abs(x[i])), max(fast, abs(v[i]))
        for j in range(modes):
            q[j] += a * weighted[i, j]
            rate[j] += b * weighted[i, j]
    for largest in (far, fast):
        if largest != 0.0 and not SMALLEST <= largest <= LARGEST:
            return False
    for j in range(modes):
        moved = q[j] - modal.still[j]
        z[Z1, modal.place[j]] = moved * modal.stretch[j]
        z[Z2, modal.place[j]] = rate[j] + modal.delta[j] * moved
    for i in range(W.shape[0]):
        y, size = 0.0, 0.0
        for k in range(n):
            y += W[i, k] * x[k]
            size += abs(W[i, k] * x[k])
        rounding = 1e-14 * size
        if not -modal.lower[i] - rounding <= y <= modal.upper[i] + rounding:
            return False
    return checked == 0.0


@inner
def displacements_of(
    modal: Modal, samples: Floats, dofs: Integers, x: Floats, v: Floats, scratch: Floats
) -> None:
    """Fill in displacements and velocities, shape (time, dof), of states (time, 2, pair)."""
    shapes = modal.shapes
    modes = shapes.shape[1]
    q, rate = scratch[Z1], scratch[Z2]
    whole = modes - modes % 4
    for t in range(samples.shape[0]):
        for j in range(modes):
            moved = samples[t, Z1, modal.place[j]] / modal.stretch[j]
            q[j] = moved + modal.still[j]
            rate[j] = samples[t, Z2, modal.place[j]] - modal.delta[j] * moved
        for k in range(dofs.size):
            i = dofs[k]
            s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
            t0, t1, t2, t3 = 0.0, 0.0, 0.0, 0.0
            for j in range(0, whole, 4):
                s0 += shapes[i, j] * q[j]
                s1 += shapes[i, j + 1] * q[j + 1]
                s2 += shapes[i, j + 2] * q[j + 2]
                s3 += shapes[i, j + 3] * q[j + 3]
                t0 += shapes[i, j] * rate[j]
                t1 += shapes[i, j + 1] * rate[j + 1]
                t2 += shapes[i, j + 2] * rate[j + 2]
                t3 += shapes[i, j + 3] * rate[j + 3]
            for j in range(whole, modes):
                s0 += shapes[i, j] * q[j]
                t0 += shapes[i, j] * rate[j]
            x[t, k] = (s0 + s2) + (s1 + s3)
            v[t, k] = modal.scale * ((t0 + t2) + (t1 + t3))
