"""The impact of a coordinate while others are in contact, which answer it with impulses.

Contacts are not struck: they give nothing of their answers back, as if their k were 0. With k of
the coordinate, Poisson's law then is Newton's, for the structure with the contacts that stay.
Bodies that only touch, without a force, are struck like all that are at their walls then.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from vibroimpact_solvers.arrays import Booleans, Floats
from vibroimpact_solvers.kernels.deviations import EPS
from vibroimpact_solvers.kernels.impact_law import MOREAU, NEWTON, POISSON, impulses
from vibroimpact_solvers.time_history.contact_forces import Contact
from vibroimpact_solvers.time_history.structure import Structure

Moved = tuple[Floats, Floats]
"""A deviation as displacements and velocities (in the basis' time), each (dof,)."""


@dataclass(frozen=True, eq=False)
class AnsweredImpact:
    """An impact, and the impulses of all walls.

    Parameters
    ----------
    structure : Structure
    contacts : tuple of Contact
        The coordinate that is struck, and those that are in contact.
    v : array, shape (dof,)
        Velocities before the impact, in the basis' time.
    impulses : array, shape (contact,)
    restitution : array, shape (contact,)
        The k with which each of them was struck; 0 in contact.
    touching : array of bool, shape (contact,)
        Those in contact without a force.
    """

    structure: Structure
    contacts: tuple[Contact, ...]
    v: Floats
    impulses: Floats
    restitution: Floats
    touching: Booleans

    @classmethod
    def of(
        cls,
        structure: Structure,
        contacts: tuple[Contact, ...],
        v: Floats,
        idle: Collection[Contact] = (),
    ) -> AnsweredImpact:
        """Return the impact of the first coordinate; the others do not move, some are idle."""
        indices, sides = np.ascontiguousarray(np.array(contacts, dtype=np.int64).T)
        speeds = np.zeros(len(contacts))
        index, side = contacts[0]
        speeds[0] = max(0.0, side * float(structure.W[index] @ v))
        touching = np.array([c in idle for c in contacts])
        own = np.array([structure.system.constraints[i].restitution for i in indices.tolist()])
        struck = np.where(touching | (np.arange(own.size) == 0), own, 0.0)
        restitution = np.zeros(len(structure.system.constraints))
        restitution[indices] = struck
        given = impulses(structure.mobility, restitution, indices, sides.astype(np.float64), speeds)
        return cls(structure, contacts, v, given, struck, touching)

    @property
    def rows(self) -> Floats:
        """The coordinates, positive towards their walls, shape (contact, dof)."""
        indices, sides = np.array(self.contacts, dtype=np.int64).T
        return np.asarray(self.structure.W[indices] * sides[:, np.newaxis])

    @property
    def speed(self) -> float:
        """The speed towards the wall, before the impact."""
        return float(self.rows[0] @ self.v)

    @property
    def law(self) -> int:
        """The law of the impact (`kernels.impact_law`)."""
        struck = self.impulses > 0.0
        if not (struck & self.touching).any():
            return NEWTON
        return MOREAU if (self.restitution[struck] == 1.0).all() else POISSON

    @property
    def undecided(self) -> float:
        """Length of the state that the order of impacts decides on.

        The smallest gap would make those of bodies that touch follow one another.
        """
        given = np.where(self.touching, (1.0 + self.restitution) * self.impulses, 0.0)
        pushed = self.rows.T @ given
        return math.sqrt(float(pushed @ self.structure.mass_solve(pushed)))

    @property
    def leaves_slowly(self) -> bool:
        """Whether the coordinate leaves its wall with a speed that is rounding."""
        return self.structure.system.constraints[self.contacts[0][0]].restitution == 0.0

    @property
    def after(self) -> Floats:
        """Velocities after the impact, shape (dof,)."""
        return self.v - self.structure.mass_solve(self.rows.T @ self.impulses)

    def through(self, moved: Moved, before: Floats, after: Floats, place: float) -> Moved:
        """Take a deviation through the impact (saltation).

        Parameters
        ----------
        moved : tuple of array
            In units of 2^-52.
        before, after : array, shape (dof,)
            Accelerations before and after the impact.
        place : float
            Error of the place of the wall.
        """
        (dx, dv), w = moved, self.rows[0]
        dy, slowed = float(w @ dx) + place, float(w @ before)
        most = math.sqrt(2.0 * abs(dy / slowed) / EPS) if slowed else math.inf
        late = min(max(-dy / self.speed, -most), most)
        turned = dv + before * late
        pushing = self.impulses > 0.0
        rows = self.rows[pushing]
        lost = rows @ turned
        lost[0] *= 1.0 + self.structure.system.constraints[self.contacts[0][0]].restitution
        mobility = rows @ self.structure.mass_solve(rows.T)
        # Dependent coordinates share their impulse.
        shared = np.linalg.pinv(mobility, hermitian=True) @ lost
        turned = turned - self.structure.mass_solve(rows.T @ shared)
        return dx + (self.v - self.after) * late, turned - after * late
