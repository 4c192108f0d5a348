"""Damping in modal coordinates, ``E^T C E``, with what of it is rounding left out.

Damping that is proportional to M and K couples no modes, but its matrix is rounded, and so are
sums over its entries. These are large beside the damping of the lowest modes, 1e12 times in a beam
of 300 elements: products with C are computed in twice the precision. Couplings that may be rounding
are left out; what they would make of a motion is part of its errors. A coupling d of two modes
whose poles are p_i and p_j takes from the one to the other

    2 r / |p_j - p_i| ,    r = d |p_j| / |p_j - p_i'| ,

of its length, p_i being the nearer pole of the mode and p_i' its other one, or, where the poles
are so close that this is not small, r t in a time t, which is below r over the slower decay.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.matrices import SymmetricMatrix
from vibroimpact_solvers.model import System
from vibroimpact_solvers.spectrum import products

Complexes = NDArray[np.complex128]

_COLUMNS: Final = 64  # modes at a time
_SUMMED: Final = 4.0  # roundings of a product of two modes
_CLOSE: Final = 0.01  # of the distance of two poles, from which a coupling exchanges energy


@dataclass(frozen=True, eq=False, slots=True)
class ModalDamping:
    """The damping of some modes, and its errors."""

    matrix: Floats | None  # (mode, mode); None of structures without damping
    errors: Floats  # absolute ones of its diagonal, (mode,)
    left_out: Floats  # bounds of couplings that are left out, (mode, mode)
    neglected: float = 0.0  # largest part of a mode's motion that couplings left out take to others


def of_modes(system: System, shapes: Floats, roots: Floats, *, exact: bool) -> ModalDamping:
    """Return the damping of modes of a system with damping, which are exact or rounded."""
    assert system.C is not None
    if exact:
        return of_exact_modes(system.M, system.C, shapes, roots * np.abs(roots))
    return of_rounded_modes(system.C, shapes)


def of_rounded_modes(C: SymmetricMatrix, shapes: Floats) -> ModalDamping:
    """Return the damping of modes that err by roundings of the structure's matrices.

    The terms of an entry add up to no more than ``sqrt(c_i c_j)``, c_i being the sum of the squares
    of mode i by the sums of the rows of |C|: ``|C|`` is below the diagonal matrix of these sums.
    Entries of a mode are known to the rounding of its largest one: a mode that is still where the
    damping acts would be coupled to the others by what rounding makes of its zeros.
    """
    damping = shapes.T @ (C @ shapes)
    rounding, squares = _rounding(C, shapes)
    small = (np.abs(damping) <= rounding) & (damping != 0.0)
    left_out = np.where(small, np.abs(damping) + EPS * np.sqrt(np.outer(squares, squares)), 0.0)
    errors = EPS * squares + np.where(small, np.abs(damping), 0.0).diagonal()
    damping[small] = 0.0
    np.fill_diagonal(left_out, 0.0)
    return ModalDamping(damping, errors, left_out)


def of_exact_modes(
    M: SymmetricMatrix, C: SymmetricMatrix, shapes: Floats, eigenvalues: Floats
) -> ModalDamping:
    """Return the damping of modes that err by roundings of their entries alone."""
    count = eigenvalues.size
    rounding, squares = _rounding(C, shapes)
    damping = np.empty((count, count))
    errors, lengths, forces = np.empty((3, count))
    inertia = np.sqrt(M.main_diagonal)[:, np.newaxis]
    inertia = np.where(inertia > 0.0, inertia, inertia.max())  # weights of forces: any will do
    for some in _parts(count):
        x = shapes[:, some]
        high, low, error = products.product(C, x)
        damping[:, some] = shapes.T @ high
        own, rest = products.along(x, high, low)
        place = np.arange(count)[some]
        damping[place, place] = own + rest
        size = np.abs(x)
        errors[some] = EPS * (size * np.abs(high)).sum(axis=0) + (size * error).sum(axis=0)
        lengths[some] = np.linalg.norm(inertia * x, axis=0)
        forces[some] = np.linalg.norm(high / inertia, axis=0)
    still = eigenvalues == 0.0  # turned: not the modes themselves
    errors[still] = EPS * squares[still]
    # Of both entries of a coupling, that of the mode with the smaller force is more exact.
    summed = _SUMMED * EPS * lengths[:, np.newaxis] * forces
    damping = np.where(summed <= summed.T, damping, damping.T)
    left_out = np.abs(damping) <= rounding
    own = damping.diagonal().copy()
    own[np.abs(own) <= np.where(still, rounding.diagonal(), errors)] = 0.0
    # Below its error a coupling counts as that, whatever its rounding happens to be.
    couplings = np.where(left_out, np.maximum(np.abs(damping), np.minimum(summed, summed.T)), 0.0)
    np.fill_diagonal(couplings, 0.0)
    exchanged, neglected = _taken(couplings, own, eigenvalues)
    couplings[damping == 0.0] = 0.0
    damping[left_out] = 0.0
    np.fill_diagonal(damping, own)
    return ModalDamping(damping, errors + exchanged, couplings, neglected)


def _rounding(C: SymmetricMatrix, shapes: Floats) -> tuple[Floats, Floats]:
    """Return which entries may be rounding, (mode, mode), and the c_i, (mode,)."""
    sums = replace(C, data=np.abs(C.data)) @ np.ones(C.n)
    sizes, magnitudes = np.sqrt(sums @ shapes**2), np.abs(shapes)
    rounded = np.outer(magnitudes.T @ sums, magnitudes.max(axis=0, initial=0.0))
    rounding = (8 + sizes.size) * np.outer(sizes, sizes) + 4.0 * (rounded + rounded.T)
    return EPS * rounding, sizes**2


def _taken(couplings: Floats, damping: Floats, eigenvalues: Floats) -> tuple[Floats, float]:
    """Return what couplings left out exchange, as rates, (mode,), and take to other modes."""
    poles = _poles(damping, eigenvalues)
    exchanged, neglected = np.zeros(eigenvalues.size), 0.0
    for some in _parts(eigenvalues.size):
        for pole in poles:
            one, other = (np.abs(pole[some] - each[:, np.newaxis]) for each in poles)
            near, far = np.minimum(one, other), np.maximum(one, other)
            # What decays exchanges no more than in the time that it lasts.
            slowest = np.where(one < other, *(each.real[:, np.newaxis] for each in poles))
            near = np.maximum(near, np.minimum(-pole.real[some], -slowest))
            size = couplings[:, some] * np.abs(pole[some])
            rate = np.divide(size, far, np.zeros_like(far), where=far > 0.0)
            close = rate > _CLOSE * near
            exchange = np.where(close, rate, 0.0).sum(axis=0)
            exchanged[some] = np.maximum(exchanged[some], exchange)
            taken = np.divide(2.0 * rate, near, np.zeros_like(near), where=~close & (near > 0.0))
            neglected = max(neglected, float(np.linalg.norm(taken, axis=0).max(initial=0.0)))
    return exchanged, neglected


def _poles(damping: Floats, eigenvalues: Floats) -> tuple[Complexes, Complexes]:
    """Return the two poles of each mode, each (mode,)."""
    half = 0.5 * damping
    root: Complexes = np.sqrt((half**2 - eigenvalues).astype(np.complex128))
    fast: Complexes = -half - root
    slow: Complexes = root - half
    # The slow one of an overdamped mode is a difference of almost equal numbers.
    overdamped = (root.real > 0.0) & (fast != 0.0)
    np.divide(eigenvalues, fast, slow, where=overdamped)
    return fast, slow


def _parts(count: int) -> Iterator[slice]:
    for start in range(0, count, _COLUMNS):
        yield slice(start, min(start + _COLUMNS, count))
