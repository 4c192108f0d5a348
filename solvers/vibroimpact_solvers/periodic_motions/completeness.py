"""Whether the multipliers that were found are all there are, and whether some nearly coincide."""

from __future__ import annotations

from typing import Final

import numpy as np
import scipy.spatial

from vibroimpact_solvers.arrays import Booleans, Floats, Integers
from vibroimpact_solvers.kernels.floquet import A_PART
from vibroimpact_solvers.kernels.floquet import Cells as Cycles
from vibroimpact_solvers.periodic_motions.pairs import Complexes

_TOGETHER: Final = 1e-5  # relative distance below which modes' own multipliers are almost one
_NOTHING: Final = 1e-30  # of the largest multiplier, below which none counts for that
_SUM: Final = 1e-6  # to which sums of multipliers are what they should be, relative to terms


def product_of_jumps(
    restitution: Floats, same: Floats, jumps: Floats, kept: Integers | None
) -> Floats:
    """Return the determinants of the jumps of some modes, shape (solution,).

    Parameters
    ----------
    restitution : array, shape (impact,)
    same : array, shape (2 impact, 2 impact, mode)
        Products of the forms and the kicks of all impacts.
    jumps : array, shape (solution, impact, 2, 2)
    kept : array of int, optional
        The modes; None for all, where it is the square of the restitution at each impact. Of some
        modes it is 0 where digits are lost.
    """
    if kept is None:
        return np.full(len(jumps), float(np.prod(restitution**2)))
    m = restitution.size
    seen = same[..., kept].sum(axis=-1).reshape(m, 2, m, 2)
    own = seen[np.arange(m), :, np.arange(m)]
    product = np.linalg.det(np.eye(2) + jumps @ own).prod(axis=1)
    return np.where(np.abs(product) > _SUM, product, 0.0)


def nearly_equal(cycles: Cycles) -> Booleans:
    """Return where two of the modes' own multipliers are almost one, shape (solution,).

    The determinant then loses the digits in which they differ, and with them its zeros.
    """
    half = 0.5 * cycles.trace
    root = np.sqrt((half * half - cycles.determinant).astype(np.complex128))
    poles = np.concatenate([half + root, half - root], axis=1)
    close = np.zeros(poles.shape[0], dtype=bool)
    if poles.shape[1] < 2:
        return close
    angles = np.sort(np.angle(poles), axis=1)
    between = np.diff(angles, axis=1, append=angles[:, :1] + 2.0 * np.pi)
    for row in np.flatnonzero(between.min(axis=1) < _TOGETHER):  # few: others are far apart
        sizes = np.abs(poles[row])
        there = sizes > _NOTHING * sizes.max()
        pole, length = poles[row, there], sizes[there]
        if pole.size < 2:
            continue
        places = np.stack([np.log(length), *(pole / length).view(np.float64).reshape(-1, 2).T])
        nearest = np.asarray(scipy.spatial.cKDTree(places.T).query(places.T, k=2)[0])[:, 1]
        close[row] = nearest.min(initial=np.inf) < _TOGETHER
    return close


def complete(cycles: Cycles, jumps: Floats, values: Complexes) -> Booleans:
    """Return whether multipliers are all there are, shape (solution,), by their sum and product.

    The sum is the trace of the product of flows and jumps, the product their determinant: those
    of the flows, and those of the jumps, (solution,).
    """
    terms, n = cycles.terms, cycles.terms.shape[1]
    later = np.arange(n)[:, np.newaxis] // 2 > np.arange(n) // 2
    A, B = terms.sum(axis=-1).transpose(3, 0, 1, 2)
    beyond = np.einsum("nijp,np->nij", terms[:, :, :, A_PART], cycles.trace) + B
    solved = np.linalg.solve(np.eye(n) - np.where(later, A, 0.0), np.where(later, beyond, A))
    trace = cycles.trace.sum(axis=1) + np.trace(solved, axis1=1, axis2=2)
    size = np.abs(values).sum(axis=1)
    whole = np.abs(values.sum(axis=1) - trace) <= _SUM * (size + np.abs(cycles.trace).sum(axis=1))
    with np.errstate(divide="ignore", invalid="ignore"):  # what has decayed tells nothing
        product = np.log(np.abs(values)).sum(axis=1) - np.log(cycles.determinant).sum(axis=1)
        product -= np.log(np.abs(jumps))
    whole &= ~(np.isfinite(product) & (np.abs(product) > _SUM * values.shape[1]))
    return np.asarray(whole)
