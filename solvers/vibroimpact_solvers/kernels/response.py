"""Impulse of one constraint along its whole family, eq. 10.53, at the speed of the machine.

The response ``S = sum_j a_j^2 T(mu_j) / omega^2`` is summed for a block of frequencies at a
time, one frequency in each lane of the vector unit. Near a pole of a mode its term outgrows
the others and p goes through zero with it: finite, as no floating-point phase is a pole. Phases
carry what rounding takes from them, so that close to its poles p is as good as the data are.
"""

from __future__ import annotations

import math

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.jit import fma, kernel
from vibroimpact_solvers.kernels.phases import LARGEST, tangent
from vibroimpact_solvers.kernels.threads import over_ranges

_LANES = 64  # frequencies of a block
_MODES = 32  # terms that are summed before their sum joins the total, against rounding


def impulse_one(
    roots: Floats,
    rests: Floats,
    weight2: Floats,
    omega: Floats,
    omega_rests: Floats,
    gap: float,
) -> tuple[Floats, Floats]:
    """Impulses of one constraint with equal gaps, eq. 10.53.

    Parameters
    ----------
    roots : array, shape (mode,)
        Natural frequencies, zero for rigid-body modes; minus the growth rate of unstable ones.
    rests : array, shape (mode,)
        What rounding took from them, relative to them.
    weight2 : array, shape (mode,)
        Squares of ``w^T e_j``.
    omega : array, shape (frequency,)
        Triangle-wave frequencies, positive, rad per unit of time.
    omega_rests : array, shape (frequency,)
        What rounding took from them, relative to them.
    gap : float
        Gap on both sides, length.

    Returns
    -------
    p, condition : array, shape (frequency,)
        Impulse parameter (10.49), and by how much relative errors of the natural frequencies
        and weights are magnified in it. Where the response vanishes, so that there is no
        impulse, or the phases of the modes are unknown, p is 0 and the condition infinite.
    """
    p, condition = np.empty(omega.size), np.empty(omega.size)
    root = np.abs(roots)
    with np.errstate(over="ignore", divide="ignore"):
        over_root = weight2 / root
    # So soft that its tangent is its argument at any frequency: a rigid-body mode.
    rigid = ~np.isfinite(over_root)
    swinging, falling = (roots > 0.0) & ~rigid, (roots < 0.0) & ~rigid
    mass = float(weight2[rigid].sum())

    def piece(start: int, stop: int) -> None:
        some = slice(start, stop)
        _impulse_one(
            root[swinging],
            rests[swinging],
            over_root[swinging],
            weight2[swinging],
            root[falling],
            weight2[falling],
            mass,
            omega[some],
            omega_rests[some],
            gap,
            p[some],
            condition[some],
        )

    over_ranges(piece, omega.size, float(roots.size) * omega.size)
    return p, condition


@kernel
def _impulse_one(
    root: Floats,
    rest: Floats,
    over_root: Floats,
    weight2: Floats,
    growth: Floats,
    growth_weight2: Floats,
    rigid: float,
    omega: Floats,
    omega_rest: Floats,
    gap: float,
    p: Floats,
    condition: Floats,
) -> None:
    total, spread = np.empty(_LANES), np.empty(_LANES)
    q, q_rest, w = np.empty(_LANES), np.empty(_LANES), np.empty(_LANES)
    largest = np.max(root) if root.size else 0.0
    for first in range(0, omega.size, _LANES):
        count = min(_LANES, omega.size - first)
        for lane in range(_LANES):
            f = first + min(lane, count - 1)
            w[lane] = omega[f]
            q[lane] = 1.0 / w[lane]
            q_rest[lane] = q[lane] * (fma(-q[lane], w[lane], 1.0) - omega_rest[f])
        _sum_swinging(root, rest, over_root, weight2, q, q_rest, w, total, spread)
        for lane in range(count):
            S = total[lane] * w[lane] + rigid
            size = spread[lane] + 2.0 * rigid
            for j in range(growth.size):
                term = growth_weight2[j] * math.tanh(growth[j] * q[lane]) / (growth[j] * q[lane])
                S += term
                size += 2.0 * term
            known = largest * q[lane] < LARGEST and S != 0.0
            p[first + lane] = gap * w[lane] * w[lane] / S if known else 0.0
            condition[first + lane] = size / abs(S) if known else np.inf


@kernel
def _sum_swinging(
    root: Floats,
    rest: Floats,
    over_root: Floats,
    weight2: Floats,
    q: Floats,
    q_rest: Floats,
    w: Floats,
    total: Floats,
    spread: Floats,
) -> None:
    """Sum ``S omega`` and what relative errors do to ``S omega^2`` over the stable modes.

    The latter is ``a^2 (2 |T| + 1/cos^2)`` for each mode: the response itself and its change
    per relative change of the natural frequency.
    """
    some, some_spread = np.empty(_LANES), np.empty(_LANES)
    for lane in range(_LANES):
        total[lane] = 0.0
        spread[lane] = 0.0
    for first in range(0, root.size, _MODES):
        for lane in range(_LANES):
            some[lane] = 0.0
            some_spread[lane] = 0.0
        for j in range(first, min(first + _MODES, root.size)):
            r, e, a, b = root[j], rest[j], over_root[j], weight2[j]
            for lane in range(_LANES):
                x = r * q[lane]
                t = tangent(x, fma(r, q[lane], -x) + fma(r, q_rest[lane], e * x))
                term = a * t
                some[lane] += term
                some_spread[lane] += fma(b, fma(t, t, 1.0), 2.0 * abs(term) * w[lane])
        for lane in range(_LANES):
            total[lane] += some[lane]
            spread[lane] += some_spread[lane]
