"""Coordinates at their walls at one instant: which of them come to rest there, and stay.

Accelerations and contact forces obey the complementarity that velocities and impulses obey at an
impact: a contact pushes, or the coordinate leaves (Moreau; Glocker and Pfeiffer). A coordinate that
leaves with a speed u, and is pressed to its wall with the acceleration a, comes to rest after
``2 u / (a (1 - k))``, the sum of its bounces.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.impact_law import impulses
from vibroimpact_solvers.kernels.next_impact import ROUNDING, SIMULTANEOUS
from vibroimpact_solvers.time_history.contact_forces import Contact
from vibroimpact_solvers.time_history.structure import Structure

CHATTER: Final = 1e-8
"""Remaining time of a chatter, in units of the fastest mode, below which it is one sum."""
_BESIDE: Final = 16.0
"""How much longer than `CHATTER` that of a coordinate may last which rests with another one."""
_SLIGHT: Final = 64.0 * 2.0**-52
"""Accelerations that are rounding, relative to the terms they are made of."""


class AtWalls:
    """The state of all constrained coordinates at an instant.

    Parameters
    ----------
    structure : Structure
    x, v : array, shape (dof,)
        Displacements, and velocities in the basis' time.
    loads : array
        The state of the loads.
    """

    def __init__(self, structure: Structure, x: Floats, v: Floats, loads: Floats) -> None:
        configuration = structure.configuration()
        z = structure.state_of(configuration, x, v, loads)
        rate = configuration.basis.rate(z)
        watched, walls = configuration.kernel.watched, configuration.kernel.walls
        self._mobility = structure.mobility
        self._velocities = structure.W @ v
        # Of the coordinates where no wall acts on them.
        self._accelerations = (watched.velocity * rate).sum(axis=(1, 2))
        self._slight = _SLIGHT * np.abs(watched.velocity * rate).sum(axis=(1, 2))
        y = (watched.coordinate * z).sum(axis=(1, 2))
        self._rooms = {1: walls["upper"] - y, -1: walls["lower"] + y}
        size = np.abs(watched.coordinate * z).sum(axis=(1, 2)) + walls["size"]
        self._rounding = ROUNDING * size
        self._restitution = walls["restitution"]
        self._forces: dict[tuple[Contact, ...], dict[Contact, float]] = {}

    def length(self, contact: Contact) -> float:
        """Return the length of the state that the speed of a coordinate alone is."""
        index, _ = contact
        return abs(float(self._velocities[index])) / math.sqrt(self._mobility[index, index])

    def forces(self, contacts: Collection[Contact]) -> dict[Contact, float]:
        """Return the contacts that stay, and their forces.

        A force that is rounding may still grow: such contacts stay, and the search decides.
        """
        ordered = tuple(sorted(contacts))
        known = self._forces.get(ordered)
        if known is None:
            known = self._forces[ordered] = self._solved(ordered) if ordered else {}
        return known

    def _solved(self, contacts: tuple[Contact, ...]) -> dict[Contact, float]:
        """Return what `forces` does, of one contact or more, in their order."""
        index, side = np.ascontiguousarray(np.array(contacts, dtype=np.int64).T)
        towards, sides = side * self._accelerations[index], side.astype(np.float64)
        inelastic = np.zeros(self._restitution.size)
        forces = impulses(self._mobility, inelastic, index, sides, towards)
        mobility = sides[:, np.newaxis] * self._mobility[np.ix_(index, index)] * sides
        slight = self._slight[index] + _SLIGHT * (np.abs(mobility) @ forces)
        stays = (forces > 0.0) | (mobility @ forces - towards <= slight)
        return {c: float(forces[i]) for i, c in enumerate(contacts) if stays[i]}

    def touching(self, contacts: Collection[Contact]) -> Contact | None:
        """Return a coordinate that stays at its wall as far as rounding tells, not in contact."""
        given, fixed = self.forces(contacts), {index for index, _ in contacts}
        for contact in self._at_their_walls():
            index, side = contact
            push = self._towards(contact, given)
            slow = -side * self._velocities[index] <= ROUNDING * np.abs(self._velocities).max()
            if index not in fixed and slow and abs(push) <= self._slight[index]:
                return contact
        return None

    def come_to_rest(self, contacts: Collection[Contact], struck: Contact) -> dict[Contact, float]:
        """Return the coordinates that come to rest beside those in contact, and after which times.

        struck is at its wall by the account of the search.
        """
        fixed = {index for index, _ in (*contacts, struck)}  # each rests at one of its walls
        others = {i: (i, s) for i, s in self._at_their_walls() if i not in fixed}
        candidates = {*others.values(), struck}
        given = self.forces(contacts)
        while candidates:
            stays = self.forces([*contacts, *candidates])
            allowed = CHATTER * (1.0 if len(candidates) == 1 else _BESIDE)
            times = {
                c: self._lasts(c, self._push(c, given, candidates), allowed) for c in candidates
            }
            last = max(sorted(candidates), key=lambda c: (c not in stays, times[c]))
            if last in stays and times[last] < math.inf:
                return times
            candidates.remove(last)
        return {}

    def _push(
        self, contact: Contact, given: dict[Contact, float], beside: Collection[Contact]
    ) -> float:
        """Return the acceleration of a coordinate towards its wall.

        given are the forces of the contacts. Bodies that fall together are pressed to one another
        as soon as those beside rest; before, it is rounding.
        """
        push = self._towards(contact, given)
        if abs(push) <= self._slight[contact[0]]:
            push = self._towards(contact, self.forces([*given, *(set(beside) - {contact})]))
        return push

    def _towards(self, contact: Contact, given: dict[Contact, float]) -> float:
        index, side = contact
        pushed = sum(s * float(self._mobility[index, i]) * f for (i, s), f in given.items())
        return side * (float(self._accelerations[index]) - pushed)

    def _lasts(self, contact: Contact, push: float, allowed: float) -> float:
        """Return how long the bounces of a coordinate last; infinite where that is not allowed.

        It is where they are no higher than the rounding of the place, which gives them energy.
        """
        index, side = contact
        u, k = max(0.0, -side * float(self._velocities[index])), float(self._restitution[index])
        if u == 0.0:
            return 0.0
        if push <= 0.0 or k == 1.0:
            return math.inf
        duration = 2.0 * u / (push * (1.0 - k))
        low = u * u <= 2.0 * push * float(self._rounding[index])
        return duration if low or duration <= allowed else math.inf

    def _at_their_walls(self) -> list[Contact]:
        """Return the walls at which a coordinate is, and does not strike."""
        near = [
            (index, side)
            for side, room in self._rooms.items()
            for index in np.flatnonzero(room <= SIMULTANEOUS * self._rounding).tolist()
        ]
        speeds = ROUNDING * np.abs(self._velocities).max(initial=0.0)
        return [(i, s) for i, s in near if s * self._velocities[i] <= speeds]
