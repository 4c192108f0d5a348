"""The whole model as the structure of its reduced one says: its stops, loads and damping.

A damping of the reduced model that is not of the whole one's matrices, such as ratios of its modes,
acts on the same motions of the whole: ``B C_r B'`` with ``B = M T M_r^-1``, so that
``T' (B C_r B') T = C_r``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.linalg

from vibroimpact.grids import angular
from vibroimpact.models.model import Model
from vibroimpact.systems import matrix
from vibroimpact.tables import Array

Damper = Callable[[Array], Array]
"""Displacements or velocities, shape (dof, column) -> forces."""


@dataclass(frozen=True, eq=False)
class Side:
    """What the structure of a reduced model stands for on the whole one.

    Parameters
    ----------
    whole, small : Model
        The whole model and the reduced one.
    T : array, shape (dof, reduced dof)
        Displacements of the whole by those of the reduced model.
    rows : array of int, shape (kept,)
        Rows of the kept degrees of freedom in the whole model.
    structure : mapping
        The document of a structure, from ``small.system``.
    """

    whole: Model
    small: Model
    T: Array
    rows: Array
    structure: Mapping[str, Any]
    dampers: Sequence[Damper] = field(init=False)

    def __post_init__(self) -> None:
        given = self.structure
        for name in ("M", "K"):
            if given.get(name) != matrix(getattr(self.small, name), name):
                raise ValueError(
                    f"structure: {name} is not that of the reduced model: a structure comes from "
                    "small.model.system(stops)"
                )
        if not given.get("constraints"):
            raise ValueError("structure: it has no stops, at which responses are compared")
        if np.any(given.get("force") or ()):
            raise ValueError("structure: the static load has no place here; give it as a load")
        object.__setattr__(self, "dampers", tuple(self._dampers()))

    @property
    def stops(self) -> Array:
        """Coordinates of the stops, shape (dof, stop)."""
        given = self.structure["constraints"]
        names = (f"stop {place}" for place in range(len(given)))
        return np.column_stack(list(map(self._coordinate, names, given)))

    def loads(self, load: Sequence[Mapping[str, Any]]) -> Array:
        """Return the forces of unit terms of a load, shape (dof, term)."""
        forces = [
            -(self.whole.M @ self.influence) if term.get("base") else self._coordinate(name, term)
            for name, term in ((f"load {place}", term) for place, term in enumerate(load))
        ]
        return np.column_stack([np.zeros((self.whole.n, 0)), *forces])

    @property
    def influence(self) -> Array:
        """Displacements of the whole model by a unit displacement of its base, shape (dof,)."""
        if self.structure.get("influence") is None:
            raise ValueError('load: the base moves, but the structure has no base=, such as "z"')
        given = np.asarray(self.structure["influence"])
        for direction in self.small.base:
            if np.array_equal(given, self.small.influence(direction)):
                return self.whole.influence(direction)
        moved: Array = self.T @ given
        return moved

    def damped(self, x: Array) -> Array:
        """Return the forces of the damping by velocities x, shape (dof, column)."""
        forces = np.zeros_like(x)
        for damper in self.dampers:
            forces += damper(x)
        return forces

    def _coordinate(self, name: str, given: Mapping[str, Any]) -> Array:
        """Return the weights of degrees of freedom in a coordinate, shape (dof,)."""
        direction = given.get("direction") or {"dofs": [given.get("dof")], "weights": [1.0]}
        weights = np.zeros(self.whole.n)
        for dof, weight in zip(direction["dofs"], direction["weights"], strict=True):
            if dof is None or not 0 <= dof < self.small.n:
                raise ValueError(f"{name}: there is no degree of freedom {dof}")
            if dof >= self.rows.size:
                raise ValueError(
                    f"{name}: degree of freedom {dof} is a mode of the reduction; only those that "
                    "are kept are compared"
                )
            weights[self.rows[dof]] += weight
        return weights

    def _dampers(self) -> list[Damper]:
        """Return the parts of the damping, each a function of velocities."""
        given, dampers = self.structure, list[Damper]()
        if given.get("C") is not None:
            own = None if self.small.C is None else matrix(self.small.C, "C")
            if given["C"] == own:
                dampers.append(lambda v: self.whole.C @ v)
            else:
                dampers.append(self._lifted(_full(given["C"], self.small.n)))
        law = given.get("damping") or {}
        if "ratio" in law:
            dampers.append(self._lifted(self._of_ratios(law["ratio"])))
        elif law:
            alpha, beta = self._proportional(law)
            dampers.append(lambda v: alpha * (self.whole.M @ v) + beta * (self.whole.K @ v))
        for place, each in enumerate(given.get("dashpots") or ()):
            w = self._coordinate(f"dashpot {place}", {"direction": each})
            dampers.append(_dashpot(w, each["c"]))
        return dampers

    def _proportional(self, law: Mapping[str, Any]) -> tuple[float, float]:
        """Return the coefficients of M and K."""
        if "structural" in law:
            return 0.0, law["structural"] / (law["at"] * self._angular(law))
        given = law["rayleigh"]
        if not isinstance(given, Mapping):
            return float(given[0]), float(given[1])
        at = np.asarray(given["at"]) * self._angular(given)
        # zeta = (alpha/Omega + beta Omega)/2 at both frequencies
        alpha, beta = np.linalg.solve(0.5 * np.column_stack([1.0 / at, at]), given["ratios"])
        return float(alpha), float(beta)

    def _angular(self, document: Mapping[str, Any]) -> float:
        units = self.structure.get("units") or {}
        return angular(document.get("unit", "Omega"), units.get("time", "s"))

    def _of_ratios(self, ratios: float | Sequence[float]) -> Array:
        """Return the matrix of the reduced model with damping ratios of its modes."""
        squares, modes = self._modes()
        heavy = self.small.M @ modes
        heavy *= np.sqrt(2.0 * np.asarray(ratios) * np.sqrt(np.maximum(squares, 0.0)))
        C: Array = heavy @ heavy.T
        return C

    def _lifted(self, C: Array) -> Damper:
        """Return the damper of the whole model by a matrix of the reduced one."""
        _, modes = self._modes()
        B = (self.whole.M @ self.T) @ (modes @ modes.T)  # M_r^-1 = modes modes'
        return lambda v: B @ (C @ (B.T @ v))

    def _modes(self) -> tuple[Array, Array]:
        try:
            squares, modes = scipy.linalg.eigh(self.small.K.toarray(), self.small.M.toarray())
        except scipy.linalg.LinAlgError:
            raise ValueError(
                "structure: a kept degree of freedom has no mass, so that the modes of the reduced "
                "model do not carry its damping over to the whole: give Rayleigh's damping"
            ) from None
        return squares, modes


def base_displacements(M: Array, forces: Array) -> Array:
    """Return displacements r by a unit displacement of the base, of inertia forces M r."""
    masses = np.diagonal(M)
    scale = 1.0 / np.sqrt(np.where(masses > 0.0, masses, 1.0))
    scaled = scale[:, np.newaxis] * M * scale
    moved: Array = scale * np.linalg.lstsq(scaled, scale * forces)[0]
    return moved


def _dashpot(w: Array, c: float) -> Damper:
    """Return a damper of one coordinate."""
    return lambda v: c * np.outer(w, w @ v)


def _full(document: Any, n: int) -> Array:
    """Return the matrix of a document."""
    if not isinstance(document, Mapping):
        return np.asarray(document, dtype=np.float64)
    if "diagonal" in document:
        return np.diag(np.asarray(document["diagonal"], dtype=np.float64))
    full = np.zeros((n, n))
    np.add.at(full, (document["row"], document["col"]), document["data"])
    return full
