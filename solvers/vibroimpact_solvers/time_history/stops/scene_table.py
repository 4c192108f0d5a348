"""Prepared scenes of a structure with stops, in the arrays that the compiled loop reads.

Scenes are prepared when a motion gets there first, and kept for all motions of the structure.
Threads share them: what is added never changes what is there, arrays that are too small are
replaced all together, and the loop is told of a scene by the last number that is written.
"""

from __future__ import annotations

from threading import Lock
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels import rigid_state
from vibroimpact_solvers.kernels.flow import DRIVE
from vibroimpact_solvers.kernels.rigid_state import WALL
from vibroimpact_solvers.kernels.stopped_scenes import (
    CHANGE,
    LAW,
    LOADED,
    NOT_PREPARED,
    OPEN,
    PASSAGE,
    RELEASED,
    SAME_MODES,
    SCENE,
    STATES,
    STOP,
    Scenes,
)
from vibroimpact_solvers.meter import hold
from vibroimpact_solvers.time_history.stops.modes import Placed
from vibroimpact_solvers.time_history.stops.scenes import Passage, Scene, States

ROOM: Final = 2**28
"""Bytes from which on a structure begins another table."""
_SLIGHTEST: Final = 1e-25
"""Growth by which a mode gains no rounding in 1e9 units of time: damping that is a rounding."""
_NUMBERS: Final = 2**13
_ROWS: Final = 8


class Preparing(Protocol):
    """What prepares scenes: a structure with stops of finite stiffness."""

    stiffness: Floats
    damping: Floats
    walls: Floats
    rows: Floats
    scale: float

    def scene(self, states: States) -> Scene:
        """Return the structure in a state of its stops."""

    def passage(self, before: Placed, after: Placed) -> Passage:
        """Return how states carry over from one basis to another."""


