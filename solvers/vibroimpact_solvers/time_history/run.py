"""One motion as it goes on: flights by the compiled loop, contacts that begin and end between."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.kernels.flight import Stop, begin, fly, impulses, spread, workspace
from vibroimpact_solvers.time_history.basis import COLUMNS, Basis
from vibroimpact_solvers.time_history.pressure import impulses as impulses_at_rest
from vibroimpact_solvers.time_history.structure import Contact, Scene, Structure

Tick = Callable[[int, int], None]
Take = Callable[[Scene, Floats, int], None]
Table = tuple[Floats, Integers, Floats]

CHATTER: Final = 1e-8
"""Times, in units of the fastest mode, below which the rest of a chatter is one sum."""

_EPS = float(np.finfo(np.float64).eps)
_ROWS = 4096  # of the table that the compiled loop fills
_BUFFER = 2**21  # numbers in the buffer of samples
_EXPANSIONS = 2e7  # pairs expanded between two ticks
_SWITCHES = 50  # contacts that may begin and end at one and the same time


def budget(basis: Basis) -> int:
    """Return how many expansions may pass between two ticks."""
    return max(1000, int(_EXPANSIONS / max(1, basis.pairs)))


def new_table(structure: Structure) -> Table:
    """Return an empty table of impacts: times, places and blows (`kernels.flight.fly`)."""
    rows = _ROWS + len(structure.system.constraints)
    return np.empty((rows, 2)), np.empty((rows, 2), np.int64), np.empty((rows, 3))


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
    impulse: float = 0.0


def hidden_walls(index: int, apart: float, known: float) -> ConvergenceError:
    """Return the error of a coordinate that is known worse than its walls are apart."""
    return ConvergenceError(
        f"the limiters of constraint {index} are {apart:.3g} apart, and the motion is so large "
        f"that double precision knows the coordinate to {known:.1g} only"
    )


class Run:
    """A motion from its initial state on.

    Parameters
    ----------
    structure : Structure
    z : array, shape (2, pair)
        Initial state, in the free scene.
    wanted : array, shape (time,)
        Times at which `take` is given the state, in units of the basis.
    t_end : float
        In these units too.
    take : callable
        Called with the scene, states (time, 2, pair) and the index of the first of them.
    keep : bool
        Whether the table of impacts is wanted.
    estimate : bool
        Whether errors are.
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
        estimate: bool = True,
        tick: Tick | None = None,
    ) -> None:
        self.structure, self.take, self.tick = structure, take, tick
        self.scene = structure.scene()
        self.scale = structure.scale
        self.wanted = wanted
        self.columns = COLUMNS if estimate else 0
        self.clock = np.zeros(8)
        self.Z = np.empty((1 + self.columns, *z.shape))
        self.Z[0] = z
        basis = self.scene.basis
        begin(self.Z, basis.noise, basis.own, self.clock)
        self.clock[2], self.clock[4] = t_end, CHATTER
        self.counts = np.zeros(11, dtype=np.int64)
        self.impacts, self.rests = Impacts(keep), list[Rest]()
        self.contacts: dict[Contact, Rest] = {}
        self._samples(self.scene)
        self._table = new_table(structure)
        self._switched: tuple[float, int] = (-1.0, 0)

    def adopt(
        self, Z: Floats, clock: Floats, counts: Integers, table: Table, samples: Floats
    ) -> None:
        """Take over a motion that the compiled loop has left, in the free scene."""
        self.Z, self.clock, self.counts, self._table = Z, clock, counts, table
        self._buffer = samples

    # -- the loop --

    def finish(self, stop: Stop | None = None) -> None:
        """Follow the motion to its end; stop tells why the compiled loop returned, if it did."""
        while True:
            if stop is None:
                place = (self.clock[0], self.clock[1], self.counts[10])
                stop = self._fly()
                if stop is Stop.PAUSE:
                    self._check_progress(place)
            self._flush_samples()
            self._flush_table(last=stop is Stop.END)
            if stop is Stop.END:
                break
            if stop is Stop.CONTACT:
                self._rest(int(self.counts[5]), int(self.counts[6]), float(self.clock[5]))
            elif stop is Stop.RELEASE:
                self._release(int(self.counts[5]))
            elif stop is Stop.STRUCK:
                self._strike(int(self.counts[5]), int(self.counts[6]))
            stop = None
        for rest in self.contacts.values():
            rest.stop = self.clock[2]
        if self.tick is not None:
            self.tick(1000, 1000)

    def _fly(self) -> Stop:
        if self.tick is not None:
            self.tick(int(1e3 * self.clock[0] / self.clock[2]), 1000)
        scene, basis = self.scene, self.scene.basis
        self._tell_walls_apart()
        self.counts[3] = self.counts[2] + budget(basis)
        self.counts[7] = bool(self.contacts)
        self.clock[3] = basis.longest
        before = (self.now, self.Z[0].copy()) if self.contacts else None
        stop = Stop(
            fly(
                basis.rates, basis.split, scene.forms, scene.sizes, scene.walls, scene.mobility,
                self.Z, basis.noise, basis.drifts, scene.bends, basis.own, self.clock,
                self.counts, *self._table, self.wanted, self._buffer, *self._workspace,
            )
        )  # fmt: skip
        if before is not None:
            self._press(*before)
        return stop

    def _tell_walls_apart(self) -> None:
        """Refuse a motion that is so large that rounding hides where between its walls it is."""
        scene, count = self.scene, len(self.scene.flying)
        sizes = np.abs(scene.forms[0, :count] * self.Z[0]).sum(axis=(1, 2))
        apart = scene.walls[0, :count] + scene.walls[1, :count]
        for place in np.flatnonzero(_EPS * sizes >= apart):
            raise hidden_walls(scene.flying[place], float(apart[place]), _EPS * float(sizes[place]))

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
        self._workspace = workspace(scene.basis.pairs, scene.walls.shape[1])

    def _flush_samples(self) -> None:
        first, count = int(self.counts[4]), int(self.counts[1])
        if count > first:
            self.take(self.scene, self._buffer[: count - first], first)
        self.counts[4] = count

    def _flush_table(self, *, last: bool) -> None:
        count = int(self.counts[0])
        if count:
            at, where, what = self._table
            at, where, what = at[:count], where[:count], what[:count]
            if not last:
                at, where, what = at.copy(), where.copy(), what.copy()
            if self.scene.contacts:
                where[:, 0] = np.array(self.scene.flying, dtype=np.int64)[where[:, 0]]
            self._keep(at, where, what)
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

    def _press(self, since: float, z: Floats) -> None:
        """Add what the walls gave to the coordinates at rest, from their rest on."""
        whole = impulses_at_rest(self.scene, z, self.now - since)
        for place, contact in enumerate(self.scene.contacts):
            rest = self.contacts[contact]
            given = float(whole[place])
            if rest.rest > since:
                early = min(rest.rest, self.now) - since
                given -= float(impulses_at_rest(self.scene, z, early)[place])
            rest.impulse += given

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
        """The error of the state relative to the motion, in units of 2^-52."""
        return float(spread(self.Z, self.scene.basis.own, self.clock[7]))
