"""Contacts in extended precision: which constraints rest at their walls, and for how long."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import flint

from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.time_history.extended.impact_law import Blow
from vibroimpact_solvers.time_history.extended.places import Places
from vibroimpact_solvers.time_history.extended.precision import (
    Real,
    column,
    real,
    undecided,
    working_digits,
)
from vibroimpact_solvers.time_history.extended.structure import Body, Configuration, Contact

_SWITCHES: Final = 50
"""Contacts that begin or end at one time, at most."""


@dataclass(slots=True)
class ContactInterval:
    """A contact."""

    contact: Contact
    start: Real
    rest: Real
    stop: Real
    impulse: Real


class Contacts:
    """The contacts of a motion.

    Parameters
    ----------
    body : Body
    end : arb
        Where the motion ends.

    Attributes
    ----------
    intervals : list of ContactInterval
        All of them so far.
    open : dict
        Contact -> its interval, of those that go on.
    leaving : dict
        Constraint at its wall that leaves it -> the order of the derivative with which it does:
        1, its velocity; 2, its acceleration; 3, the rate of that.
    """

    def __init__(self, body: Body, end: Real) -> None:
        self._body, self._end = body, end
        self.intervals: list[ContactInterval] = []
        self.open: dict[Contact, ContactInterval] = {}
        self.leaving: dict[Contact, int] = {}
        self._switched: tuple[float, int] = (-1.0, 0)
        fastest = real(1.0 / body.configuration().rate)
        self._chatter = fastest * flint.arb(10) ** (-(working_digits() // 2) - 1)

    def end_all(self) -> None:
        """End the contacts that go on with the motion."""
        for rest in self.open.values():
            rest.stop = self._end

    def settled(
        self,
        now: Real,
        held: tuple[Contact, ...],
        landed: Iterable[Contact],
        arrivals: dict[Contact, Real],
        state: Places,
        given: Sequence[Blow] = (),
    ) -> Configuration:
        """Decide which constraints rest at their walls, and return the new configuration.

        Parameters
        ----------
        now : arb
        held : tuple
            The contacts until now.
        landed : iterable
            Constraints at their walls.
        arrivals : dict
            Velocities with which those leave that were struck; none: they are at rest.
        state : Places
        given : sequence of Blow
            The impacts.
        """
        contacts, waiting, freed = set(held), list(landed), set[Contact]()
        rests: dict[Contact, Real] = {}
        for _ in range(_SWITCHES):
            configuration = self._body.configuration(frozenset(contacts))
            q, v = state.all_after(configuration, given)
            changed = False
            for watch in configuration.watches:
                if not watch.force:
                    continue
                tension = (watch.by_q * q)[0, 0] - watch.wall
                tension += (watch.drive * state.force)[0, 0]
                if watch.by_v is not None:
                    tension += (watch.by_v * v)[0, 0]
                if tension < 0:
                    continue
                if not tension > 0:
                    index = watch.contact[0]
                    raise undecided(f"whether constraint {index} is pressed on its wall", now)
                contacts.remove(watch.contact)
                freed.add(watch.contact)
                changed = True
                break
            if not changed:
                acceleration = configuration.E * configuration.accelerations(q, v, state.force)
                for contact in waiting:
                    if contact in contacts or contact in freed:
                        continue
                    push = (self._body.row(contact) * acceleration)[0, 0]
                    rest = self._rest(now, contact, arrivals.get(contact, flint.arb(0)), push)
                    if rest is not None:
                        rests[contact] = rest
                        contacts.add(contact)
                        changed = True
                        break
            if not changed:
                break
        else:
            raise ConvergenceError(f"contacts begin and end without end at t = {float(now)!r}")
        for contact in set(held) - contacts:
            self.end(contact, now)
            self.leaving[contact] = 2
        for contact in waiting:
            if contact in contacts:
                speed = self.restitution(contact) * state.speed(self._body.row(contact))
                rest = (now + rests[contact] * abs(speed)).min(self._end)
                interval = ContactInterval(contact, now, rest, self._end, flint.arb(0))
                self.open[contact] = interval
                self.intervals.append(interval)
            else:
                arrived = arrivals.get(contact, flint.arb(0))
                self.leaving[contact] = 1 if arrived > 0 else 2
        return configuration

    def _rest(self, now: Real, contact: Contact, speed: Real, push: Real) -> Real | None:
        """Return the time until a constraint at its wall rests there, per velocity.

        None: it leaves.
        """
        k = self.restitution(contact)
        if speed.is_zero():
            if push > 0:
                return flint.arb(0)
            if push < 0:
                return None
            raise undecided(f"whether constraint {contact[0]} stays at its wall", now)
        if not (k < 1 and push > 0):
            return None
        time = 2 / (push * (1 - k))
        return time if time * speed <= self._chatter else None

    def chatter_error(
        self, configuration: Configuration, interval: ContactInterval, arrivals: dict[Contact, Real]
    ) -> Real:
        """Return what a chatter changes in the other coordinates.

        Its impulses do not act on them; they feel the stiffness and damping of the constrained
        coordinate, which stays within ``u^2/p`` of its wall (u its velocity, p/2 what presses it
        at least) and travels ``2 u^2/(p (1 - k^2))`` in all.
        """
        contact = interval.contact
        speed = arrivals.get(contact, flint.arb(0))
        if speed.is_zero():
            return flint.arb(0)
        k = self.restitution(contact)
        duration = 2 * (interval.rest - interval.start)
        push = 2 * speed / ((1 - k) * (interval.rest - interval.start))
        far, path = speed * speed / push, 2 * speed * speed / (push * (1 - k * k))
        place = configuration.contacts.index(contact)
        held = column([row[place] for row in configuration.held.tolist()])
        stiff = sum(map(abs, (configuration.onto * self._body.K * held).entries()), flint.arb(0))
        total = stiff * far * duration
        if self._body.C is not None:
            damped = (configuration.onto * self._body.C * held).entries()
            total += sum(map(abs, damped), flint.arb(0)) * path
        return (4 * total).upper()

    def restitution(self, contact: Contact) -> Real:
        """Return the coefficient of restitution of a constraint."""
        return real(self._body.system.constraints[contact[0]].restitution)

    def end(self, contact: Contact, now: Real) -> None:
        """End a contact, if it is one."""
        if contact in self.open:
            self.open.pop(contact).stop = now

    def count(self, now: Real) -> None:
        """Take note that contacts ended by themselves.

        Raises
        ------
        ConvergenceError
            Where they end and begin too often at one time.
        """
        time = float(now)
        self._switched = (time, self._switched[1] + 1 if self._switched[0] == time else 1)
        if self._switched[1] > _SWITCHES:
            raise ConvergenceError(f"contacts begin and end without end at t = {time!r}")
