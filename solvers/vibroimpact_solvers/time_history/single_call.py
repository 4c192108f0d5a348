"""Motions of a structure with uncoupled modes, each in a single call of a compiled function."""

from __future__ import annotations

import weakref
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.modal import handed_over
from vibroimpact_solvers.kernels.rigid_motion import Stop, follow
from vibroimpact_solvers.kernels.rigid_state import PROGRESS, Rows, workspace
from vibroimpact_solvers.results.time_history import Result
from vibroimpact_solvers.time_history import result_values
from vibroimpact_solvers.time_history.basis import COLUMNS
from vibroimpact_solvers.time_history.problem import Problem, State
from vibroimpact_solvers.time_history.run import budget, new_progress, new_table
from vibroimpact_solvers.time_history.structure import Structure

MOST: Final = 4
"""Output times up to which the history is filled in by the same call."""


_END, _REFUSED = int(Stop.END), int(Stop.REFUSED)
_COLUMNS: Final = {
    "impact_time": "time",
    "impact_condition": "deviation",
    "impact_velocity": "velocity",
    "impact_impulse": "impulse",
    "impact_constraint": "constraint",
    "impact_side": "side",
}
"""Fields of the result, and columns of the table of impacts."""


class Arrays:
    """What the compiled function writes to (`kernels.rigid_state.Motion`).

    Parameters
    ----------
    structure : Structure
    columns : int
        Number of deviations that are carried along for error estimates.
    """

    def __init__(self, structure: Structure, columns: int) -> None:
        pairs = structure.configuration().basis.pairs
        self.Z = np.empty((1 + columns, 2, pairs))
        self.progress: Rows = np.zeros(1, PROGRESS)
        self.table, self.samples = new_table(structure), np.empty((MOST, 2, pairs))
        self.work = workspace(pairs, len(structure.system.constraints))
        # Views that would take as long to make as a short motion: the numbers of the progress, and
        # the columns of the table.
        self.progress_bytes = self.progress.view(np.uint8)
        self.columns = tuple(self.table[name] for name in _COLUMNS.values())
        self.state = self.Z[0], self.Z[1:], self.progress, self.table


@dataclass(slots=True)
class Unfinished:
    """A motion that the compiled function stopped before its end.

    Parameters
    ----------
    stop : Stop
        Why it stopped.
    arrays : Arrays
        The arrays from which it can be continued.
    """

    stop: Stop
    arrays: Arrays


@dataclass(slots=True)
class _Shared:
    """What all motions of a structure share.

    Parameters
    ----------
    modal : tuple
        `kernels.modal.Modal`.
    arguments : tuple
        `kernels.rigid_state.Structure`.
    longest : float
        Of an expansion.
    expansions : int
        How many may pass in one call.
    free : dict
        Work arrays not in use by the number of deviations; threads take from and return to them.
    """

    modal: tuple[Any, ...]
    arguments: tuple[Any, ...]
    longest: float
    expansions: int
    free: dict[int, list[Arrays]] = field(default_factory=lambda: {0: [], COLUMNS: []})


_SHARED: weakref.WeakKeyDictionary[Structure, _Shared | None] = weakref.WeakKeyDictionary()


def _shared_by(structure: Structure) -> _Shared | None:
    """Return what motions of a structure share, None where its modes are coupled."""
    if structure not in _SHARED:
        _SHARED[structure] = _prepared(structure) if structure.configuration().basis.plain else None
    return _SHARED[structure]


def _prepared(structure: Structure) -> _Shared:
    configuration = structure.configuration()
    basis = configuration.basis
    return _Shared(
        handed_over(structure.modal), configuration.arguments, basis.longest, budget(basis)
    )


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
        begin = new_progress(problem.t_end * scale, shared.longest, shared.expansions)
        self._begin = begin.view(np.uint8)
        self._structure_arguments, self._modal = shared.arguments, shared.modal
        self._times, self._dofs = output_times * scale, problem.output_dofs
        dofs = self._dofs
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
            arrays = self._free.pop()
        except IndexError:
            arrays = Arrays(self._structure, self._columns)
        xs, vs = np.empty(self._history), np.empty(self._history)
        arrays.progress_bytes[:] = self._begin
        motion = (*arrays.state, self._times, arrays.samples)
        outcome = follow(
            self._structure_arguments, motion, arrays.work, self._modal, x, v,
            (self._dofs, xs, vs),
        )  # fmt: skip
        if outcome[0] == _END:
            result = self._result(outcome, xs, vs, arrays)
            self._free.append(arrays)
            return result
        if outcome[0] == _REFUSED:
            self._free.append(arrays)
            self._problem.check(initial)
            return None
        return Unfinished(Stop(outcome[0]), arrays)

    def _result(
        self,
        outcome: tuple[int, int, int, int, float, float],
        xs: Floats,
        vs: Floats,
        arrays: Arrays,
    ) -> Result:
        """Return the result of a motion that reached its end."""
        _, rows, grazings, expansions, penetration, growth = outcome
        values = self._bare.copy()
        if self._x:
            values["x"] = xs
        if self._v:
            values["v"] = vs
        if self._impacts:
            for name, column in zip(_COLUMNS, arrays.columns, strict=True):
                values[name] = column[:rows].copy()
        values["count_impacts"] = rows
        values["count_grazings"], values["count_expansions"] = grazings, expansions
        if not penetration < self._gap:
            result_values.checked_penetration(self._problem, penetration)
        values["error_penetration"] = penetration
        if self._estimate:
            times, deviations = (column[:rows] for column in arrays.columns[:2])
            result_values.set_condition(values, growth, times, deviations)
        return Result(**values)
