"""A structure in one state of its stops, and how states carry over from one to another."""

from __future__ import annotations

from dataclasses import dataclass

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels import rigid_state
from vibroimpact_solvers.kernels.stopped_scenes import LOADED
from vibroimpact_solvers.time_history.basis import Basis
from vibroimpact_solvers.time_history.stops.modes import Placed

States = tuple[int, ...]
"""States of all stops: `OPEN`, or `LOADED` or `RELEASED` times the side."""


@dataclass(frozen=True, eq=False, slots=True)
class Scene:
    """The structure in one state of its stops.

    Parameters
    ----------
    states : tuple of int
        Of each constraint: `OPEN`, or `LOADED` or `RELEASED` times the side.
    placed : Placed
    forces : tuple of int
        The constraints whose forces are watched, after all coordinates.
    kernel : rigid_state.Structure
    """

    states: States
    placed: Placed
    forces: tuple[int, ...]
    kernel: rigid_state.Structure

    def force_place(self, constraint: int) -> int:
        """Return where the force of a stop that is not open is watched."""
        return len(self.states) + self.forces.index(constraint)

    @property
    def basis(self) -> Basis:
        """The pairs of its states."""
        return self.placed.basis

    def force_form(self, constraint: int) -> tuple[Floats, float]:
        """Return the form of the force of a stop that is not open, and its level."""
        place = self.force_place(constraint)
        wall = self.kernel.walls[place]
        loaded = abs(self.states[constraint]) == LOADED
        level = float(wall["lower"] if loaded else -wall["upper"])
        return self.kernel.watched.coordinate[place], level


@dataclass(frozen=True, eq=False, slots=True)
class Passage:
    """How states carry over from one scene to another: ``matrix z + offset``, flattened.

    Parameters
    ----------
    matrix : array, shape (2 pair, 2 pair)
    offset : array, shape (2 pair,)
    terms : array, shape (2 pair,)
        Magnitudes of what the offset is the sum of.
    """

    matrix: Floats
    offset: Floats
    terms: Floats
