"""Motions of one structure, each in one call of a compiled function with all that they share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.flight import Stop
from vibroimpact_solvers.kernels.launch import REFUSED, launch
from vibroimpact_solvers.time_history.basis import COLUMNS
from vibroimpact_solvers.time_history.problem import Problem, State
from vibroimpact_solvers.time_history.run import CHATTER, Table, budget, new_table
from vibroimpact_solvers.time_history.structure import Structure


@dataclass(slots=True)
class Launched:
    """A motion as the compiled function left it: arrays as of `kernels.flight.fly`.

    Parameters
    ----------
    stop : Stop
        Why it was left.
    Z, clock, counts, table, samples : array
    x, v : array, shape (time, dof)
        The history; filled in where the end was reached.
    """

    stop: Stop
    Z: Floats
    clock: Floats
    counts: Integers
    table: Table
    samples: Floats
    x: Floats
    v: Floats


class Launcher:
    """Launches motions of a structure whose modes move apart from one another.

    Parameters
    ----------
    structure : Structure
        Its free basis is plain.
    problem : Problem
    wanted : array, shape (time,)
        A few times at which the state is wanted.
    """

    def __init__(self, structure: Structure, problem: Problem, wanted: Floats) -> None:
        self._structure = structure
        scene, basis = structure.scene(), structure.scene().basis
        modes = basis.modes
        self._shared = (
            structure.scale, modes.weighted, basis.normal, basis.place, structure.W,
            structure.limits, modes.shapes, problem.wanted_dofs, basis.rates, basis.split,
            scene.forms, scene.sizes, scene.walls, scene.mobility, basis.noise, basis.drifts,
            scene.bends, basis.own, wanted * structure.scale,
        )  # fmt: skip
        self._size = (1 + (COLUMNS if problem.estimate else 0), 2, basis.pairs)
        self._clock, self._counts = np.zeros(8), np.zeros(11, dtype=np.int64)
        self._clock[2:5] = problem.t_end * structure.scale, basis.longest, CHATTER
        self._counts[3] = budget(basis)
        self._history = (wanted.size, problem.wanted_dofs.size)

    def fly(self, problem: Problem, initial: State) -> Launched:
        """Follow a motion to its end, or until the compiled loop leaves it."""
        if initial.x.shape != (self._structure.system.n,) or initial.v.shape != initial.x.shape:
            problem.check(initial)
        Z, clock, counts = np.zeros(self._size), self._clock.copy(), self._counts.copy()
        table = new_table(self._structure)
        samples = np.empty((max(1, self._history[0]), 2, self._size[2]))
        x, v = np.empty(self._history), np.empty(self._history)
        stop = launch(initial.x, initial.v, *self._shared, Z, clock, counts, *table, samples, x, v)
        if stop == REFUSED:
            problem.check(initial)
        return Launched(_STOPS[stop], Z, clock, counts, table, samples, x, v)


_STOPS = tuple(Stop)
