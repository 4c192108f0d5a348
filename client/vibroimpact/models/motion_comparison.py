"""Periodic motions of a reduced model beside those of the whole one.

Those of a whole model with few degrees of freedom are computed on all of them. Others, where stops
have a stiffness, in the subspace that has the responses of the whole model at its stops, see
`whole_response`: what such stops do converges as vectors are added, at rigid ones it does not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from vibroimpact.local import Local
from vibroimpact.models.whole_response import Subspace
from vibroimpact.models.whole_system import Side, base_displacements
from vibroimpact.stops import has_stiff_stops
from vibroimpact.systems import matrix
from vibroimpact.tables import Array

if TYPE_CHECKING:
    from vibroimpact.client import Client
    from vibroimpact.kinds import PeriodicMotions

_FEW: Final = 300
"""Degrees of freedom up to which motions are computed on the whole model itself."""
_HEAVY: Final = 1e-12
"""Mass of a vector of unit energy, relative to the largest, below which it only deflects."""
_COMPARED: Final = {
    "solution": ("x_max", "x_min"),
    "impact": ("momentum",),
    "contact": ("duration", "impulse", "peak_force"),
}
"""Columns of periodic motions that are compared."""


@dataclass(frozen=True, eq=False, repr=False)
class MotionComparison:
    """Periodic motions of a reduced model beside those of the whole one.

    Parameters
    ----------
    reduced, whole : PeriodicMotions
        The results at one frequency.
    of : int
        Degrees of freedom on which the motions of the whole model were computed: all of them, or
        the dimension of the subspace that has its responses.
    change : mapping of str to array
        Absolute difference of ``solution.x_max`` and ``solution.x_min`` at the stops,
        ``impact.momentum``, ``contact.duration``, ``contact.impulse`` and ``contact.peak_force``,
        rows of motions that exist; empty where these are not the same motions by their number and
        by the stops that they meet.
    size : mapping of str to float
        Largest value of each in the whole model.
    """

    reduced: PeriodicMotions
    whole: PeriodicMotions
    of: int
    change: Mapping[str, Array]
    size: Mapping[str, float]

    @classmethod
    def between(cls, reduced: Any, whole: Any, of: int) -> MotionComparison:
        """Compare two results."""
        change: dict[str, Array] = {}
        size: dict[str, float] = {}
        mine, theirs = _existing(reduced), _existing(whole)
        if all(np.array_equal(mine[name], theirs[name]) for name in ("kind", "impact", "contact")):
            for name in mine.keys() & theirs.keys() - {"kind", "impact", "contact"}:
                change[name] = np.abs(mine[name] - theirs[name])
                size[name] = float(np.abs(theirs[name]).max(initial=0.0))
        return cls(reduced, whole, of, dict(sorted(change.items())), size)

    def relative(self, name: str) -> float:
        """Return the largest change of a column relative to its largest value."""
        largest = float(self.change[name].max(initial=0.0))
        return largest / self.size[name] if self.size[name] else 0.0

    def __repr__(self) -> str:
        """Return the sentence about it."""
        return f"<MotionComparison: {self}>"

    def __str__(self) -> str:
        """Return a sentence such as ``3 motions, contact.peak_force differs by up to 0.2 %``."""
        counts = [int(each.solution.exists.sum()) for each in (self.reduced, self.whole)]
        number = f"{counts[0]} motion{'s' * (counts[0] != 1)}"
        if not self.change and counts != [0, 0]:
            return f"{number}, but {counts[1]} of the whole model, or at other stops"
        differ = [
            f"{name.partition('.')[2]} differs by up to {100.0 * self.relative(name):.2g} %"
            for name, change in self.change.items()
            if change.size
        ]
        return ", ".join([number, *differ])


def _existing(result: Any) -> dict[str, Array]:
    """Return the numbers of motions that exist, and which stops they meet."""
    exists, existing = result.solution.exists, dict[str, Array]()
    existing["kind"] = np.column_stack([result.solution.impacts[exists]])
    rows = {"solution": exists}
    for table in ("impact", "contact"):
        columns = getattr(result, table, None)
        existing[table] = np.zeros((0, 3))
        if columns is not None and "solution" in columns:
            rows[table] = exists[columns.solution]
            places = [columns.solution, columns.constraint, columns.side]
            existing[table] = np.column_stack(places)[rows[table]]
            number = np.cumsum(exists) - 1
            existing[table][:, 0] = number[existing[table][:, 0]]
    for table, names in _COMPARED.items():
        for name in names if table in rows else ():
            existing[f"{table}.{name}"] = getattr(result, table)[name][rows[table]]
    return existing


def check(side: Side) -> None:
    """Refuse structures of which no motion of the whole model can be computed.

    Raises
    ------
    ValueError
        If a stop is rigid and the whole model is large.
    """
    stops = side.structure["constraints"]
    if not _is_few(side) and not all(has_stiff_stops({"constraints": [each]}) for each in stops):
        raise ValueError(
            "at: what happens at rigid stops has no limit as modes are added, so that no motion of "
            f"a whole model with more than {_FEW} degrees of freedom is there to be compared with; "
            "Reduction.compute says what the modes change"
        )


def compare(
    side: Side,
    space: Subspace,
    first: int,
    load: Sequence[Mapping[str, Any]],
    unit: str,
    at: float,
    client: Client | Local | None,
    options: Mapping[str, Any],
) -> MotionComparison:
    """Compute the motions at one frequency of the drive, of the reduced model and the whole.

    Parameters
    ----------
    side : Side
    space : Subspace
    first : int
        Its vectors before those of which the kept degrees of freedom are at rest.
    load, unit, at, client, options
        As of `Reduction.compare`.
    """
    places = np.arange(side.small.n)
    whole = _of_subspace(side, space, first)
    if _is_few(side):
        places, whole = side.rows, _of_whole(side)
    client = Local() if client is None else client

    def motions(system: Mapping[str, Any], places: Array) -> Any:
        placed = [_placed(each, places) for each in system["constraints"]]
        structure: Any = {**system, "constraints": placed}
        terms: Any = [_placed(each, places) for each in load]
        dofs = sorted({dof for each in placed for dof in _dofs(each)})
        return client.periodic_motions(
            structure,
            [at],
            terms,
            unit=unit,
            outputs=["exists", "extremes"],
            dofs=dofs,
            **options,
        )

    reduced = motions(dict(side.structure), np.arange(side.small.n))
    return MotionComparison.between(reduced, motions(whole, places), _size(whole))


def _is_few(side: Side) -> bool:
    """Return whether motions are computed on all degrees of freedom, which then need mass."""
    return side.whole.n <= _FEW and bool((side.whole.M.diagonal() > 0.0).all())


def _of_whole(side: Side) -> dict[str, Any]:
    """Return the structure of all degrees of freedom; its stops are yet to be placed."""
    influence = None if side.structure.get("influence") is None else side.influence
    C = side.damped(np.eye(side.whole.n))
    return _structure(side, side.whole.M, C, side.whole.K, influence)


def _of_subspace(side: Side, space: Subspace, first: int) -> dict[str, Any]:
    """Return the structure in a subspace; its first degrees of freedom are those of the reduced."""
    masses = np.diagonal(space.M)[first:]
    heavy = masses > _HEAVY * masses.max(initial=0.0)
    keep = np.concatenate([np.arange(first), first + np.flatnonzero(heavy)])
    scale = np.concatenate([np.ones(first), 1.0 / np.sqrt(masses[heavy])])
    M, C = (part[np.ix_(keep, keep)] * np.outer(scale, scale) for part in (space.M, space.C))
    K = np.diag(scale**2)  # vectors have unit energy, and none together with static shapes
    K[:first, :first] = side.small.K.toarray()[:first, :first]
    influence = None
    if side.structure.get("influence") is not None:
        forces = scale * (space.V[:, keep].T @ (side.whole.M @ side.influence))
        influence = base_displacements(M, forces)
    return _structure(side, M, C, K, influence)


def _structure(side: Side, M: Any, C: Array, K: Any, influence: Array | None) -> dict[str, Any]:
    """Return a structure with other matrices, and the damping as one of them."""
    left = ("damping", "dashpots", "force", "residual_flexibility")
    system = {name: value for name, value in side.structure.items() if name not in left}
    system |= {"M": matrix(M), "K": matrix(K)}
    if side.dampers:
        system["C"] = matrix(0.5 * (C + C.T))
    return system if influence is None else system | {"influence": influence.tolist()}


def _size(system: Mapping[str, Any]) -> int:
    """Return the number of degrees of freedom."""
    M = system["M"]
    if isinstance(M, Mapping):
        return len(M["diagonal"]) if "diagonal" in M else int(M["shape"][0])
    return len(M)


def _dofs(given: Mapping[str, Any]) -> list[int]:
    """Return the degrees of freedom of a stop."""
    return [given["dof"]] if given.get("direction") is None else list(given["direction"]["dofs"])


def _placed(given: Mapping[str, Any], places: Array) -> dict[str, Any]:
    """Return a stop or a load with its degrees of freedom at other places."""
    placed = dict(given)
    if given.get("dof") is not None:
        placed["dof"] = int(places[given["dof"]])
    if given.get("direction") is not None:
        dofs = [int(places[dof]) for dof in given["direction"]["dofs"]]
        placed["direction"] = {**given["direction"], "dofs": dofs}
    return placed
