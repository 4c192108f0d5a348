"""Conversion between displacements and states: at the start of a motion and at its output times.

The same as matrix products over the modal matrix, in the call that follows the motion: in small
structures calls would last longer than a motion with its impacts.

Modes that are a pair each are converted one by one, with the pairs of loads and of modes that
damping couples going through a matrix.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.flow import Z1, Z2
from vibroimpact_solvers.kernels.jit import fma, inline, inner, once, product

SMALLEST, LARGEST = 1e-100, 1e100
"""Range of magnitudes whose squares double precision can represent."""
SAMPLES: Final = 16
"""States that are converted at a time, half of them where there are more modes than `MANY`, and
two thirds of them where accelerations are asked for."""
MANY: Final = 256
_PRODUCT = 260_000  # multiplications up to which OpenBLAS starts no threads, which would spin


class Modal(NamedTuple):
    """Modes of a structure, how pairs make their coordinates, and the limits of a start."""

    scale: float  # velocities of x over those of the pairs
    level: float  # energy where all modal coordinates are zero
    weighted: Floats  # (dof, mode): M E
    shapes: Floats  # (output dof, mode): rows of E
    base: Floats  # (output dof,): displacements where all modal coordinates are zero
    still: Floats  # (mode,): coordinates at rest
    stretch: Floats  # (mode,): z1 over the coordinate
    delta: Floats  # (mode,): half the damping
    stiffness: Floats  # (mode,): eigenvalues
    load: Floats  # (mode,)
    place: Integers  # (mode,): the pair of every mode, negative where it is not one pair
    others: Integers  # (other,): the pairs of loads and of modes that damping couples
    # (2 other, 2 mode): coordinates and rates that these make, and, with the mode's coordinates
    # and rates and 1 as factors, their start: (2 other, 2 mode + 1)
    made: Floats
    start: Floats
    W: Floats  # (constraint, dof)
    lower: Floats  # (constraint,): distances, infinite where there is no wall
    upper: Floats  # (constraint,)


_STILL, _STRETCH, _DELTA, _STIFFNESS, _LOAD = range(5)
_LOWER, _UPPER = range(2)


def handed_over(modal: Modal) -> tuple[Any, ...]:
    """Return what `modal_of` gives names to: few arrays, as each takes time to hand over."""
    own = np.array([modal.still, modal.stretch, modal.delta, modal.stiffness, modal.load])
    pairs = np.concatenate([modal.place, modal.others])
    limits = np.array([modal.lower, modal.upper])
    sizes = modal.scale, modal.level
    given = modal.weighted, modal.shapes, modal.made, modal.start, modal.W
    matrices = tuple(map(np.ascontiguousarray, given))
    return sizes, matrices, modal.base, own, pairs, limits


def between(given: tuple[Any, ...], limits: Floats) -> tuple[Any, ...]:
    """Return the same as `handed_over` of modes with other limits, (2, constraint)."""
    return *given[:-1], limits


@once
def modal_of(given: tuple[Any, ...]) -> Modal:
    """Give names to what `handed_over` returns."""
    (scale, level), (weighted, shapes, made, start, W), base, own, pairs, limits = given
    modes = shapes.shape[1]
    return Modal(
        scale, level, weighted, shapes, base, own[_STILL], own[_STRETCH], own[_DELTA],
        own[_STIFFNESS], own[_LOAD], pairs[:modes], pairs[modes:], made, start, W, limits[_LOWER],
        limits[_UPPER],
    )  # fmt: skip


@inline
def _is_within_limits(modal: Modal, x: Floats) -> bool:
    """Return whether displacements are within the limits, but for a rounding."""
    W = modal.W
    for i in range(W.shape[0]):
        y, size = 0.0, 0.0
        for k in range(x.size):
            y += W[i, k] * x[k]
            size += abs(W[i, k] * x[k])
        rounding = 1e-14 * size
        if not -modal.lower[i] - rounding <= y <= modal.upper[i] + rounding:
            return False
    return True


@inline
def _project(weighted: Floats, unit: float, x: Floats, v: Floats, out: Floats) -> None:
    """Fill in modal coordinates and, times unit, velocities: (2, mode)."""
    n, modes = weighted.shape
    q, rate, whole = out[Z1], out[Z2], n - n % 4
    for j in range(modes):
        q[j] = rate[j] = 0.0
    for i in range(0, whole, 4):
        a0, a1, a2, a3 = x[i], x[i + 1], x[i + 2], x[i + 3]
        b0, b1, b2, b3 = unit * v[i], unit * v[i + 1], unit * v[i + 2], unit * v[i + 3]
        for j in range(modes):
            w0, w1 = weighted[i, j], weighted[i + 1, j]
            w2, w3 = weighted[i + 2, j], weighted[i + 3, j]
            q[j] = fma(a3, w3, fma(a2, w2, fma(a1, w1, fma(a0, w0, q[j]))))
            rate[j] = fma(b3, w3, fma(b2, w2, fma(b1, w1, fma(b0, w0, rate[j]))))
    for i in range(whole, n):
        a, b = x[i], unit * v[i]
        for j in range(modes):
            q[j] = fma(a, weighted[i, j], q[j])
            rate[j] = fma(b, weighted[i, j], rate[j])


@inner
def state_of(modal: Modal, x: Floats, v: Floats, z: Floats, scratch: Floats) -> bool:
    """Fill in the state of displacements and velocities, each (dof,), at t = 0, without contacts.

    Returns whether these are finite, and within the range of double precision and the limits. The
    scratch has room for (2, mode).
    """
    modes = modal.place.size
    checked, far, fast = 0.0, 0.0, 0.0
    for i in range(x.size):
        checked += 0.0 * x[i] + 0.0 * v[i]
        far, fast = max(far, abs(x[i])), max(fast, abs(v[i]))
    for largest in (far, fast):
        if largest != 0.0 and not SMALLEST <= largest <= LARGEST:
            return False
    if checked != 0.0 or not _is_within_limits(modal, x):
        return False
    _project(modal.weighted, 1.0 / modal.scale, x, v, scratch)
    q, rate, others, start = scratch[Z1], scratch[Z2], modal.others, modal.start
    for j in range(z.shape[1]):
        z[Z1, j] = z[Z2, j] = 0.0
    for j in range(modes):
        q[j] -= modal.still[j]
    for row in range(start.shape[0]):
        of, pair = (Z1, row) if row < others.size else (Z2, row - others.size)
        z[of, others[pair]] = given = start[row, 2 * modes]
        for j in range(modes if given != 0.0 else 0):
            q[j] -= given * modal.made[row, j]
            rate[j] -= given * modal.made[row, modes + j]
    for row in range(start.shape[0]):
        of, pair = (Z1, row) if row < others.size else (Z2, row - others.size)
        for j in range(modes):
            z[of, others[pair]] += start[row, j] * q[j] + start[row, modes + j] * rate[j]
    for j in range(modes):
        if modal.place[j] >= 0:
            z[Z1, modal.place[j]] = q[j] * modal.stretch[j]
            z[Z2, modal.place[j]] = rate[j] + modal.delta[j] * q[j]
    return True


@inner
def coordinates_of(modal: Modal, z: Floats, scratch: Floats) -> None:
    """Fill in modal coordinates and rates of a state, (2, mode)."""
    q, rate, others, modes = scratch[Z1], scratch[Z2], modal.others, modal.place.size
    for j in range(modes):
        q[j], rate[j] = modal.still[j], 0.0
        if modal.place[j] >= 0:
            moved = z[Z1, modal.place[j]] / modal.stretch[j]
            q[j] = moved + modal.still[j]
            rate[j] = z[Z2, modal.place[j]] - modal.delta[j] * moved
    for row in range(modal.made.shape[0]):
        of, pair = (Z1, row) if row < others.size else (Z2, row - others.size)
        value = z[of, others[pair]]
        for j in range(modes):
            q[j] += value * modal.made[row, j]
            rate[j] += value * modal.made[row, modes + j]


@inner
def energy_of(modal: Modal, coordinates: Floats) -> float:
    """Return the energy of modal coordinates and rates, (2, mode)."""
    q, rate, energy = coordinates[Z1], coordinates[Z2], modal.level
    for j in range(modal.place.size):
        speed = modal.scale * rate[j]
        energy += 0.5 * speed * speed + (0.5 * modal.stiffness[j] * q[j] - modal.load[j]) * q[j]
    return energy


@inline
def keep_coordinates(coordinates: Floats, block: Floats, row: int, x: bool, v: bool) -> None:
    """Copy what is asked for of a state's coordinates and rates to a block, from a row on."""
    for j in range(block.shape[1]):
        if x:
            block[row, j] = coordinates[Z1, j]
        if v:
            block[row + int(x), j] = coordinates[Z2, j]


