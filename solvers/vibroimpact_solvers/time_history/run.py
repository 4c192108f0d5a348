"""One motion as it goes on: flights by the compiled loop, contacts that begin and end between."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.kernels.flight import Stop, fly, impulses, length
from vibroimpact_solvers.time_history.structure import Contact, Scene, Structure

Tick = Callable[[int, int], None]
Take = Callable[[Scene, Floats, int], None]

CHATTER: Final = 1e-8
"""Times, in units of the fastest mode, below which the rest of a chatter is one sum."""

_ROWS = 4096  # of the table that the compiled loop fills
_BUFFER = 2**21  # numbers in the buffer of samples
_EXPANSIONS = 2e7  # pairs expanded between two ticks
_COLUMNS = 2  # deviations taken along
_DEPENDENT = 16.0  # times the growth of independent roundings
_SWITCHES = 50  # contacts that may begin and end at one and the same time


@dataclass
class Impacts:
    """The table of impacts, in pieces."""

    keep: bool
    count: int = 0
    at: list[Floats] = field(default_factory=list)
    where: list[Integers] = field(default_factory=list)
    what: list[Floats] = field(default_factory=list)
    growth: list[Floats] = field(default_factory=list)


@dataclass
class Rest:
    """A contact: times in units of the basis."""

    contact: Contact
    start: float
    rest: float
    stop: float = math.nan


class Run:
    """A motion from its initial state on.

    Parameters
    ----------
    structure : Structure
    x, v : array, shape (dof,)
        Initial state.
    wanted : array, shape (time,)
        Times at which `take` is given the state.
    t_end : float
    take : callable
        Called with the scene, states (time, 2, pair) and the index of the first of them.
    keep : bool
        Whether the table of impacts is wanted.
    """

    def __init__(
        self,
        structure: Structure,
        z: Floats,
        wanted: Floats,
        t_end: float,
        take: Take,
        *,
        keep: bool,
        tick: Tick | None = None,
    ) -> None:
        self.structure, self.take, self.tick = structure, take, tick
        self.scene = structure.scene()
        self.scale = math.ldexp(1.0, structure.exponent)
        self.wanted = wanted * self.scale
        self.clock = np.zeros(8)
        self._draw_noise()
        self.Z = np.empty((1 + _COLUMNS, *z.shape))
        self.Z[0] = z
        self.clock[7] = length(self.Z, 0, self.scene.basis.own)
        self.Z[1:] = self.noise[:_COLUMNS] * self.clock[7]
        self.clock[2], self.clock[4] = t_end * self.scale, CHATTER
        self.counts = np.zeros(11, dtype=np.int64)
        self.impacts, self.rests = Impacts(keep), list[Rest]()
        self.contacts: dict[Contact, Rest] = {}
        self._samples(self.scene)
        self._table = self._new_table()
        self._switched: tuple[float, int] = (-1.0, 0)

    # -- the loop --

    def finish(self) -> None:
        """Follow the motion to its end."""
        budget = max(1000, int(_EXPANSIONS / max(1, self.scene.basis.pairs)))
        stop = Stop.PAUSE
        while stop is not Stop.END:
            if self.tick is not None:
                self.tick(int(1e3 * self.clock[0] / self.clock[2]), 1000)
            self.counts[3] = self.counts[2] + budget
            self.counts[7] = bool(self.contacts)
            place = (self.clock[0], self.clock[1], self.counts[10])
            basis = self.scene.basis
            growth = basis.growth
            self.clock[3] = 1.0 / growth if growth > 0.0 else math.inf
            stop = Stop(
                fly(
                    basis.rates, basis.split, self.scene.forms, self.scene.sizes, self.scene.walls,
                    self.scene.mobility, self.Z, self.noise, basis.own, self.clock, self.counts,
                    *self._table, self.wanted, self._buffer,
                )
            )  # fmt: skip
            self._flush_samples()
            self._flush_table()
            if stop is Stop.PAUSE:
                self._check_progress(place)
            elif stop is Stop.CONTACT:
                self._rest(int(self.counts[5]), int(self.counts[6]), float(self.clock[5]))
            elif stop is Stop.RELEASE:
                self._release(int(self.counts[5]))
            elif stop is Stop.STRUCK:
                self._strike(int(self.counts[5]), int(self.counts[6]))
        for rest in self.contacts.values():
            rest.stop = self.clock[2]
        if self.tick is not None:
            self.tick(1000, 1000)

    def _check_progress(self, before: tuple[float, float, int]) -> None:
        """Refuse a motion that grazes a wall for ever, within rounding at the same time."""
        if before == (self.clock[0], self.clock[1], self.counts[10]):
            message = f"the motion goes on grazing at t = {self.now / self.scale!r}"
            raise ConvergenceError(message)

    @property
    def now(self) -> float:
        """The time, in units of the basis."""
        return float(self.clock[0] + self.clock[1])

    # -- what the compiled loop hands over --

    def _samples(self, scene: Scene) -> None:
        rows = max(1, min(self.wanted.size, _BUFFER // max(1, 2 * scene.basis.pairs)))
        self._buffer = np.empty((rows, 2, scene.basis.pairs))

    def _new_table(self) -> tuple[Floats, Integers, Floats]:
        rows = _ROWS + len(self.structure.system.constraints)
        return np.empty((rows, 2)), np.empty((rows, 2), np.int64), np.empty((rows, 3))

    def _flush_samples(self) -> None:
        first, count = int(self.counts[4]), int(self.counts[1])
        if count > first:
            self.take(self.scene, self._buffer[: count - first], first)
        self.counts[4] = count

    def _flush_table(self) -> None:
        count = int(self.counts[0])
        if count:
            at, where, what = self._table
            places = where[:count].copy()
            places[:, 0] = np.array(self.scene.flying, dtype=np.int64)[places[:, 0]]
            self._keep(at[:count].copy(), places, what[:count].copy())
        self.counts[0] = 0

    def _keep(self, at: Floats, where: Integers, what: Floats) -> None:
        table = self.impacts
        table.count += at.shape[0]
        table.growth.append(what[:, 2])
        table.at.append(at)
        if table.keep:
            table.where.append(where)
            table.what.append(what)

    # -- contacts --

    def _place(self) -> tuple[Floats, Floats]:
        """Return displacements and velocities (in the basis' time), each (dof,)."""
        return self.structure.place(self.scene, self.Z[0])

    def _enter(self, x: Floats, v: Floats, contacts: frozenset[Contact]) -> None:
        """Go on from a state with these contacts."""
        loads = self.scene.basis.loads_of(self.Z[0])
        moved = [self.structure.place(self.scene, X, level=False) for X in self.Z[1:]]
        scene = self.structure.scene(contacts)
        if scene is not self.scene:
            self.Z = np.empty((self.Z.shape[0], 2, scene.basis.pairs))
            for c, (dx, dv) in enumerate(moved, start=1):
                self.Z[c] = self.structure.enter(scene, dx, dv)
            self.scene = scene
            self._draw_noise()
            self._samples(scene)
        self.Z[0] = self.structure.enter(scene, x, v, loads)
        time, count = self._switched
        self._switched = (self.now, count + 1 if self.now == time else 1)
        if self._switched[1] > _SWITCHES:
            message = f"contacts begin and end without end at t = {self.now / self.scale!r}"
            raise ConvergenceError(message)

    def _hold(self, contact: Contact, lasts: float) -> None:
        rest = Rest(contact, self.now, min(self.now + lasts, self.clock[2]))
        self.contacts[contact] = rest
        self.rests.append(rest)

    def _let_go(self, contact: Contact) -> None:
        self.contacts.pop(contact).stop = self.now

    def _rest(self, watched: int, side: int, lasts: float) -> None:
        """Hold a constraint at its wall."""
        x, v = self._place()
        self._hold((self.scene.flying[watched], side), lasts)
        self._settle(x, v)

    def _settle(self, x: Floats, v: Floats) -> None:
        """Go on with the contacts there are, but for those that would have to be pulled."""
        while True:
            contacts = frozenset(self.contacts)
            scene = self.structure.scene(contacts)
            z = self.structure.enter(scene, x, v, self.scene.basis.loads_of(self.Z[0]))
            forces = self.structure.pressing(scene, z)
            # A force that is rounding may still grow: the search decides about it.
            pulled = [c for c, f, grain in forces if f < -grain]
            if not pulled:
                break
            self._let_go(pulled[0])
            released = pulled[0][0]
            self.counts[9] = 0
            if not self.contacts or released is not None:
                self._excuse(released)
        self._enter(x, v, contacts)

    def _excuse(self, constraint: int) -> None:
        scene = self.structure.scene(frozenset(self.contacts))
        self.counts[9] = 1 + scene.flying.index(constraint)

    def _release(self, watched: int) -> None:
        x, v = self._place()
        contact = self.scene.contacts[watched - len(self.scene.flying)]
        self._let_go(contact)
        self._excuse(contact[0])
        self._enter(x, v, frozenset(self.contacts))

    def _strike(self, watched: int, side: int) -> None:
        """Let a constraint strike while others are held."""
        x, v = self._place()
        structure = self.structure
        struck = [(self.scene.flying[watched], side), *self.contacts]
        indices = np.array([index for index, _ in struck], dtype=np.int64)
        sides = np.array([s for _, s in struck], dtype=np.float64)
        W = structure.W[indices]
        speeds = sides * (W @ v)
        speeds[1:] = 0.0
        restitution = np.array([c.restitution for c in structure.system.constraints])
        given = impulses(structure.mobility, restitution, indices, sides, speeds)
        v = v - structure.by_mass(W.T @ (sides * given))
        growth = self.growth
        for (index, s), P, speed in zip(struck, given, speeds, strict=True):
            if P > 0.0:
                at = self.clock[np.newaxis, :2].copy()
                what = np.array([[s * speed, P, growth]])
                self._keep(at, np.array([[index, s]]), what)
        after = -sides * (W @ v)
        grain = 1e-14 * float(np.abs(speeds).max())
        for contact, leaving in list(zip(struck, after, strict=True))[1:]:
            if leaving > grain:
                self._let_go(contact)
        # Does it come to rest too?
        scene = structure.scene(frozenset(self.contacts))
        loads = self.scene.basis.loads_of(self.Z[0])
        push = structure.push(scene, structure.enter(scene, x, v, loads), struck[0])
        k, leaving = restitution[struck[0][0]], max(float(after[0]), 0.0)
        if speeds[0] <= 0.0 or leaving <= grain:
            leaving = 0.0
        lasts = 0.0 if leaving == 0.0 else math.inf
        if leaving > 0.0 and push > 0.0 and k < 1.0:
            lasts = 2.0 * leaving / (push * (1.0 - k))
        if push >= 0.0 and lasts <= CHATTER:
            self._hold(struck[0], lasts)
        self._settle(x, v)

    @property
    def growth(self) -> float:
        """Deviations relative to the motion, in units of the relative rounding.

        The deviations are those of independent roundings. Real ones are not independent from
        one impact to the next: errors of up to 11 times as much were met.
        """
        mean = float((self.Z[1:] ** 2 * self.scene.basis.own).sum()) / _COLUMNS
        return _DEPENDENT * math.sqrt(mean) / self.clock[7] if self.clock[7] > 0.0 else 0.0

    def _draw_noise(self) -> None:
        """Take the vectors that stand for rounding in the scene."""
        self.noise = self.scene.basis.noise
