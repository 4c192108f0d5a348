"""The problem of natural frequencies: a structure, how many modes, what is held."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers import holding
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.checks import check_indices, check_outputs, check_tolerance
from vibroimpact_solvers.derivatives import Parameter, check_parameters
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.holding import ConstrainedStructure
from vibroimpact_solvers.model import RANGE, System

OUTPUTS: Final = ("Omega", "shape", "participation", "effective_mass", "residual_flexibility")
DEFAULT: Final = frozenset({"Omega", "shape", "participation"})
COUNT: Final = 10
"""Modes that are returned where nothing else is asked for."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Natural frequencies of a structure.

    Parameters
    ----------
    system : System
        Its damping, its loads and the gaps of its constraints have no effect.
    count : int, optional
        Number of modes, from the lowest; of a structure with fewer, all. Default: 10, or all up
        to `stop`.
    stop : float, optional
        Instead of `count`: the angular frequency up to which all modes are returned.
    fixed : tuple of int
        Indices of the constraints whose coordinates are held at zero.
    directions : array, shape (direction, dof), optional
        Displacements r of all degrees of freedom by unit motions of the base, for
        ``effective_mass``. Default: the influence of the system's base.
    outputs : frozenset of str
        The requested ones of `OUTPUTS`.
    tolerance : float, optional
        Largest relative error of the frequencies; the result tells which meet it.
    parameters : tuple of Parameter
        By which the outputs are differentiated.

    Raises
    ------
    ModelError
        Naming the invalid field.
    """

    system: System
    count: int | None = None
    stop: float | None = None
    fixed: tuple[int, ...] = ()
    directions: Floats | None = None
    outputs: frozenset[str] = DEFAULT
    tolerance: float | None = None
    parameters: tuple[Parameter, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "outputs", frozenset(self.outputs))
        if self.count is not None and self.stop is not None:
            message = "give either a count or a frequency at which to stop"
            raise ModelError(("count",), message, code="count_or_stop")
        if self.count is not None and self.count < 1:
            raise ModelError(("count",), f"{self.count} is below 1", code="out_of_range")
        if self.stop is not None and not (
            math.isfinite(self.stop) and RANGE[0] <= self.stop <= RANGE[1]
        ):
            message = f"{self.stop!r} is not between {RANGE[0]} and {RANGE[1]}"
            raise ModelError(("stop",), message, code="out_of_range")
        places = np.array(self.fixed, dtype=np.int64)
        check_indices("fixed", places, len(self.system.constraints))
        check_outputs(self.outputs, OUTPUTS)
        check_tolerance(self.tolerance)
        if self.parameters:
            check_parameters(self.parameters, self.system)
        self._check_directions()
        held = holding.hold(self.system, self.fixed) if self.fixed else None
        if self.fixed and held is None:
            message = "with these constraints held nothing is left that can move"
            raise ModelError(("fixed",), message, code="nothing_moves")
        object.__setattr__(self, "held", held)

    held: ConstrainedStructure | None = None
    """The structure without its held coordinates; None: none is held. Set by the checks."""

    def _check_directions(self) -> None:
        if self.directions is None and self.system.influence is not None:
            object.__setattr__(self, "directions", self.system.influence[np.newaxis])
        if self.directions is None:
            if "effective_mass" in self.outputs:
                message = (
                    "effective masses need the directions in which the base moves, or a system "
                    "with an influence"
                )
                raise ModelError(("directions",), message, code="missing_directions")
            return
        directions = np.array(self.directions, dtype=np.float64, ndmin=2)
        if directions.ndim != 2 or directions.shape[1] != self.system.n:
            message = f"each direction needs {self.system.n} numbers, one a degree of freedom"
            raise ModelError(("directions",), message, code="wrong_length")
        if not np.isfinite(directions).all():
            raise ModelError(("directions",), "a number is not finite", code="not_finite")
        directions.setflags(write=False)
        object.__setattr__(self, "directions", directions)

    @property
    def moving(self) -> System:
        """The structure whose modes are computed."""
        return self.system if self.held is None else self.held.system

    @property
    def modes(self) -> int:
        """Number of modes that the structure has."""
        return self.moving.n - self.moving.massless.size

    @property
    def most(self) -> int:
        """Largest number of modes that are returned."""
        if self.stop is not None:
            return self.modes
        return min(COUNT if self.count is None else self.count, self.modes)

    @property
    def neglected(self) -> list[str]:
        """Nothing: natural frequencies are defined without damping, loads and stops."""
        return []


def mode_count(problem: Problem) -> int:
    """Return the number of modes of a problem, at most where they are asked for up to a frequency.

    In sweeps it is the same at every point.
    """
    return problem.most
