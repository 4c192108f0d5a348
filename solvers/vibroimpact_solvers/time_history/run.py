"""One motion with rigid limiters: free motion and impacts by the compiled loop, contacts here."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.kernels.deviations import SAFETY
from vibroimpact_solvers.kernels.impact_law import impulses
from vibroimpact_solvers.kernels.modal import NOTHING
from vibroimpact_solvers.kernels.rigid_motion import Stop, follow
from vibroimpact_solvers.kernels.rigid_state import IMPACT, PROGRESS, Rows, workspace
from vibroimpact_solvers.time_history.at_walls import CHATTER, AtWalls
from vibroimpact_solvers.time_history.basis import COLUMNS, Basis
from vibroimpact_solvers.time_history.contact_impulses import impulses as impulses_at_rest
from vibroimpact_solvers.time_history.structure import Configuration, Contact, Structure

Tick = Callable[[int, int], None]
Take = Callable[[Configuration, Floats, int], None]

_EPS = float(np.finfo(np.float64).eps)
_ROWS = 4096  # of the table that the compiled loop fills
_BUFFER = 2**21  # numbers in the buffer of samples
_EXPANSIONS = 2e7  # pairs expanded between two ticks
_SWITCHES = 50  # contacts that may begin and end at one and the same time


def budget(basis: Basis) -> int:
    """Return how many expansions may pass between two ticks."""
    return max(1000, int(_EXPANSIONS / max(1, basis.pairs)))


def new_table(structure: Structure) -> Rows:
    """Return an empty table of impacts, of `rigid_state.IMPACT`."""
    return np.empty(_ROWS + len(structure.system.constraints), IMPACT)


def new_progress(t_end: float, longest: float, expansions: int) -> Rows:
    """Return the progress of a motion that begins, of `rigid_state.PROGRESS`."""
    progress = np.zeros(1, PROGRESS)
    progress["end"], progress["longest"], progress["chatter"] = t_end, longest, CHATTER
    progress["budget"], progress["released"] = expansions, -1
    return progress


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
        estimate: bool = True,
        tick: Tick | None = None,
    ) -> None:
        self.structure, self.take, self.tick = structure, take, tick
        self.configuration = structure.configuration()
        self.scale = structure.scale
        self.output_times = output_times
        self.Z = np.empty((1 + (COLUMNS if estimate else 0), *z.shape))
        self.Z[0] = z
        basis = self.configuration.basis
        self.progress = new_progress(t_end, basis.longest, budget(basis))
        self.impacts, self.intervals = list[Rows](), list[ContactInterval]()
        self.contacts: dict[Contact, ContactInterval] = {}
        self._samples(self.configuration)
        self._table = new_table(structure)
        self._switched: tuple[float, int] = (-1.0, 0)

    def adopt(self, Z: Floats, progress: Rows, table: Rows, samples: Floats) -> None:
        """Continue a motion that the compiled loop has stopped, without contacts."""
        self.Z, self.progress, self._table, self._buffer = Z, progress, table, samples

    @property
    def progress_row(self) -> np.void:
        """The row of the progress."""
        return self.progress[0]  # type: ignore[no-any-return]

    # -- the loop --

    def finish(self, stop: Stop | None = None) -> None:
        """Follow the motion to its end; stop is why the compiled loop returned, if it has run."""
        while True:
            if stop is None:
                place = self._place
                stop = self._advance()
                if stop is Stop.PAUSE:
                    self._check_progress(place)
            self._flush_samples()
            self._flush_table(last=stop is Stop.END)
            if stop is Stop.END:
                break
            watched, side = int(self.progress_row["coordinate"]), int(self.progress_row["side"])
            if stop is Stop.CONTACT:
                self._rest(watched, side, float(self.progress_row["chatter_left"]))
            elif stop is Stop.RELEASE:
                self._release(watched)
            elif stop is Stop.IMPACT_IN_CONTACT:
                self._impact(watched, side)
            stop = None
        for rest in self.contacts.values():
            rest.stop = self.end
        if self.tick is not None:
            self.tick(1000, 1000)

    def _advance(self) -> Stop:
        if self.tick is not None:
            self.tick(int(1e3 * float(self.progress_row["time"]) / self.end), 1000)
        configuration, basis = self.configuration, self.configuration.basis
        self._check_walls_distinguishable()
        now = self.progress_row
        now["budget"] = now["expansions"] + budget(basis)
        now["stops_at_impacts"], now["longest"] = bool(self.contacts), basis.longest
        before = (self.now, self.Z[0].copy()) if self.contacts else None
        motion = (
            self.Z[0], self.Z[1:], self.progress, self._table, self.output_times, self._buffer,
        )  # fmt: skip
        stop, *_ = follow(configuration.arguments, motion, self._scratch, *NOTHING)
        if before is not None:
            self._add_contact_impulses(*before)
        return Stop(stop)

    def _check_walls_distinguishable(self) -> None:
        """Refuse a motion so large that its rounding exceeds the distance of its walls."""
        configuration, count = self.configuration, len(self.configuration.free)
        walls = configuration.kernel.walls[:count]
        coordinates = configuration.kernel.watched.coordinate[:count]
        sizes = np.abs(coordinates * self.Z[0]).sum(axis=(1, 2))
        apart = walls["lower"] + walls["upper"]
        for place in np.flatnonzero(_EPS * sizes >= apart):
            raise indistinguishable_walls(
                configuration.free[place], float(apart[place]), _EPS * float(sizes[place])
            )

    def _check_progress(self, before: tuple[float, float, int]) -> None:
        """Refuse a motion that keeps grazing a wall at one instant, within rounding."""
        if before == self._place:
            message = f"the motion keeps grazing at t = {self.now / self.scale!r}"
            raise ConvergenceError(message)

    @property
    def _place(self) -> tuple[float, float, int]:
        now = self.progress_row
        return float(now["time"]), float(now["time_rest"]), int(now["impacts"])

    @property
    def now(self) -> float:
        """The time, in units of the basis."""
        return float(self.progress_row["time"] + self.progress_row["time_rest"])

    @property
    def end(self) -> float:
        """The end of the motion, in units of the basis."""
        return float(self.progress_row["end"])

    @property
    def _latest(self) -> float:
        """The time after which nothing happens."""
        return self.end

    # -- samples and impacts from the compiled loop --

    def _samples(self, configuration: Configuration) -> None:
        rows = max(1, min(self.output_times.size, _BUFFER // max(1, 2 * configuration.basis.pairs)))
        pairs, watched = configuration.basis.pairs, configuration.kernel.walls.size
        self._buffer = np.empty((rows, 2, pairs))
        self._scratch = workspace(pairs, watched)

    def _flush_samples(self) -> None:
        first, count = int(self.progress_row["first_sample"]), int(self.progress_row["samples"])
        if count > first:
            self.take(self.configuration, self._buffer[: count - first], first)
        self.progress_row["first_sample"] = count

    def _flush_table(self, *, last: bool) -> None:
        count = int(self.progress_row["rows"])
        if count:
            rows = self._table[:count] if last else self._table[:count].copy()
            if self.configuration.contacts:
                free = np.array(self.configuration.free, dtype=np.int64)
                rows["constraint"] = free[rows["constraint"]]
            self.impacts.append(rows)
        self.progress_row["rows"] = 0

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
        """Begin the contact of a constraint that comes to rest at its wall, and of others with it.

        duration is that of its remaining chatter.
        """
        x, v = self._displacements()
        contact = self.configuration.free[watched], side
        self._begin_contacts(self._at_walls(x, v), contact, {contact: duration})
        self._resolve_contacts(x, v)

    def _at_walls(self, x: Floats, v: Floats) -> AtWalls:
        return AtWalls(self.structure, x, v, self.configuration.basis.loads_of(self.Z[0]))

    def _begin_contacts(
        self, at_walls: AtWalls, struck: Contact, known: dict[Contact, float]
    ) -> None:
        """Begin the contacts of coordinates that come to rest, those known to do so among them."""
        for contact, duration in (at_walls.come_to_rest(self.contacts, struck) | known).items():
            rest = ContactInterval(contact, self.now, min(self.now + duration, self._latest))
            self.contacts[contact] = rest
            self.intervals.append(rest)

    def _resolve_contacts(self, x: Floats, v: Floats) -> None:
        """Continue with the present contacts except those whose force would have to be tensile."""
        stays = self._at_walls(x, v).forces(self.contacts)
        for contact in sorted(set(self.contacts) - set(stays)):
            self._end_contact(contact)
            self._mark_released(contact[0])
        self._continue_from(x, v, frozenset(self.contacts))

    def _mark_released(self, constraint: int) -> None:
        configuration = self.structure.configuration(frozenset(self.contacts))
        self.progress_row["released"] = configuration.free.index(constraint)

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
        (index, s), *held = struck
        now = self.progress_row["time"], self.progress_row["time_rest"]
        row = (*now, s * speeds[0], given[0], self.growth, index, s)
        self.impacts.append(np.array([row], IMPACT))
        after = -sides * (W @ v)
        rounding = 1e-14 * float(np.abs(speeds).max())
        for contact, P, leaving in zip(held, given[1:], after[1:], strict=True):
            # Impulses of contacts are forces by time, this one is mass by velocity.
            self.contacts[contact].impulse += float(P) * self.scale**2
            if leaving > rounding:
                self._end_contact(contact)
        self._begin_contacts(self._at_walls(x, v), struck[0], {})
        self._resolve_contacts(x, v)

    @property
    def growth(self) -> float:
        """The error of the state relative to the motion, in units of 2^-52."""
        own, largest = self.configuration.basis.own, float(self.progress_row["largest"])
        squares = (own * self.Z[1:] ** 2).sum(axis=(1, 2))
        return SAFETY * math.sqrt(squares.max(initial=0.0)) / largest if largest > 0.0 else 0.0
