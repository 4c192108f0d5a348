"""Errors of contacts: of the times at which they begin, rest and end, and of their impulses.

With the state known to a length E (`stated_errors`), a contact force is known to dF, and ends early
or late by as much as an impact whose coordinate is off:

    dt = 2 dF / (|F'| + (F'^2 - 2 F'' dF)^(1/2)) .

What is left of a chatter after an impact that leaves with the speed u lasts ``2 u / (a (1 - k))``,
a being the acceleration towards the wall. With the coordinate known to dy and its velocity to dv it
ends early or late by

    dt = 2 dv / (a (1 - k)) + dy (1 + k) / (u (1 - k)) ,

32 times of which is stated, for the largest of the bounces after which nothing else strikes and a
changes by half at most: the end of a chatter is the same function of the state at each of them, but
for the roundings that come later.
Where all are low, an error dy changes the speed of no bounce by more than ``(2 a dy)^(1/2)``:

    dt = 2 (dv + (2 a dy)^(1/2)) / (a (1 - k)) + (2 dy / a)^(1/2) .
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.kernels.rigid_state import Rows
from vibroimpact_solvers.time_history.problem import Problem
from vibroimpact_solvers.time_history.stated_errors import StatedErrors, lengths
from vibroimpact_solvers.time_history.structure import Configuration, Contact, Structure

_TERMS: Final = 64.0  # roundings of the terms of a force, which are made of many products
_LATER: Final = 32.0
"""Error of the end of a chatter over what the error at its largest bounce makes of it."""


class ContactErrors:
    """Errors of the contacts of a motion, in the units of x.

    Parameters
    ----------
    problem : Problem
    structure : Structure
    """

    def __init__(self, problem: Problem, structure: Structure) -> None:
        self._structure, self._stated = structure, StatedErrors(problem, structure)

    def impacts(
        self, configuration: Configuration, rows: Rows, sizes: tuple[float, float]
    ) -> tuple[Floats, Floats]:
        """Return the errors of the times and impulses of impacts, each (impact,).

        Sizes are those of the largest state and of the largest distance from a wall at an impact.
        """
        largest, gap = (np.array([size]) for size in sizes)
        errors = self._stated.of([configuration]).impacts(
            rows, np.array([rows.size]), largest, np.array([math.inf]), gap
        )
        return errors["error_impact_time"], errors["error_impact_impulse"]

    def forces(
        self, configuration: Configuration, z: Floats, state: float
    ) -> tuple[Floats, Floats]:
        """Return the contact forces of a state known to a length, and their errors."""
        forms, levels = configuration.forces
        forces = (forms * z).sum(axis=(1, 2)) + levels
        errors = state * lengths(configuration.basis, forms)
        form_errors = configuration.kernel.errors.coordinates[0, len(configuration.free) :]
        errors += EPS * np.abs(form_errors * z).sum(axis=(1, 2))
        return forces, errors + _TERMS * EPS * (np.abs(forms * z).sum(axis=(1, 2)) + np.abs(levels))

    def release(self, configuration: Configuration, place: int, z: Floats, state: float) -> float:
        """Return the error of the time at which the force of a contact vanishes."""
        forces, errors = self.forces(configuration, z, state)
        basis, scale = configuration.basis, self._structure.scale
        slope = configuration.kernel.watched.velocity[len(configuration.free) + place]
        rate = basis.rate(z)
        fall, bend = abs(float((slope * z).sum())), abs(float((slope * rate).sum()))
        off = float(errors[place]) + abs(float(forces[place]))
        return passage(off, scale * fall, 2.0 * scale**2 * bend)

    def rest(
        self,
        before: Configuration,
        after: Configuration,
        contact: Contact,
        known: tuple[Floats, float],
        impacts: Rows,
        at_end: tuple[float, float],
    ) -> tuple[float, float]:
        """Return the error of the time of rest, and the largest force then.

        Parameters
        ----------
        before, after : Configuration
            Without and with the contact.
        contact : Contact
        known : tuple
            The state, and the length to which it is known.
        impacts : array of `kernels.rigid_state.IMPACT`
            The last ones, of all constraints.
        at_end : tuple
            Time until all further bounces have ended, and the largest distance from a wall at an
            impact.
        """
        (index, _), (z, state), (lasts, gap) = contact, known, at_end
        row = after.contacts.index(contact)
        forces, errors = self.forces(after, z, state)
        force, error = float(forces[row]), float(errors[row])
        held = [i for i, _ in after.contacts]
        among = self._structure.mobility[np.ix_(held, held)]
        mobility = 1.0 / float(np.linalg.inv(among)[row, row])
        push, most = (force - error) * mobility, (force + error) * mobility
        if not push > 0.0:
            return math.inf, math.inf
        reach = self._stated.reach(before)
        size = float(self._structure.configuration().kernel.walls["size"][index])
        place, rate = reach.coordinates[:2, index].tolist()
        gap = 2.0 * gap + EPS * size
        off, slow = state * place + gap, state * rate
        k, fastest = self._structure.system.constraints[index].restitution, reach.fastest
        # In the sum of the bounces the force does not change.
        late = lasts * min(1.0, 4.0 * fastest * lasts)
        low = math.sqrt(2.0 * off / push)
        if k < 1.0:
            low += 2.0 * (slow + math.sqrt(2.0 * most * off)) / (push * (1.0 - k))
            speed, then = _largest(impacts, contact, push)
            if k * speed > 0.0:
                high = 2.0 * then * rate / push
                high += (then * place + gap) * (1.0 + k) / (k * speed)
                low = min(low, _LATER * high / (1.0 - k))
        return late + (low if k < 1.0 else math.inf), force + error

    def impulses(
        self,
        configuration: Configuration,
        answered: tuple[Rows, tuple[float, float]],
        force: Floats,
        span: float,
    ) -> Floats:
        """Return the errors of the impulses of contacts in a time, shape (contact,).

        Parameters
        ----------
        configuration : Configuration
        answered : tuple
            The impacts in that time, which contacts answer, and sizes as of `impacts`.
        force : array, shape (contact,)
            Errors of the contact forces.
        span : float
        """
        rows, sizes = answered
        errors = np.asarray(span * force)
        if rows.size and configuration.answers.any():
            _, impulses = self.impacts(configuration, rows, sizes)
            places = [configuration.free.index(i) for i in rows["constraint"].tolist()]
            errors += np.abs(configuration.answers[:, places]) @ impulses
        return errors


def _largest(rows: Rows, contact: Contact, push: float) -> tuple[float, float]:
    """Return the largest speed of the last impacts, all at one wall with nearly the same push.

    And the length to which the state is known until the next one.
    """
    index, side = contact
    other = (rows["constraint"] != index) | (rows["side"] != side)
    other |= ~(np.abs(side * rows["acceleration"] - push) <= 0.5 * push)
    same = rows[int(np.flatnonzero(other)[-1]) + 1 :] if other.any() else rows
    if not same.size:
        return 0.0, 0.0
    first = int(np.argmax(np.abs(same["velocity"])))
    known = EPS * float(same["before"][first : first + 2].max())
    return abs(float(same["velocity"][first])), known


def passage(off: float, speed: float, bend: float) -> float:
    """Return by how much a passage may be early or late; infinite where it may not take place.

    Parameters
    ----------
    off, speed, bend : float
        Error of what passes, its rate, and a bound of how fast that changes.
    """
    late, swing = 2.0 * bend * off, speed * speed
    return 2.0 * off / (speed + math.sqrt(swing - late)) if late < swing else math.inf


def masked(times: Sequence[float], errors: Sequence[float], until: float) -> Floats:
    """Return errors of what is at some times: infinite from a horizon on."""
    known = np.asarray(times) < until if until < math.inf else np.ones(len(times), dtype=bool)
    return np.where(known, np.asarray(errors, dtype=np.float64), np.inf)