@product
def _multiply(rows: Floats, shapes: Floats, out: Floats) -> None:
    """Fill in ``rows @ shapes^T``."""
    np.dot(rows, shapes.T, out)


@inner
def displacements_of(
    modal: Modal, block: Floats, sums: Floats, samples: int, x: Floats, v: Floats, a: Floats
) -> None:
    """Fill in displacements, velocities and accelerations, (time, dof), of a block's samples.

    Those that are not asked for are empty. The block has room for (2 `SAMPLES`, mode), the sums for
    (2 `SAMPLES` dof) of those asked for.
    """
    moved = int(x.size > 0)
    each = moved + (v.size > 0) + (a.size > 0)
    if each * samples == 0:
        return
    rows, dofs = each * samples, modal.base.size
    some = max(1, min(dofs, _PRODUCT // (rows * max(1, block.shape[1]))))
    for first in range(0, dofs, some):
        last = min(first + some, dofs)
        out = sums[: rows * (last - first)].reshape(rows, last - first)
        _multiply(block[:rows], modal.shapes[first:last], out)
        for place in range(samples):
            for i in range(first, last):
                if x.size > 0:
                    x[place, i] = modal.base[i] + out[each * place, i - first]
                if v.size > 0:
                    v[place, i] = modal.scale * out[each * place + moved, i - first]
                if a.size > 0:
                    bend = out[each * place + each - 1, i - first]
                    a[place, i] = modal.scale * (modal.scale * bend)
