"""One motion with rigid limiters: free motion and impacts by the compiled loop, contacts here."""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.kernels.deviations import EPS, SAFETY
from vibroimpact_solvers.kernels.rigid_motion import Stop, follow
from vibroimpact_solvers.kernels.rigid_state import IMPACT, PROGRESS, Rows, workspace
from vibroimpact_solvers.meter import hold
from vibroimpact_solvers.time_history.answered_impact import AnsweredImpact, Moved
from vibroimpact_solvers.time_history.at_walls import CHATTER, AtWalls
from vibroimpact_solvers.time_history.basis import Basis
from vibroimpact_solvers.time_history.contact_errors import ContactErrors
from vibroimpact_solvers.time_history.contact_forces import Contact
from vibroimpact_solvers.time_history.contact_impulses import Struck
from vibroimpact_solvers.time_history.contact_impulses import impulses as impulses_at_rest
from vibroimpact_solvers.time_history.history import History
from vibroimpact_solvers.time_history.problem import Problem, tolerance_of
from vibroimpact_solvers.time_history.structure import Configuration, Structure

Tick = Callable[[int, int], None]

NO_START: Final = np.zeros((0, 0))
"""In place of initial displacements and velocities: the motion goes on from its state."""

_CONVERTED = 2.0  # roundings of a state that goes on as another one
_ROWS = 4096  # of the table that the compiled loop fills
WORK = 5_000_000  # between two ticks, of `kernels.rigid_state.PIECE`: some 5 ms
_SWITCHES = 50  # contacts that may begin and end at one time, as far as that is known
_REPEATED = 10  # of them, after which slow impacts at that time are taken for rounding
_SLOW = 1e-9  # speed of slow impacts over the velocities that it is made of, or
_ROUNDED = 32.0 * EPS  # over the largest velocity of the motion so far
_MOST_ROWS = 2**20  # impacts of a motion, or of a window of it, and
_MOST_EVENTS = 50_000  # those in contact; windows are planned for a tenth of that at most
_MOST_AFTERWARDS = 2_000  # those in contact where the motion is not predictable any more


def new_progress(structure: Structure, problem: Problem, t_end: float) -> Rows:
    """Return the progress of a motion that begins, of `rigid_state.PROGRESS`."""
    basis = structure.configuration().basis
    known = _BEGINNINGS.get(basis)
    if known is None:
        known = _BEGINNINGS[basis] = np.zeros(1, PROGRESS)
        known["longest"], known["chatter"], known["budget"] = basis.longest, CHATTER, WORK
        known["growth"], known["known_until"], known["released"] = 1.0, math.inf, -1
        known["unresolved"] = basis.modes.neglected / EPS
    progress = known.copy()
    progress["end"], progress["tolerance"] = t_end * structure.scale, tolerance_of(problem)
    progress["scale"] = structure.scale
    return progress


_BEGINNINGS: weakref.WeakKeyDictionary[Basis, Rows] = weakref.WeakKeyDictionary()


class Arrays:
    """What the compiled loop writes to, besides the history (`kernels.rigid_state`).

    Parameters
    ----------
    structure : Structure
    columns : int
        Number of deviations that are carried along for error estimates.
    dofs : int
        Number of degrees of freedom of the history.
    """

    def __init__(self, structure: Structure, columns: int, dofs: int) -> None:
        configuration = structure.configuration()
        self.Z = np.empty((1 + columns, 2, configuration.basis.pairs))
        self.progress: Rows = np.zeros(1, PROGRESS)
        self.table = np.empty(_ROWS + len(structure.system.constraints), IMPACT)
        self.work = work_arrays(configuration, dofs)
        # Views that would take as long to make as a short motion.
        self.progress_bytes = self.progress.view(np.uint8)
        self.state = self.Z[0], self.Z[1:], self.progress, self.table

    def start(self, state: Floats) -> None:
        """Start at a state, shape (2, pair); its deviations follow when the motion begins."""
        self.Z[0], self.Z[1:] = state, 0.0


