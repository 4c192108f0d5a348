"""Results of motions with stops of finite stiffness from different initial states."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.results.time_history import Result
from vibroimpact_solvers.time_history.basis import COLUMNS
from vibroimpact_solvers.time_history.contact_errors import masked
from vibroimpact_solvers.time_history.history import conserves, relative_drift
from vibroimpact_solvers.time_history.problem import Problem, State
from vibroimpact_solvers.time_history.result_values import UNKNOWN, default_values
from vibroimpact_solvers.time_history.run import Tick
from vibroimpact_solvers.time_history.stops.configurations import StoppedStructure
from vibroimpact_solvers.time_history.stops.motion import StoppedMotion
from vibroimpact_solvers.time_history.stops.samples import Samples
from vibroimpact_solvers.time_history.structure import Structure

_STATEMENT: Final = (
    "estimate: roundings of the initial state, the motion, the modes with and without loaded stops "
    "and of the passage from one to the other, carried along by the linearised motion, six times "
    "the largest of five samples of each pair of modes, absolute and infinite from "
    "predictable_until on in each output; while no stop switches the motion is exact, and no "
    "contact is missed; impulses, largest forces, indentations and losses are those of "
    "polynomials whose remainder is bounded"
)
_SIZES: Final = 8  # kinds of arrays that are kept for other motions
_COLUMNS: Final = (
    "start", "stop", "velocity", "impulse", "peak_force", "indentation", "energy_lost",
)  # fmt: skip
_AT_START: Final = ("start", "velocity")  # what the end of a contact does not change


class StoppedMotions:
    """Solver for the motions of one structure with stops of finite stiffness.

    Parameters
    ----------
    structure : Structure
    problem : Problem
    """

    def __init__(self, structure: Structure, problem: Problem) -> None:
        self._structure, self._problem = StoppedStructure.of(structure), problem
        self._size = COLUMNS if problem.estimate else 0, problem.history_times.size

    def _taken(self) -> StoppedMotion:
        """Return the arrays of a motion that has ended, or new ones; threads share them."""
        free = self._structure.free
        if len(free) > _SIZES:
            free.clear()
        try:
            known: StoppedMotion = free.setdefault(self._size, []).pop()
        except IndexError:
            return StoppedMotion(self._structure, *self._size)
        return known

    def solve(self, initial: State, tick: Tick | None = None) -> Result:
        """Compute a motion.

        Raises
        ------
        ModelError
            Where the initial state is not finite.
        ConvergenceError
            Where stops keep switching.
        """
        problem = self._problem
        if initial is not problem.initial:
            problem.check(initial)
        samples, motion = Samples(self._structure, problem), self._taken()
        motion.follow(problem, initial, samples, tick)
        values = default_values(problem) | samples.values
        values["error_statement"] = _STATEMENT if problem.estimate else UNKNOWN
        now = motion.progress[0]
        values["count_expansions"] = int(now["expansions"])
        known = float(now["known_until"]) if problem.estimate else math.nan
        if problem.estimate:
            values["error_condition"] = float(now["growth"])
            values["error_predictable_until"] = min(known, problem.t_end)
            if known < problem.t_end:
                late = problem.history_times > known
                for name in samples.values:
                    if name.startswith("error_"):
                        values[name][late] = math.inf
        else:
            values["error_condition"] = values["error_predictable_until"] = math.nan
        if "contacts" in problem.outputs:
            values |= self._contacts(motion, known)
        if "energy" in problem.outputs and conserves(problem):
            values["error_energy_drift"] = float(relative_drift(values["energy"][np.newaxis])[0])
        self._structure.free.setdefault(self._size, []).append(motion)
        return Result(**values)

    def _contacts(self, motion: StoppedMotion, known: float) -> dict[str, Any]:
        """Return the table of contacts, and its errors."""
        rows = motion.contacts
        table: dict[str, Any] = {f"contact_{name}": rows[name].copy() for name in _COLUMNS}
        table["contact_rest"] = table["contact_start"].copy()
        for name in ("constraint", "side"):
            table[f"contact_{name}"] = rows[name].copy()
        if self._problem.estimate:
            ends = table["contact_stop"]
            for name in _COLUMNS:
                at = table["contact_start"] if name in _AT_START else ends
                table[f"error_contact_{name}"] = masked(at, rows[f"error_{name}"].copy(), known)
            table["error_contact_rest"] = table["error_contact_start"].copy()
        return table
