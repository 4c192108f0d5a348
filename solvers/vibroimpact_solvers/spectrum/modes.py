"""The natural modes of a structure: frequencies, their errors, and rows of the modal matrix."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.model import Constraint


@dataclass(frozen=True, eq=False, slots=True)
class Spectrum:
    """Natural modes, ``K e_j = lambda_j M e_j``, ``e_i^T M e_j = delta_ij``."""

    # Natural angular frequencies, (mode,), ascending; zero for rigid-body modes, minus the growth
    # rate for unstable ones
    roots: Floats
    # The modes as columns, (dof, mode), or a function that returns the rows of given dofs
    modal_matrix: Floats | Callable[[Integers], Floats]
    n: int  # number of degrees of freedom
    uncertainty: float = 0.0  # absolute error of every eigenvalue, besides its rounding
    # Relative rounding errors of the roots, (exact - root)/exact, where they are known, (mode,)
    rounding: Floats | None = None
    # Error of the norms of the modes and of their orthogonality, and relative error of the
    # eigenvalues, besides rounding
    norms: float = 0.0

    @property
    def eigenvalues(self) -> Floats:
        """The lambda_j, shape (mode,)."""
        return self.roots * np.abs(self.roots)

    @property
    def largest_frequency(self) -> float:
        """Largest magnitude of the roots."""
        return float(np.abs(self.roots).max(initial=0.0))

    @property
    def modes(self) -> Floats:
        """The e_j as columns, shape (dof, mode)."""
        return self.rows(np.arange(self.n))

    def rows(self, dofs: Integers) -> Floats:
        """Return rows of the modal matrix, shape (len(dofs), mode)."""
        if callable(self.modal_matrix):
            return self.modal_matrix(dofs)
        return np.asarray(self.modal_matrix[dofs])

    def along(self, constraints: Iterable[Constraint]) -> Floats:
        """Return ``W E``: the participations of the modes, shape (constraint, mode)."""
        rows = []
        for constraint in constraints:
            dofs, weights = zip(*constraint.coordinate, strict=True)
            rows.append(np.array(weights) @ self.rows(np.array(dofs)))
        return np.array(rows).reshape(len(rows), self.roots.size)

    @property
    def nbytes(self) -> int:
        """Memory held."""
        return self.roots.nbytes + (0 if callable(self.modal_matrix) else self.modal_matrix.nbytes)
