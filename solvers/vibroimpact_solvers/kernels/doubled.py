"""Matrix products and quotients in twice the working precision: sums of two doubles.

Every product is split into its rounded value and its rounding (fused multiply-add), every sum
likewise (Knuth), and the roundings are summed beside the values (Ogita, Rump and Oishi 2005). An
entry of a product of matrices with n terms then errs by at most

    2 ((n + 4) u)^2 (|A| |B|) ,    u = 2^-53 .
"""

from __future__ import annotations

import math

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.jit import fma, inner, kernel

_UNIT = 1.1102230246251565e-16


def roundings(n: int) -> float:
    """Return the factor of ``|A| |B|`` in the error of a product with n terms."""
    return 2.0 * ((n + 4) * _UNIT) ** 2


def product(
    A: Floats, A_low: Floats, B: Floats, B_low: Floats, half: bool
) -> tuple[Floats, Floats]:
    """Return ``(A + A_low) (B + B_low)`` as the rounded entries and their roundings.

    Of a symmetric product only a half is computed. A matrix (0, 0) stands for zeros.
    """
    # The kernel has one signature: writable arrays in rows.
    a, a_low, b, b_low = (np.array(part, order="C") for part in (A, A_low, B, B_low))
    return _product(a, a_low, b, b_low, half)


@kernel
def _product(
    A: Floats, A_low: Floats, B: Floats, B_low: Floats, half: bool
) -> tuple[Floats, Floats]:
    shape = A.shape[0], B.shape[1]
    high, low = np.zeros(shape), np.zeros(shape)
    for i in range(shape[0]):
        first = i if half else 0
        total, rest = high[i, first:], low[i, first:]
        for j in range(A.shape[1]):
            if A[i, j] != 0.0:
                _add(A[i, j], B[j, first:], total, rest)
                if B_low.shape[1] > 0:
                    _add_low(A[i, j], B_low[j, first:], rest)
            if A_low.shape[1] > 0:
                _add_low(A_low[i, j], B[j, first:], rest)
        for k in range(total.size):
            value = total[k]
            total[k] = value + rest[k]
            rest[k] -= total[k] - value
    for i in range(shape[0] if half else 0):
        for k in range(i):
            high[i, k], low[i, k] = high[k, i], low[k, i]
    return high, low


@inner
def _add(factor: float, row: Floats, total: Floats, rest: Floats) -> None:
    """Add a multiple of a row to a sum and its roundings."""
    for k in range(row.size):
        term = factor * row[k]
        before = total[k]
        after = before + term
        part = after - before
        lost = (before - (after - part)) + (term - part)
        total[k] = after
        rest[k] += lost + fma(factor, row[k], -term)


@inner
def _add_low(factor: float, row: Floats, rest: Floats) -> None:
    for k in range(row.size):
        rest[k] = fma(factor, row[k], rest[k])


@kernel
def quotients(top: Floats, low: Floats) -> tuple[Floats, Floats]:
    """Return quotients of doubles, and what rounding took from them."""
    value, rest = np.empty(top.size), np.empty(top.size)
    for j in range(top.size):
        value[j] = top[j] / low[j]
        rest[j] = fma(-value[j], low[j], top[j]) / low[j]
    return value, rest


@kernel
def roots(square: Floats, rest: Floats) -> tuple[Floats, Floats]:
    """Return signed roots of magnitudes, and what rounding took from them, relative to them."""
    root, lost = np.empty(square.size), np.empty(square.size)
    for j in range(square.size):
        root[j] = math.copysign(math.sqrt(abs(square[j])), square[j])
        left = fma(-root[j], abs(root[j]), square[j]) + rest[j]
        lost[j] = 0.5 * left / square[j] if square[j] != 0.0 else 0.0
    return root, lost
