"""Selection of coordinates of a structure: degrees of freedom or combinations of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.model import Constraint


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Coordinates picked from vectors (dof, column), giving (coordinate, column)."""

    dofs: Integers  # degrees of freedom that enter, (dof,)
    # Coordinates as combinations of these; absent: the degrees of freedom themselves,
    # (coordinate, dof)
    weights: Floats | None = None

    @classmethod
    def along(cls, constraints: Iterable[Constraint]) -> Coordinates:
        """Return the constrained coordinates."""
        lines = [constraint.coordinate for constraint in constraints]
        dofs = sorted({dof for line in lines for dof, _ in line})
        place = {dof: k for k, dof in enumerate(dofs)}
        weights = np.zeros((len(lines), len(dofs)))
        for row, line in zip(weights, lines, strict=True):
            for dof, weight in line:
                row[place[dof]] = weight
        return cls(np.array(dofs, dtype=np.int64), weights)

    def __call__(self, vectors: Floats) -> Floats:
        """Return the coordinates of vectors of all degrees of freedom."""
        return self.combined(vectors[self.dofs])

    def combined(self, picked: Floats) -> Floats:
        """Return the coordinates of vectors that are given at `dofs` alone."""
        return picked if self.weights is None else np.asarray(self.weights @ picked)

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return self.dofs.size if self.weights is None else len(self.weights)
