"""Time histories of a batch of motions: their states at the drive's phase 0, and their impacts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

import numpy as np

from vibroimpact_solvers import time_history
from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.attractors.problem import Problem
from vibroimpact_solvers.attractors.recurrence import recurrence, states_of
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
        At the drive's phase 0, from the end of `settle` on; fewer than those of the problem where
        it rests and returns to its states but for their rounding (`_returns`).
    impacts : Impacts
    rests : bool
        Whether it rests at a rigid wall for a while.
    contacts : dict
        The table of contacts with stops of finite stiffness, columns of `CONTACT`.
    """

    row: int
    x: Floats
    v: Floats
    impacts: Impacts
    rests: bool
    contacts: dict[str, Any] = field(default_factory=dict)

    @property
    def struck(self) -> bool:
        """Whether it strikes a stop, or is in contact with one."""
        return bool(self.impacts.time.size or len(self.contacts.get("start", ())))

    @property
    def periods(self) -> int:
        """For how many periods of the drive it is observed."""
        return len(self.x) - 1


Outcome = Observed | SolverError
_TURNS: Final = 3  # of the longest period that is looked for: how long states have to return
_ROUNDED: Final = 16.0  # of the rounding of their times, within which they do


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
    enough = partial(_returns, problem)
    for piece in time_history.solve_states(pattern, plan, x, v, report, enough):
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
                else _of_result(problem, start + row, outcome)
            )
    yield from ((start + row, outcomes[row]) for row in range(stop - start))


def _of_result(problem: Problem, row: int, result: time_history.Result) -> Observed:
    assert result.x is not None
    assert result.v is not None
    table = {name: getattr(result, name) for name in _COLUMNS}
    first, last = float(problem.sections[0]), len(result.x) - 1
    impacts = _impacts(table, first)
    if problem.stopped:
        return Observed(row, result.x, result.v, impacts, False, _contacts(result, first))
    if last < problem.observe:  # its window ends after its last state
        impacts = impacts.between(first, float(problem.sections[last]))
    return Observed(row, result.x, result.v, impacts, _rests(result, first))


def _rests(result: time_history.Result, since: float) -> bool:
    """Whether a motion rests at a wall after a time; contacts that go on have no end."""
    assert result.contact_stop is not None
    return bool((~(result.contact_stop <= since)).any())


def _returns(problem: Problem, result: time_history.Result) -> bool:
    """Whether a motion rests, and has returned to its states but for their rounding.

    It then does so for ever, as far as rounding tells: what follows would be the same. As it has
    returned for so long, nothing is left of a transient but one that a longer look would hardly
    show. Motions that do not rest are observed to the end, from which their exponents follow.
    """
    assert result.x is not None
    assert result.v is not None
    last = result.x.shape[0] - 1
    if last < _TURNS * problem.longest:
        return False
    since = float(problem.sections[last - problem.longest])
    if not _rests(result, since):
        return False
    late, close = slice(last - _TURNS * problem.longest, None), _ROUNDED * problem.rounding
    states, scale = states_of(problem, result.x[late], result.v[late])
    period, _ = recurrence(states / scale, problem.longest, close)
    return bool(period and np.abs(states[period:] - states[:-period]).max() <= close * scale)


CONTACT: Final = (
    "constraint", "side", "start", "stop", "velocity", "impulse", "peak_force", "indentation",
    "energy_lost",
)  # fmt: skip
"""Columns of contacts that are kept, as of time histories."""


def _contacts(result: time_history.Result, first: float) -> dict[str, Any]:
    """Return the contacts that last at a time or begin later."""
    assert result.contact_stop is not None
    late = result.contact_stop > first
    return {name: getattr(result, f"contact_{name}")[late] for name in CONTACT}


_COLUMNS: Final = tuple(
    f"impact_{name}" for name in ("time", "constraint", "side", "velocity", "impulse")
)


def _impacts(table: dict[str, Any], first: float) -> Impacts:
    time, constraint, side, velocity, impulse = (table[name] for name in _COLUMNS)
    return Impacts(time, constraint, side, velocity, np.abs(impulse)).between(first, np.inf)
