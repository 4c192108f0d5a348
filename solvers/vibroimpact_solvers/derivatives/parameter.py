"""A number of a problem, and how the problem changes with it to first order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.matrices import SymmetricMatrix
from vibroimpact_solvers.model import Coordinate, System

MOST: Final = 1000
"""Parameters of one request: each adds an axis to every output."""


@dataclass(frozen=True, eq=False, slots=True)
class MatrixRate:
    """Rate of change of a matrix: ``factor`` times itself, and ``entries`` besides."""

    factor: float = 0.0
    entries: SymmetricMatrix | None = None

    def __bool__(self) -> bool:
        """Whether the matrix changes."""
        return self.factor != 0.0 or self.entries is not None

    def whole(self, matrix: SymmetricMatrix) -> SymmetricMatrix:
        """Return the rate of a matrix as a matrix."""
        scaled = replace(matrix, data=self.factor * matrix.data)
        return scaled if self.entries is None else scaled.plus(1.0, self.entries)


@dataclass(frozen=True, eq=False, slots=True)
class StopRate:
    """Rates of change of one stop."""

    constraint: int
    lower: float = 0.0  # of the distance to the lower wall
    upper: float = 0.0  # of the distance to the upper wall
    restitution: float = 0.0
    weights: Coordinate = ()  # of the weights of its coordinate, by degree of freedom


@dataclass(frozen=True, slots=True)
class LoadRate:
    """Rate of change of a load on one degree of freedom.

    ``(steady_cosine + t cosine) cos(frequency t) - (steady_sine + t sine) sin(frequency t)``.
    """

    dof: int
    frequency: float
    steady_cosine: float = 0.0
    steady_sine: float = 0.0
    cosine: float = 0.0  # of what grows with time
    sine: float = 0.0


@dataclass(frozen=True, eq=False, slots=True)
class Parameter:
    """One number of a problem, and the rates of change of what depends on it.

    Parameters
    ----------
    path : str
        Its name in results: the path of the number in the request.
    unit : str
        Its unit, as a product of powers of length, mass and time.
    M, K, C : MatrixRate
        Rates of the matrices.
    force : array, shape (dof,), optional
        Rate of the constant load.
    stops : tuple of StopRate
        Rates of the stops that change.
    frequency : float or array, shape (frequency,)
        Rate of the fundamental frequencies Omega.
    loads : tuple of LoadRate
        Rates of the loads that vary with time.
    x, v : array, shape (dof,), optional
        Rates of the displacements and velocities from which a motion starts.
    """

    path: str
    unit: str = "1"
    M: MatrixRate = MatrixRate()
    K: MatrixRate = MatrixRate()
    C: MatrixRate = MatrixRate()
    force: Floats | None = None
    stops: tuple[StopRate, ...] = ()
    frequency: float | Floats = 0.0
    loads: tuple[LoadRate, ...] = ()
    x: Floats | None = None
    v: Floats | None = None

    @property
    def structural(self) -> bool:
        """Whether mass or stiffness change."""
        return bool(self.M) or bool(self.K)

    def at(self, frequencies: slice) -> Parameter:
        """Return the same at some of the frequencies."""
        if np.ndim(self.frequency) == 0:
            return self
        return replace(self, frequency=np.asarray(self.frequency)[frequencies])

    def directions(self, n: int, active: Sequence[int]) -> Floats:
        """Return the rates of the rows ``w_a`` of some constraints, shape (constraint, dof)."""
        rows = np.zeros((len(active), n))
        places = {index: place for place, index in enumerate(active)}
        for stop in self.stops:
            if stop.constraint in places:
                for dof, rate in stop.weights:
                    rows[places[stop.constraint], dof] += rate
        return rows

    def walls(self, active: Sequence[int]) -> tuple[Floats, Floats]:
        """Return the rates of the distances of lower and upper walls, each (constraint,)."""
        lower, upper = np.zeros((2, len(active)))
        places = {index: place for place, index in enumerate(active)}
        for stop in self.stops:
            if stop.constraint in places:
                lower[places[stop.constraint]] += stop.lower
                upper[places[stop.constraint]] += stop.upper
        return lower, upper


def named(parameters: Sequence[Parameter]) -> dict[str, list[str]]:
    """Return what results call their parameters, by the names of the fields."""
    return {
        "parameter": [each.path for each in parameters],
        "parameter_unit": [each.unit for each in parameters],
    }


def check_parameters(parameters: Sequence[Parameter], system: System) -> None:
    """Raise `ModelError` where parameters do not fit a structure."""
    if len(parameters) > MOST:
        message = f"{len(parameters)} parameters are more than {MOST}"
        raise ModelError(("derivatives",), message, code="too_many_parameters")
    seen: dict[str, int] = {}
    for place, parameter in enumerate(parameters):
        if seen.setdefault(parameter.path, place) != place:
            message = f"it is the same as number {seen[parameter.path]}"
            raise ModelError(("derivatives", place), message, code="duplicate_path")
        changed = parameter.M.entries
        if changed is not None and changed.block(system.massless).nnz:
            message = "degrees of freedom without mass stay without: there is no derivative"
            raise ModelError(("derivatives", place), message, code="massless")
