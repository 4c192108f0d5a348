"""One motion with rigid limiters: free motion and impacts by the compiled loop, contacts here."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.kernels.free_motion import (
    Stop,
    advance,
    estimated_error,
    impulses,
    start_deviations,
    workspace,
)
from vibroimpact_solvers.time_history.basis import COLUMNS, Basis
from vibroimpact_solvers.time_history.contact_impulses import impulses as impulses_at_rest
from vibroimpact_solvers.time_history.structure import Configuration, Contact, Structure

Tick = Callable[[int, int], None]
Take = Callable[[Configuration, Floats, int], None]
Table = tuple[Floats, Integers, Floats]

CHATTER: Final = 1e-8
"""Remaining time of a chatter, in units of the fastest mode, below which it is one sum."""

_EPS = float(np.finfo(np.float64).eps)
_ROWS = 4096  # of the table that the compiled loop fills
_BUFFER = 2**21  # numbers in the buffer of samples
_EXPANSIONS = 2e7  # pairs expanded between two ticks
_SWITCHES = 50  # contacts that may begin and end at one and the same time


def budget(basis: Basis) -> int:
    """Return how many expansions may pass between two ticks."""
    return max(1000, int(_EXPANSIONS / max(1, basis.pairs)))


def new_table(structure: Structure) -> Table:
    """Return an empty table of impacts (`kernels.free_motion.advance`)."""
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
class ContactInterval:
    """A constraint in contact from a start to a stop: times in units of the basis."""

    contact: Contact
    start: float
    rest: float
    stop: float = math.nan
    impulse: float = 0.0


def indistinguishable_walls(index: int, apart: float, known: float) -> ConvergenceError:
    """Return the error of a coordinate whose uncertainty exceeds the distance of its walls."""
    return ConvergenceError(
        f"the limiters of constraint {index} are {apart:.3g} apart, and the motion is so large "
        f"that double precision knows the coordinate to {known:.1g} only"
    )


class Run:
    """A motion with rigid limiters.

    Parameters
    ----------
    structure : Structure
    z : array, shape (2, pair)
        Initial state, without contacts.
    output_times : array, shape (time,)
        Times at which `take` is given the state, in units of the basis.
    t_end : float
        In these units too.
    take : callable
        Called with the configuration, states (time, 2, pair) and the index of the first of them.
    keep : bool
        Whether the table of impacts is kept.
    estimate : bool
        Whether errors are estimated.
    """

    def __init__(
        self,
        structure: Structure,
        z: Floats,
        output_times: Floats,
        t_end: float,
        take: Take,
        *,
        keep: bool,
        estimate: bool = True,
        tick: Tick | None = None,
    ) -> None:
        self.structure, self.take, self.tick = structure, take, tick
        self.configuration = structure.configuration()
        self.scale = structure.scale
        self.output_times = output_times
        self.columns = COLUMNS if estimate else 0
        self.clock = np.zeros(8)
        self.Z = np.empty((1 + self.columns, *z.shape))
        self.Z[0] = z
        basis = self.configuration.basis
        start_deviations(self.Z, basis.noise, basis.own, self.clock)
        self.clock[2], self.clock[4] = t_end, CHATTER
        self.counts = np.zeros(11, dtype=np.int64)
        self.impacts, self.intervals = Impacts(keep), list[ContactInterval]()
        self.contacts: dict[Contact, ContactInterval] = {}
        self._samples(self.configuration)
        self._table = new_table(structure)
        self._switched: tuple[float, int] = (-1.0, 0)

    def adopt(
        self, Z: Floats, clock: Floats, counts: Integers, table: Table, samples: Floats
    ) -> None:
        """Continue a motion that the compiled loop has stopped, without contacts."""
        self.Z, self.clock, self.counts, self._table = Z, clock, counts, table
        self._buffer = samples

    # -- the loop --

    def finish(self, stop: Stop | None = None) -> None:
        """Follow the motion to its end; stop is why the compiled loop returned, if it has run."""
        while True:
            if stop is None:
                place = (self.clock[0], self.clock[1], self.counts[10])
                stop = self._advance()
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
                self._impact(int(self.counts[5]), int(self.counts[6]))
            stop = None
        for rest in self.contacts.values():
            rest.stop = self.clock[2]
        if self.tick is not None:
            self.tick(1000, 1000)

    def _advance(self) -> Stop:
        if self.tick is not None:
            self.tick(int(1e3 * self.clock[0] / self.clock[2]), 1000)
        configuration, basis = self.configuration, self.configuration.basis
        self._check_walls_distinguishable()
        self.counts[3] = self.counts[2] + budget(basis)
        self.counts[7] = bool(self.contacts)
        self.clock[3] = basis.longest
        before = (self.now, self.Z[0].copy()) if self.contacts else None
        stop = Stop(
            advance(
                basis.rates, basis.split, configuration.forms, configuration.sizes,
                configuration.walls, configuration.mobility, self.Z, basis.noise, basis.drifts,
                configuration.bends, basis.own, self.clock, self.counts, *self._table,
                self.output_times, self._buffer, *self._workspace,
            )
        )  # fmt: skip
        if before is not None:
            self._add_contact_impulses(*before)
        return stop

    def _check_walls_distinguishable(self) -> None:
        """Refuse a motion so large that its rounding exceeds the distance of its walls."""
        configuration, count = self.configuration, len(self.configuration.free)
        sizes = np.abs(configuration.forms[0, :count] * self.Z[0]).sum(axis=(1, 2))
        apart = configuration.walls[0, :count] + configuration.walls[1, :count]
        for place in np.flatnonzero(_EPS * sizes >= apart):
            raise indistinguishable_walls(
                configuration.free[place], float(apart[place]), _EPS * float(sizes[place])
            )

    def _check_progress(self, before: tuple[float, float, int]) -> None:
        """Refuse a motion that keeps grazing a wall at one instant, within rounding."""
        if before == (self.clock[0], self.clock[1], self.counts[10]):
            message = f"the motion keeps grazing at t = {self.now / self.scale!r}"
            raise ConvergenceError(message)

    @property
    def now(self) -> float:
        """The time, in units of the basis."""
        return float(self.clock[0] + self.clock[1])

    # -- samples and impacts from the compiled loop --

    def _samples(self, configuration: Configuration) -> None:
        rows = max(1, min(self.output_times.size, _BUFFER // max(1, 2 * configuration.basis.pairs)))
        self._buffer = np.empty((rows, 2, configuration.basis.pairs))
        self._workspace = workspace(configuration.basis.pairs, configuration.walls.shape[1])

    def _flush_samples(self) -> None:
        first, count = int(self.counts[4]), int(self.counts[1])
        if count > first:
            self.take(self.configuration, self._buffer[: count - first], first)
        self.counts[4] = count

    def _flush_table(self, *, last: bool) -> None:
        count = int(self.counts[0])
        if count:
            at, where, what = self._table
            at, where, what = at[:count], where[:count], what[:count]
            if not last:
                at, where, what = at.copy(), where.copy(), what.copy()
            if self.configuration.contacts:
                where[:, 0] = np.array(self.configuration.free, dtype=np.int64)[where[:, 0]]
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

    def _displacements(self) -> tuple[Floats, Floats]:
        """Return displacements and velocities (in the basis' time), each (dof,)."""
        return self.structure.displacements(self.configuration, self.Z[0])

    def _continue_from(self, x: Floats, v: Floats, contacts: frozenset[Contact]) -> None:
        """Continue from a state with these contacts."""
        loads = self.configuration.basis.loads_of(self.Z[0])
        moved = [
            self.structure.displacements(self.configuration, X, level=False) for X in self.Z[1:]
        ]
        configuration = self.structure.configuration(contacts)
        if configuration is not self.configuration:
            self.Z = np.empty((self.Z.shape[0], 2, configuration.basis.pairs))
            for c, (dx, dv) in enumerate(moved, start=1):
                self.Z[c] = self.structure.state_of(configuration, dx, dv)
            self.configuration = configuration
            self._samples(configuration)
        self.Z[0] = self.structure.state_of(configuration, x, v, loads)
        time, count = self._switched
        self._switched = (self.now, count + 1 if self.now == time else 1)
        if self._switched[1] > _SWITCHES:
            message = f"contacts begin and end without end at t = {self.now / self.scale!r}"
            raise ConvergenceError(message)

    def _begin_contact(self, contact: Contact, duration: float) -> None:
        rest = ContactInterval(contact, self.now, min(self.now + duration, self.clock[2]))
        self.contacts[contact] = rest
        self.intervals.append(rest)

    def _add_contact_impulses(self, since: float, z: Floats) -> None:
        """Add the impulses of the walls on the coordinates at rest, from their rest on."""
        whole = impulses_at_rest(self.configuration, z, self.now - since)
        for place, contact in enumerate(self.configuration.contacts):
            rest = self.contacts[contact]
            given = float(whole[place])
            if rest.rest > since:
                early = min(rest.rest, self.now) - since
                given -= float(impulses_at_rest(self.configuration, z, early)[place])
            rest.impulse += given

    def _end_contact(self, contact: Contact) -> None:
        self.contacts.pop(contact).stop = self.now

    def _rest(self, watched: int, side: int, duration: float) -> None:
        """Begin the contact of a constraint that comes to rest at its wall."""
        x, v = self._displacements()
        self._begin_contact((self.configuration.free[watched], side), duration)
        self._resolve_contacts(x, v)

    def _resolve_contacts(self, x: Floats, v: Floats) -> None:
        """Continue with the present contacts except those whose force would have to be tensile."""
        while True:
            contacts = frozenset(self.contacts)
            configuration = self.structure.configuration(contacts)
            z = self.structure.state_of(
                configuration, x, v, self.configuration.basis.loads_of(self.Z[0])
            )
            forces = self.structure.contact_forces(configuration, z)
            # A force that is rounding may still grow: the search decides about it.
            pulled = [c for c, f, rounding in forces if f < -rounding]
            if not pulled:
                break
            self._end_contact(pulled[0])
            released = pulled[0][0]
            self.counts[9] = 0
            if not self.contacts or released is not None:
                self._mark_released(released)
        self._continue_from(x, v, contacts)

    def _mark_released(self, constraint: int) -> None:
        configuration = self.structure.configuration(frozenset(self.contacts))
        self.counts[9] = 1 + configuration.free.index(constraint)

    def _release(self, watched: int) -> None:
        x, v = self._displacements()
        contact = self.configuration.contacts[watched - len(self.configuration.free)]
        self._end_contact(contact)
        self._mark_released(contact[0])
        self._continue_from(x, v, frozenset(self.contacts))

    def _impact(self, watched: int, side: int) -> None:
        """Apply the impact of a constraint while others are in contact."""
        x, v = self._displacements()
        structure = self.structure
        struck = [(self.configuration.free[watched], side), *self.contacts]
        indices = np.array([index for index, _ in struck], dtype=np.int64)
        sides = np.array([s for _, s in struck], dtype=np.float64)
        W = structure.W[indices]
        speeds = sides * (W @ v)
        speeds[1:] = 0.0
        restitution = np.array([c.restitution for c in structure.system.constraints])
        given = impulses(structure.mobility, restitution, indices, sides, speeds)
        v = v - structure.mass_solve(W.T @ (sides * given))
        growth = self.growth
        for (index, s), P, speed in zip(struck, given, speeds, strict=True):
            if P > 0.0:
                at = self.clock[np.newaxis, :2].copy()
                what = np.array([[s * speed, P, growth]])
                self._keep(at, np.array([[index, s]]), what)
        after = -sides * (W @ v)
        rounding = 1e-14 * float(np.abs(speeds).max())
        for contact, leaving in list(zip(struck, after, strict=True))[1:]:
            if leaving > rounding:
                self._end_contact(contact)
        # Does it come to rest too?
        configuration = structure.configuration(frozenset(self.contacts))
        loads = self.configuration.basis.loads_of(self.Z[0])
        pressed = structure.acceleration_towards(
            configuration, structure.state_of(configuration, x, v, loads), struck[0]
        )
        k, leaving = restitution[struck[0][0]], max(float(after[0]), 0.0)
        if speeds[0] <= 0.0 or leaving <= rounding:
            leaving = 0.0
        duration = 0.0 if leaving == 0.0 else math.inf
        if leaving > 0.0 and pressed > 0.0 and k < 1.0:
            duration = 2.0 * leaving / (pressed * (1.0 - k))
        if pressed >= 0.0 and duration <= CHATTER:
            self._begin_contact(struck[0], duration)
        self._resolve_contacts(x, v)

    @property
    def growth(self) -> float:
        """The error of the state relative to the motion, in units of 2^-52."""
        return float(estimated_error(self.Z, self.configuration.basis.own, self.clock[7]))
