"""A structure with stops of finite stiffness, in the states that its motions reach.

A stop is open, loaded or released (`vibroimpact_solvers.laws`); with the modes of the loaded ones
(`modes`), the watched forms are the coordinates at their walls and the forces of the others.
"""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels import rigid_state
from vibroimpact_solvers.kernels.flow import Watched
from vibroimpact_solvers.kernels.stopped_scenes import LOADED, OPEN, RELEASED
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.time_history.stops.modes import Placed, StoppedModes
from vibroimpact_solvers.time_history.stops.scene_table import SceneTable
from vibroimpact_solvers.time_history.stops.scenes import Passage, Scene, States
from vibroimpact_solvers.time_history.structure import Structure, errors_of


class StoppedStructure(StoppedModes):
    """A structure with stops of finite stiffness, in the states that its motions reach.

    Parameters
    ----------
    structure : Structure
        The structure that no stop touches.

    Attributes
    ----------
    free : dict
        Arrays of motions that have ended, by the numbers of deviations and of output times.
    """

    def __init__(self, structure: Structure) -> None:
        super().__init__(structure)
        self._table = SceneTable(self)
        self.free: dict[tuple[int, int], list[Any]] = {}

    @property
    def table(self) -> SceneTable:
        """The scenes that are prepared; another table begins where one is full."""
        if self._table.full:
            self.forget()
            self._table = SceneTable(self)
        return self._table

    @classmethod
    def of(cls, structure: Structure) -> StoppedStructure:
        """Return what is kept beside a structure, or prepare it."""
        known = structure.beside.get(cls)
        if known is None:
            known = structure.beside[cls] = cls(structure)
        return cast("StoppedStructure", known)

    def scene(self, states: States) -> Scene:
        """Return the structure in a state of its stops."""
        loaded = tuple(
            (a, 1 if code > 0 else -1) for a, code in enumerate(states) if abs(code) == LOADED
        )
        placed, basis = self.placed(loaded), self.placed(loaded).basis
        forces = tuple(a for a, code in enumerate(states) if code != OPEN)
        moves, slides = basis.displacement(placed.rows), basis.velocity(placed.rows)
        if placed.course.moves:
            course = placed.course.form(basis)
            moves, slides = moves - course, slides - basis.rates_of(course)
        kicks = basis.kick(placed.rows)
        count = len(states)
        walls = np.zeros(count + len(forces), rigid_state.WALL)
        walls["restitution"], walls["lower"], walls["upper"] = -1.0, np.inf, np.inf
        for a, code in enumerate(states):
            self._set_walls(walls[a : a + 1], a, code, placed.levels[a])
        walls["size"][:count] += placed.course.sizes
        form_rows, slope_rows = [*moves], [*slides]
        for place, a in enumerate(forces, start=count):
            form, wall = self._force(placed, a, states[a], moves[a], slides[a])
            form_rows.append(form)
            slope_rows.append(basis.rates_of(form))
            still = np.abs(placed.rows[a]) @ placed.terms + placed.course.sizes[a]
            walls["size"][place] = abs(wall) + self.stiffness[a] * float(still)
            if abs(states[a]) == LOADED:
                walls["lower"][place] = wall
            else:
                walls["upper"][place] = -wall
                walls["size"][place] += self.stiffness[a] * abs(self.wall(a, states[a]))
        forms, slopes = np.array(form_rows), np.array(slope_rows)
        every = np.concatenate([kicks, np.zeros((len(forces), *kicks.shape[1:]))])
        high, size, low = (np.ascontiguousarray(part) for part in basis.weight(forms))
        watched = Watched(forms, slopes, every, basis.drift(every), size, high, low)
        kernel = rigid_state.Structure(
            basis.flow, watched, walls, np.zeros((walls.size, walls.size)),
            errors_of(basis, watched),
        )  # fmt: skip
        return Scene(states, placed, forces, kernel)

    def _set_walls(self, wall: rigid_state.Rows, a: int, code: int, level: float) -> None:
        """Set what a coordinate must not pass in a state of its stop."""
        lower, upper = self.walls[0, a], self.walls[1, a]
        if abs(code) == LOADED or not self.acts(a):
            return  # its force is watched; or nothing is
        if code == RELEASED:
            lower, upper = -upper, math.inf
        elif code == -RELEASED:
            lower, upper = math.inf, -lower
        wall["lower"], wall["upper"] = lower + level, upper - level
        finite = [abs(d) for d in (lower, upper) if math.isfinite(d)]
        wall["size"] = max(finite, default=0.0) + abs(level)

    def _force(
        self, placed: Placed, a: int, code: int, moves: Floats, slides: Floats
    ) -> tuple[Floats, float]:
        """Return the form ``k d + c d'`` of a stop's force and its value at the zero of states."""
        side = 1 if code > 0 else -1
        k, c = self.stiffness[a], self.damping[a]
        form = side * (k * moves + (c * self.scale) * slides)
        if abs(code) == LOADED:
            return form, float(k * placed.indentations[a])
        return form, float(k * (side * placed.levels[a] - self.wall(a, side)))

    # -- from scene to scene --

    def passage(self, before: Placed, after: Placed) -> Passage:
        """Return how states carry over from one basis to another, displacements unchanged."""
        one, other = before.basis, after.basis
        turn = after.vectors.T @ before.vectors
        shift = turn @ one.still + after.vectors.T @ (before.origin - after.origin) - other.still

        def carried(z: Floats, shift: Floats | float, loads: Floats) -> Floats:
            q, rate = one.coordinates(z)
            return other.pairs_of(turn @ q + shift, turn @ rate, loads).ravel()

        size = 2 * one.pairs
        none = np.zeros((2, one.pairs))
        constant = one.loads_of(none)
        offset = carried(none, shift, constant)
        units = np.eye(size).reshape(size, 2, one.pairs)
        columns = np.empty((size, 2 * other.pairs))
        for row, unit in zip(columns, units, strict=True):
            look()
            # Not as a difference from the offset, which may be larger by any number of digits.
            row[:] = carried(unit, 0.0, one.loads_of(unit) - constant)
        terms = np.abs(turn) @ before.terms + after.terms
        terms += np.abs(after.vectors).T @ (np.abs(before.origin) + np.abs(after.origin))
        return Passage(np.ascontiguousarray(columns.T), offset, after.sizes_of(terms))

    def initial_states(self, y: Floats, rate: Floats) -> States:
        """Return the states of stops at coordinates and velocities, each shape (constraint,).

        With a residual flexibility the loaded ones displace the coordinates of all.
        """
        if self.series.flexibility is not None:
            lower, upper = self.walls
            loaded = self.series.loaded_at(np.stack([-y - lower, y - upper]))
            shares = self.series.shares([a for a, _ in loaded])
            if shares is not None:
                at = np.array([side * self.wall(a, side) for a, side in loaded])
                which = [a for a, _ in loaded]
                beyond, rates = y[which] - at, rate[which]
                y, rate = y + shares @ beyond, rate + shares @ rates
                y[which], rate[which] = at + (shares @ beyond)[which], (shares @ rates)[which]
        return tuple(self._initial(a, float(y[a]), float(rate[a])) for a in range(y.size))

    def _initial(self, a: int, y: float, rate: float) -> int:
        for side in (1, -1) if self.acts(a) else ():
            indentation, speed = side * y - self.wall(a, side), side * rate
            if indentation > 0.0 or (indentation == 0.0 and speed > 0.0):
                force = self.stiffness[a] * indentation + self.damping[a] * speed
                return side * (LOADED if force >= 0.0 else RELEASED)
        return OPEN
