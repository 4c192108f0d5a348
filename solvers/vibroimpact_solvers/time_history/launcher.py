"""Motions of one structure, each in one call of a compiled function with all that they share."""

from __future__ import annotations

import weakref
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.flight import Stop, workspace
from vibroimpact_solvers.kernels.launch import REFUSED, launch
from vibroimpact_solvers.time_history import answer
from vibroimpact_solvers.time_history.basis import COLUMNS
from vibroimpact_solvers.time_history.problem import Problem, State
from vibroimpact_solvers.time_history.result import Result
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
        self.arrays: tuple[Any, ...] = (
            self.Z, self.clock, self.counts, *self.table, self.samples, *own, self.numbers,
            self.places,
        )  # fmt: skip


@dataclass(slots=True)
class Launched:
    """A motion that the compiled function left before its end.

    Parameters
    ----------
    stop : Stop
        Why it was left.
    scratch : Scratch
        Where it can go on.
    """

    stop: Stop
    scratch: Scratch


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
        self._bare, self._gap = answer.bare_of_flights(problem), answer.least_gap(problem)
        outputs, self._estimate = problem.outputs, problem.estimate
        self._x, self._v, self._impacts = (name in outputs for name in ("x", "v", "impacts"))

    @classmethod
    def of(cls, structure: Structure, problem: Problem, wanted: Floats) -> Launcher | None:
        """Return what launches the motions of a problem, None where they take more than that."""
        if wanted.size > MOST or "energy" in problem.outputs:
            return None
        gear = _gear(structure)
        return None if gear is None else cls(structure, gear, problem, wanted)

    def fly(self, initial: State) -> Result | Launched | None:
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
        found = launch(x, v, xs, vs, *self._shared, *scratch.arrays)
        if found[0] == 0:
            result = self._result(found, xs, vs, scratch)
            self._free.append(scratch)
            return result
        if found[0] == REFUSED:
            self._free.append(scratch)
            self._problem.check(initial)
            return None
        return Launched(_STOPS[found[0]], scratch)

    def _result(
        self,
        flown: tuple[int, int, int, int, float, float],
        xs: Floats,
        vs: Floats,
        scratch: Scratch,
    ) -> Result:
        """Return what a motion that reached its end yields."""
        _, rows, grazings, expansions, penetration, growth = flown
        found = self._bare.copy()
        if self._x:
            found["x"] = xs
        if self._v:
            found["v"] = vs
        if self._impacts:
            numbers, places = scratch.numbers[:, :rows].copy(), scratch.places[:, :rows].copy()
            # To unpack an array ends in an error that is raised, worded and caught.
            found["impact_time"], found["impact_velocity"] = numbers[0], numbers[1]
            found["impact_impulse"], found["impact_condition"] = numbers[2], numbers[3]
            found["impact_constraint"], found["impact_side"] = places[0], places[1]
        found["count_impacts"] = rows
        found["count_grazings"], found["count_expansions"] = grazings, expansions
        if not penetration < self._gap:
            answer.told_apart(self._problem, penetration)
        found["error_penetration"] = penetration
        if self._estimate:
            times, condition = scratch.numbers[0, :rows], scratch.numbers[3, :rows]
            answer.fill_condition(found, growth, times, condition)
        return Result.of(found)
