"""What of a structure is permitted, and is more often a mistake: sentences beside its modes."""

from __future__ import annotations

from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Booleans, Floats
from vibroimpact_solvers.matrices import SymmetricMatrix
from vibroimpact_solvers.model import System

_BALANCE: Final = 1e-6  # sum of a row over the sum of its magnitudes; files have six digits
_SHARE: Final = 1.0 / 3.0  # of the coupled rows; a beam's rotations have rows that are not balanced
_LISTED: Final = 5  # modes that are named


def cautions(system: System, roots: Floats, errors: Floats, modes: Floats | None) -> list[str]:
    """Return a sentence about each property that a structure seldom has on purpose.

    Parameters
    ----------
    system : System
        With n degrees of freedom.
    roots, errors : arrays, shape (mode,)
        Natural frequencies, minus the rate of growth where a motion grows, and their errors.
    modes : array, shape (n, mode), optional
        Of unit modal mass; where they were not computed, nothing is said about damping.
    """
    return [
        *_interchanged(system.M, system.K),
        *_growing(roots, errors),
        *([] if modes is None or system.C is None else _overdamped(system.C, roots, modes)),
    ]


def _interchanged(M: SymmetricMatrix, K: SymmetricMatrix) -> list[str]:
    """Compare M and K with the form of stiffnesses, whose forces balance in most rows.

    A motion of all coordinates by the same length deforms no spring between them, but it moves
    their masses: rows of K may sum to zero, rows of M do so only where K and M are interchanged.
    Springs couple by negative entries, and masses by positive ones or not at all.
    """
    mass, stiffness = _Form(M), _Form(K)
    balanced = mass.balanced >= max(1.0, _SHARE * mass.coupled)
    springs = mass.coupled > 0 and mass.negative and stiffness.coupled == 0
    if not springs and not (balanced and mass.balanced > 2 * stiffness.balanced):
        return []
    return ["M has the form of a stiffness matrix, and K has not: M and K may be interchanged"]


class _Form:
    """How the rows of a symmetric matrix couple degrees of freedom."""

    def __init__(self, matrix: SymmetricMatrix) -> None:
        rows = matrix.to_sparse()
        size = np.asarray(abs(rows).sum(axis=1)).ravel()
        couples: Booleans = size > np.abs(rows.diagonal())
        places = rows.tocoo()
        sums = np.abs(np.asarray(rows.sum(axis=1)).ravel())
        self.coupled = int(np.count_nonzero(couples))
        """Rows with entries beside the diagonal."""
        self.balanced = int(np.count_nonzero(couples & (sums <= _BALANCE * size)))
        """Those that sum to zero."""
        self.negative = bool((places.data[places.row != places.col] <= 0.0).all())
        """Whether no entry beside the diagonal is positive."""


def _growing(roots: Floats, errors: Floats) -> list[str]:
    count = int(np.count_nonzero(roots < -errors))
    if not count:
        return []
    which = (
        "the natural frequency of mode 0 is negative, minus the rate at which its motion grows"
        if count == 1
        else f"the natural frequencies of modes 0 to {count - 1} are negative, minus the rates at "
        "which their motions grow"
    )
    return [f"{which}: K is indefinite, and the structure does not stay at rest"]


def _overdamped(C: SymmetricMatrix, roots: Floats, modes: Floats) -> list[str]:
    """Compare the damping of each mode by itself, ``e^T C e``, with its critical one, 2 Omega."""
    own = np.einsum("ij,ij->j", modes, C @ modes)
    oscillates = roots > 0.0
    ratios = np.divide(own, 2.0 * roots, out=np.zeros_like(own), where=oscillates)
    places = np.flatnonzero(ratios >= 1.0)
    if not places.size:
        return []
    named = ", ".join(map(str, places[:_LISTED])) + (" …" if places.size > _LISTED else "")
    largest = f"{100.0 * ratios.max():.3g} %"
    if places.size == 1:
        return [f"mode {named} has {largest} of its critical damping, and does not oscillate"]
    return [
        f"{places.size} modes ({named}) have critical damping or more, up to {largest}, and do not "
        "oscillate"
    ]
