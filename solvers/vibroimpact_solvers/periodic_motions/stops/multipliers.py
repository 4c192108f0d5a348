"""Floquet multipliers of motions with one contact phase per cell.

A deviation from a motion goes through both phases by their flows. Where a contact phase begins at
the wall the force jumps to ``c d'``: a deviation that comes earlier has been pushed by c times the
way till then, ``dz -> dz - c (w dx) M^-1 w``. At the other switchings the force is zero.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.stops.phases import Phases
from vibroimpact_solvers.periodic_motions.stops.prescribed import GONE, Cells
from vibroimpact_solvers.periodic_motions.stops.solutions import Solutions

_SAMPLED: Final = 4.0  # errors over the root of the sum of squares of independent ones
_ROUNDED: Final = 8.0


def multipliers(phases: Phases, cells: Cells, solved: Solutions) -> tuple[Complexes, Floats]:
    """Return all multipliers over a period by descending modulus, and their errors.

    Both have shape (solution, multiplier); of conjugate ones that with positive imaginary part
    comes first.
    """
    count = 2 * phases.open.pairs.moving.size
    values = np.zeros((solved.index.size, count), dtype=np.complex128)
    errors = np.zeros((solved.index.size, count))
    for k in range(solved.index.size):
        look()
        some, off = _of(phases, cells, solved, k)
        if cells.sign < 0.0:
            some, off = some**2, 2.0 * np.abs(some) * off + off**2
        order = np.lexsort((-some.imag, -np.round(np.abs(some), 14)))
        values[k, : some.size], errors[k, : some.size] = some[order], off[order]
        errors[k, some.size :] = math.exp(-GONE)
    return values, errors


def _scaled(flow: Floats, sign: float) -> Floats:
    """Return a flow of pairs as four diagonals, (2, 2, pair)."""
    even, odd, back = flow
    return sign * np.array([[even, odd], [back, even]])


def _through(flow: Floats, matrix: Floats) -> Floats:
    """Return the product of a flow and a matrix, (2 pair, column)."""
    n = flow.shape[-1]
    first, second = matrix[:n], matrix[n:]
    (even, odd), (back, other) = flow[..., np.newaxis]
    return np.concatenate([even * first + odd * second, back * first + other * second])


def _of(phases: Phases, cells: Cells, solved: Solutions, k: int) -> tuple[Complexes, Floats]:
    """Return the multipliers of one solution over its cell, and their errors."""
    opened, loaded = phases.open, phases.loaded
    d, rest = float(solved.d[k]), float(solved.rest[k])
    moving = opened.pairs.moving
    own = moving[opened.growth[moving] * rest > -GONE]
    live = np.concatenate([own, own + opened.size])
    if not live.size:
        return np.zeros(0, np.complex128), np.zeros(0)
    F0 = _scaled(np.array([f[0] for f in opened.propagators(np.array([rest]))]), cells.sign)
    F1 = _scaled(np.array([f[0] for f in loaded.propagators(np.array([d]))]), 1.0)
    start = phases.to_loaded[:, live]
    a = phases.impact.constraint
    jump = 0.0
    if phases.damping > 0.0 and not solved.regained[k]:
        jump = phases.damping * math.ldexp(1.0, -2 * phases.stopped.exponent)
        start = start - jump * np.outer(phases.to_loaded @ opened.kick[a], opened.position[a, live])
    moved = _through(F1, start)
    period = _through(F0[..., own], phases.to_open[live] @ moved)
    values, right = np.linalg.eig(period)
    try:
        left = np.linalg.inv(right)
    except np.linalg.LinAlgError:
        return values, np.full(values.size, np.inf)
    # Independent errors of all products, and of the rates of the pairs.
    drift0, drift1 = opened.pairs.drift * rest, loaded.pairs.drift * d
    each = (opened.shape_error + loaded.shape_error + _ROUNDED * EPS) ** 2
    fast1, fast0 = (F1**2).sum(axis=(0, 1)), (F0[..., own] ** 2).sum(axis=(0, 1))
    lost1, lost0 = fast1 * (each + drift1**2), fast0 * (each + drift0[own] ** 2)
    begins = phases.to_loaded[:, live] ** 2
    if jump:
        shift = phases.to_loaded @ opened.kick[a]
        begins = begins + jump**2 * np.outer(shift**2, opened.position[a, live] ** 2)
    both = begins[: loaded.size] + begins[loaded.size :]
    back2 = phases.to_open[live] ** 2
    n = own.size

    def ended(weights: Floats) -> Floats:
        once = weights[:, np.newaxis] * both
        through = back2 @ np.concatenate([once, once])
        return np.asarray(through[:n] + through[n:])

    squares = lost0[:, np.newaxis] * ended(fast1) + fast0[:, np.newaxis] * (
        ended(lost1) + each * ended(fast1)
    )
    squares = np.concatenate([squares, squares])
    scales = (np.abs(left) ** 2 @ squares * (np.abs(right.T) ** 2)).sum(axis=1)
    # A phase that lasts longer is one more impulse.
    unit = math.ldexp(1.0, -2 * phases.stopped.exponent) * phases.impact.side
    kick = _through(F0[..., own], unit * opened.kick[a][live][:, np.newaxis])[:, 0]
    late = np.abs((left @ kick) * (loaded.force @ moved @ right)) * solved.d_error[k]
    return values, _SAMPLED * np.sqrt(scales) + late
