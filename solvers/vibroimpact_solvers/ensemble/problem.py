"""The problem: the motions of a structure from many initial states."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import InitVar, dataclass, field, fields, replace
from functools import cached_property
from typing import Any, Final

import numpy as np

from vibroimpact_solvers import time_history
from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.laws import require
from vibroimpact_solvers.model import System
from vibroimpact_solvers.time_history import Load, Power, State

KIND: Final = "ensemble"


@dataclass(frozen=True, eq=False)
class Problem:
    """Motions of a structure from many initial states, and their outputs.

    Parameters
    ----------
    system : System
    x, v : array, shape (member, dof)
        Displacements and velocities at t = 0.
    t_end, t, dofs, outputs, tolerance, load, limiter, method
        As in `time_history.Problem`, of every motion.
    first : int
        Index of the first member, where this is a piece of a larger ensemble.
    report : callable, optional
        Called while initial states are checked; may raise to end that.

    Raises
    ------
    ModelError
        Where something is wrong with all members; a member that starts outside of the limits
        has a status of its own in the result.
    """

    system: System
    x: Floats
    v: Floats
    t_end: float
    t: Floats | None = None
    dofs: Integers | None = None
    outputs: frozenset[str] = frozenset({"impacts"})
    tolerance: float | None = None
    load: tuple[Load, ...] = ()
    limiter: Power | None = None
    method: str = time_history.EXACT
    first: int = 0
    report: InitVar[Callable[[], None] | None] = None
    start: time_history.Start | None = field(init=False)
    """The first member that can move; None where numbers of all are out of range."""

    def __post_init__(self, report: Callable[[], None] | None) -> None:
        require(KIND, self.system.constraints)
        time_history.check_states(self.system, self.x, self.v)
        stops = self.system.constraints
        rigid = stops if self.limiter is None and all(c.law.rigid for c in stops) else ()
        start = time_history.first_start(rigid, self.x, self.v, report)
        object.__setattr__(self, "start", start)
        self.pattern  # noqa: B018 (checks the fields common to all members)

    @property
    def stopped(self) -> bool:
        """Whether the stops have a finite stiffness."""
        return any(not c.law.rigid for c in self.system.constraints)

    @property
    def size(self) -> int:
        """Number of members."""
        return int(self.x.shape[0])

    @cached_property
    def pattern(self) -> time_history.Problem:
        """The first member inside its limits.

        Where none is, the first in range, or at rest where none is, without limiters.
        """
        if self.moves:
            assert self.start is not None
            return self.member(self.start.row)
        rest = np.zeros(self.system.n)
        at = State(rest, rest) if self.start is None else self._state(self.start.row)
        return self._motion(self.system.limited(()), at)

    @property
    def neglected(self) -> list[str]:
        """A sentence about each part of the structure that has no effect."""
        return self.pattern.neglected if self.moves else []

    @property
    def moves(self) -> bool:
        """Whether there is a member that starts inside its limits."""
        return self.start is not None and self.start.inside

    def member(self, index: int) -> time_history.Problem:
        """Return the problem of one motion.

        Raises
        ------
        ModelError
            Where it starts outside of the limits.
        """
        return self._motion(self.system, self._state(index))

    def _state(self, index: int) -> State:
        return State(self.x[index], self.v[index])

    def _motion(self, system: System, initial: State) -> time_history.Problem:
        shared: dict[str, Any] = {name: getattr(self, name) for name in _SHARED}
        return time_history.Problem(system, initial, **shared)

    def piece(self, start: int, stop: int) -> Problem:
        """Return some of the members."""
        x, v = self.x[start:stop], self.v[start:stop]
        return replace(self, x=x, v=v, first=self.first + start)


_SHARED: Final = tuple(
    field.name
    for field in fields(Problem)
    if field.name not in {"system", "x", "v", "first", "start"}
)
