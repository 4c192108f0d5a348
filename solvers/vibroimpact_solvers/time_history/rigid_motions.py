"""Motions with rigid limiters from different initial states: one, or many in one call.

The compiled loop follows a motion from displacements and velocities to its end and writes its
history on the way; `run.Run` takes over where contacts begin.
"""

from __future__ import annotations

import math
import weakref
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.errors import SolverError, attempt
from vibroimpact_solvers.kernels.rigid_motion import Stop, follow
from vibroimpact_solvers.kernels.rigid_state import Rows
from vibroimpact_solvers.meter import hold
from vibroimpact_solvers.results.time_history import Result
from vibroimpact_solvers.time_history import accurate_start, result_values
from vibroimpact_solvers.time_history.basis import COLUMNS, Basis
from vibroimpact_solvers.time_history.derivatives import derived
from vibroimpact_solvers.time_history.history import History, new_history, some_of
from vibroimpact_solvers.time_history.problem import ImpactMode, Problem, State
from vibroimpact_solvers.time_history.run import Arrays, Run, Tick, new_progress
from vibroimpact_solvers.time_history.start import initial_state
from vibroimpact_solvers.time_history.stated_errors import StatedErrors
from vibroimpact_solvers.time_history.structure import Structure

_END, _TABLE, _PAUSE, _REFUSED = map(int, (Stop.END, Stop.TABLE, Stop.PAUSE, Stop.REFUSED))
_FREE: weakref.WeakKeyDictionary[Basis, dict[tuple[int, int], list[Arrays]]] = (
    weakref.WeakKeyDictionary()
)
"""Work arrays not in use, by the numbers of deviations and of output dofs; threads share them."""


@dataclass(frozen=True, eq=False, slots=True)
class Piece:
    """Motions from some of many initial states.

    Parameters
    ----------
    places : array of int
        The motions in `arrays`, by the places of their initial states.
    arrays : mapping
        As in `results.ensemble.Result`, of these motions.
    others : mapping
        Results of other motions, or their errors, by place.
    """

    places: Integers
    arrays: Mapping[str, Any]
    others: Mapping[int, Result | SolverError]


