"""Motions of one structure, each in one call of a compiled function with all that they share."""

from __future__ import annotations

import weakref
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.flight import Stop, workspace
from vibroimpact_solvers.kernels.launch import REFUSED, launch
from vibroimpact_solvers.time_history.basis import COLUMNS
from vibroimpact_solvers.time_history.problem import Problem, State
from vibroimpact_solvers.time_history.run import CHATTER, Table, budget, new_table
from vibroimpact_solvers.time_history.structure import Structure

MOST: Final = 4
"""Times of a history up to which it is filled in by the call that follows the motion."""
_STOPS = tuple(Stop)


class Scratch:
    """What the compiled function writes to: arrays as of `kernels.launch.launch`.

    Parameters
    ----------
    structure : Structure
    columns : int
        Deviations that go along.
    """

    def __init__(self, structure: Structure, columns: int) -> None:
        pairs = structure.scene().basis.pairs
        self.Z = np.empty((1 + columns, 2, pairs))
        self.clock, self.counts = np.empty(8), np.empty(11, dtype=np.int64)
        self.table: Table = new_table(structure)
        self.samples = np.empty((MOST, 2, pairs))
        rows = self.table[0].shape[0]
        self.numbers, self.places = np.empty((4, rows)), np.empty((2, rows), dtype=np.int64)
        own = workspace(pairs, len(structure.system.constraints))
        arrays = self.Z, self.clock, self.counts, *self.table, self.samples, *own
        self.arrays: tuple[Any, ...] = arrays


@dataclass(slots=True)
class Launched:
    """A motion as the compiled function left it.

    Parameters
    ----------
    stop : Stop
        Why it was left.
    rows, grazings, expansions : int
    penetration, growth : float
        As `kernels.launch.launch` returns them.
    x, v : array, shape (time, dof)
    numbers, places : array
        The history and the table of impacts; there where the end was reached.
    scratch : Scratch, optional
        Where it can go on; there where the end was not reached.
    """

    stop: Stop
    rows: int
    grazings: int
    expansions: int
    penetration: float
    growth: float
    x: Floats
    v: Floats
    numbers: Floats
    places: Integers
    scratch: Scratch | None


@dataclass(slots=True)
class _Gear:
    """What motions of one structure share: constant arrays, and scratch that is free.

    Parameters
    ----------
    before, after : tuple
        Arguments of `kernels.launch.launch` before and after the wanted dofs.
    longest, expansions : float
    free : dict
        By the number of deviations; lists that threads take from and add to.
    """

    before: tuple[Any, ...]
    after: tuple[Any, ...]
    longest: float
    expansions: float
    free: dict[int, list[Scratch]] = field(default_factory=lambda: {0: [], COLUMNS: []})


_GEARS: weakref.WeakKeyDictionary[Structure, _Gear | None] = weakref.WeakKeyDictionary()


def _gear(structure: Structure) -> _Gear | None:
    """Return what motions of a structure share, None where its modes do not move apart."""
    if structure not in _GEARS:
        _GEARS[structure] = _made(structure) if structure.scene().basis.plain else None
    return _GEARS[structure]


def _made(structure: Structure) -> _Gear:
    scene, basis, modes = structure.scene(), structure.scene().basis, structure.scene().basis.modes
    before = (
        modes.weighted, basis.normal, basis.place, structure.W, structure.limits, modes.shapes,
    )  # fmt: skip
    after = (
        basis.rates, basis.split, scene.forms, scene.sizes, scene.walls, scene.mobility,
        basis.noise, basis.drifts, scene.bends, basis.own,
    )  # fmt: skip
    return _Gear(before, after, basis.longest, float(budget(basis)))


class Launcher:
    """Launches motions of a structure whose modes move apart from one another.

    Parameters
    ----------
    structure : Structure
    problem : Problem
    wanted : array, shape (time,)
        At most `MOST` times at which the state is wanted.
    """

    def __init__(self, structure: Structure, gear: _Gear, problem: Problem, wanted: Floats) -> None:
        self._structure, self._problem = structure, problem
        scale = structure.scale
        settings = np.array([scale, problem.t_end * scale, gear.longest, CHATTER, gear.expansions])
        dofs = problem.wanted_dofs
        self._shared = (settings, *gear.before, dofs, *gear.after, wanted * scale)
        self._columns = COLUMNS if problem.estimate else 0
        self._free = gear.free[self._columns]
        self._shape, self._history = (problem.system.n,), (wanted.size, dofs.size)

    @classmethod
    def of(cls, structure: Structure, problem: Problem, wanted: Floats) -> Launcher | None:
        """Return what launches the motions of a problem, None where they take more than that."""
        if wanted.size > MOST or "energy" in problem.outputs:
            return None
        gear = _gear(structure)
        return None if gear is None else cls(structure, gear, problem, wanted)

    def fly(self, initial: State) -> Launched | None:
        """Follow a motion to its end, or until the compiled loop leaves it.

        None where the initial state was not accepted, though by a rounding only.
        """
        x, v = initial.x, initial.v
        if x.shape != self._shape or v.shape != self._shape:
            self._problem.check(initial)
        try:
            scratch = self._free.pop()
        except IndexError:
            scratch = Scratch(self._structure, self._columns)
        xs, vs = np.empty(self._history), np.empty(self._history)
        numbers, places = scratch.numbers, scratch.places
        arguments = (x, v, *self._shared, *scratch.arrays, xs, vs, numbers, places)
        stop, rows, grazings, expansions, penetration, growth = launch(*arguments)
        found = Launched(
            _STOPS[stop], rows, grazings, expansions, penetration, growth, xs, vs, numbers,
            places, scratch,
        )  # fmt: skip
        if stop == 0:
            found.numbers, found.places = numbers[:, :rows].copy(), places[:, :rows].copy()
            found.scratch = None
            self._free.append(scratch)
        elif stop == REFUSED:
            self._free.append(scratch)
            self._problem.check(initial)
            return None
        return found
