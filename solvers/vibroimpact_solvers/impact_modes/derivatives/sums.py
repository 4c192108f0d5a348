"""Sums over modes and unknowns whose bits do not depend on how many frequencies there are.

Products of whole matrices are summed in an order that depends on their sizes, so that a piece of a
grid of frequencies would have other last bits than the whole grid.
"""

from __future__ import annotations

import numpy as np

from vibroimpact_solvers.arrays import Floats


def over_modes(values: Floats, rows: Floats) -> Floats:
    """Return ``sum_j values[..., j] rows[..., i, j]``, shape (…, i).

    `values` are (parameter, frequency, mode) or (frequency, mode), `rows` (unknown, mode) or
    (parameter, unknown, mode).
    """
    if rows.ndim == 2:
        return np.stack([(values * row).sum(axis=-1) for row in rows], axis=-1)
    each = [(values * rows[:, i, np.newaxis]).sum(axis=-1) for i in range(rows.shape[1])]
    return np.stack(each, axis=-1)


def over_unknowns(values: Floats, rows: Floats) -> Floats:
    """Return ``sum_i values[..., i] rows[..., i, j]``, shape (…, j), of the same shapes."""
    if rows.ndim == 2:
        parts = [values[..., i, np.newaxis] * row for i, row in enumerate(rows)]
    else:
        count = rows.shape[1]
        parts = [values[..., i, np.newaxis] * rows[:, i, np.newaxis] for i in range(count)]
    total: Floats = parts[0]
    for part in parts[1:]:
        total = total + part
    return total


def at_dofs(values: Floats, shapes: Floats) -> Floats:
    """Return ``sum_j values[..., j] shapes[..., d, j]``, shape (…, d), one frequency at a time.

    `shapes` are (dof, mode) or (parameter, dof, mode).
    """
    columns = np.swapaxes(shapes, -1, -2)
    if columns.ndim == 3:
        columns = columns[:, np.newaxis]
    return np.asarray((values[..., np.newaxis, :] @ columns)[..., 0, :])
