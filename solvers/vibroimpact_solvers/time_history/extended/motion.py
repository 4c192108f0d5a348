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
from vibroimpact_solvers.time_history.extended.deviations import Deviations
from vibroimpact_solvers.time_history.extended.flight import MEANT, Flight, Search, Watch
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
from vibroimpact_solvers.time_history.extended.scene import Body, Contact, Scene, as_doubles
from vibroimpact_solvers.time_history.run import Tick

MOST_TOGETHER: Final = 8
"""Constraints that may strike at one instant."""
_SWITCHES: Final = 50
_CROWD: Final = 40  # impacts within a millionth of the time of the fastest mode


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
class Rest:
    """A contact."""

    contact: Contact
    start: Real
    rest: Real
    stop: Real
    impulse: Real


class Motion:
    """A motion from its initial state on.

    Parameters
    ----------
    body : Body
    x, v : list of arb, shape (dof,)
        Initial state.
    t_end : float
    wanted : array, shape (time,)
        Times at which states are kept.
    tick : callable, optional
    """

    def __init__(
        self, body: Body, x: Row, v: Row, t_end: float, wanted: Floats, tick: Tick | None = None
    ) -> None:
        self.body, self._tick = body, tick
        self._end, self._wanted = flint.arb(t_end), wanted
        self.now: Real = flint.arb(0)
        self.scene = body.scene()
        self.q, self.rate = self.scene.enter(x, v)
        self.samples: list[tuple[Scene, Row, Row]] = []
        self.impacts: list[Impact] = []
        self.rests: list[Rest] = []
        self._held: dict[Contact, Rest] = {}
        self._leaving: frozenset[int] = frozenset()
        self._inertia = body.system.M.to_dense()
        self._restitution = [flint.arb(c.restitution) for c in body.system.constraints]
        self.deviations = Deviations(self.scene, *self._doubles())
        self.unit = 10.0 ** -(body.digits + MEANT)
        self.grazings = self.expansions = 0
        largest = float(np.abs(self.scene.rates).max(initial=0.0))
        fastest = 1.0 / largest if largest > 0.0 else t_end
        self._chatter = flint.arb(fastest) * flint.arb(10) ** (-(body.digits // 2) - 1)
        self._crowd = flint.arb(1e-6 * fastest)
        self._switched: tuple[float, int] = (-1.0, 0)

    def finish(self) -> None:
        """Follow the motion to its end."""
        while True:
            if self._tick is not None:
                self._tick(int(1000 * float(self.now) / float(self._end)), 1000)
            flight = Flight(self.scene, self.q, self.rate, self.now)
            watches = self._watches()
            search = Search(flight, watches, self.body.digits)
            leaving = frozenset(i for i, w in enumerate(watches) if w.constraint in self._leaving)
            s, which = search.first(self._end - self.now, leaving)
            self.expansions += search.expansions
            self._sample(flight, s, last=which is None)
            self._advance(flight, s, last=which is None)
            if which is None:
                break
            watch = watches[which]
            if watch.constraint < 0:
                self._release(self.scene.contacts[-1 - watch.constraint])
            else:
                self._strike(search, s, which)
        for rest in self._held.values():
            rest.stop = self._end
        if self._tick is not None:
            self._tick(1000, 1000)

    def state(self) -> tuple[Row, Row]:
        """Return displacements and velocities now."""
        return self.scene.place(self.q, self.rate, range(self.body.system.n))

    # -- flights --

    def _watches(self) -> list[Watch]:
        found = []
        held = {index for index, _ in self._held}
        for index, constraint in enumerate(self.body.system.constraints):
            if index in held:
                continue
            form = self.scene.coordinate(index)
            for side, wall in ((1, constraint.upper), (-1, constraint.lower)):
                if wall is not None:
                    found.append(Watch(form, side, flint.arb(wall), index))
        for place, form in enumerate(self.scene.pulling()):
            found.append(Watch(form, 1, flint.arb(0), -1 - place))
        return found

    def _sample(self, flight: Flight, s: Real, *, last: bool) -> None:
        stop = self.now + s
        while len(self.samples) < self._wanted.size:
            time = flint.arb(float(self._wanted[len(self.samples)]))
            if not last and not time <= stop:
                break
            q, rate = flight.state(time - self.now)
            self.samples.append((self.scene, q, rate))

    def _advance(self, flight: Flight, s: Real, *, last: bool) -> None:
        if self._held:
            self._press(flight, s)
        self.q, self.rate = flight.state(s)
        self.now = self._end if last else middle(self.now + s)
        self.deviations.fly(*self._doubles(), float(s))
        self._leaving = frozenset()

    def _press(self, flight: Flight, s: Real) -> None:
        """Add the integrals of the forces of contacts, from their rest on."""
        forms = self.scene.pulling()
        for form, contact in zip(forms, self.scene.contacts, strict=True):
            rest = self._held[contact]
            early = min(max(rest.rest - self.now, flint.arb(0)), s)
            search = Search(flight, [Watch(form, 1, flint.arb(0), -1)], self.body.digits)
            rest.impulse = middle(rest.impulse - search.integral(0, early, s))

    def _doubles(self) -> tuple[Floats, Floats]:
        return as_doubles(self.q), as_doubles(self.rate)

    # -- impacts --

    def _strike(self, search: Search, s: Real, which: int) -> None:
        """Let all constraints that are at their walls strike."""
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
        struck += self.scene.contacts
        if len(struck) > MOST_TOGETHER:
            raise PlanError(f"more than {MOST_TOGETHER} constraints strike at one instant")
        speeds = [side * dot(self.body.W[index], v) for index, side in struck]
        speeds[fresh:] = [flint.arb(0)] * (len(struck) - fresh)
        if self._grazes(search, s, which, speeds):
            return
        rows = [[side * value for value in self.body.W[index]] for index, side in struck]
        kicks = rows_of(self.body.M.solve(matrix(rows).transpose()).transpose())
        G = [times(rows, kick) for kick in kicks]
        k = [self._restitution[index] for index, _ in struck]
        given = _impulses(G, speeds, k)
        after = list(v)
        for P, kick in zip(given, kicks, strict=True):
            after = [middle(a - P * b) for a, b in zip(after, kick, strict=True)]
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
        """Raise where impacts crowd that are no chatter of one lossy constraint, which ends."""
        last = self.impacts[-_CROWD:]
        if len(last) < _CROWD or self.now - last[0].time > self._crowd:
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
        """Let constraints leave their walls, or come to rest there."""
        grain = flint.arb(10) ** (-self.body.digits) * max(
            (abs(value) for value in v), default=flint.arb(0)
        )
        for contact, speed in list(zip(struck, left, strict=True))[fresh:]:
            if speed > grain:
                self._let_go(contact)
        scene = self.body.scene(frozenset(self._held))
        q, rate = scene.enter(x, v)
        loads = [flint.acb(0, omega * self.now).exp() for omega in self.body.loads]
        falls = scene.place(q, scene.accelerations(q, rate, loads), range(self.body.system.n))[1]
        leaving = set()
        for contact, speed in list(zip(struck, left, strict=True))[:fresh]:
            index, side = contact
            push = side * dot(self.body.W[index], falls)
            k = self._restitution[index]
            speed = speed if speed > grain or (speed > 0 and k > 0) else flint.arb(0)
            lasts = flint.arb(0)
            if speed > 0:
                lasts = 2 * speed / (push * (1 - k)) if k < 1 and push > 0 else flint.arb("inf")
            if push >= 0 and lasts <= self._chatter:
                rest = min(middle(self.now + lasts), self._end)
                self._held[contact] = held = Rest(contact, self.now, rest, self._end, flint.arb(0))
                self.rests.append(held)
            else:
                leaving.add(index)
        self._settle(x, v, frozenset(leaving))

    # -- contacts --

    def _release(self, contact: Contact) -> None:
        x, v = self.state()
        self._let_go(contact)
        self._settle(x, v, frozenset({contact[0]}))

    def _let_go(self, contact: Contact) -> None:
        self._held.pop(contact).stop = self.now

    def _settle(self, x: Row, v: Row, leaving: frozenset[int]) -> None:
        """Go on with the contacts there are, but for those that would have to be pulled."""
        while True:
            scene = self.body.scene(frozenset(self._held))
            q, rate = scene.enter(x, v)
            flight = Flight(scene, q, rate, self.now)
            watches = [
                Watch(form, 1, flint.arb(0), -1 - k) for k, form in enumerate(scene.pulling())
            ]
            search = Search(flight, watches, self.body.digits)
            zero = flint.arb(0)
            pulled = [
                contact
                for i, contact in enumerate(scene.contacts)
                if search.room(i, zero) < -search.tiny[i]
            ]
            if not pulled:
                break
            self._let_go(pulled[0])
            leaving |= {pulled[0][0]}
        if scene is not self.scene:
            self.deviations.enter(scene, self._inertia)
            self._count()
        self.scene, self.q, self.rate, self._leaving = scene, q, rate, leaving

    def _count(self) -> None:
        now = float(self.now)
        self._switched = (now, self._switched[1] + 1 if self._switched[0] == now else 1)
        if self._switched[1] > _SWITCHES:
            raise ConvergenceError(f"contacts begin and end without end at t = {now!r}")

    # -- errors --

    def _saltate(
        self, struck: list[Contact], speeds: Sequence[Real], given: Sequence[Real], after: Row
    ) -> None:
        """Take the deviations through the impact, constraint by constraint."""
        scene = self.scene
        loads = [flint.acb(0, omega * self.now).exp() for omega in self.body.loads]
        falls = as_doubles(scene.accelerations(self.q, self.rate, loads))
        before = as_doubles(self.rate)
        whole = scene.shapes.T @ self._inertia @ as_doubles(after)
        rises = as_doubles(
            scene.accelerations(self.q, [flint.arb(float(value)) for value in whole], loads)
        )
        hits = [c for c, P, u in zip(struck, given, speeds, strict=True) if P > 0 and u > 0]
        for index, _ in hits:
            row = scene.shapes.T @ self.body.system.directions([index])[0]
            square = float(row @ row)
            if square <= 0.0:
                continue
            factor = (1.0 + self.body.system.constraints[index].restitution) / square
            single = before - factor * (row @ before) * row if len(hits) > 1 else whole
            self.deviations.strike(row, before, single, factor, falls, rises)


def _impulses(G: list[Row], speeds: list[Real], restitution: list[Real]) -> Row:
    """Return the impulses of a linear complementarity problem; see `kernels.flight.impulses`.

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
                found = small.solve(matrix([[-q[a]] for a in active]))
                for a, (value,) in zip(active, rows_of(found), strict=True):
                    P[a] = value
            w = [value + dot(row, P) for value, row in zip(q, G, strict=True)]
            if all(P[a] >= 0 for a in active) and all(middle(value) >= -tiny for value in w):
                return P
    raise ConvergenceError("no impulses satisfy the laws of impact")
