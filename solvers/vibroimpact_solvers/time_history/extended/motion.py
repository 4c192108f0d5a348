"""A motion in extended precision from event to event: impacts, chatter, contacts, releases.

The motion and all that its roundings cannot be told from are followed together (`enclosure`), and
every decision is one that holds for all of them, or the motion is refused.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Final

import flint
import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.time_history.extended.contacts import Contacts
from vibroimpact_solvers.time_history.extended.derivatives import (
    flow_map,
    product,
    release,
    saltation,
)
from vibroimpact_solvers.time_history.extended.enclosure import Enclosure
from vibroimpact_solvers.time_history.extended.free_motion import Approach, Event, FreeMotion
from vibroimpact_solvers.time_history.extended.impact_law import blows
from vibroimpact_solvers.time_history.extended.places import Places
from vibroimpact_solvers.time_history.extended.precision import (
    Matrix,
    Real,
    above,
    around,
    column,
    radii,
    real,
    undecided,
    widened,
    within,
)
from vibroimpact_solvers.time_history.extended.search import WHOLE, first_events
from vibroimpact_solvers.time_history.extended.structure import REACH, Body, Configuration, Contact
from vibroimpact_solvers.time_history.run import Tick

_LOST: Final = 1e3  # deviations over the motion that are followed at most
_ACCUMULATED: Final = 40  # impacts within a millionth of the time of the fastest mode
_GROWTH: Final = math.exp(REACH) * (1.0 + 1e-9)


@dataclass(slots=True)
class Impact:
    """An impact: condition is the bound of the error of the state, relative to it.

    Time, velocity and impulse are balls of those of all motions that are followed together.
    """

    time: Real
    constraint: int
    side: int
    velocity: Real
    impulse: Real
    condition: float


class Motion:
    """A motion in extended precision.

    Parameters
    ----------
    body : Body
    x, v : array, shape (dof,)
        Initial state.
    t_end : float
    output_times : array, shape (time,)
        Times at which states are kept.
    tick : callable, optional
    """

    def __init__(
        self,
        body: Body,
        x: Floats,
        v: Floats,
        t_end: float,
        output_times: Floats,
        tick: Tick | None = None,
    ) -> None:
        self.body, self._tick = body, tick
        self._end, self._output_times = real(t_end), output_times
        self.now: Real = flint.arb(0)
        self.samples: list[tuple[Matrix, Matrix]] = []
        self.impacts: list[Impact] = []
        self.errors: list[tuple[Real, float]] = []
        self.grazings = self.expansions = 0
        self._struck: list[Contact] = []
        self._size = 0.0
        self.configuration = body.configuration()
        self.contacts = Contacts(body, self._end)
        self._accumulation_time = real(1e-6 * (1.0 / self.configuration.rate))
        self._begin(x, v)

    def finish(self) -> None:
        """Follow the motion to its end."""
        while self._struck or self.now < self._end:
            if self._tick is not None:
                self._tick(int(1000 * float(self.now) / float(self._end)), 1000)
            free_motion = FreeMotion(self.configuration, self.q, self.v, self.now)
            self._account(free_motion)
            if self._struck:
                struck, self._struck = self._struck, []
                zero = flint.arb(0)
                self._impact(free_motion, zero, zero, zero, struck)
                continue
            self._step(free_motion)
        self.contacts.end_all()
        if self._tick is not None:
            self._tick(1000, 1000)

    def state(self) -> tuple[list[Real], list[Real]]:
        """Return displacements and velocities now: balls that enclose all motions."""
        box, weights = self._enclosure.box, self.configuration.weights.tolist()
        q = widened(self.q, [b / w for b, w in zip(box, weights, strict=False)])
        v = widened(self.v, box[len(weights) :])
        x, v = self.configuration.displacements(q, v)
        return self.body.whole(x), self.body.whole(v)

    @property
    def condition(self) -> float:
        """A bound of the error of the state, relative to the largest so far."""
        return above(self._enclosure.size) / self._size if self._size > 0.0 else 0.0

    # -- the beginning --

    def _begin(self, x: Floats, v: Floats) -> None:
        """Take the initial state; decide what constraints at their walls do."""
        at_rest, constraints = [], self.body.system.constraints
        for index, constraint in enumerate(constraints):
            y, u = (
                sum(Fraction(w) * Fraction(float(z[dof])) for dof, w in constraint.coordinate)
                for z in (x, v)
            )
            for side, wall in ((1, constraint.upper), (-1, constraint.lower)):
                # A start beyond the wall by the rounding of y counts as one at the wall.
                if wall is None or side * y < Fraction(wall):
                    continue
                if u * side > 0:
                    self._struck.append((index, side))
                elif u != 0:
                    self.contacts.leaving[(index, side)] = 1
                else:
                    at_rest.append((index, side))
        places = [column(list(map(real, self.body.restricted(z).tolist()))) for z in (x, v)]
        force = self.body.force_series(self.now, 1.0, 1)[0]
        self.q, self.v = self.configuration.states(*places)
        self._enclosure = Enclosure(self._radii(self.configuration, self.q, self.v))
        if at_rest:
            state = Places(self.configuration, self.q, self.v, self.q, self.v, force)
            configuration = self.contacts.settled(self.now, (), at_rest, {}, state)
            self.q, self.v = configuration.states(*places)
            self._enclosure = Enclosure(self._radii(configuration, self.q, self.v))
            self.configuration = configuration
        self.q, self.v = self.q.mid(), self.v.mid()

    # -- free motion --

    def _step(self, free_motion: FreeMotion) -> None:
        """Follow the motion to the next event, or for a step."""
        stop, last = flint.arb(WHOLE), (self._end - self.now) / free_motion.h
        ends = not last > stop
        stop = last if ends else stop
        spread, box = self._spread(), self._enclosure.box
        watches = self.configuration.watches
        approaches = [Approach(free_motion, watch, box, spread) for watch in watches]
        events, left = first_events(approaches, stop, self.contacts.leaving, self.now)
        self.expansions += 1
        if not events:
            self._sample(free_motion, stop, last=ends)
            self._drift(free_motion, stop)
            self.contacts.leaving = left
            if ends:
                self.now = self._end
            return
        sigma = events[0].sigma
        tight, wide = flint.arb(0), flint.arb(0)
        for event in events:
            apart = abs(event.sigma - sigma)
            tight, wide = tight.max(apart + event.tight), wide.max(apart + event.wide)
        self.contacts.leaving = left
        kinds = {(event.watch.force, event.most is None) for event in events}
        self._sample(free_motion, sigma, last=False)
        if kinds == {(False, True)}:
            self._impact(free_motion, sigma, tight, wide, [e.watch.contact for e in events])
        elif kinds == {(True, True)}:
            self._release(free_motion, events, tight, wide)
        elif kinds == {(False, False)} and len(events) == 1:
            self._graze(free_motion, events[0])
        else:
            names = " and ".join(sorted({str(e.watch.contact[0]) for e in events}))
            raise undecided(f"what happens first at constraints {names}", self.now)

    def _carry(self, J: Floats, errors: Floats, radii: Sequence[Real]) -> None:
        """Apply a map to all motions."""
        self._enclosure.map(J, errors, radii)
        if not self._enclosure.size < _LOST * max(self._size, 1e-300):
            raise undecided("where the motion is", self.now)

    def _spread(self) -> Real:
        """Return a bound of the size of deviations during the next step."""
        return (self._enclosure.size * flint.arb(_GROWTH)).upper()

    def _account(self, free_motion: FreeMotion) -> None:
        self._size = max(self._size, float(free_motion.size))
        self.errors.append((self.now, self.condition))

    def _sample(self, free_motion: FreeMotion, sigma: Real, *, last: bool) -> None:
        stop = float((self.now + sigma * free_motion.h).mid())
        while len(self.samples) < self._output_times.size:
            time = float(self._output_times[len(self.samples)])
            if not last and time > stop:
                break
            q, v = free_motion.state((real(time) - self.now) / free_motion.h)
            off, weights = self._spread(), self.configuration.weights.tolist()
            q = widened(q, [off / w for w in weights])
            v = widened(v, [off] * v.nrows())
            self.samples.append(self.configuration.displacements(q, v))
        if self.contacts.open:
            self._add_contact_impulses(free_motion, sigma)

    def _add_contact_impulses(self, free_motion: FreeMotion, sigma: Real) -> None:
        """Add the impulses of the walls on the coordinates at rest, from their rest on."""
        none = flint.arb(0)
        for watch in self.configuration.watches:
            if watch.force:
                rest = self.contacts.open[watch.contact]
                early = ((rest.rest - self.now) / free_motion.h).max(none).min(sigma)
                force = Approach(free_motion, watch, [], none)
                # The quantity is the tensile force over its level.
                pressed = watch.wall * (sigma - early) - force.integral(early, sigma)
                rest.impulse += pressed * free_motion.h

    def _drift(self, free_motion: FreeMotion, sigma: Real) -> None:
        """Move all motions on by a part of the step."""
        F = flow_map(free_motion, sigma, flint.arb(0))
        q, v = free_motion.state(sigma)
        self._carry(*F, self._radii(self.configuration, q, v))
        self.q, self.v, self.now = q.mid(), v.mid(), self.now + sigma * free_motion.h

    def _radii(self, configuration: Configuration, q: Matrix, v: Matrix) -> list[Real]:
        """Return the radii of a state, in the size of states."""
        weights = configuration.weights.tolist()
        return [real(w) * r for w, r in zip(weights, radii(q), strict=True)] + radii(v)

    def _radii_at(
        self, configuration: Configuration, q: Matrix, v: Matrix, force: Matrix, late: Real
    ) -> list[Real]:
        """Return the radii of a state that is that of a time uncertain by `late`."""
        a = configuration.accelerations(q, v, force)
        q = widened(q, [(2 * late * (abs(b) + late * abs(c))).upper()
                        for b, c in zip(v.entries(), a.entries(), strict=True)])  # fmt: skip
        v = widened(v, [(2 * late * abs(c)).upper() for c in a.entries()])
        return self._radii(configuration, q, v)

    # -- impacts --

    def _places(self, free_motion: FreeMotion, sigma: Real, tight: Real, wide: Real) -> Places:
        """Return the state at an event."""
        q, v = free_motion.state(within(sigma, tight))
        configuration, force = self.configuration, free_motion.force(within(sigma, wide))
        F, errors = flow_map(free_motion, sigma, wide)
        box, late = self._enclosure.box, wide * free_motion.h
        rows = ((np.abs(F) + errors) * (1.0 + 1e-9)).tolist()
        grown = [sum((b * f for b, f in zip(box, row, strict=True)), flint.arb(0)) for row in rows]
        # By the velocities and accelerations within the time of the event.
        bend = late * late * real(configuration.rate) * free_motion.speed
        a = configuration.accelerations(q, v, force).entries()
        m = len(a)
        off_v = [abs(c) * late + bend + g for c, g in zip(a, grown[m:], strict=True)]
        off_q = [
            late * (abs(b) + o) + g / w
            for b, o, g, w in zip(v.entries(), off_v, grown, free_motion.weights, strict=False)
        ]
        all_q, all_v = widened(q, off_q), widened(v, off_v)
        return Places(configuration, q, v, all_q, all_v, force)

    def _impact(
        self, free_motion: FreeMotion, sigma: Real, tight: Real, wide: Real, fresh: list[Contact]
    ) -> None:
        """Apply the impacts of the constraints that meet their walls."""
        self.now += sigma * free_motion.h
        self._require_progress()
        before, contacts = self.configuration, self.contacts
        state = self._places(free_motion, sigma, tight, wide)
        rows = [self.body.row(contact) for contact in fresh]
        speeds = [state.speed(row) for row in rows]
        all_speeds = [state.all_speeds(row) for row in rows]
        given = blows(self.body, fresh, before.contacts, all_speeds, self.now)
        left = {c for blow in given for c in blow.released}
        for contact in left:
            contacts.end(contact, self.now)
            contacts.leaving[contact] = 1
        arrivals = {c: contacts.restitution(c) * u for c, u in zip(fresh, all_speeds, strict=True)}
        first = len(contacts.intervals)
        kept = tuple(c for c in before.contacts if c not in left)
        configuration = contacts.settled(self.now, kept, fresh, arrivals, state, given)
        q, v = state.after(configuration, given)
        radii = self._radii_at(configuration, q, v, state.force, tight * free_motion.h)
        for interval in contacts.intervals[first:]:
            more = contacts.chatter_error(configuration, interval, arrivals)
            radii = [r + more for r in radii]
        J = saltation(configuration, given, all_speeds, state, wide, self._size, self.now)
        self._carry(*product(J, flow_map(free_motion, sigma, wide)), radii)
        condition = self.condition
        time = within(self.now.mid(), self.now.rad() + wide * free_motion.h)
        for blow, u, every in zip(given, speeds, all_speeds, strict=True):
            impulses = zip(
                (blow.impulses * before.E * state.v).entries(),
                (blow.impulses * before.E * state.all_v).entries(),
                strict=True,
            )
            for (index, side), (P, all_P) in zip(blow.active, impulses, strict=True):
                speed = flint.arb(0)
                if (index, side) == blow.contact:
                    speed = around(side * u, side * every)
                self.impacts.append(Impact(time, index, side, speed, around(P, all_P), condition))
        self.configuration, self.q, self.v = configuration, q.mid(), v.mid()

    def _require_progress(self) -> None:
        """Raise where impacts accumulate, unless it is chatter of one lossy constraint."""
        last = self.impacts[-_ACCUMULATED:]
        if len(last) < _ACCUMULATED or self.now - last[0].time.mid() > self._accumulation_time:
            return
        struck = {impact.constraint for impact in last}
        if len(struck) > 1 or self.body.system.constraints[last[0].constraint].restitution == 1.0:
            message = f"impacts accumulate at t = {float(self.now)!r}"
            raise ConvergenceError(f"{message}: this is followed in double precision only")

    def _graze(self, free_motion: FreeMotion, event: Event) -> None:
        """Enclose the motions with and without an impact at a touch of a wall.

        A coordinate that accelerates away from its wall strikes once at most, with a velocity
        that is the root of how far it could pass it.
        """
        contact, configuration = event.watch.contact, self.configuration
        assert event.most is not None
        if any(not (self.body.row(c) * self.body.change(contact))[0, 0].is_zero()
               for c in configuration.contacts):  # fmt: skip
            raise undecided(f"whether constraint {contact[0]} strikes", self.now)
        self.grazings += 1
        stop = event.sigma + event.wide
        restitution = self.contacts.restitution(contact)
        change = self.body.change(contact)
        impulse = (
            (1 + restitution) * event.most / free_motion.h / (self.body.row(contact) * change)[0, 0]
        )
        kick = [abs(a) for a in (configuration.T * change * impulse).entries()]
        total = sum(kick, flint.arb(0))
        time = 2 * event.wide * free_motion.h
        # A deviation grows by its rate for this time, in the coordinate and in the rates.
        grown = total * (real(configuration.rate) * time).exp()
        q, v = free_motion.state(stop)
        F = flow_map(free_motion, stop, flint.arb(0))
        radii = self._radii(configuration, q, v)
        weights = free_motion.weights
        radii = [
            r + (w * grown * time if j < len(weights) else kick[j - len(weights)]
                 + grown * real(configuration.rate) * time)
            for j, (r, w) in enumerate(zip(radii, [*weights, *weights], strict=True))
        ]  # fmt: skip
        self._carry(*F, radii)
        self.q, self.v, self.now = q.mid(), v.mid(), self.now + stop * free_motion.h

    # -- contacts --

    def _release(
        self, free_motion: FreeMotion, events: list[Event], tight: Real, wide: Real
    ) -> None:
        """End the contacts whose forces vanish."""
        sigma, before = events[0].sigma, self.configuration
        self.now += sigma * free_motion.h
        state = self._places(free_motion, sigma, tight, wide)
        ended = {event.watch.contact for event in events}
        for contact in ended:
            self.contacts.end(contact, self.now)
        configuration = self.contacts.settled(
            self.now, tuple(c for c in before.contacts if c not in ended), (), {}, state
        )
        self.contacts.leaving |= dict.fromkeys(ended, 3)
        q, v = state.after(configuration)
        J = release(configuration, events, state, free_motion.h, wide, self.now)
        radii = self._radii_at(configuration, q, v, state.force, tight * free_motion.h)
        self._carry(*product(J, flow_map(free_motion, sigma, wide)), radii)
        self.contacts.count(self.now)
        self.configuration, self.q, self.v = configuration, q.mid(), v.mid()
