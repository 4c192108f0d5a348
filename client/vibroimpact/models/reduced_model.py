"""A reduced model with stops and loads anywhere on the whole one, and what it lacks there.

Displacements of the whole model are ``x = T q``. Forces f at its coordinates ``W' x`` displace them
by more than the reduced model does, at low frequencies by the residual flexibility

    delta = W' K^-1 W - W' T (T' K T)^-1 T' W = D' K D ,   D = K^-1 W - T (T' K T)^-1 T' W ,

where K^-1 stands for the elastic displacements of free structures. The two terms hardly differ, but
T q is the best of its displacements (Galerkin), so that D' K D is the same without cancellation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, Self, cast

import numpy as np

from vibroimpact.models.flexibility import Flexibility
from vibroimpact.models.model import Model
from vibroimpact.models.static_solvers import flexibility
from vibroimpact.stops import has_stiff_stops
from vibroimpact.systems import several
from vibroimpact.tables import Array

if TYPE_CHECKING:
    from vibroimpact import documents
    from vibroimpact.systems import Constraints, Damping, Dashpots
    from vibroimpact_schema.files.labels import Label

_ROUNDED: Final = 1e-12
"""Part of the flexibility at a stop below which a residual one is the rounding of solutions."""


class Stop(dict[str, Any]):
    """The document of a stop on a reduced model, which knows its coordinate of the whole model.

    Attributes
    ----------
    coordinate : mapping of int to float
        Weights of the whole model's degrees of freedom.
    """

    def __init__(self, document: Mapping[str, Any], coordinate: Mapping[int, float]) -> None:
        super().__init__(document)
        self.coordinate = dict(coordinate)


@dataclass(frozen=True, eq=False, repr=False)
class Whole:
    """A model that was reduced.

    Parameters
    ----------
    model : Model
    R : array, shape (dof, rigid)
        Its motions of rigid bodies.
    """

    model: Model
    R: Array

    @cached_property
    def flexibility(self) -> Flexibility:
        """Its elastic displacements by forces, for which its stiffness is factored once."""
        return flexibility(self.model, self.R)

    def __getstate__(self) -> dict[str, Any]:
        """Return what is pickled: factors are made anew."""
        return {"model": self.model, "R": self.R}


@dataclass(frozen=True, eq=False, repr=False)
class ReducedModel(Model):
    """The matrices of a reduction, with stops and loads at any node of the whole model.

    `weights` and `constraint` take the nodes of the whole model, whether or not they are kept: the
    displacement of another one is a sum of reduced degrees of freedom.

    Parameters
    ----------
    T : array, shape (dof, reduced dof)
        Displacements of the whole model by those of the reduced one.
    whole : Whole
        The whole model.
    motions : array, shape (reduced dof, rigid)
        Motions of rigid bodies of the whole structure.
    """

    T: Array = field(default_factory=lambda: np.zeros((0, 0)))
    whole: Whole | None = None
    motions: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def weights(
        self,
        node: int,
        direction: str | Mapping[str, float] = "x",
        *,
        against: int | None = None,
    ) -> dict[int, float]:
        """Return the weights of the reduced degrees of freedom in a displacement of a node.

        They are what `vibroimpact.drive`, `sampled` and `dashpot` take as `dof`; arguments are
        those of `constraint`. The node is any of the whole model.
        """
        coordinate = self._coordinate(node, direction, against)
        if coordinate is None:
            return super().weights(node, direction, against=against)
        moved = self._column(coordinate) @ self.T
        return {dof: weight for dof, weight in enumerate(moved.tolist()) if weight != 0.0}

    def _coordinate(
        self, node: int, direction: str | Mapping[str, float], against: int | None
    ) -> dict[int, float] | None:
        """Return the weights in the whole model; None for a mode, which is no part of it."""
        parts = [direction] if isinstance(direction, str) else list(direction)
        if self.whole is None or "mode" in parts:
            return None
        return self.whole.model.weights(node, direction, against=against)

    def _column(self, coordinate: Mapping[int, float]) -> Array:
        """Return a coordinate of the whole model as a vector."""
        column = np.zeros(self.T.shape[0])
        for dof, weight in coordinate.items():
            column[dof] += weight
        return column

    def _placed(
        self,
        stop: documents.Constraint,
        node: int,
        direction: str | Mapping[str, float],
        against: int | None,
    ) -> documents.Constraint:
        coordinate = self._coordinate(node, direction, against)
        return stop if coordinate is None else cast("documents.Constraint", Stop(stop, coordinate))

    def part(self, keep: Sequence[int]) -> Self:
        """Return the model with some of its degrees of freedom, the others held fixed.

        It stands for the whole model as long as only elastic modes are left out.
        """
        rows = np.asarray(keep, dtype=np.int64)
        left = np.setdiff1d(np.arange(self.n), rows)
        elastic = all(self.labels[row][1] == "mode" for row in left)
        whole = self.whole if elastic and not self.motions[left].any() else None
        T, motions = self.T[:, rows], self.motions[rows]
        return replace(super().part(keep), T=T, motions=motions, whole=whole)

    def residual_flexibility(self, constraints: Constraints) -> Array:
        """Return the static flexibility at stops that the whole model has and the reduced lacks.

        At a kept degree of freedom of a supported structure there is none: its static shape is in
        the reduced model. Of free structures, it is that of the elastic displacements while the
        inertia of the rigid bodies carries the forces.

        Parameters
        ----------
        constraints : iterable of dict
            From `constraint`.

        Returns
        -------
        array, shape (constraint, constraint)
            Length by force; for `residual_flexibility` of `vibroimpact.system`.

        Raises
        ------
        ValueError
            If a stop acts on a mode and does not come from `constraint`.
        """
        if self.whole is None:
            raise ValueError("the reduced model does not have its whole model")
        stops = several(constraints)
        columns = [self._column(self._of_stop(*each)) for each in enumerate(stops)]
        W = np.column_stack([np.zeros((self.T.shape[0], 0)), *columns])
        x = self.whole.flexibility.elastic(W)
        D = x - self.T @ Flexibility(self.K, self.M, self.motions).elastic(self.T.T @ W)
        delta: Array = D.T @ (self.whole.model.K @ D)
        none = np.abs(np.diagonal(delta)) <= _ROUNDED * np.abs(np.sum(W * x, axis=0))
        delta[none] = delta[:, none] = 0.0
        return 0.5 * (delta + delta.T)

    def _of_stop(self, place: int, stop: Mapping[str, Any]) -> Mapping[int, float]:
        """Return the coordinate of a stop in the whole model."""
        if isinstance(stop, Stop):
            return stop.coordinate
        assert self.whole is not None
        given = stop.get("direction") or {"dofs": [stop.get("dof")], "weights": [1.0]}
        coordinate: dict[int, float] = {}
        for dof, weight in zip(given["dofs"], given["weights"], strict=True):
            node, direction = self.labels[dof]
            if direction == "mode":
                raise ValueError(
                    f"constraint {place} acts on a mode, so that its place on the whole model is "
                    "not known: make it by constraint(node, direction, ...) of the reduced model"
                )
            coordinate[self.whole.model.dof(node, direction)] = weight
        return coordinate

    def system(
        self,
        constraints: Constraints,
        force: Mapping[Label, float] | None = None,
        *,
        damping: Damping | None = None,
        dashpots: Dashpots = (),
        base: str | None = None,
        residual_flexibility: bool = False,
    ) -> documents.MatrixSystem:
        """Return the structure's document, see `Model.system`.

        Parameters
        ----------
        constraints, force, damping, dashpots, base
            As of `Model.system`.
        residual_flexibility : bool
            Whether the stops are in series with what the reduced model lacks there, see the method
            of this name.

        Raises
        ------
        ValueError
            If that is not zero at a stop that is not linear, or has a damping.
        """
        stops = several(constraints)
        document = super().system(stops, force, damping=damping, dashpots=dashpots, base=base)
        if residual_flexibility:
            delta = self.residual_flexibility(stops)
            for place, stop in enumerate(stops):
                if delta[place].any():
                    _check_stop(place, stop, float(delta[place, place]))
            if delta.any():
                document["residual_flexibility"] = delta.tolist()
        return document


def _check_stop(place: int, stop: Mapping[str, Any], delta: float) -> None:
    """Refuse a stop that has no residual flexibility in series."""
    law = stop.get("law") or {}
    if not has_stiff_stops({"constraints": [stop]}):
        what = (
            f"is rigid: in series with a flexibility it is a linear stop, here with a stiffness of "
            f"{1.0 / delta:.6g}"
        )
    elif law["type"] != "linear":
        what = f"has a {law['type']} law, which is not computed in series with a flexibility"
    elif law.get("damping") or law.get("restitution", 1.0) != 1.0:
        what = "has a damping, which in series with a flexibility has a state of its own"
    else:
        return
    raise ValueError(
        f"residual_flexibility: constraint {place} {what}. Keep its degree of freedom in the "
        "reduction, whose static shape has the flexibility, or leave residual_flexibility out"
    )
