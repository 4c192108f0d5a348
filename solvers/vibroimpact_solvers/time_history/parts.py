"""The parts of a long motion, one for each window of time, and how they are joined."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import Floats, Integers, along, declared
from vibroimpact_solvers.plan import Plan
from vibroimpact_solvers.results.time_history import Result
from vibroimpact_solvers.time_history.history import conserves
from vibroimpact_solvers.time_history.problem import MOVED, STATES, Problem


@dataclass(frozen=True, eq=False)
class Part:
    """The result of one window, and the seed of the next one.

    A contact is listed in the window in which it begins; its end and impulse, in the window in
    which it ends.

    Parameters
    ----------
    x, v, energy, impact_time, …
        As in `Result`, of the window.
    late_row, late_stop, late_impulse : array, shape (late,)
        Contacts of earlier windows that end in this one, by their rows in the whole table.
    late_stop_error, late_impulse_error : array, shape (late,)
    seed_state : array, shape (1 + deviation, 2, pair)
    seed_progress : array, shape (number,)
        The numbers of `kernels.rigid_state.PROGRESS`.
    seed_open : array, shape (open, 6)
        Contacts that continue: constraint, side, row, time of rest, impulse so far and its error.
    contacts : int
        Rows of the whole table of contacts until the end of the window.
    """

    x: Floats | None
    v: Floats | None
    a: Floats | None
    energy: Floats | None
    error_x: Floats | None
    error_v: Floats | None
    error_a: Floats | None
    error_energy: Floats | None
    error_impact_time: Floats | None
    error_impact_velocity: Floats | None
    error_impact_impulse: Floats | None
    error_contact_start: Floats | None
    error_contact_rest: Floats | None
    error_contact_stop: Floats | None
    error_contact_impulse: Floats | None
    impact_time: Floats | None
    impact_constraint: Integers | None
    impact_side: Integers | None
    impact_velocity: Floats | None
    impact_impulse: Floats | None
    impact_condition: Floats | None
    impact_law: Integers | None
    contact_start: Floats | None
    contact_rest: Floats | None
    contact_stop: Floats | None
    contact_constraint: Integers | None
    contact_side: Integers | None
    contact_impulse: Floats | None
    late_row: Integers
    late_stop: Floats
    late_impulse: Floats
    late_stop_error: Floats
    late_impulse_error: Floats
    seed_state: Floats
    seed_progress: Floats
    seed_open: Floats
    contacts: int
    count_impacts: int
    count_grazings: int
    count_expansions: int
    error_condition: float
    error_penetration: float
    error_predictable_until: float
    error_tolerance: float
    error_statement: str


ROWS: Final = tuple(
    name
    for name in along(Result, "time", "impact", "contact")
    if name in {part.name for part in fields(Part)}
)
"""Arrays of the result whose rows the windows contribute."""

SCALARS: Final = tuple(
    name
    for name, field in declared(Result).items()
    if not field.array and name in {part.name for part in fields(Part)}
)
"""Numbers and texts of the result that windows have too."""


class Sink(Protocol):
    """Where the rows of windows go, one window after the other."""

    def append(self, name: str, rows: NDArray[Any]) -> None:
        """Take the next rows of an array."""

    def patch(self, name: str, row: int, value: float) -> None:
        """Replace a number of rows that were taken before."""


class Assembly:
    """Joins windows in their order, without keeping their arrays.

    Parameters
    ----------
    problem : Problem
    sink : Sink
    """

    def __init__(self, problem: Problem, sink: Sink) -> None:
        self._problem, self._sink = problem, sink
        self._scalars: dict[str, Any] = {}
        self._energy = (math.nan, 0.0, 0.0)

    def add(self, part: Part) -> None:
        """Take the next window."""
        for name in ROWS:
            rows = getattr(part, name)
            if rows is not None:
                self._sink.append(name, rows)
        if part.contact_stop is not None:
            for name in ("stop", "impulse"):
                late = getattr(part, f"late_{name}"), getattr(part, f"late_{name}_error")
                for row, value, error in zip(part.late_row.tolist(), *late, strict=True):
                    self._sink.patch(f"contact_{name}", row, float(value))
                    if part.error_contact_stop is not None:
                        self._sink.patch(f"error_contact_{name}", row, float(error))
        if part.energy is not None and part.energy.size:
            first, spread, size = self._energy
            first = float(part.energy[0]) if math.isnan(first) else first
            spread = max(spread, float(np.abs(part.energy - first).max()))
            self._energy = first, spread, max(size, float(np.abs(part.energy).max()))
        total, scalars = self._scalars, {name: getattr(part, name) for name in SCALARS}
        if total:
            scalars["count_impacts"] += total["count_impacts"]
            scalars["error_condition"] = max(scalars["error_condition"], total["error_condition"])
            until = "error_predictable_until"
            scalars[until] = min(scalars[until], total[until])
        self._scalars = scalars

    def plain(self) -> dict[str, Any]:
        """Return the fields of the result that are not arrays."""
        _, spread, size = self._energy
        drift = None
        if "energy" in self._problem.outputs and conserves(self._problem):
            drift = spread / size if size > 0.0 else 0.0
        return {
            **self._scalars,
            "error_energy_drift": drift,
            "error_difference": None,
            "error_digits": None,
        }

    def labels(self) -> dict[str, Any]:
        """Return the coordinates of the result."""
        outputs = self._problem.outputs
        timed, placed = outputs & STATES, outputs & {*MOVED}
        return {
            "t": self._problem.times if timed else None,
            "dof": self._problem.output_dofs if placed else None,
        }

    def result(self, arrays: dict[str, Any]) -> Result:
        """Return the result whose rows went to the sink."""
        absent: dict[str, Any] = dict.fromkeys(field.name for field in fields(Result))
        return Result(**absent | self.labels() | arrays | self.plain())


class RowLists:
    """A sink that keeps all rows in memory."""

    def __init__(self) -> None:
        self._pieces: dict[str, list[NDArray[Any]]] = {}

    def append(self, name: str, rows: NDArray[Any]) -> None:
        """Take the next rows of an array."""
        self._pieces.setdefault(name, []).append(np.array(rows))

    def patch(self, name: str, row: int, value: float) -> None:
        """Replace a number of rows that were taken before."""
        for piece in self._pieces[name]:
            if row < piece.size:
                piece[row] = value
                return
            row -= piece.size

    def joined(self) -> dict[str, NDArray[Any]]:
        """Return the arrays."""
        return {name: np.concatenate(pieces) for name, pieces in self._pieces.items()}


def join(problem: Problem, plan: Plan, results: Sequence[Any]) -> Result:
    """Join the results of the pieces."""
    if len(results) == 1 and isinstance(results[0], Result):
        return results[0]
    kept = RowLists()
    assembly = Assembly(problem, kept)
    for part in results:
        assembly.add(part)
    return assembly.result(kept.joined())