class RigidMotions:
    """Solver for the motions of one structure with rigid limiters.

    Parameters
    ----------
    structure : Structure
    problem : Problem
    """

    def __init__(self, structure: Structure, problem: Problem) -> None:
        self._structure, self._problem = structure, problem
        configuration = structure.configuration()
        self._arguments = configuration.arguments
        self._modal = structure.modal(configuration, problem.output_dofs)
        self._begin = new_progress(structure, problem, problem.t_end)
        self._begin_bytes = self._begin.view(np.uint8)
        self._times = problem.history_times * structure.scale
        self._size = COLUMNS if problem.estimate else 0, problem.output_dofs.size
        self._free = _FREE.setdefault(configuration.basis, {}).setdefault(self._size, [])
        self._every = StatedErrors(problem, structure)
        self._errors = self._every.of((configuration,))
        self._bare = result_values.values_of_exact_motion(problem)
        self._shape = (problem.system.n,)
        self._wide = structure.natural.is_wide

    def _taken(self) -> Arrays:
        try:
            return self._free.pop()
        except IndexError:
            return Arrays(self._structure, *self._size)

    def solve(self, initial: State | ImpactMode, tick: Tick | None = None) -> Result:
        """Compute a motion.

        Raises
        ------
        ModelError
            Where the initial state is not finite, or outside of the limits.
        """
        arrays, history = self._taken(), new_history(self._problem, 1)
        stop: int | None = _REFUSED
        arrays.progress_bytes[:] = self._begin_bytes
        if isinstance(initial, State) and self._wide:
            self._problem.check(initial)
            accurate_start.begin(self._structure, arrays, initial.x, initial.v)
            stop = None
        elif isinstance(initial, State) and not self._structure.ramps.count:
            x, v = initial.x, initial.v
            if x.shape != self._shape or v.shape != self._shape:
                self._problem.check(initial)
            stop, _ = follow(
                self._arguments, (*arrays.state, self._times), arrays.work, self._modal,
                x[np.newaxis], v[np.newaxis], history,
            )  # fmt: skip
        if stop == _END:
            if tick is not None:
                tick(1000, 1000)
            progress = arrays.progress[0]
            impacts = arrays.table[: progress["rows"]]
            result = result_values.result_of(
                self._bare.copy(), self._problem, self._structure, progress, impacts, history,
                self._errors,
            )  # fmt: skip
            if self._problem.parameters:
                self._differentiate(result, impacts, progress, initial)
        else:
            result = self._continued(initial, arrays, history, stop, tick)
        self._free.append(arrays)
        return result

    def _continued(
        self,
        initial: State | ImpactMode,
        arrays: Arrays,
        history: History,
        stop: int | None,
        tick: Tick | None,
    ) -> Result:
        """Return the result of a motion that the loop stopped, or has not begun."""
        problem, structure, reason = self._problem, self._structure, None
        if stop == _REFUSED:  # though perhaps by a rounding only
            arrays.start(initial_state(problem, initial, structure))
        elif stop is not None:
            reason = Stop(stop)
        run = Run(structure, arrays, problem, history, tick)
        run.finish(reason)
        impacts, progress = run.all_impacts, run.progress_row
        result = result_values.result_of(
            self._bare.copy(), problem, structure, progress, impacts, history,
            self._every.of(run.used.values()), run.intervals,
        )  # fmt: skip
        if problem.parameters:
            rests = min((rest.start for rest in run.intervals), default=math.inf)
            self._differentiate(result, impacts, progress, initial, rests / structure.scale)
        return result

    def _differentiate(
        self,
        result: Result,
        impacts: Rows,
        progress: np.void,
        initial: State | ImpactMode,
        contact: float = math.inf,
    ) -> None:
        """Add the derivatives of a motion, the first contact of which begins at a time."""
        problem = self._problem
        until, largest = float(progress["known_until"]), np.array([progress["largest"]])
        errors = self._errors.impacts(
            impacts, np.array([impacts.size]), largest, np.array([until]),
            np.array([progress["penetration"]]),
        )["error_impact_time"]  # fmt: skip
        if initial is not problem.initial:
            problem = replace(problem, initial=initial)
        for name, value in derived(
            problem, self._structure, impacts, errors, contact, until, int(progress["grazings"]),
            self._every.reach(self._structure.configuration()),
        ).items():  # fmt: skip
            setattr(result, name, value)

    def solve_some(self, x: Floats, v: Floats, start: int, stop: int, tick: Tick) -> Piece:
        """Compute the motions from some of many initial states, each (motion, dof).

        `tick` is called now and then, and may raise to stop.
        """
        x, v, count = x[start:stop], v[start:stop], stop - start
        progress, history = np.repeat(self._begin, count), new_history(self._problem, count)
        tables, others = list[Rows](), dict[int, Result | SolverError]()
        arrays, place = self._taken(), 0
        if self._structure.ramps.count or self._wide:
            for place in range(count):
                tick(0, 1)
                others[place] = attempt(self.solve, State(x[place], v[place]), tick)
            place, tables = count, [arrays.table[:0]]
        while place < count:
            tick(0, 1)
            given = arrays.Z[0], arrays.Z[1:], progress[place:], arrays.table, self._times
            why, last = follow(
                self._arguments, given, arrays.work, self._modal, x[place:], v[place:],
                some_of(history, slice(place, None)),
            )  # fmt: skip
            last += place
            if why == _PAUSE:
                place = last
                continue
            now = progress[last]
            ended = int(now["rows" if why == _END else "first_row"])
            tables.append(arrays.table[:ended].copy())
            hold(tables[-1].nbytes)
            place = last + 1
            if why == _TABLE and ended > 0:
                progress[last], place = self._begin[0], last  # again, with an empty table
            elif why == _REFUSED:
                others[last] = attempt(self.solve, State(x[last], v[last]), tick)
            elif why != _END:
                arrays.progress[0] = now
                state, own = State(x[last], v[last]), some_of(history, slice(last, last + 1))
                others[last] = attempt(self._continued, state, arrays, own, why, tick)
        self._free.append(arrays)
        return self._piece(start, progress, history, np.concatenate(tables), others)

    def _piece(
        self,
        start: int,
        progress: Rows,
        history: History,
        impacts: Rows,
        others: dict[int, Result | SolverError],
    ) -> Piece:
        """Return the motions that reached their ends, and the others."""
        problem, structure = self._problem, self._structure
        ended = np.ones(progress.size, dtype=bool)
        ended[list(others)] = False
        wide = progress["penetration"] < structure.narrowest_gap
        for place in np.flatnonzero(ended & ~wide).tolist():
            penetration = float(progress["penetration"][place])
            others[place] = attempt(result_values.checked_penetration, problem, penetration)
        counts = progress["rows"] - progress["first_row"]
        impacts = impacts[np.repeat(wide[ended], counts[ended])]
        places = np.flatnonzero(ended & wide)
        arrays = result_values.arrays_of(
            self._bare, problem, progress[places], impacts, some_of(history, places), self._errors
        )
        return Piece(start + places, arrays, {start + i: other for i, other in others.items()})
