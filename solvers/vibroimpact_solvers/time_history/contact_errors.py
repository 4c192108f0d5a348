"""Errors of contacts: of the times at which they begin, rest and end, and of their impulses.

A contact force is known to dF as the deviations of the state tell, and the contact ends early or
late by as much as an impact whose coordinate is off:

    dt = 2 dF / (|F'| + (F'^2 - 2 F'' dF)^(1/2)) .

After an impact with the speed u what is left of a chatter lasts ``2 k u / (a (1 - k))``, a being
the acceleration towards the wall. With the time of the impact known to ds and u to du, of one sign
and another, as samples of them tell (`kernels.impact_law`), it ends early or late by

    dt = ds + 2 k du / (a (1 - k)) .

Where dt is not small beside the next bounce, an error dy changes the speed of no bounce by more
than ``(2 a dy)^(1/2)``:

    dt = 2 (du + (2 a dy)^(1/2)) / (a (1 - k)) + (2 dy / a)^(1/2) .
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.kernels.deviations import SAFETY
from vibroimpact_solvers.kernels.output_errors import passage
from vibroimpact_solvers.kernels.rigid_state import Rows
from vibroimpact_solvers.time_history.contact_forces import Contact
from vibroimpact_solvers.time_history.problem import Problem
from vibroimpact_solvers.time_history.stated_errors import StatedErrors, lengths
from vibroimpact_solvers.time_history.structure import Configuration, Structure

_TERMS: Final = 16.0  # roundings of the terms of a force, and of their sums, which are pairwise
_LINEAR: Final = 0.125  # of a bounce, by which its end may be off for errors to be linear


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
        self, configuration: Configuration, Z: Floats, least: float
    ) -> tuple[Floats, Floats]:
        """Return the contact forces, and their errors.

        Parameters
        ----------
        configuration : Configuration
        Z : array, shape (1 + deviation, 2, pair)
            The state, and its deviations.
        least : float
            Length to which the state is known at best.
        """
        (forms, levels), z = configuration.forces, Z[0]
        forces = (forms * z).sum(axis=(1, 2)) + levels
        sampled = np.abs(np.tensordot(forms, Z[1:], axes=([1, 2], [1, 2])))
        errors = SAFETY * EPS * sampled.max(axis=1, initial=0.0)
        errors += least * lengths(configuration.basis, forms)
        form_errors = configuration.kernel.errors.coordinates[0, len(configuration.free) :]
        errors += EPS * np.abs(form_errors * z).sum(axis=(1, 2))
        return forces, errors + _TERMS * EPS * (np.abs(forms * z).sum(axis=(1, 2)) + np.abs(levels))

    def begin(
        self, configuration: Configuration, contact: Contact, Z: Floats, least: float
    ) -> tuple[float, float]:
        """Return the errors of the time and of the impulse of a contact from the first instant on.

        There are none, unless rounding decides whether its force pushes then, or not until later.
        """
        place = configuration.contacts.index(contact)
        forces, errors = self.forces(configuration, Z, least)
        unknown = float(errors[place])
        if float(forces[place]) > unknown or contact in configuration.idle:
            return 0.0, 0.0
        late = self.release(configuration, place, Z, least)
        return late, 2.0 * unknown * late

    def release(self, configuration: Configuration, place: int, Z: Floats, least: float) -> float:
        """Return the error of the time at which the force of a contact vanishes."""
        forces, errors = self.forces(configuration, Z, least)
        fall, bend = self._slopes(configuration, place, Z[0])
        off = float(errors[place]) + abs(float(forces[place]))
        return passage(off, fall, 2.0 * bend)

    def _slopes(self, configuration: Configuration, place: int, z: Floats) -> tuple[float, float]:
        """Return how fast a contact force changes, and how fast that does."""
        slope, scale = configuration.kernel.watched.velocity, self._structure.scale
        row = slope[len(configuration.free) + place]
        fall, bend = (row * z).sum(), (row * configuration.basis.rate(z)).sum()
        return scale * abs(float(fall)), scale**2 * abs(float(bend))

    def rest(
        self,
        before: Configuration,
        after: Configuration,
        contact: Contact,
        known: tuple[Floats, float, float],
        chatter: tuple[float, float],
        gap: float,
    ) -> tuple[float, float]:
        """Return the error of the time of rest, and the largest force then.

        Parameters
        ----------
        before, after : Configuration
            Without and with the contact.
        contact : Contact
        known : tuple
            The state with its deviations, the length to which it is known, and that at best.
        chatter : tuple
            Time until all further bounces have ended, and by how much they are early or late as
            far as errors are linear.
        gap : float
            The largest distance from a wall at an impact.
        """
        (index, _), (Z, state, least), (lasts, linear) = contact, known, chatter
        row = after.contacts.index(contact)
        forces, errors = self.forces(after, Z, least)
        force, error = float(forces[row]), float(errors[row])
        held = [i for i, _ in after.contacts]
        among = self._structure.mobility[np.ix_(held, held)]
        mobility = 1.0 / float(np.linalg.inv(among)[row, row])
        push, most = (force - error) * mobility, (force + error) * mobility
        k = self._structure.system.constraints[index].restitution
        if not push > 0.0 or not k < 1.0:
            return math.inf, force + error if push > 0.0 else math.inf
        # In the sum of the bounces the acceleration does not change.
        fall, bend = self._slopes(after, row, Z[0])
        changes = (fall + bend * lasts) / (force - error)
        late = lasts * min(1.0, lasts * (changes + self._stated.reach(before).fastest))
        if linear <= _LINEAR * (1.0 - k) * lasts:
            return late + linear, force + error
        reach = self._stated.reach(before).coordinates[:, index]
        size = float(self._structure.configuration().kernel.walls["size"][index])
        place, rate = reach[:2].tolist()
        off, slow = state * place + 2.0 * gap + EPS * size, state * rate
        low = math.sqrt(2.0 * off / push)
        low += 2.0 * (slow + math.sqrt(2.0 * most * off)) / (push * (1.0 - k))
        return late + low, force + error

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


def masked(times: Floats, errors: Floats, until: float) -> Floats:
    """Return errors of what is at some times: infinite from a horizon on, and of unknown times."""
    return np.where(times < until, errors, np.inf)
