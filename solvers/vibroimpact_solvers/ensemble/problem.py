"""The problem: the motions of a structure from many initial states."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Final

from vibroimpact_solvers import time_history
from vibroimpact_solvers.arrays import Floats, Integers
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

    def __post_init__(self) -> None:
        time_history.check_states(self.system, self.x, self.v)
        self.pattern  # noqa: B018 (checks the fields common to all members)

    @property
    def size(self) -> int:
        """Number of members."""
        return int(self.x.shape[0])

    @cached_property
    def pattern(self) -> time_history.Problem:
        """The first member inside its limits; where there is none, the first without limiters."""
        first = time_history.first_inside(self.size, self.member)
        if first is not None:
            return first
        free = replace(self, system=self.system.limited(()), x=self.x[:1], v=self.v[:1])
        return free.member(0)

    def member(self, index: int) -> time_history.Problem:
        """Return the problem of one motion.

        Raises
        ------
        ModelError
            Where it starts outside of the limits.
        """
        shared: dict[str, Any] = {name: getattr(self, name) for name in _SHARED}
        return time_history.Problem(initial=State(self.x[index], self.v[index]), **shared)

    def piece(self, start: int, stop: int) -> Problem:
        """Return some of the members."""
        x, v = self.x[start:stop], self.v[start:stop]
        return replace(self, x=x, v=v, first=self.first + start)


_SHARED: Final = tuple(
    field.name for field in fields(Problem) if field.name not in {"x", "v", "first"}
)
