"""Records and views of a structure in the states of its stops, as kernels read them.

The stops of a structure are open, loaded or released; with the stops in given states it is a
*scene*: a linear structure with forms that are watched. Scenes differ in their numbers of pairs
and forms. Their numbers therefore stand one after the other in few arrays, and records say where.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.jit import inline, once, record
from vibroimpact_solvers.kernels.rigid_state import (
    Rows,
    Scratch,
    Structure,
    scratch_of,
    structure_of,
)

OPEN: Final = 0
LOADED: Final = 1
RELEASED: Final = 2
"""States of a stop; with the sign of its side where it is not open."""
STATES: Final = 5
"""How many states a stop has: the codes from -`RELEASED` to `RELEASED`."""
NOT_PREPARED: Final = -1
SAME_MODES: Final = -1
"""Where a scene is not prepared, and a passage to one with the same modes."""

SCENE: Final = record(
    [
        ("table", "i8"),  # its place in the numbers, as of `rigid_state.handed_over`
        ("rows", "i8"),
        ("pairs", "i8"),
        ("modes", "i8"),
        ("rotations", "i8"),
        ("hyperbolas_end", "i8"),
        ("damped", "i8"),
        ("growth", "f8"),
        ("columns", "i8"),  # of errors of frequencies and forms
        ("carrying", "i8"),  # rows of what loads carry
        ("still", "f8"),
        ("drift", "f8"),
        ("longest", "f8"),  # time of one expansion
        ("loads", "i8"),  # place in the integers
        ("load_count", "i8"),
        ("drives", "i8"),  # place in the drives
        ("drive_count", "i8"),
        ("walls", "i8"),  # place in the walls
        ("watched", "i8"),  # forms
        ("mixing", "i8"),  # place in the numbers of shares of other pairs; negative: none
    ]
)
"""A structure in given states of its stops."""

STOP: Final = record(
    [
        ("state", "i8"),  # a code
        ("force", "i8"),  # which of the watched forms its force is, if it is not open
        ("level", "f8"),  # its coordinate at the zero of the state
        ("indentation", "f8"),  # of a loaded stop, at the zero of the state
        ("still", "f8"),  # magnitude of what deflections under constant loads make of it
    ]
)
"""A stop in a scene; a row for each scene and stop."""

LAW: Final = record(
    [
        ("stiffness", "f8"),
        ("damping", "f8"),
        ("lower", "f8"),  # distances of its walls, infinite where there is none
        ("upper", "f8"),
    ]
)
"""The law of a stop, in the units of x."""

CHANGE: Final = record([("scene", "i8"), ("passage", "i8")])
"""Where a change of one stop's state leads to; for each scene, stop and new state."""

PASSAGE: Final = record(
    [
        ("matrix", "i8"),  # place in the numbers: (2 pair before, 2 pair after), transposed
        ("offset", "i8"),  # (2 pair after)
        ("terms", "i8"),  # (2 pair after): magnitudes of what the offset is the sum of
    ]
)
"""How states carry over from one scene to another: ``matrix z + offset``."""


class Scenes(NamedTuple):
    """All scenes that are prepared."""

    numbers: Floats
    integers: Integers
    scenes: Any  # (scene,), of `SCENE`
    stops: Any  # (scene, stop), of `STOP`
    laws: Any  # (stop,), of `LAW`
    changes: Any  # (scene, stop, `STATES`), of `CHANGE`
    passages: Any  # (passage,), of `PASSAGE`
    walls: Rows  # of `rigid_state.WALL`
    drives: Rows  # of `flow.DRIVE`
    scale: float  # times of the basis over those of x


@once
def scene_of(prepared: Scenes, place: int) -> Structure:
    """Return the structure of a scene."""
    scene, numbers = prepared.scenes[place], prepared.numbers
    table = numbers[scene.table : scene.table + scene.rows * scene.pairs]
    kinds = scene.rotations, scene.hyperbolas_end, scene.damped != 0, scene.growth
    sizes = scene.columns, scene.carrying, scene.still, scene.drift
    return structure_of((
        table.reshape(scene.rows, scene.pairs), kinds, sizes,
        prepared.integers[scene.loads : scene.loads + scene.load_count],
        prepared.drives[scene.drives : scene.drives + scene.drive_count],
        prepared.walls[scene.walls : scene.walls + scene.watched],
        numbers[:0].reshape(0, 0),
    ))  # fmt: skip


@once
def scratch_for(given: Any, watched: int, pairs: int, modes: int) -> Scratch:
    """Return the scratch of a scene from work arrays that are large enough for any."""
    room, marks, struck, piece = given
    count = marks.size // struck.size
    own = room, marks[: count * watched].reshape(count, watched), struck[:watched], piece
    return scratch_of(own, pairs, modes)


@inline
def wall_of(laws: Any, stop: int, side: int) -> float:
    """Return the distance of a wall from the zero of its coordinate."""
    return float(laws[stop].upper if side > 0 else laws[stop].lower)


@inline
def side_of(code: int) -> int:
    """Return the side of a stop that is not open."""
    return 1 if code > 0 else -1