def work_arrays(configuration: Configuration, dofs: int) -> tuple[Any, ...]:
    """Return the arrays of `rigid_state.workspace` for a configuration."""
    modes = configuration.basis.modes.roots.size
    return workspace(configuration.basis.pairs, configuration.kernel.walls.size, modes, dofs)


@dataclass
class ContactInterval:
    """A constraint in contact from a start to a stop: times in units of the basis.

    Their errors, and that of the impulse, are in the units of x.
    """

    contact: Contact
    start: float
    rest: float
    stop: float = math.nan
    impulse: float = 0.0
    bounce: float = 0.0  # length of the state that its speed is, of bounces until its rest
    start_error: float = math.nan
    rest_error: float = math.nan
    stop_error: float = math.nan
    impulse_error: float = math.nan


def indistinguishable_walls(index: int, apart: float, known: float) -> ConvergenceError:
    """Return the error of a coordinate whose uncertainty exceeds the distance of its walls."""
    return ConvergenceError(
        f"the limiters of constraint {index} are {apart:.3g} apart, and the motion is so large "
        f"that double precision knows the coordinate to {known:.1g} only"
    )


class Run:
    """A motion with rigid limiters that goes on from a state.

    Parameters
    ----------
    structure : Structure
    arrays : Arrays
        Its state and its progress, without contacts.
    problem : Problem
        Of which the output times and the degrees of freedom of the history are used.
    history : tuple
    tick : callable, optional
    """

    def __init__(
        self,
        structure: Structure,
        arrays: Arrays,
        problem: Problem,
        history: History,
        tick: Tick | None = None,
    ) -> None:
        self.structure, self.history, self.tick = structure, history, tick
        self.configuration, self.scale = structure.configuration(), structure.scale
        self.output_times, self.dofs = problem.history_times * self.scale, problem.output_dofs
        self.Z, self.progress, self._table = arrays.Z, arrays.progress, arrays.table
        self.progress_row: np.void = arrays.progress[0]
        """The row of the progress, a view."""
        self._work = arrays.work
        self.impacts, self.intervals = list[Rows](), list[ContactInterval]()
        self.contacts: dict[Contact, ContactInterval] = {}
        self._switched: tuple[float, int] = (-1.0, 0)
        self._errors = ContactErrors(problem, structure) if problem.estimate else None
        self._impulses = problem.contact_impulses
        self._event_error = math.nan  # of the time of what happens now, in the units of x
        self._begun = list[tuple[ContactInterval, Configuration, float, float]]()
        self._whole_end, self._segment = self.end, -1
        self.used = {self.configuration.contacts: self.configuration}
        self._rows = self._events = self._afterwards = 0

    # -- the loop --

    def finish(self, stop: Stop | None = None) -> None:
        """Follow the motion to its end; stop is why the compiled loop returned, if it has run."""
        while True:
            if stop is None or stop is Stop.PAUSE:
                if self.structure.ramps.count and self._segment < 0:
                    self._begin_segment(self.structure.ramps.segment(self.now / self.scale))
                place = self._place
                stop = self._advance()
                if stop is Stop.STILL and place == self._place:
                    self._begin_touch()
            self._flush_table()
            if stop is Stop.END:
                if self.end >= self._whole_end:
                    break
                self._begin_segment(self._segment + 1)
            else:
                self._check_number(stop)
            watched, side = int(self.progress_row["coordinate"]), int(self.progress_row["side"])
            if stop is Stop.CONTACT:
                self._rest(watched, side, float(self.progress_row["chatter_left"]))
            elif stop is Stop.RELEASE:
                self._release(watched)
            elif stop is Stop.IMPACT_IN_CONTACT:
                self._impact(watched, side)
            stop = None
        for rest in self.contacts.values():
            rest.stop, rest.stop_error = self.end, 0.0
        self._doubt_samples_of_bounces()
        if self.tick is not None:
            self.tick(1000, 1000)

    def _doubt_samples_of_bounces(self) -> None:
        """Let velocities while bounces last, which are one sum, be unknown by the first of them."""
        errors, times = self.history[-1][0], self.output_times
        for rest in self.intervals if errors.size else ():
            first, last = np.searchsorted(times, [rest.start, rest.rest], "right").tolist()
            errors[first:last] = np.maximum(errors[first:last], rest.bounce / EPS)

    def _begin_segment(self, segment: int) -> None:
        """Let loads vary as they do between two samples."""
        ramps, now = self.structure.ramps, self.now
        state = ramps.state(segment, now / self.scale)
        self.configuration.basis.set_ramps(self.Z, state)
        self._segment = segment
        until = math.inf
        if segment + 2 < ramps.times.size:
            until = float(ramps.times[segment + 1]) * self.scale
        self.progress_row["end"] = min(until, self._whole_end)

    def _check_number(self, stop: Stop) -> None:
        """Refuse a motion whose impacts are more than any plan expects of it.

        They come ever faster where they end in no rest: with k = 1, or as fast as they grow.
        """
        if stop in {Stop.TABLE, Stop.STILL}:
            self._check_rows()
            return
        lost = float(self.progress_row["known_until"]) < math.inf
        self._events += 1
        self._afterwards += lost
        if self._events > _MOST_EVENTS or self._afterwards > _MOST_AFTERWARDS:
            raise self._too_many(self._events)

    def _check_rows(self) -> None:
        if self._rows > _MOST_ROWS:
            raise self._too_many(self._rows)

    def _too_many(self, count: int) -> ConvergenceError:
        known, now = float(self.progress_row["known_until"]), self.now / self.scale
        return ConvergenceError(
            f"{count} impacts and contacts until t = {now!r} are many more than planned; the "
            f"motion is predictable until {min(known, now)!r}: ask for one that ends before"
        )

    def _advance(self) -> Stop:
        """Let the compiled loop go on until it stops for more than a pause."""
        configuration, basis = self.configuration, self.configuration.basis
        self._check_walls_distinguishable()
        now = self.progress_row
        now["budget"], now["longest"] = WORK, basis.longest
        before = (self.now, self.Z.copy()) if self.contacts and self._impulses else None
        times = self.output_times
        if self.end < self._whole_end:
            times = times[: np.searchsorted(times, self.end, "right")]
        motion = self.Z[0], self.Z[1:], self.progress, self._table, times
        modal = self.structure.modal(configuration, self.dofs)
        stop: int = Stop.PAUSE
        while stop == Stop.PAUSE:
            if self.tick is not None:
                self.tick(int(1e3 * float(now["time"]) / self._whole_end), 1000)
            stop, _ = follow(
                configuration.arguments, motion, self._work, modal, NO_START, NO_START, self.history
            )
        if before is not None:
            self._add_contact_impulses(*before)
        return Stop(stop)

    def _check_walls_distinguishable(self) -> None:
        """Refuse a motion so large that its rounding exceeds the distance of its walls."""
        if self.structure.narrowest_gap == math.inf:
            return
        configuration, count = self.configuration, len(self.configuration.free)
        walls = configuration.kernel.walls[:count]
        coordinates = configuration.kernel.watched.coordinate[:count]
        sizes = np.abs(coordinates * self.Z[0]).sum(axis=(1, 2))
        apart = walls["lower"] + walls["upper"]
        for place in np.flatnonzero(EPS * sizes >= apart):
            raise indistinguishable_walls(
                configuration.free[place], float(apart[place]), EPS * float(sizes[place])
            )

    def _begin_touch(self) -> None:
        """Let a coordinate rest that is at its wall and that only rounding takes away from it.

        Where there is none, the motion keeps grazing a wall at one instant, and is refused.
        """
        touching = self._at_walls(*self._displacements()).touching(self.contacts)
        if touching is None:
            message = f"the motion keeps grazing at t = {self.now / self.scale!r}"
            raise ConvergenceError(message)
        index, side = touching
        self._rest(self.configuration.free.index(index), side, 0.0)

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
        """The end of the motion, or of the time in which its loads do not bend, in the basis'."""
        return float(self.progress_row["end"])

    @property
    def _latest(self) -> float:
        """The time after which nothing happens."""
        return self._whole_end

    # -- impacts from the compiled loop --

    def _flush_table(self) -> None:
        now = self.progress_row
        rows = self._latest_rows.copy()
        hold(rows.nbytes)
        self.impacts.append(self._with_their_constraints(rows))
        self._rows += rows.size
        now["first_row"] = now["rows"] = 0

    @property
    def _latest_rows(self) -> Rows:
        """The impacts that the compiled loop has written since its table was emptied."""
        now = self.progress_row
        return self._table[now["first_row"] : now["rows"]]

    def _with_their_constraints(self, rows: Rows) -> Rows:
        """Let rows of the compiled loop name constraints, not their places among the free ones."""
        if self.configuration.contacts:
            free = np.array(self.configuration.free, dtype=np.int64)
            rows["constraint"] = free[rows["constraint"]]
        return rows

    @property
    def all_impacts(self) -> Rows:
        """The table of all impacts."""
        return np.concatenate(self.impacts, dtype=IMPACT)  # told, or found out for each pair

    # -- contacts --

    def _displacements(self) -> tuple[Floats, Floats]:
        """Return displacements and velocities (in the basis' time), each (dof,)."""
        return self.structure.displacements(self.configuration, self.Z[0])

    def _continue_from(self, x: Floats, v: Floats, contacts: frozenset[Contact]) -> None:
        """Continue from a state with these contacts."""
        loads = self.configuration.basis.loads_of(self.Z[0])
        moved = self._rounded(self._deviations(), self._roundings())
        configuration = self.structure.configuration(contacts)
        if configuration is not self.configuration:
            self.Z = np.empty((self.Z.shape[0], 2, configuration.basis.pairs))
            for c, (dx, dv) in enumerate(moved, start=1):
                self.Z[c] = self.structure.state_of(configuration, dx, dv)
            self.configuration = configuration
            self.used[configuration.contacts] = configuration
            self._work = work_arrays(configuration, self.dofs.size)
        self.Z[0] = self.structure.state_of(configuration, x, v, loads)
        configuration.basis.doubt_loads(self.Z)
        time, count = self._switched
        self._switched = (time, count + 1) if self._at_once(time) else (self.now, 1)
        if self._switched[1] > _SWITCHES:
            raise self._too_many(self._switched[1])

    def _add_contact_impulses(self, since: float, Z: Floats) -> None:
        """Add the impulses of the walls on the coordinates at rest, from their rest on."""
        configuration = self.configuration
        struck = self._struck(since)
        errors, z = self._impulse_errors(since, Z), Z[0]
        whole = impulses_at_rest(configuration, z, struck, self.now - since)
        for place, contact in enumerate(configuration.contacts):
            rest = self.contacts[contact]
            given = float(whole[place])
            if rest.rest > since:
                early = min(rest.rest, self.now) - since
                given -= float(impulses_at_rest(configuration, z, struck, early)[place])
            rest.impulse += given
            rest.impulse_error += float(errors[place])

    def _impulse_errors(self, since: float, Z: Floats) -> Floats:
        """Return the errors of what the contacts have given since a time, (contact,)."""
        configuration = self.configuration
        if self._errors is None:
            return np.full(len(configuration.contacts), math.nan)
        least = self._known_at_best
        forces = [self._errors.forces(configuration, state, least)[1] for state in (Z, self.Z)]
        answered = self._with_their_constraints(self._latest_rows.copy()), self._sizes
        span = (self.now - since) / self.scale
        return self._errors.impulses(configuration, answered, np.maximum(*forces), span)

    def _struck(self, since: float) -> Struck:
        """Return the impacts of the last free motions, which began at a time."""
        rows = self._latest_rows
        impulses = -rows["side"] * rows["impulse"] / self.scale
        return Struck(rows["time"] * self.scale - since, rows["constraint"].copy(), impulses)

    def _end_contact(self, contact: Contact) -> None:
        ended = self.contacts.pop(contact)
        ended.stop, ended.stop_error = self.now, self._event_error + EPS * self.now / self.scale

    def _tear_off(self, contact: Contact) -> None:
        """End a contact by an impact, whatever its force is."""
        errors, configuration, ended = self._errors, self.configuration, self.contacts[contact]
        self._end_contact(contact)
        if errors is not None and contact in configuration.contacts:
            forces, _ = errors.forces(configuration, self.Z, self._known_at_best)
            force = abs(float(forces[configuration.contacts.index(contact)]))
            if force > 0.0:
                ended.impulse_error += force * ended.stop_error

    def _rest(self, watched: int, side: int, duration: float) -> None:
        """Begin the contact of a constraint that comes to rest at its wall, and of others with it.

        duration is that of its remaining chatter.
        """
        x, v = self._displacements()
        contact = self.configuration.free[watched], side
        self._event_error = self._error_of_impact(contact)
        at_walls = self._at_walls(x, v)
        self._begin_contacts(at_walls, contact, {contact: duration})
        self._resolve_contacts(at_walls, x, v)

    def _error_of_impact(self, contact: Contact) -> float:
        """Return the error of the time of the last impact, where it was that of a contact now."""
        rows = self.impacts[-1][-len(self.configuration.free) :]
        now, (constraint, side) = self.now / self.scale, contact
        same = (rows["constraint"] == constraint) & (rows["side"] == side) & (rows["time"] == now)
        if self._errors is None or not same.any():
            return math.nan
        return float(self._errors.impacts(self.configuration, rows[same][-1:], self._sizes)[0][0])

    def _at_walls(self, x: Floats, v: Floats) -> AtWalls:
        return AtWalls(self.structure, x, v, self.configuration.basis.loads_of(self.Z[0]))

    def _begin_contacts(
        self, at_walls: AtWalls, struck: Contact, known: dict[Contact, float]
    ) -> None:
        """Begin the contacts of coordinates that come to rest, those known to do so among them."""
        for contact, duration in (at_walls.come_to_rest(self.contacts, struck) | known).items():
            rest = ContactInterval(contact, self.now, min(self.now + duration, self._latest))
            rest.impulse = 0.0 if self._impulses else math.nan
            self.contacts[contact] = rest
            self.intervals.append(rest)
            rest.bounce = at_walls.length(contact)
            self._doubt_place(rest.bounce, duration)
            late = float(self.progress_row["chatter_late"]) if contact in known else math.inf
            self._begun.append((rest, self.configuration, self._known, late / self.scale))

    def _doubt_place(self, speed: float, duration: float) -> None:
        """Let displacements be unknown by a speed, as a length of the state, while bounces last."""
        self._doubt(speed * duration)

    def _doubt(self, unknown: float) -> None:
        """Let the state be unknown by a length from now on."""
        now = self.progress_row
        if now["largest"] > 0.0:
            now["unresolved"] = max(now["unresolved"], unknown / (EPS * now["largest"]))

    def _resolve_contacts(self, at_walls: AtWalls, x: Floats, v: Floats) -> None:
        """Continue with the present contacts except those whose force would have to be tensile."""
        stays = at_walls.forces(self.contacts)
        for contact in sorted(set(self.contacts) - set(stays)):
            self._tear_off(contact)
            self._mark_released(contact[0])
        self._continue_from(x, v, frozenset(self.contacts))
        while self._begun:
            self._note_begin(*self._begun.pop())

    def _note_begin(
        self, rest: ContactInterval, before: Configuration, known: float, late: float
    ) -> None:
        """State the errors of a contact that has begun, which its bounces make late as told."""
        errors = self._errors
        if errors is None or rest.contact not in self.configuration.contacts:
            return
        if rest.rest == 0.0:  # it begins with the motion
            begun = errors.begin(self.configuration, rest.contact, self.Z, self._known_at_best)
            rest.start_error, rest.rest_error, rest.impulse_error = begun[0], *begun
            return
        lasts = (rest.rest - rest.start) / self.scale
        state = self.Z, max(known, self._known), self._known_at_best
        late, force = errors.rest(
            before, self.configuration, rest.contact, state, (lasts, late), self._sizes[1]
        )
        # Where nothing strikes it begins as it rests.
        rest.start_error = late if math.isnan(self._event_error) else self._event_error
        if self.structure.system.constraints[rest.contact[0]].restitution == 0.0:
            late = min(late, rest.start_error + lasts)
        rest.rest_error, rest.impulse_error = late + EPS * self.now / self.scale, force * late

    def _mark_released(self, constraint: int) -> None:
        configuration = self.structure.configuration(frozenset(self.contacts))
        self.progress_row["released"] = configuration.free.index(constraint)

    def _release(self, watched: int) -> None:
        x, v = self._displacements()
        place = watched - len(self.configuration.free)
        contact = self.configuration.contacts[place]
        if self._errors is not None:
            self._event_error = self._errors.release(
                self.configuration, place, self.Z, self._known_at_best
            )
        self._end_contact(contact)
        self._mark_released(contact[0])
        self._continue_from(x, v, frozenset(self.contacts))

    def _impact(self, watched: int, side: int) -> None:
        """Apply the impact of a constraint while others are in contact."""
        x, v = self._displacements()
        contact = self.configuration.free[watched], side
        idle = self.configuration.idle
        impact = AnsweredImpact.of(self.structure, (contact, *self.contacts), v, idle)
        if self._repeats(impact.speed, contact[0], v):
            self._doubt(self._at_walls(x, v).length(contact))
            self._rest(watched, side, 0.0)
            return
        moved, before, growth = self._deviations(), self._acceleration(), self.growth
        roundings = self._roundings()
        row = self._row(contact, impact, before, growth)
        error, given = self._error_of_answered(row), float(row["impulse"][0])
        leaving = -impact.rows @ impact.after
        for place, other in enumerate(list(self.contacts), start=1):
            # Impulses of contacts are forces by time, these are mass by velocity.
            answer, rest = float(impact.impulses[place]), self.contacts[other]
            rest.impulse += answer * self.scale**2
            if answer:
                share = answer / float(impact.impulses[0])
                rest.impulse_error += error * share + self._answer_rounding(contact, other) * given
            if leaving[place] > 1e-14 * abs(impact.speed):
                self._tear_off(other)
        at_walls = self._at_walls(x, impact.after)
        self._begin_contacts(at_walls, contact, {})
        self._resolve_contacts(at_walls, x, impact.after)
        if contact not in self.contacts and impact.leaves_slowly:
            self._mark_released(contact[0])
        if not impact.impulses[0] > 0.0:
            return
        size = float(self.structure.configuration().kernel.walls["size"][contact[0]])
        after, turned = self._acceleration(), list[Moved]()
        for c, deviation in enumerate(moved):
            off = -side * size if c & 1 else size  # the place of the wall, as in the kernel
            turned.append(impact.through(deviation, before, after, off))
        for c, (dx, dv) in enumerate(self._rounded(turned, roundings), start=1):
            self.Z[c] = self.structure.state_of(self.configuration, dx, dv)
        self.configuration.basis.doubt_loads(self.Z)
        self._doubt(impact.undecided)
        row["deviation"] = max(growth, self.growth)
        self._add_impact(row)

    def _at_once(self, time: float) -> bool:
        """Return whether no rounding of the motion tells a time from now."""
        return self.now - time <= EPS * max(1.0, self.now)

    def _repeats(self, speed: float, constraint: int, v: Floats) -> bool:
        """Return whether an impact is one of many at this time, with a speed that is rounding."""
        time, count = self._switched
        among = float(np.abs(self.structure.W[constraint]).max() * np.abs(v).max())
        largest = float(self.progress_row["largest"])
        largest *= math.sqrt(float(self.structure.mobility[constraint, constraint]))
        slow = speed <= max(_SLOW * among, _ROUNDED * largest)
        return self._at_once(time) and count > _REPEATED and slow

    def _answer_rounding(self, struck: Contact, other: Contact) -> float:
        """Return the rounding of the part of an impulse that a contact answers."""
        mobility = self.structure.mobility.diagonal()
        return _CONVERTED * EPS * math.sqrt(float(mobility[struck[0]] / mobility[other[0]]))

    def _row(self, contact: Contact, impact: AnsweredImpact, before: Floats, growth: float) -> Rows:
        """Return a row of the table of impacts, its error being that before the impact."""
        (constraint, side), scale = contact, self.scale
        velocity, impulse = scale * side * impact.speed, scale * float(impact.impulses[0])
        bend = scale**2 * float(self.structure.W[constraint] @ before)
        known = growth, growth * float(self.progress_row["largest"])
        row = self.now / scale, 0.0, velocity, impulse, bend, *known, constraint, side, impact.law
        return np.array([row], IMPACT)

    def _error_of_answered(self, row: Rows) -> float:
        """Note the error of the time of an impact, and return that of its impulse."""
        self._event_error = math.nan
        if self._errors is None or not row["impulse"][0] > 0.0:
            return math.nan
        times, impulses = self._errors.impacts(self.configuration, row, self._sizes)
        self._event_error = float(times[0])
        return float(impulses[0])

    def _deviations(self) -> list[Moved]:
        return [
            self.structure.displacements(self.configuration, Z, level=False) for Z in self.Z[1:]
        ]

    def _roundings(self) -> list[Moved]:
        """Return samples of the roundings of displacements and velocities, one per deviation.

        At every conversion of a state with the present contacts they are the same, as those of its
        matrices are: a motion that rests a hundred times is off by a hundred of them.
        """
        count = len(self.Z) - 1
        if not count:
            return []
        configuration = self.configuration
        sizes = _CONVERTED * np.stack(self.structure.magnitudes(configuration, self.Z[0]))
        source = np.random.default_rng(
            [1 + 2 * i + (side > 0) for i, side in configuration.contacts]
        )
        signs = source.choice([-1.0, 1.0], (count, *sizes.shape))
        return [(dx, dv) for dx, dv in signs * sizes]

    @staticmethod
    def _rounded(moved: list[Moved], roundings: list[Moved]) -> list[Moved]:
        """Add roundings to deviations, both in units of 2^-52."""
        pairs = zip(moved, roundings, strict=True)
        return [(dx + rx, dv + rv) for (dx, dv), (rx, rv) in pairs]

    def _acceleration(self) -> Floats:
        rate = self.configuration.basis.rate(self.Z[0])
        return self.structure.displacements(self.configuration, rate, level=False)[1]

    def _add_impact(self, row: Rows) -> None:
        """Add a row to the table of impacts."""
        now, time, growth = self.progress_row, self.now / self.scale, float(row["deviation"][0])
        self.impacts.append(row)
        if not growth <= now["growth"]:
            now["growth"] = growth
        if not growth * EPS <= now["tolerance"] and now["known_until"] == math.inf:
            now["known_until"] = time

    @property
    def _sizes(self) -> tuple[float, float]:
        """The length of the largest state, and the largest distance from a wall at an impact."""
        now = self.progress_row
        return float(now["largest"]), float(now["penetration"])

    @property
    def _known(self) -> float:
        """The length to which the state is known, that of two roundings of it included."""
        return EPS * (self.growth + 2.0) * float(self.progress_row["largest"])

    @property
    def _known_at_best(self) -> float:
        """The length to which the state is known whatever its deviations are."""
        now = self.progress_row
        return EPS * (float(now["unresolved"]) + 2.0) * float(now["largest"])

    @property
    def growth(self) -> float:
        """The error of the state relative to the motion, in units of 2^-52."""
        basis, now = self.configuration.basis, self.progress_row
        sampled = SAFETY * max(map(basis.length, self.Z[1:]), default=0.0)
        error = sampled / float(now["largest"]) if now["largest"] > 0.0 else 0.0
        return max(error, float(now["unresolved"]))
