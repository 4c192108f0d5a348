"""A structure in each state of its stops: what is watched, and how states carry over.

A stop is open, loaded or released (`vibroimpact_solvers.laws`); with the modes of the loaded ones
(`modes`), the watched forms are the coordinates at their walls and the forces of the others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Final, cast

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels import rigid_state
from vibroimpact_solvers.kernels.flow import Z2, Watched
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.time_history.basis import Basis
from vibroimpact_solvers.time_history.stops.modes import Placed, StoppedModes
from vibroimpact_solvers.time_history.structure import Structure, errors_of

OPEN: Final = 0
LOADED: Final = 1
RELEASED: Final = 2
_ROOM: Final = 2**28  # bytes of the passages that are kept
_FEWEST: Final = 4  # of them, however large they are
"""States of a stop; with the sign of its side where it is not open."""
States = tuple[int, ...]


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
    arguments : tuple
        The same as kernels take it.
    rises : array, shape (watched,)
        What constant loads on free bodies add to the rates of the watched forms.
    pushed : bool
        Whether they add anything.
    sizes : array, shape (2, watched, 2 pair)
        Magnitudes of the watched forms and of their rates.
    """

    states: States
    placed: Placed
    forces: tuple[int, ...]
    kernel: rigid_state.Structure
    arguments: tuple[Any, ...]
    rises: Floats
    pushed: bool
    sizes: Floats

    def force_place(self, constraint: int) -> int:
        """Return where the force of a stop that is not open is watched."""
        return len(self.states) + self.forces.index(constraint)

    def workspace(self) -> tuple[Any, ...]:
        """Return new work arrays of kernels."""
        modes = self.basis.modes.roots.size
        return rigid_state.workspace(self.basis.pairs, self.kernel.walls.size, modes, 0)

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
    sizes: Floats = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "sizes", np.abs(self.matrix))

    def rounding(self, z: Floats) -> Floats:
        """Return the magnitudes of what a state that is carried over is the sum of."""
        return np.asarray(self.sizes @ np.abs(z) + self.terms)


class StoppedStructure(StoppedModes):
    """A structure with stops of finite stiffness, in the states that its motions reach.

    Parameters
    ----------
    structure : Structure
        The structure that no stop touches.
    """

    def __init__(self, structure: Structure) -> None:
        super().__init__(structure)
        self._scenes: dict[States, Scene] = {}
        self._passages: dict[tuple[States, States], Passage] = {}

    @classmethod
    def of(cls, structure: Structure) -> StoppedStructure:
        """Return what is kept beside a structure, or prepare it."""
        known = structure.beside.get(cls)
        if known is None:
            known = structure.beside[cls] = cls(structure)
        return cast("StoppedStructure", known)

    def scene(self, states: States) -> Scene:
        """Return the structure in a state of its stops."""
        known = self._scenes.get(states)
        if known is None:
            known = self._scenes[states] = self._scene(states)
        return known

    def _scene(self, states: States) -> Scene:
        loaded = tuple(
            (a, 1 if code > 0 else -1) for a, code in enumerate(states) if abs(code) == LOADED
        )
        placed, basis = self.placed(loaded), self.placed(loaded).basis
        forces = tuple(a for a, code in enumerate(states) if code != OPEN)
        moves, slides = basis.displacement(placed.rows), basis.velocity(placed.rows)
        kicks = basis.kick(placed.rows)
        count = len(states)
        walls = np.zeros(count + len(forces), rigid_state.WALL)
        walls["restitution"], walls["lower"], walls["upper"] = -1.0, np.inf, np.inf
        for a, code in enumerate(states):
            self._set_walls(walls[a : a + 1], a, code, placed.levels[a])
        form_rows, slope_rows = [*moves], [*slides]
        for place, a in enumerate(forces, start=count):
            form, wall = self._force(placed, a, states[a], moves[a], slides[a])
            form_rows.append(form)
            slope_rows.append(basis.rates_of(form))
            walls["size"][place] = abs(wall) + self.stiffness[a] * float(
                np.abs(placed.rows[a]) @ placed.terms
            )
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
        rises = forms[:, Z2] @ basis.push
        given = rigid_state.handed_over(kernel)
        sizes = np.abs([forms, slopes]).reshape(2, len(forms), -1)
        return Scene(states, placed, forces, kernel, given, rises, bool(rises.any()), sizes)

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

    def passage(self, before: Scene, after: Scene) -> Passage:
        """Return how states carry over from one scene to another, displacements unchanged."""
        key = before.states, after.states
        known = self._passages.get(key)
        if known is None:
            known = self._passage(before.placed, after.placed)
            if len(self._passages) >= max(_FEWEST, _ROOM // (4 * known.matrix.nbytes)):
                self._passages.clear()
            self._passages[key] = known
        return known

    def _passage(self, before: Placed, after: Placed) -> Passage:
        one, other = before.basis, after.basis
        if one is other:
            size = 2 * one.pairs
            return Passage(np.eye(size), np.zeros(size), np.zeros(size))
        turn = after.vectors.T @ before.vectors
        shift = turn @ one.still + after.vectors.T @ (before.origin - after.origin) - other.still

        def carried(z: Floats) -> Floats:
            q, rate = one.coordinates(z)
            return other.pairs_of(turn @ q + shift, turn @ rate, one.loads_of(z)).ravel()

        size = 2 * one.pairs
        offset = carried(np.zeros((2, one.pairs)))
        units = np.eye(size).reshape(size, 2, one.pairs)
        columns = np.empty((size, 2 * other.pairs))
        for row, unit in zip(columns, units, strict=True):
            look()
            row[:] = carried(unit) - offset
        terms = np.abs(turn) @ before.terms + after.terms
        terms += np.abs(after.vectors).T @ (np.abs(before.origin) + np.abs(after.origin))
        return Passage(np.ascontiguousarray(columns.T), offset, after.sizes_of(terms))

    def initial_states(self, y: Floats, rate: Floats) -> States:
        """Return the states of stops at coordinates and velocities, each shape (constraint,)."""
        return tuple(self._initial(a, float(y[a]), float(rate[a])) for a in range(y.size))

    def _initial(self, a: int, y: float, rate: float) -> int:
        for side in (1, -1) if self.acts(a) else ():
            indentation, speed = side * y - self.wall(a, side), side * rate
            if indentation > 0.0 or (indentation == 0.0 and speed > 0.0):
                force = self.stiffness[a] * indentation + self.damping[a] * speed
                return side * (LOADED if force >= 0.0 else RELEASED)
        return OPEN
