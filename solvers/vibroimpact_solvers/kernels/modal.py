"""Conversion between displacements and states, for structures with uncoupled modes.

The same as matrix products over the modal matrix, in one call: in small structures calls would
last longer than a motion with its impacts.
"""

from __future__ import annotations

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.jit import inner

SMALLEST, LARGEST = 1e-100, 1e100
"""Range of magnitudes whose squares double precision can represent."""


@inner
def state_of(
    x: Floats,
    v: Floats,
    unit: float,
    weighted: Floats,
    normal: Floats,
    place: Integers,
    W: Floats,
    limits: Floats,
    Z: Floats,
    own: Floats,
) -> bool:
    """Fill in the state Z[0] and return whether it is finite, within range and the limits.

    Parameters
    ----------
    x, v : array, shape (dof,)
        Displacements and velocities.
    unit : float
        The unit of time of the pairs.
    weighted : array, shape (dof, mode)
        ``M E``.
    normal : array, shape (3, mode)
        Of every mode: its coordinate at rest, the factor of z1 and delta (`kernels.flow`).
    place : array of int, shape (mode,)
        The pair of every mode.
    W : array, shape (constraint, dof)
    limits : array, shape (2, constraint)
        Lower limits, as distances, and upper ones.
    Z : array, shape (1 + column, 2, pair)
        Zero at the pairs that belong to no mode.
    own : array, shape (2, mode) or with longer rows
        Overwritten.
    """
    n, modes = weighted.shape
    q, rate, checked = own[0], own[1], 0.0
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
        moved = q[j] - normal[0, j]
        Z[0, 0, place[j]] = moved * normal[1, j]
        Z[0, 1, place[j]] = rate[j] + normal[2, j] * moved
    for i in range(W.shape[0]):
        y, size = 0.0, 0.0
        for k in range(n):
            y += W[i, k] * x[k]
            size += abs(W[i, k] * x[k])
        if not -limits[0, i] - 1e-14 * size <= y <= limits[1, i] + 1e-14 * size:
            return False
    return checked == 0.0


@inner
def motion_of(
    samples: Floats,
    scale: float,
    shapes: Floats,
    dofs: Integers,
    normal: Floats,
    place: Integers,
    x: Floats,
    v: Floats,
    own: Floats,
) -> None:
    """Fill in displacements and velocities, shape (time, dof), of states (time, 2, pair).

    Parameters
    ----------
    scale : float
        Factor from velocities in units of the pairs to those of v.
    shapes : array, shape (dof, mode)
    dofs : array of int
        Degrees of freedom of x and v.
    normal, place, own : array
        As of `state_of`.
    """
    modes = shapes.shape[1]
    q, rate = own[0], own[1]
    whole = modes - modes % 4
    for t in range(samples.shape[0]):
        for j in range(modes):
            moved = samples[t, 0, place[j]] / normal[1, j]
            q[j] = moved + normal[0, j]
            rate[j] = samples[t, 1, place[j]] - normal[2, j] * moved
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
            v[t, k] = scale * ((t0 + t2) + (t1 + t3))
