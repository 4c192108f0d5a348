"""Time histories of a batch of motions: their states at the drive's phase 0, and their impacts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from vibroimpact_solvers import time_history
from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.attractors.problem import Problem
from vibroimpact_solvers.errors import SolverError, attempt
from vibroimpact_solvers.plan import Plan


@dataclass(frozen=True, eq=False, slots=True)
class Impacts:
    """Impacts of one motion while it is observed, in their order.

    Parameters
    ----------
    time, velocity, momentum : array, shape (impact,)
        velocity of the coordinate before the impact; momentum is not negative.
    constraint, side : array of int, shape (impact,)
    """

    time: Floats
    constraint: Integers
    side: Integers
    velocity: Floats
    momentum: Floats

    def between(self, start: float, stop: float) -> Impacts:
        """Return those at times from start to before stop."""
        kept = (self.time >= start) & (self.time < stop)
        names = Impacts.__dataclass_fields__
        return Impacts(*(getattr(self, name)[kept] for name in names))


@dataclass(frozen=True, eq=False, slots=True)
class Observed:
    """One motion while it is observed.

    Parameters
    ----------
    row : int
        Of its initial state.
    x, v : array, shape (section, dof)
        At the drive's phase 0, from the end of `settle` on.
    impacts : Impacts
    rests : bool
        Whether it rests at a wall for a while.
    """

    row: int
    x: Floats
    v: Floats
    impacts: Impacts
    rests: bool


Outcome = Observed | SolverError


def observe(
    problem: Problem, plan: Plan, start: int, stop: int, report: Callable[[], None]
) -> Iterator[tuple[int, Outcome]]:
    """Yield motions from some of the initial states, or why there is none, in their order.

    plan is the one of the time histories.
    """
    if not problem.start.inside:  # and no other initial state is inside the limits
        for row in range(start, stop):
            report()
            yield row, attempt(problem.motion, row)
        return
    pattern = problem.pattern
    x, v = problem.x[start:stop], problem.v[start:stop]
    first = float(problem.sections[0])
    outcomes: dict[int, Outcome] = {}
    for piece in time_history.solve_states(pattern, plan, x, v, report):
        counts = piece.arrays.get("impact_count", ())
        begin = 0
        for place, row in enumerate(piece.places.tolist()):
            rows = slice(begin, begin + int(counts[place]))
            begin = rows.stop
            table = {name: piece.arrays[name][rows] for name in _COLUMNS}
            # Motions that rest at walls are not among those that the loop follows to the end.
            outcomes[row] = Observed(
                # Copies: a motion that is kept does not keep all others of the piece.
                start + row, piece.arrays["x"][place].copy(), piece.arrays["v"][place].copy(),
                _impacts(table, first), rests=False,
            )  # fmt: skip
        for row, outcome in piece.others.items():
            outcomes[row] = (
                outcome
                if isinstance(outcome, SolverError)
                else _of_result(start + row, outcome, first)
            )
    yield from ((start + row, outcomes[row]) for row in range(stop - start))


def _of_result(row: int, result: time_history.Result, first: float) -> Observed:
    assert result.x is not None
    assert result.v is not None
    assert result.contact_stop is not None
    rests = bool((result.contact_stop > first).any())
    table = {name: getattr(result, name) for name in _COLUMNS}
    return Observed(row, result.x, result.v, _impacts(table, first), rests)


_COLUMNS: Final = tuple(
    f"impact_{name}" for name in ("time", "constraint", "side", "velocity", "impulse")
)


def _impacts(table: dict[str, Any], first: float) -> Impacts:
    time, constraint, side, velocity, impulse = (table[name] for name in _COLUMNS)
    return Impacts(time, constraint, side, velocity, np.abs(impulse)).between(first, np.inf)