class SceneTable:
    """Scenes of a structure, and how motions get from one to another.

    Parameters
    ----------
    structure : Preparing

    Attributes
    ----------
    scenes : list of Scene
        By their places.
    arrays : tuple
        `kernels.stopped_scenes.Scenes`.
    most_pairs, most_watched, most_modes : int
        The largest numbers of all scenes.
    """

    def __init__(self, structure: Preparing) -> None:
        self._structure, self._lock = structure, Lock()
        count = structure.stiffness.size
        self.scenes: list[Scene] = []
        self._places: dict[States, int] = {}
        self._passages: dict[tuple[int, int], int] = {}
        self._laws = np.zeros(count, LAW)
        self._laws["stiffness"], self._laws["damping"] = structure.stiffness, structure.damping
        self._laws["lower"], self._laws["upper"] = structure.walls
        self._pools: dict[str, NDArray[Any]] = {
            "numbers": np.zeros(_NUMBERS),
            "integers": np.zeros(_ROWS, np.int64),
            "scenes": np.zeros(_ROWS, SCENE),
            "stops": np.zeros((_ROWS, count), STOP),
            "changes": _no_changes(_ROWS, count),
            "passages": np.zeros(_ROWS, PASSAGE),
            "walls": np.zeros(_ROWS, WALL),
            "drives": np.zeros(_ROWS, DRIVE),
        }
        self._used = dict.fromkeys(self._pools, 0)
        self.most_pairs = self.most_watched = self.most_modes = 0
        self.arrays = self._arrays()

    @property
    def full(self) -> bool:
        """Whether it is so large that motions should go on with another one."""
        return 8 * self._used["numbers"] > ROOM

    def place(self, states: States) -> int:
        """Return the place of a scene, prepared if it is not there."""
        with self._lock:
            return self._place(states)

    def prepare(self, place: int, stop: int, state: int) -> int:
        """Prepare the scene to which a stop's switching leads; return its place."""
        with self._lock:
            before = self.scenes[place]
            states = before.states
            after = self._place((*states[:stop], state, *states[stop + 1 :]))
            row = self._pools["changes"]
            passage = self._passage(before.placed, self.scenes[after].placed)
            row = self._pools["changes"][place, stop, state + RELEASED]
            row["passage"] = passage
            row["scene"] = after  # read first: what it leads to is complete
            return after

    def _place(self, states: States) -> int:
        known = self._places.get(states)
        if known is None:
            known = self._places[states] = self._add(self._structure.scene(states))
        return known

    def _passage(self, before: Placed, after: Placed) -> int:
        if before is after:
            return SAME_MODES
        key = id(before), id(after)  # both are kept by their scenes
        known = self._passages.get(key)
        if known is None:
            given = self._structure.passage(before, after)
            row = np.zeros(1, PASSAGE)
            row["matrix"] = self._append("numbers", given.matrix.T.ravel())
            row["offset"] = self._append("numbers", given.offset)
            row["terms"] = self._append("numbers", given.terms)
            known = self._passages[key] = self._append("passages", row)
        return known

    def _add(self, scene: Scene) -> int:
        """Add a scene to the arrays; return its place."""
        basis = scene.basis
        given = rigid_state.handed_over(scene.kernel)
        table, kinds, sizes, loads, drives, walls, _ = given
        row = np.zeros(1, SCENE)
        row["table"], row["rows"] = self._append("numbers", table.ravel()), len(table)
        row["pairs"], row["modes"] = basis.pairs, basis.modes.roots.size
        row["rotations"], row["hyperbolas_end"], row["damped"], row["growth"] = kinds
        row["growth"] *= row["growth"] > _SLIGHTEST
        row["columns"], row["carrying"], row["still"], row["drift"] = sizes
        row["longest"] = basis.longest
        row["loads"], row["load_count"] = self._append("integers", loads), loads.size
        row["drives"], row["drive_count"] = self._append("drives", drives), drives.size
        row["walls"], row["watched"] = self._append("walls", walls), walls.size
        mixing = scene.placed.mixing
        row["mixing"] = -1 if mixing is None else self._append("numbers", mixing.ravel())
        self._append("stops", self._stops(scene)[np.newaxis])
        self._append("changes", _no_changes(1, len(self._laws)))
        place = self._append("scenes", row)
        self.scenes.append(scene)
        self.most_pairs = max(self.most_pairs, basis.pairs)
        self.most_watched = max(self.most_watched, walls.size)
        self.most_modes = max(self.most_modes, basis.modes.roots.size)
        return place

    def _stops(self, scene: Scene) -> NDArray[np.void]:
        """Return the rows of the stops of a scene."""
        placed, stops = scene.placed, np.zeros(len(self._laws), STOP)
        stops["state"], stops["force"] = scene.states, -1
        for a, code in enumerate(scene.states):
            if code != OPEN:
                stops["force"][a] = scene.force_place(a)
        stops["level"] = placed.levels
        loaded = np.abs(scene.states) == LOADED
        stops["indentation"] = np.where(loaded, placed.indentations, 0.0)
        stops["still"] = np.abs(placed.rows) @ placed.terms + placed.course.sizes
        return stops

    def _append(self, name: str, values: NDArray[Any]) -> int:
        """Append to a pool; return where that begins."""
        first, last = self._used[name], self._used[name] + len(values)
        if last > len(self._pools[name]):
            # All are replaced: a loop that reads the former ones finds them as they were.
            for each, pool in self._pools.items():
                size = max(2 * len(pool), last) if each == name else len(pool)
                grown = np.zeros((size, *pool.shape[1:]), pool.dtype)
                grown[: self._used[each]] = pool[: self._used[each]]
                self._pools[each] = grown
            hold(self._pools[name].nbytes // 2)
            self.arrays = self._arrays()
        self._pools[name][first:last] = values
        self._used[name] = last
        return first

    def _arrays(self) -> tuple[Any, ...]:
        pools = self._pools
        return Scenes(
            pools["numbers"], pools["integers"], pools["scenes"], pools["stops"], self._laws,
            pools["changes"], pools["passages"], pools["walls"], pools["drives"],
            self._structure.scale,
        )[:]  # fmt: skip


def _no_changes(scenes: int, stops: int) -> NDArray[np.void]:
    changes = np.zeros((scenes, stops, STATES), CHANGE)
    changes["scene"] = NOT_PREPARED
    return changes
