"""The mechanical model: M x'' + C x' + K x = f with stops.

Degrees of freedom whose rows of M are zero have no mass: they follow the others statically, see
`condensation`.

Examples
--------
>>> from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
>>> M = SymmetricMatrix.diagonal([2.0, 1.0])
>>> K = SymmetricMatrix.dense([[3.0, -1.0], [-1.0, 1.0]])
>>> system = System(M, K, (Constraint.at(dof=1, gap=0.5),))
>>> system.directions([0])
array([[0., 1.]])
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.body import Body
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.factors import Solve
from vibroimpact_solvers.laws import ELASTIC, Law, Rigid
from vibroimpact_solvers.matrices import SymmetricMatrix
from vibroimpact_solvers.walls import Wall

RANGE: Final = (1e-100, 1e100)
"""Allowed magnitudes of gaps, matrices and frequencies: their squares stay finite."""

_HELD: Final = 1e-14
"""Part of the diagonal of K without which what has no mass must still be held by springs."""
_ROUNDED: Final = 4.0 * EPS
"""The same for every degree of freedom without mass, where there are many."""

Coordinate = tuple[tuple[int, float], ...]
"""Pairs of a degree of freedom and its weight."""
Coordinates = tuple[Coordinate, ...]
__all__ = [
    "RANGE",
    "ChainShape",
    "Constraint",
    "Coordinate",
    "Coordinates",
    "SymmetricMatrix",
    "System",
    "Units",
    "listed",
    "within_range",
]


def within_range(values: Floats) -> bool:
    """Whether all magnitudes are in `RANGE`."""
    sizes = np.abs(values)
    return not sizes.size or bool(sizes.min() >= RANGE[0] and sizes.max() <= RANGE[1])


def listed(dofs: Integers) -> str:
    """Return degrees of freedom as text, the first of them where there are many."""
    return ", ".join(map(str, dofs[:10].tolist())) + (", …" if dofs.size > 10 else "")


@dataclass(frozen=True, slots=True)
class Constraint:
    """A stop of the coordinate ``y = sum(weight * x[dof])``, with walls at -lower and upper.

    Parameters
    ----------
    dofs : tuple of int
        Degrees of freedom in the coordinate, counted from 0.
    weights : tuple of float
        Their weights.
    lower, upper : float or None
        Distances to the walls (length); None if there is no wall.
    restitution : float
        Newton's coefficient of a rigid stop, 0 to 1.
    law : Law, optional
        What the stop does beyond its wall; where it is not rigid, restitution has no meaning.
    wall : Wall
        How both walls move.
    """

    dofs: tuple[int, ...]
    weights: tuple[float, ...]
    lower: float | None
    upper: float | None
    restitution: float = 1.0
    law: Law = ELASTIC
    wall: Wall = ()
    coordinate: Coordinate = field(init=False, repr=False, compare=False)
    """Pairs of a degree of freedom and its nonzero weight, ascending."""

    def __post_init__(self) -> None:
        if not self.dofs or len(set(self.dofs)) != len(self.dofs):
            message = "a direction needs at least one dof, and all of them distinct"
            raise ModelError(("direction", "dofs"), message, code="duplicate_dof")
        if len(self.weights) != len(self.dofs) or not all(map(math.isfinite, self.weights)):
            message = "a direction needs one finite weight per dof"
            raise ModelError(("direction", "weights"), message, code="wrong_length")
        if not any(self.weights):
            message = "all weights of the direction are zero"
            raise ModelError(("direction", "weights"), message, code="zero_direction")
        if not all(RANGE[0] <= abs(weight) <= RANGE[1] for weight in self.weights if weight):
            message = f"a weight is neither zero nor between {RANGE[0]} and {RANGE[1]}"
            raise ModelError(("direction", "weights"), message, code="out_of_range")
        walls = [wall for wall in (self.lower, self.upper) if wall is not None]
        if not walls or not all(map(math.isfinite, walls)):
            message = "a constraint needs at least one wall, at a finite distance"
            raise ModelError(("gap",), message, code="no_wall")
        if not all(RANGE[0] <= abs(wall) <= RANGE[1] for wall in walls if wall):
            message = f"a wall's distance is neither zero nor between {RANGE[0]} and {RANGE[1]}"
            raise ModelError(("gap",), message, code="out_of_range")
        if len(walls) == 2 and sum(walls) <= 0:
            message = f"the walls leave no room: lower + upper is {sum(walls)!r}, not positive"
            raise ModelError(("gap",), message, code="gap_not_positive")
        self._set_law()
        pairs = sorted((d, w) for d, w in zip(self.dofs, self.weights, strict=True) if w)
        object.__setattr__(self, "coordinate", tuple(pairs))

    def _set_law(self) -> None:
        """Let law and restitution agree."""
        if self.law == ELASTIC:
            object.__setattr__(self, "law", Rigid(self.restitution))
        elif self.restitution != 1.0:
            message = "the restitution of a stop with a law stands in the law, not beside it"
            raise ModelError(("restitution",), message, code="two_restitutions")
        elif isinstance(self.law, Rigid):
            object.__setattr__(self, "restitution", self.law.restitution)

    @classmethod
    def at(cls, dof: int, gap: float, restitution: float = 1.0) -> Constraint:
        """Limit one degree of freedom to ``|x[dof]| <= gap``."""
        return cls((dof,), (1.0,), gap, gap, restitution)

    @property
    def symmetric(self) -> bool:
        """Whether there are two walls at equal distances."""
        return self.lower is not None and self.lower == self.upper

    @property
    def line(self) -> Coordinate:
        """The coordinate up to a factor: the same for all limiters along one direction."""
        return tuple((dof, weight / self.coordinate[0][1]) for dof, weight in self.coordinate)


@dataclass(frozen=True, slots=True)
class Units:
    """The consistent set of units of all numbers."""

    length: str
    mass: str
    time: str


@dataclass(frozen=True, slots=True)
class ChainShape:
    """Parameters of a uniform chain, whose modes are known (eq. 10.60, 10.63)."""

    n: int
    mass: float
    stiffness: float


@dataclass(frozen=True, eq=False)
class System:
    """A structure with limiters.

    Parameters
    ----------
    M, K : SymmetricMatrix
        Mass and stiffness, shape (n, n). M is positive definite, apart from rows that are zero:
        such degrees of freedom must be held by springs, without limiters, loads and damping.
    constraints : sequence of Constraint
        The limiters; results refer to them by index.
    C : SymmetricMatrix, optional
        Damping.
    force : array, shape (n,), optional
        Constant load.
    units : Units, optional
        Units of the numbers; None: dimensionless.
    chain : ChainShape, optional
        Set by `presets.chain`: the natural modes are known in closed form.
    influence : array, shape (n,), optional
        Displacements by a unit displacement of the base.

    Attributes
    ----------
    flexibility : array, shape (constraint, constraint), optional
        In series with the stops (`flexibility`, set by `in_series`); other limiters have none.
    n : int
        Number of degrees of freedom.
    massless : array of int
        Degrees of freedom without mass, ascending.
    body : Body
        What it shares with systems that differ from it in their limiters only.

    Raises
    ------
    ModelError
        Naming the invalid field.
    """

    M: SymmetricMatrix
    K: SymmetricMatrix
    constraints: tuple[Constraint, ...]
    C: SymmetricMatrix | None = None
    force: Floats | None = None
    units: Units | None = None
    chain: ChainShape | None = None
    influence: Floats | None = None
    flexibility: Floats | None = field(init=False, default=None)
    n: int = field(init=False, repr=False)
    massless: Integers = field(init=False, repr=False)
    body: Body = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "constraints", tuple(self.constraints))
        object.__setattr__(self, "n", self.M.n)
        object.__setattr__(self, "body", Body(self.M))
        for name, matrix in (("K", self.K), ("C", self.C)):
            if matrix is not None and matrix.n != self.n:
                message = f"{name} has {matrix.n} rows, M has {self.n}"
                raise ModelError((name,), message, code="wrong_size")
        for name in ("force", "influence"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, self._of_dofs(name, getattr(self, name)))
        self._check_constraints()
        self._check_magnitudes()
        object.__setattr__(self, "massless", self._without_mass())
        self._check_massless()

    def _check_magnitudes(self) -> None:
        C = None if self.C is None else self.C.data
        parts = ("M", self.M.data), ("K", self.K.data), ("C", C), ("force", self.force)
        for name, numbers in ((name, given) for name, given in parts if given is not None):
            largest = float(np.abs(numbers).max(initial=0.0))
            if largest and not within_range(np.array([largest])):
                message = f"the largest entry is {largest!r}, not between {RANGE[0]} and {RANGE[1]}"
                raise ModelError((name,), message, code="out_of_range")
        masses = self.M.main_diagonal
        if self.chain is None and not within_range(masses[masses > 0.0]):
            message = f"a mass is not between {RANGE[0]} and {RANGE[1]}"
            raise ModelError(("M",), message, code="out_of_range")

    def _without_mass(self) -> Integers:
        """Return the degrees of freedom without mass; refuse other mass matrices than the class."""
        masses = self.M.main_diagonal
        massless = np.flatnonzero(masses == 0.0)
        if self.chain is not None or (not massless.size and self.M.is_positive_definite()):
            return massless
        rest = np.flatnonzero(masses)
        unclear = "the mass matrix is not positive definite"
        if not massless.size or (masses < 0.0).any():
            raise ModelError(("M",), unclear, code="not_positive_definite")
        if not rest.size:
            message = f"{unclear}: no degree of freedom has mass"
            raise ModelError(("M",), message, code="not_positive_definite")
        if self.M.block(massless).nnz:
            message = f"{unclear}: a degree of freedom without mass is coupled to others by mass"
            raise ModelError(("M",), message, code="not_positive_definite")
        if not self.M.part(rest).is_positive_definite():
            message = f"{unclear}, nor is what remains without its rows that are zero"
            raise ModelError(("M",), message, code="not_positive_definite")
        held = self.K.part(massless)
        part = max(_HELD, _ROUNDED * massless.size)
        held = held.plus(-part, SymmetricMatrix.diagonal(held.main_diagonal))
        if not held.is_positive_definite():
            message = (
                f"the degrees of freedom without mass ({listed(massless)}) are not held by "
                "springs: their part of the stiffness matrix is not positive definite, so that "
                "they do not follow the others"
            )
            raise ModelError(("K",), message, code="massless_not_held")
        return massless

    def _check_massless(self) -> None:
        """Refuse limiters, loads and damping of degrees of freedom without mass."""
        if not self.massless.size:
            return
        without = set(self.massless.tolist())
        for index, constraint in enumerate(self.constraints):
            both = [str(dof) for dof, _ in constraint.coordinate if dof in without]
            if both:
                message = (
                    f"dof {', '.join(both)} has no mass: an impact is not defined there, give the "
                    "stop a mass"
                )
                raise ModelError(("constraints", index), message, code="massless_constraint")
        if self.force is not None:
            self.check_load(self.force, ("force",))
        if self.C is not None and self.C.block(self.massless).nnz:
            message = (
                f"degrees of freedom without mass ({listed(self.massless)}) have damping: they "
                "would not follow the others statically; give them a mass, or no damping"
            )
            raise ModelError(("C",), message, code="massless_damping")

    def check_load(self, forces: Floats, pointer: tuple[str | int, ...]) -> None:
        """Refuse a load, shape (dof,), that acts where there is no mass."""
        loaded = self.massless[forces[self.massless] != 0.0]
        if loaded.size:
            message = (
                f"a load acts on dof {listed(loaded)}, without mass: put it on degrees of freedom "
                "with mass, as the static condensation distributes it"
            )
            raise ModelError(pointer, message, code="massless_load")

    def _with(self, **changes: object) -> System:
        """Return the same with other fields, none of which is checked again."""
        system = object.__new__(System)
        vars(system).update(vars(self), **changes)
        return system

    def limited(self, constraints: Sequence[Constraint]) -> System:
        """Return the same structure with other limiters; its matrices are not checked again."""
        system = self._with(constraints=tuple(constraints), flexibility=None)
        system._check_constraints()
        system._check_massless()
        return system

    def _of_dofs(self, field: str, given: Floats) -> Floats:
        """Return finite numbers, one for each degree of freedom, that nobody changes."""
        numbers = np.array(given, dtype=np.float64)
        if numbers.shape != (self.n,) or not np.isfinite(numbers).all():
            what = "the force" if field == "force" else "the influence of the base"
            message = f"{what} needs {self.n} finite numbers"
            raise ModelError((field,), message, code="wrong_size")
        numbers.setflags(write=False)
        return numbers

    def on_base(self, influence: Floats) -> System:
        """Return the structure on a base, whose unit displacement moves it so, shape (dof,)."""
        return self._with(influence=self._of_dofs("influence", influence))

    def damped(self, C: SymmetricMatrix) -> System:
        """Return the structure with another damping matrix; M and K are not checked again."""
        if C.n != self.n:
            raise ModelError(("C",), f"C has {C.n} rows, M has {self.n}", code="wrong_size")
        # What is kept beside a body may depend on its damping.
        system = self._with(C=C, body=Body(self.M))
        system._check_magnitudes()
        system._check_massless()
        return system

    def _check_constraints(self) -> None:
        seen: dict[Coordinate, int] = {}
        for index, constraint in enumerate(self.constraints):
            for dof in constraint.dofs:
                if not 0 <= dof < self.n:
                    field = ("dof",) if len(constraint.dofs) == 1 else ("direction", "dofs")
                    message = f"dof {dof} is none of 0 to {self.n - 1}: they count from 0"
                    pointer = ("constraints", index, *field)
                    raise ModelError(pointer, message, code="index_out_of_range")
            if (first := seen.setdefault(constraint.line, index)) != index:
                message = f"it limits the same coordinate as constraint {first}: give it both walls"
                raise ModelError(("constraints", index), message, code="duplicate_constraint")

    @property
    def coordinates(self) -> Coordinates:
        """The coordinates of all constraints, which do not depend on where walls are."""
        return tuple(constraint.coordinate for constraint in self.constraints)

    @property
    def solve_M(self) -> Solve:
        """The function that solves with M; without `massless`, see `condensation.solve_mass`."""
        return self.body.solve_M

    @property
    def loaded(self) -> bool:
        """Whether a constant load acts."""
        return self.force is not None and bool(self.force.any())

    def directions(self, active: Sequence[int]) -> Floats:
        """Return the rows w_a of some constraints, shape (constraint, dof)."""
        rows = np.zeros((len(active), self.n))
        for row, constraint in zip(rows, (self.constraints[a] for a in active), strict=True):
            row[list(constraint.dofs)] = constraint.weights
        return rows

    def losses(self, active: Sequence[int]) -> list[str]:
        """Return a sentence for each cause of energy loss, which motions without loss neglect."""
        why = "the motions have no energy loss"
        sentences = self.taken_as_elastic(active, why)
        if self.C is not None and self.C.data.any():
            sentences.insert(0, f"the damping C is neglected: {why}")
        return sentences

    def taken_as_elastic(self, active: Sequence[int], why: str) -> list[str]:
        """Return a sentence about the restitution of some constraints, none where it is 1."""
        lossy = [i for i in active if self.constraints[i].restitution < 1.0]
        if not lossy:
            return []
        text = f"constraint{'s' if len(lossy) > 1 else ''} {listed(np.array(lossy))}"
        return [f"the restitution of {text} is taken as 1: {why}"]
