"""Motions of a structure with uncoupled modes, each in a single call of a compiled function."""

from __future__ import annotations

import weakref
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.free_motion import Stop, workspace
from vibroimpact_solvers.kernels.whole_motion import REFUSED, whole_motion
from vibroimpact_solvers.results.time_history import Result
from vibroimpact_solvers.time_history import result_values
from vibroimpact_solvers.time_history.basis import COLUMNS
from vibroimpact_solvers.time_history.problem import Problem, State
from vibroimpact_solvers.time_history.run import CHATTER, Table, budget, new_table
from vibroimpact_solvers.time_history.structure import Structure

MOST: Final = 4
"""Output times up to which the history is filled in by the same call."""
_STOPS = tuple(Stop)


class Scratch:
    """What the compiled function writes to: arrays as of `kernels.whole_motion.whole_motion`.

    Parameters
    ----------
    structure : Structure
    columns : int
        Number of deviations that are carried along for error estimates.
    """

    def __init__(self, structure: Structure, columns: int) -> None:
        pairs = structure.configuration().basis.pairs
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
class Unfinished:
    """A motion that the compiled function stopped before its end.

    Parameters
    ----------
    stop : Stop
        Why it stopped.
    scratch : Scratch
        The arrays from which it can be continued.
    """

    stop: Stop
    scratch: Scratch


@dataclass(slots=True)
class _Shared:
    """Constant arrays that all motions of a structure share, and work arrays not in use.

    Parameters
    ----------
    before, after : tuple
        Arguments of `kernels.whole_motion.whole_motion` before and after the output dofs.
    longest, expansions : float
    free : dict
        Work arrays not in use by the number of deviations; threads take from and return to them.
    """

    before: tuple[Any, ...]
    after: tuple[Any, ...]
    longest: float
    expansions: float
    free: dict[int, list[Scratch]] = field(default_factory=lambda: {0: [], COLUMNS: []})


_SHARED: weakref.WeakKeyDictionary[Structure, _Shared | None] = weakref.WeakKeyDictionary()


def _shared_by(structure: Structure) -> _Shared | None:
    """Return the arrays that motions of a structure share, None where its modes are coupled."""
    if structure not in _SHARED:
        _SHARED[structure] = _prepared(structure) if structure.configuration().basis.plain else None
    return _SHARED[structure]


def _prepared(structure: Structure) -> _Shared:
    configuration = structure.configuration()
    basis, modes = configuration.basis, configuration.basis.modes
    before = (
        modes.weighted, basis.normal, basis.place, structure.W, structure.limits, modes.shapes,
    )  # fmt: skip
    after = (
        basis.rates, basis.split, configuration.forms, configuration.sizes, configuration.walls,
        configuration.mobility, basis.noise, basis.drifts, configuration.bends, basis.own,
    )  # fmt: skip
    return _Shared(before, after, basis.longest, float(budget(basis)))


class SingleCall:
    """Solves for motions of a structure with uncoupled modes, each in a single call.

    Parameters
    ----------
    structure : Structure
    shared : _Shared
    problem : Problem
    output_times : array, shape (time,)
        At most `MOST` of them.
    """

    def __init__(
        self, structure: Structure, shared: _Shared, problem: Problem, output_times: Floats
    ) -> None:
        self._structure, self._problem = structure, problem
        scale = structure.scale
        settings = np.array(
            [scale, problem.t_end * scale, shared.longest, CHATTER, shared.expansions]
        )
        dofs = problem.output_dofs
        self._shared = (settings, *shared.before, dofs, *shared.after, output_times * scale)
        self._columns = COLUMNS if problem.estimate else 0
        self._free = shared.free[self._columns]
        self._shape, self._history = (problem.system.n,), (output_times.size, dofs.size)
        self._bare, self._gap = (
            result_values.values_of_exact_motion(problem),
            result_values.narrowest_gap(problem),
        )
        outputs, self._estimate = problem.outputs, problem.estimate
        self._x, self._v, self._impacts = (name in outputs for name in ("x", "v", "impacts"))

    @classmethod
    def of(cls, structure: Structure, problem: Problem, output_times: Floats) -> SingleCall | None:
        """Return the solver for the motions of a problem, None where a single call cannot do it."""
        if output_times.size > MOST or "energy" in problem.outputs:
            return None
        shared = _shared_by(structure)
        return None if shared is None else cls(structure, shared, problem, output_times)

    def solve(self, initial: State) -> Result | Unfinished | None:
        """Compute a motion to its end, or until the compiled loop stops.

        None where the initial state is beyond a limit, though by a rounding only.
        """
        x, v = initial.x, initial.v
        if x.shape != self._shape or v.shape != self._shape:
            self._problem.check(initial)
        try:
            scratch = self._free.pop()
        except IndexError:
            scratch = Scratch(self._structure, self._columns)
        xs, vs = np.empty(self._history), np.empty(self._history)
        outcome = whole_motion(x, v, xs, vs, *self._shared, *scratch.arrays)
        if outcome[0] == 0:
            result = self._result(outcome, xs, vs, scratch)
            self._free.append(scratch)
            return result
        if outcome[0] == REFUSED:
            self._free.append(scratch)
            self._problem.check(initial)
            return None
        return Unfinished(_STOPS[outcome[0]], scratch)

    def _result(
        self,
        outcome: tuple[int, int, int, int, float, float],
        xs: Floats,
        vs: Floats,
        scratch: Scratch,
    ) -> Result:
        """Return the result of a motion that reached its end."""
        _, rows, grazings, expansions, penetration, growth = outcome
        values = self._bare.copy()
        if self._x:
            values["x"] = xs
        if self._v:
            values["v"] = vs
        if self._impacts:
            numbers, places = scratch.numbers[:, :rows].copy(), scratch.places[:, :rows].copy()
            # Unpacking an array would end in an IndexError raised and caught by the interpreter.
            values["impact_time"], values["impact_velocity"] = numbers[0], numbers[1]
            values["impact_impulse"], values["impact_condition"] = numbers[2], numbers[3]
            values["impact_constraint"], values["impact_side"] = places[0], places[1]
        values["count_impacts"] = rows
        values["count_grazings"], values["count_expansions"] = grazings, expansions
        if not penetration < self._gap:
            result_values.checked_penetration(self._problem, penetration)
        values["error_penetration"] = penetration
        if self._estimate:
            times, condition = scratch.numbers[0, :rows], scratch.numbers[3, :rows]
            result_values.set_condition(values, growth, times, condition)
        return Result(**values)
