"""A motion in extended precision from event to event: impacts, chatter, contacts, releases."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import flint
import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ConvergenceError, PlanError
from vibroimpact_solvers.time_history.extended.configuration import (
    Body,
    Configuration,
    Contact,
    as_doubles,
)
from vibroimpact_solvers.time_history.extended.deviations import Deviations
from vibroimpact_solvers.time_history.extended.free_motion import MEANT, FreeMotion, Search, Watch
from vibroimpact_solvers.time_history.extended.precision import (
    GUARD,
    Real,
    Row,
    dot,
    matrix,
    middle,
    rows_of,
    times,
)
from vibroimpact_solvers.time_history.run import Tick

MOST_SIMULTANEOUS: Final = 8
"""Largest number of simultaneous impacts."""
_SWITCHES: Final = 50
_ACCUMULATED: Final = 40  # impacts within a millionth of the time of the fastest mode


@dataclass(slots=True)
class Impact:
    """An impact: condition is the error of the state, relative to it."""

    time: Real
    constraint: int
    side: int
    velocity: Real
    impulse: Real
    condition: float


@dataclass(slots=True)
class ContactInterval:
    """A contact."""

    contact: Contact
    start: Real
    rest: Real
    stop: Real
    impulse: Real


class Motion:
    """A motion in extended precision.

    Parameters
    ----------
    body : Body
    x, v : list of arb, shape (dof,)
        Initial state.
    t_end : float
    output_times : array, shape (time,)
        Times at which states are kept.
    tick : callable, optional
    """

    def __init__(
        self,
        body: Body,
        x: Row,
        v: Row,
        t_end: float,
        output_times: Floats,
        tick: Tick | None = None,
    ) -> None:
        self.body, self._tick = body, tick
        self._end, self._output_times = flint.arb(t_end), output_times
        self.now: Real = flint.arb(0)
        self.configuration = body.configuration()
        self.q, self.rate = self.configuration.state_of(x, v)
        self.samples: list[tuple[Configuration, Row, Row]] = []
        self.impacts: list[Impact] = []
        self.intervals: list[ContactInterval] = []
        self._contacts: dict[Contact, ContactInterval] = {}
        self._leaving: frozenset[int] = frozenset()
        self._inertia = body.system.M.to_dense()
        self._restitution = [flint.arb(c.restitution) for c in body.system.constraints]
        self.deviations = Deviations(self.configuration, *self._doubles())
        self.unit = 10.0 ** -(body.digits + MEANT)
        self.grazings = self.expansions = 0
        largest = float(np.abs(self.configuration.rates).max(initial=0.0))
        fastest = 1.0 / largest if largest > 0.0 else t_end
        self._chatter = flint.arb(fastest) * flint.arb(10) ** (-(body.digits // 2) - 1)
        self._accumulation_time = flint.arb(1e-6 * fastest)
        self._switched: tuple[float, int] = (-1.0, 0)

    def finish(self) -> None:
        """Follow the motion to its end."""
        while True:
            if self._tick is not None:
                self._tick(int(1000 * float(self.now) / float(self._end)), 1000)
            free_motion = FreeMotion(self.configuration, self.q, self.rate, self.now)
            watches = self._watches()
            search = Search(free_motion, watches, self.body.digits)
            leaving = frozenset(i for i, w in enumerate(watches) if w.constraint in self._leaving)
            s, which = search.first(self._end - self.now, leaving)
            self.expansions += search.expansions
            self._sample(free_motion, s, last=which is None)
            self._advance(free_motion, s, last=which is None)
            if which is None:
                break
            watch = watches[which]
            if watch.constraint < 0:
                self._release(self.configuration.contacts[-1 - watch.constraint])
            else:
                self._impact(search, s, which)
        for rest in self._contacts.values():
            rest.stop = self._end
        if self._tick is not None:
            self._tick(1000, 1000)

    def state(self) -> tuple[Row, Row]:
        """Return displacements and velocities now."""
        return self.configuration.displacements(self.q, self.rate, range(self.body.system.n))

    # -- free motion --

    def _watches(self) -> list[Watch]:
        watches = []
        in_contact = {index for index, _ in self._contacts}
        for index, constraint in enumerate(self.body.system.constraints):
            if index in in_contact:
                continue
            form = self.configuration.coordinate(index)
            for side, wall in ((1, constraint.upper), (-1, constraint.lower)):
                if wall is not None:
                    watches.append(Watch(form, side, flint.arb(wall), index))
        for place, form in enumerate(self.configuration.tensile_forces()):
            watches.append(Watch(form, 1, flint.arb(0), -1 - place))
        return watches

    def _sample(self, free_motion: FreeMotion, s: Real, *, last: bool) -> None:
        stop = self.now + s
        while len(self.samples) < self._output_times.size:
            time = flint.arb(float(self._output_times[len(self.samples)]))
            if not last and not time <= stop:
                break
            q, rate = free_motion.state(time - self.now)
            self.samples.append((self.configuration, q, rate))

    def _advance(self, free_motion: FreeMotion, s: Real, *, last: bool) -> None:
        if self._contacts:
            self._add_contact_impulses(free_motion, s)
        self.q, self.rate = free_motion.state(s)
        self.now = self._end if last else middle(self.now + s)
        self.deviations.advance(*self._doubles(), float(s))
        self._leaving = frozenset()

    def _add_contact_impulses(self, free_motion: FreeMotion, s: Real) -> None:
        """Add the impulses of the walls on the coordinates at rest, from their rest on."""
        forms = self.configuration.tensile_forces()
        for form, contact in zip(forms, self.configuration.contacts, strict=True):
            rest = self._contacts[contact]
            early = min(max(rest.rest - self.now, flint.arb(0)), s)
            search = Search(free_motion, [Watch(form, 1, flint.arb(0), -1)], self.body.digits)
            rest.impulse = middle(rest.impulse - search.integral(0, early, s))

    def _doubles(self) -> tuple[Floats, Floats]:
        return as_doubles(self.q), as_doubles(self.rate)

    # -- impacts --

    def _impact(self, search: Search, s: Real, which: int) -> None:
        """Apply the impacts of all constraints that are at their walls."""
        who = search.watches[which]
        near = flint.arb(10) ** (-self.body.digits)
        struck = [(who.constraint, who.sign)]
        for i, watch in enumerate(search.watches):
            if i == which or watch.constraint < 0:
                continue
            if search.room(i, s) <= near * flint.arb(float(search.sizes[i])):
                struck.append((watch.constraint, watch.sign))
        self._require_progress()
        x, v = self.state()
        fresh = len(struck)
        struck += self.configuration.contacts
        if len(struck) > MOST_SIMULTANEOUS:
            raise PlanError(f"more than {MOST_SIMULTANEOUS} constraints strike at one instant")
        speeds = [side * dot(self.body.W[index], v) for index, side in struck]
        speeds[fresh:] = [flint.arb(0)] * (len(struck) - fresh)
        if self._grazes(search, s, which, speeds):
            return
        rows = [[side * value for value in self.body.W[index]] for index, side in struck]
        velocity_changes = rows_of(self.body.M.solve(matrix(rows).transpose()).transpose())
        G = [times(rows, change) for change in velocity_changes]
        k = [self._restitution[index] for index, _ in struck]
        given = _impulses(G, speeds, k)
        after = list(v)
        for P, change in zip(given, velocity_changes, strict=True):
            after = [middle(a - P * b) for a, b in zip(after, change, strict=True)]
        self._saltate(struck, speeds, given, after)
        for (index, side), P, speed in zip(struck, given, speeds, strict=True):
            if P > 0:
                condition = self.deviations.condition * self.unit
                self.impacts.append(
                    Impact(self.now, index, side, side * speed, middle(P), condition)
                )
        left = [-dot(row, after) for row in rows]
        if fresh == 1 and len(struck) == 1:
            left = [k[0] * speeds[0]]  # without the rounding of the sum
        self._part(struck, fresh, left, x, after)

    def _require_progress(self) -> None:
        """Raise where impacts accumulate, unless it is chatter of one lossy constraint."""
        last = self.impacts[-_ACCUMULATED:]
        if len(last) < _ACCUMULATED or self.now - last[0].time > self._accumulation_time:
            return
        struck = {impact.constraint for impact in last}
        if len(struck) > 1 or self.body.system.constraints[last[0].constraint].restitution == 1.0:
            message = f"impacts accumulate at t = {float(self.now)!r}"
            raise ConvergenceError(f"{message}: this is followed in double precision only")

    def _grazes(self, search: Search, s: Real, which: int, speeds: list[Real]) -> bool:
        """Whether the coordinate only touches its wall, within rounding."""
        turned = [(sigma * s).exp() for sigma in search._sigma]
        _, slope, bend = search._derivatives(which, s, turned)
        speed, curve = middle(slope), middle(bend)
        if len(speeds) > 1 or not (curve < 0 and speed * speed <= -2 * curve * search.tiny[which]):
            return False
        self.grazings += 1
        self._leaving = frozenset({search.watches[which].constraint})
        return True

    def _part(self, struck: list[Contact], fresh: int, left: list[Real], x: Row, v: Row) -> None:
        """Decide which constraints leave their walls and which come to rest there."""
        rounding = flint.arb(10) ** (-self.body.digits) * max(
            (abs(value) for value in v), default=flint.arb(0)
        )
        for contact, speed in list(zip(struck, left, strict=True))[fresh:]:
            if speed > rounding:
                self._end_contact(contact)
        configuration = self.body.configuration(frozenset(self._contacts))
        q, rate = configuration.state_of(x, v)
        loads = [flint.acb(0, omega * self.now).exp() for omega in self.body.loads]
        accelerations = configuration.displacements(
            q, configuration.accelerations(q, rate, loads), range(self.body.system.n)
        )[1]
        leaving = set()
        for contact, speed in list(zip(struck, left, strict=True))[:fresh]:
            index, side = contact
            push = side * dot(self.body.W[index], accelerations)
            k = self._restitution[index]
            speed = speed if speed > rounding or (speed > 0 and k > 0) else flint.arb(0)
            duration = flint.arb(0)
            if speed > 0:
                duration = 2 * speed / (push * (1 - k)) if k < 1 and push > 0 else flint.arb("inf")
            if push >= 0 and duration <= self._chatter:
                rest = min(middle(self.now + duration), self._end)
                self._contacts[contact] = interval = ContactInterval(
                    contact, self.now, rest, self._end, flint.arb(0)
                )
                self.intervals.append(interval)
            else:
                leaving.add(index)
        self._resolve_contacts(x, v, frozenset(leaving))

    # -- contacts --

    def _release(self, contact: Contact) -> None:
        x, v = self.state()
        self._end_contact(contact)
        self._resolve_contacts(x, v, frozenset({contact[0]}))

    def _end_contact(self, contact: Contact) -> None:
        self._contacts.pop(contact).stop = self.now

    def _resolve_contacts(self, x: Row, v: Row, leaving: frozenset[int]) -> None:
        """Continue with the present contacts except those whose force would have to be tensile."""
        while True:
            configuration = self.body.configuration(frozenset(self._contacts))
            q, rate = configuration.state_of(x, v)
            free_motion = FreeMotion(configuration, q, rate, self.now)
            watches = [
                Watch(form, 1, flint.arb(0), -1 - k)
                for k, form in enumerate(configuration.tensile_forces())
            ]
            search = Search(free_motion, watches, self.body.digits)
            zero = flint.arb(0)
            pulled = [
                contact
                for i, contact in enumerate(configuration.contacts)
                if search.room(i, zero) < -search.tiny[i]
            ]
            if not pulled:
                break
            self._end_contact(pulled[0])
            leaving |= {pulled[0][0]}
        if configuration is not self.configuration:
            self.deviations.transform(configuration, self._inertia)
            self._count()
        self.configuration, self.q, self.rate, self._leaving = configuration, q, rate, leaving

    def _count(self) -> None:
        now = float(self.now)
        self._switched = (now, self._switched[1] + 1 if self._switched[0] == now else 1)
        if self._switched[1] > _SWITCHES:
            raise ConvergenceError(f"contacts begin and end without end at t = {now!r}")

    # -- errors --

    def _saltate(
        self, struck: list[Contact], speeds: Sequence[Real], given: Sequence[Real], after: Row
    ) -> None:
        """Apply the saltation matrices of the impact to the deviations, one by one."""
        configuration = self.configuration
        loads = [flint.acb(0, omega * self.now).exp() for omega in self.body.loads]
        acceleration_before = as_doubles(configuration.accelerations(self.q, self.rate, loads))
        before = as_doubles(self.rate)
        whole = configuration.shapes.T @ self._inertia @ as_doubles(after)
        acceleration_after = as_doubles(
            configuration.accelerations(self.q, [flint.arb(float(value)) for value in whole], loads)
        )
        hits = [c for c, P, u in zip(struck, given, speeds, strict=True) if P > 0 and u > 0]
        for index, _ in hits:
            row = configuration.shapes.T @ self.body.system.directions([index])[0]
            square = float(row @ row)
            if square <= 0.0:
                continue
            factor = (1.0 + self.body.system.constraints[index].restitution) / square
            single = before - factor * (row @ before) * row if len(hits) > 1 else whole
            self.deviations.strike(
                row, before, single, factor, acceleration_before, acceleration_after
            )


def _impulses(G: list[Row], speeds: list[Real], restitution: list[Real]) -> Row:
    """Return the impulses of a linear complementarity problem; see `kernels.free_motion.impulses`.

    Of all sets of walls that give an impulse, the one is taken for which no impulse is negative
    and no coordinate goes on into its wall: with positive definite G there is just one.
    """
    m = len(speeds)
    q = [-u * (1 + k) if u > 0 else -u for u, k in zip(speeds, restitution, strict=True)]
    scale = max((abs(value) for value in q), default=flint.arb(0))
    tiny = scale * flint.arb(2) ** (GUARD - flint.ctx.prec)
    for size in range(m + 1):
        for active in itertools.combinations(range(m), size):
            P = [flint.arb(0)] * m
            if active:
                small = matrix([[G[a][b] for b in active] for a in active])
                solution = small.solve(matrix([[-q[a]] for a in active]))
                for a, (value,) in zip(active, rows_of(solution), strict=True):
                    P[a] = value
            w = [value + dot(row, P) for value, row in zip(q, G, strict=True)]
            if all(P[a] >= 0 for a in active) and all(middle(value) >= -tiny for value in w):
                return P
    raise ConvergenceError("no impulses satisfy the laws of impact")
