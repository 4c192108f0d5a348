"""A structure in one state of its stops, and how states carry over from one to another."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels import rigid_state
from vibroimpact_solvers.kernels.stopped_scenes import LOADED
from vibroimpact_solvers.time_history.basis import Basis
from vibroimpact_solvers.time_history.stops.modes import Placed

States = tuple[int, ...]
"""States of all stops: `OPEN`, or `LOADED` or `RELEASED` times the side."""


@dataclass(frozen=True, eq=False, slots=True)
class HistoryForms:
    """What makes displacements, velocities and accelerations of some degrees of freedom of states.

    Parameters
    ----------
    values, sizes : array, shape (3 dof, 2 pair)
        The forms, and their magnitudes.
    offset, terms : array, shape (3 dof,)
        What is added to them, and the magnitudes of what it is the sum of.
    """

    values: Floats
    sizes: Floats
    offset: Floats
    terms: Floats


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
    _history: list[tuple[bytes, HistoryForms]] = field(default_factory=list, repr=False)

    def history_forms(self, dofs: Integers, scale: float) -> HistoryForms:
        """Return what makes histories of states; the last ones are kept."""
        key, known = dofs.tobytes(), self._history[:]  # threads may replace it
        if known and known[0][0] == key:
            return known[0][1]
        modes, basis = self.basis.modes, self.basis
        shapes, base = modes.shapes[dofs], modes.base[dofs]
        velocity = basis.velocity(shapes)
        bend = scale**2 * basis.rates_of(velocity)
        given = basis.displacement(shapes), scale * velocity, bend
        values = np.concatenate(given).reshape(3 * dofs.size, -1)
        offset, terms = np.zeros((2, 3, dofs.size))
        offset[0] = shapes @ basis.still + base
        terms[0] = np.abs(shapes) @ self.placed.terms + np.abs(base)
        offset[2] = scale**2 * (velocity[:, 1] @ basis.push)
        terms[2] = scale**2 * (np.abs(velocity[:, 1]) @ np.abs(basis.push))
        offset, terms = offset.ravel(), terms.ravel()
        forms = HistoryForms(values, np.abs(values), offset, terms)
        self._history[:] = [(key, forms)]
        return forms

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
