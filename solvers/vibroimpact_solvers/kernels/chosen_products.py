"""Products of some rows with some columns, and bounds of what vibrations add between two times."""

from __future__ import annotations

import math

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.flow import Z1, Z2, Flow
from vibroimpact_solvers.kernels.jit import bare
from vibroimpact_solvers.kernels.sums import scalar_product

FAST = 4.0  # radians of an interval in which a vibration may be anywhere


@bare
def chosen_products(
    rows: Floats, forms: Floats, place: Integers, dof: Integers, out: Floats
) -> None:
    """Fill in ``rows[place] . forms[dof]``, shape (candidate,)."""
    for k in range(place.size):
        out[k] = scalar_product(rows[place[k]], forms[dof[k]])


@bare
def set_bounds(flow: Flow, start: Floats, width: Floats, derivative: int, out: Floats) -> None:
    """Fill in bounds of both numbers of pairs in intervals.

    Parameters
    ----------
    flow : Flow
    start : array, shape (interval, 2, pair)
        The pairs at the beginning.
    width : array, shape (interval,)
    derivative : int
        2: how far numbers are from straight lines between their values at both ends;
        3: their third derivatives.
    out : array, shape (interval, 2 pair)
        Both numbers by turns.
    """
    for i in range(width.size):
        h = width[i]
        part = 0.125 * h * h if derivative == 2 else 1.0
        for j in range(flow.alpha.size):
            a, b = abs(start[i, Z1, j]), abs(start[i, Z2, j])
            alpha, nu, growth = flow.alpha[j], flow.nu[j], flow.alpha[j]
            rate, there, back = abs(alpha) + nu, nu, nu
            if j < flow.rotations:
                a = b = math.sqrt(a * a + b * b)
                rate, there, back = math.sqrt(alpha * alpha + nu * nu), 0.0, 0.0
            elif j < flow.hyperbolas_end:
                growth += nu
            else:
                rate, there, back = abs(alpha), 1.0, 0.0
            # The odd propagator is below s e^(growth s) but for the factor of the other number.
            odd = h if growth * h >= -1.0 else -1.0 / (math.e * growth)
            a, b = a + there * odd * b, b + back * odd * a
            if growth > 0.0:
                rise = math.exp(growth * h)
                a, b = rise * a, rise * b
            if derivative == 2 and rate * h > FAST:
                out[i, 2 * j], out[i, 2 * j + 1] = 2.0 * a, 2.0 * b
                continue
            own = rate if j < flow.rotations else abs(alpha)
            for _ in range(derivative):
                a, b = own * a + there * b, own * b + back * a
            out[i, 2 * j], out[i, 2 * j + 1] = part * a, part * b
