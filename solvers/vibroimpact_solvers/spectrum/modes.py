"""The natural modes of a structure: frequencies, their errors, and rows of the modal matrix."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.kernels import doubled
from vibroimpact_solvers.model import Constraint

_WIDE: Final = 100.0
"""Ratio from which roundings of a deflection move the highest modes visibly."""


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
    # Absolute errors of the eigenvalues, besides what `rounding` states, and errors of the modes
    # in the norm of M, besides the rounding of their entries; zeros if absent, (mode,)
    errors: Floats | None = None
    angles: Floats | None = None
    # What rounding took from the entries of the modal matrix, where it is known, (dof, mode)
    modal_matrix_low: Floats | None = None
    proved: bool = True  # whether these errors are bounds, or else estimates

    @property
    def eigenvalues(self) -> Floats:
        """The lambda_j, shape (mode,)."""
        return self.roots * np.abs(self.roots)

    @property
    def largest_frequency(self) -> float:
        """Largest magnitude of the roots."""
        return float(np.abs(self.roots).max(initial=0.0))

    @property
    def is_wide(self) -> bool:
        """Whether the natural frequencies differ by more than a factor of 100, all being proved."""
        moving = np.abs(self.roots[self.roots != 0.0])
        return self.proved and bool(moving.size and moving.max() > _WIDE * moving.min())

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
        return self.participations(constraints)[0]

    def participations(
        self, constraints: Iterable[Constraint], reach: Floats | None = None
    ) -> tuple[Floats, Floats]:
        """Return ``W E`` and its errors, each (constraint, mode).

        A participation below its error is 0: the mode has a node at the constraint.

        Parameters
        ----------
        constraints : iterable of Constraint
        reach : array, shape (constraint,), optional
            Largest value of each coordinate in a vector of unit length in the norm of M,
            ``(w^T M^-1 w)^(1/2)``. Needed where there are not all modes, of which it is
            ``(sum_j (w^T e_j)^2)^(1/2)``.
        """
        lines = [constraint.coordinate for constraint in constraints]
        rows, errors = np.zeros((2, len(lines), self.roots.size))
        for place, (row, error, line) in enumerate(zip(rows, errors, lines, strict=True)):
            dofs, weights = (np.array(part) for part in zip(*line, strict=True))
            entries = self.rows(dofs)
            size = np.abs(weights) @ np.abs(entries)
            if self.modal_matrix_low is None:
                row[:] = weights @ entries
                error[:] = 0.5 * EPS * dofs.size * size
            else:
                low, none = self.modal_matrix_low[dofs], np.zeros((0, 0))
                row[:] = doubled.product(weights[np.newaxis], none, entries, low, False)[0][0]
                error[:] = doubled.roundings(dofs.size) * size
            if self.angles is not None:
                size = np.linalg.norm(row) if reach is None else reach[place]
                error += size * self.angles
            small = np.abs(row) <= error
            row[small] = 0.0
            error[:] = np.where(small, 2.0 * error, error + 0.5 * EPS * np.abs(row))
        return rows, errors

    @property
    def nbytes(self) -> int:
        """Memory held."""
        parts = (self.roots, self.modal_matrix, self.modal_matrix_low)
        return sum(part.nbytes for part in parts if isinstance(part, np.ndarray))
