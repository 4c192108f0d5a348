"""Structures with some of their constrained coordinates held fixed.

The held coordinates ``w_a^T x`` vanish. Elimination of one degree of freedom for each of them
leaves the others as coordinates q of what can still move,

    x = Z q ,    W Z = 0 ,    M_held = Z^T M Z ,    K_held = Z^T K Z .

Examples
--------
>>> from vibroimpact_solvers import holding
>>> from vibroimpact_solvers.model import Constraint
>>> from vibroimpact_solvers.presets import chain
>>> held = holding.hold(chain(3, [Constraint.at(1, gap=1.0)]), (0,))
>>> held.free, held.system.K.to_dense()
(array([0, 2]), array([[2., 0.],
       [0., 2.]]))
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.sparse

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.matrices import SymmetricMatrix
from vibroimpact_solvers.model import Constraint, Coordinate, System

_DEPENDENT: Final = 1e-12
"""Part of a direction's largest weight that is left by rounding where others hold it already."""


@dataclass(frozen=True, eq=False, slots=True)
class ConstrainedStructure:
    """A structure with some of its coordinates held fixed."""

    system: System  # its matrices, without limiters
    basis: scipy.sparse.csr_array  # Z, (dof, free)
    free: Integers  # degrees of freedom whose displacements are the coordinates, ascending
    exact: bool  # whether its matrices are those of the structure, without rounding

    def along(self, constraint: Constraint) -> Constraint | None:
        """Return a constraint's coordinate in terms of what can move; None where it is held."""
        row = np.zeros(self.basis.shape[0])
        row[list(constraint.dofs)] = constraint.weights
        weights = np.asarray(self.basis.T @ row)
        weights[np.abs(weights) <= _DEPENDENT * np.abs(row).max()] = 0.0
        dofs = np.flatnonzero(weights)
        if not dofs.size:
            return None
        return Constraint(tuple(dofs.tolist()), tuple(weights[dofs].tolist()), 1.0, 1.0)


def hold(system: System, constraints: Sequence[int]) -> ConstrainedStructure | None:
    """Return a structure with the coordinates of some constraints held; None: nothing can move."""
    coordinates = [system.constraints[index].coordinate for index in constraints]
    Z, free = basis(system.n, coordinates)
    if not free.size:
        return None
    exact = all(len(coordinate) == 1 for coordinate in coordinates)
    if exact:
        M, K = system.M.part(free), system.K.part(free)
    else:
        M, K = (
            SymmetricMatrix.leanest(scipy.sparse.csr_array(0.5 * (matrix + matrix.T)))
            for matrix in (Z.T @ part.to_sparse() @ Z for part in (system.M, system.K))
        )
    if not M.main_diagonal.any():
        return None  # what is left has no mass
    return ConstrainedStructure(System(M, K, (), units=system.units), Z, free, exact)


def basis(n: int, coordinates: Sequence[Coordinate]) -> tuple[scipy.sparse.csr_array, Integers]:
    """Return Z, (dof, free), and the degrees of freedom that stay as coordinates.

    Coordinates that follow from others, which are held already, change nothing.
    """
    rows = np.zeros((len(coordinates), n))
    for row, coordinate in zip(rows, coordinates, strict=True):
        for dof, weight in coordinate:
            row[dof] = weight
    sizes = np.abs(rows).max(axis=1, initial=0.0)
    pivots = dict[int, Floats]()
    for place, row in enumerate(rows):
        pivot = int(np.abs(row).argmax())
        if np.abs(row[pivot]) <= _DEPENDENT * sizes[place]:
            continue
        row /= row[pivot]
        row[pivot] = 1.0
        for other in (*rows[:place], *rows[place + 1 :]):
            other -= other[pivot] * row
            other[pivot] = 0.0
        pivots[pivot] = row
    free = np.delete(np.arange(n), list(pivots))
    entries, at, columns = [np.ones(free.size)], [free], [np.arange(free.size)]
    for pivot, row in pivots.items():
        some = np.flatnonzero(row[free])
        entries.append(-row[free][some])
        at.append(np.full(some.size, pivot))
        columns.append(some)
    index = (np.concatenate(at).astype(np.int64), np.concatenate(columns).astype(np.int64))
    Z = scipy.sparse.csr_array((np.concatenate(entries), index), shape=(n, free.size))
    return Z, free
