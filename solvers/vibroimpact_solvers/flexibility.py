"""Residual flexibility: what a model of few modes lacks at its stops, in series with them.

A model of some modes yields less to forces at its stops than the structure does, by

    delta = W^T K^-1 W - sum_j W^T e_j Omega_j^-2 e_j^T W ,

the static flexibility of the modes that are left out. With forces f at the stops, the limited
coordinates are ``y = W^T x + delta f``. A set S of stops with springs k that are loaded is then the
spring ``(diag(1/k) + delta_SS)^-1`` between the modes and the walls. A dashpot in series with delta
would have a state of its own.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any, Final, Protocol, TypeVar

import numpy as np
import scipy.linalg

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.meter import look


class HasStops(Protocol):
    """A system."""

    @property
    def constraints(self) -> Sequence[Any]:
        """Its limiters."""


OfSystem = TypeVar("OfSystem", bound=HasStops)
FIELD: Final = "residual_flexibility"
_ROUNDED: Final = 64.0  # roundings within which a matrix is symmetric, or not negative
_PIVOTS: Final = 100_000  # of which a few are needed


def in_series(system: OfSystem, given: Any) -> OfSystem:
    """Return a system with a residual flexibility in series with its stops, see `checked`."""
    matrix = checked(given, system.constraints)
    other = copy.copy(system)
    object.__setattr__(other, "flexibility", matrix)
    return other


def checked(given: Any, constraints: Sequence[Any]) -> Floats | None:
    """Return a residual flexibility as a matrix that nobody changes; None where it is zero.

    Parameters
    ----------
    given : array, shape (constraint, constraint)
        Symmetric and positive semidefinite, each to rounding.
    constraints : sequence of model.Constraint

    Raises
    ------
    ModelError
        Naming the field, or the law of a stop that has none in series.
    """
    count = len(constraints)
    matrix = np.array(given, dtype=np.float64)
    if matrix.shape != (count, count):
        message = f"it needs a row and a column for each of the {count} constraints"
        raise ModelError((FIELD,), message, code="wrong_size")
    largest = float(np.abs(matrix).max(initial=0.0))
    if not largest < 1e150:
        message = "an entry is nan, infinite or above 1e150"
        raise ModelError((FIELD,), message, code="not_finite")
    if largest == 0.0:
        return None
    if (np.abs(matrix - matrix.T) > _ROUNDED * EPS * largest).any():
        raise ModelError((FIELD,), "the matrix is not symmetric", code="not_symmetric")
    matrix = 0.5 * (matrix + matrix.T)
    least = float(scipy.linalg.eigvalsh(matrix)[0])
    if least < -_ROUNDED * count * EPS * largest:
        message = f"the matrix is not positive semidefinite: it has the eigenvalue {least!r}"
        raise ModelError((FIELD,), message, code="not_positive_definite")
    for index in np.flatnonzero(matrix.any(axis=1)).tolist():
        law = constraints[index].law
        if law.rigid:
            message = (
                f"constraint {index} has a residual flexibility and a rigid stop: in series they "
                "are a linear stop of the stiffness 1/delta; give it as the law, without the "
                "flexibility"
            )
        elif law.lossy or law.name != "linear":
            message = (
                f"constraint {index} has a residual flexibility in series with a {law.name} stop "
                f"{'that loses energy' if law.lossy else 'of another law'}, which is not computed: "
                "it is offered with linear stops without damping"
            )
        else:
            continue
        raise ModelError(("constraints", index, "law"), message, code="not_possible")
    matrix.setflags(write=False)
    return matrix


class Series:
    """Springs of stops in series with a residual flexibility.

    Parameters
    ----------
    stiffness : array, shape (constraint,)
    flexibility : array, shape (constraint, constraint), optional
    """

    def __init__(self, stiffness: Floats, flexibility: Floats | None) -> None:
        self.stiffness, self.flexibility = stiffness, flexibility

    def springs(self, loaded: Sequence[int]) -> Floats:
        """Return the spring matrix ``(diag(1/k) + delta)^-1`` of loaded stops."""
        k = self.stiffness[[*loaded]]
        if self.flexibility is None or not len(loaded):
            return np.diag(k)
        root = np.sqrt(k)
        return root[:, np.newaxis] * self._shared(root, loaded) * root

    def axes(self, loaded: Sequence[int]) -> tuple[Floats, Floats | None]:
        """Return the springs as stiffnesses along orthonormal combinations, the columns.

        None where the combinations are the stops themselves.
        """
        springs = self.springs(loaded)
        if self.flexibility is None or not len(loaded):
            return springs.diagonal(), None
        stiffness, axes = scipy.linalg.eigh(springs)
        return np.maximum(stiffness, 0.0), axes

    def shares(self, loaded: Sequence[int]) -> Floats | None:
        """Return what of ``W^T x - walls`` of loaded stops is in the coordinates of all.

        That is ``diag(1/k) springs`` of the loaded ones, and of the others ``-delta springs``,
        shape (constraint, loaded); None where it is the coordinates themselves.
        """
        if self.flexibility is None or not len(loaded):
            return None
        root, shares = np.sqrt(self.stiffness[[*loaded]]), -self.flexibility[:, [*loaded]]
        shared = self._shared(root, loaded)
        shares = shares @ (root[:, np.newaxis] * shared * root)
        inverse = np.where(root > 0.0, 1.0 / np.where(root > 0.0, root, 1.0), 1.0)
        shares[[*loaded]] = inverse[:, np.newaxis] * shared * root
        return np.asarray(shares)

    def _shared(self, root: Floats, loaded: Sequence[int]) -> Floats:
        """Return ``(1 + k^(1/2) delta k^(1/2))^-1``."""
        assert self.flexibility is not None
        among = self.flexibility[np.ix_([*loaded], [*loaded])]
        inverse = np.linalg.inv(np.eye(root.size) + root[:, np.newaxis] * among * root)
        return np.asarray(0.5 * (inverse + inverse.T))

    def loaded_at(self, beyond: Floats) -> list[tuple[int, int]]:
        """Return the stops that are loaded where ``W^T x`` is so far beyond the walls.

        Their forces F solve a linear complementarity problem, ``d = beyond - delta F``,
        ``F = k d`` or F = 0 and d <= 0, of a positive definite matrix: it has one solution, and
        pivots of the least index end there (K. G. Murty, "Note on a Bard-type scheme for solving
        the complementarity problem", Opsearch 11, 1974).

        Parameters
        ----------
        beyond : array, shape (2, constraint)
            Of lower and upper walls; minus infinity where there is none.
        """
        assert self.flexibility is not None
        sides = np.array([-1.0, 1.0])
        delta = np.kron(np.outer(sides, sides), self.flexibility)
        k, d = np.tile(self.stiffness, 2), beyond.ravel()
        root, count = np.sqrt(k), self.stiffness.size
        chosen = np.zeros(k.size, dtype=bool)
        for _ in range(_PIVOTS):
            look()
            some, force = np.flatnonzero(chosen), np.zeros(k.size)
            among = delta[np.ix_(some, some)]
            A = np.eye(some.size) + root[some, np.newaxis] * among * root[some]
            force[some] = root[some] * np.linalg.solve(A, root[some] * d[some])
            open_ = ~chosen & (k > 0.0) & (d - delta @ force > 0.0)
            wrong = np.flatnonzero(open_ | (chosen & (force < 0.0)))
            if not wrong.size:
                return [(int(i % count), 1 if i >= count else -1) for i in some]
            chosen[wrong[0]] ^= True
        message = "rounding decides which stops are loaded at the beginning"
        raise ModelError((FIELD,), message, code="out_of_range")
