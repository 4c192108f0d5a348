"""The state at an event, of the centre and of all enclosed motions, and how it goes on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from vibroimpact_solvers.time_history.extended.impact_law import Blow
from vibroimpact_solvers.time_history.extended.precision import Matrix, Real
from vibroimpact_solvers.time_history.extended.structure import Configuration


@dataclass(frozen=True, eq=False, slots=True)
class Places:
    """A state in the coordinates of a configuration, at an event.

    Coordinates are carried over to another configuration by themselves, and not by displacements:
    that of a wall is known far better than the displacements that it consists of.

    Parameters
    ----------
    configuration : Configuration
        Until the event.
    q, v : matrix of one column
        Of the centre.
    all_q, all_v : matrix of one column
        Of all enclosed motions, at their own times of the event.
    force : matrix, shape (dof, 1)
        The loads.
    """

    configuration: Configuration
    q: Matrix
    v: Matrix
    all_q: Matrix
    all_v: Matrix
    force: Matrix

    def speed(self, row: Matrix) -> Real:
        """Return the velocity of a coordinate."""
        return (row * self.configuration.E * self.v)[0, 0]

    def all_speeds(self, row: Matrix) -> Real:
        """Return the velocities of a coordinate of all motions."""
        return (row * self.configuration.E * self.all_v)[0, 0]

    def after(self, new: Configuration, given: Sequence[Blow] = ()) -> tuple[Matrix, Matrix]:
        """Return the centre's coordinates and rates in a configuration, after impacts."""
        return self._carried(new, given, self.q, self.v)

    def all_after(self, new: Configuration, given: Sequence[Blow] = ()) -> tuple[Matrix, Matrix]:
        """Return those of all motions."""
        return self._carried(new, given, self.all_q, self.all_v)

    def _carried(
        self, new: Configuration, given: Sequence[Blow], q: Matrix, v: Matrix
    ) -> tuple[Matrix, Matrix]:
        old = self.configuration
        after_q, after_v = new.carried(old, q, v)
        for blow in given:
            after_v -= (new.T * blow.changes) * (blow.impulses * old.E * v)
        return after_q, after_v
