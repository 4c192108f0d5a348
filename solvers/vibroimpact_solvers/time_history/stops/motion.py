"""A motion with stops of finite stiffness: exact between switchings, none of which is missed."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.kernels.next_impact import SIMULTANEOUS
from vibroimpact_solvers.kernels.rigid_state import ANEW, IMPACT, PROGRESS
from vibroimpact_solvers.kernels.switchings import (
    END,
    PAUSE,
    SAMPLES,
    SWITCH,
    follow_until_switch,
)
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.time_history.basis import COLUMNS
from vibroimpact_solvers.time_history.problem import Problem, State, tolerance_of
from vibroimpact_solvers.time_history.run import WORK, Tick
from vibroimpact_solvers.time_history.stops.configurations import (
    LOADED,
    OPEN,
    RELEASED,
    Passage,
    Scene,
    States,
    StoppedStructure,
)
from vibroimpact_solvers.time_history.stops.contacts import SAMPLED, Contacts, error_of, spread_of
from vibroimpact_solvers.time_history.stops.samples import Samples

_ROWS: Final = 64  # samples that are taken at once
_SWITCHES: Final = 200  # at one instant, more of which are taken for rounding
_MOST: Final = 2_000_000  # switchings of a motion
_CONVERTED: Final = 2.0  # roundings of a state that goes on as another one
_FOUND: Final = 4.0  # roundings within which a form is zero
_CLEAR: Final = 64.0  # roundings of a slope that has a sign
_APART: Final = 7  # rows of signs between those of two deviations
_EACH: Final = np.arange(1, 1 + COLUMNS)
_SLOWEST: Final = 1e-300
_NONE: Final = np.empty(0, IMPACT)


class StoppedMotion:
    """One motion of a structure with stops of finite stiffness.

    Parameters
    ----------
    structure : StoppedStructure
    problem : Problem
        With displacements and velocities as initial state.
    samples : Samples
        What becomes of the states at the output times.

    Attributes
    ----------
    contacts : Contacts
    progress : array, shape (1,)
        Of `rigid_state.PROGRESS`.
    """

    def __init__(self, structure: StoppedStructure, problem: Problem, samples: Samples) -> None:
        self._structure, self._samples = structure, samples
        self.contacts = Contacts(structure, wanted="contacts" in problem.outputs)
        self._times = problem.history_times * structure.scale
        self._end = problem.t_end * structure.scale
        self._columns = COLUMNS if problem.estimate else 0
        self._works = dict[States, tuple[Any, ...]]()
        self._switches = 0
        self._room = 0.0  # roundings that a form which was zero has been given
        self.progress = np.zeros(1, PROGRESS)
        now = self.progress[0]
        now["budget"], now["growth"], now["known_until"] = WORK, 1.0, math.inf
        now["released"], now["end"], now["tolerance"] = -1, self._end, tolerance_of(problem)
        now["scale"] = structure.scale

    def follow(self, initial: State, tick: Tick | None = None) -> None:
        """Follow the motion from an initial state to its end.

        Raises
        ------
        ConvergenceError
            Where stops keep switching, or more often than any plan expects.
        """
        self._begin(initial)
        ramps, now, still = self._structure.structure.ramps, self.progress[0], 0
        segment = self._begin_segment(ramps.segment(0.0)) if ramps.count else -1
        while True:
            before = self._now
            stop, who = self._advance(tick)
            if stop == END:
                if float(now["end"]) >= self._end:
                    break
                segment = self._begin_segment(segment + 1)
                continue
            if stop == SWITCH:
                self._switch(who)
            still = still + 1 if self._now == before else 0
            self._check(still)
        self._close()
        if tick is not None:
            tick(1000, 1000)

    # -- the loop --

    def _begin(self, initial: State) -> None:
        structure = self._structure
        y, rate = structure.structure.W @ initial.x, structure.structure.W @ initial.v
        scene = structure.scene(structure.initial_states(y, rate))
        self._enter(scene)
        basis, modes = scene.basis, scene.basis.modes
        moves = initial.x - modes.base, initial.v / structure.scale
        q, speed = np.stack(moves) @ modes.weighted
        self._Z = np.zeros((1 + self._columns, 2, basis.pairs))
        self._Z[0] = basis.pairs_of(q - basis.still, speed, basis.loads_at_start())
        self.progress[0]["unresolved"] = modes.neglected / EPS
        self._buffer()
        for a, code in enumerate(scene.states):
            if abs(code) == LOADED:
                speed = float(rate[a]) / structure.scale
                self.contacts.start(a, _side(code), 0.0, 0.0, speed, 0.0)
        if self._columns:
            # Deviations start in a motion that does not get on; then those of its state are added.
            self.progress[0]["end"] = 0.0
            self._advance(None)
            self.progress[0]["end"] = self._end
            terms = (np.abs(initial.x) + np.abs(modes.base)) @ np.abs(modes.weighted)
            size = scene.placed.sizes_of(terms + scene.placed.terms).reshape(2, -1)
            for column in range(1, len(self._Z)):
                self._Z[column] += _CONVERTED * size * basis.signs[3 * column % len(basis.signs)]

    def _enter(self, scene: Scene) -> None:
        """Go on in a scene, with work arrays of this motion's own."""
        self._scene = scene
        work = self._works.get(scene.states)
        if work is None:
            work = self._works[scene.states] = scene.workspace()
        self._work = work
        *_, piece = work
        piece["stage"] = ANEW

    def _buffer(self) -> None:
        """Make room for samples of the present basis."""
        shape = min(_ROWS, self._times.size), *self._Z.shape[1:]
        self._sampled = np.empty(shape), np.empty(shape)

    def _begin_segment(self, segment: int) -> int:
        """Let loads vary as they do between two samples."""
        ramps, scale = self._structure.structure.ramps, self._structure.scale
        self._scene.basis.set_ramps(self._Z, ramps.state(segment, self._now / scale))
        until = math.inf
        if segment + 2 < ramps.times.size:
            until = float(ramps.times[segment + 1]) * scale
        self.progress[0]["end"] = min(until, self._end)
        return segment

    def _advance(self, tick: Tick | None) -> tuple[int, int]:
        """Go on until a stop switches, or to the end of the time in which loads do not bend."""
        scene, now = self._scene, self.progress[0]
        now["longest"] = scene.basis.longest
        modes, began = scene.basis.modes.roots.size, self._now
        motion = self._Z[0], self._Z[1:], self.progress, _NONE, self._times
        z, stop, who = self._Z[0].copy(), PAUSE, -1
        spread = self._spread() if self.contacts.lasting else _NOTHING
        while stop in {PAUSE, SAMPLES}:
            stop, who, _ = follow_until_switch(
                scene.arguments, motion, self._work, modes, *self._sampled
            )
            self._flush()
            if tick is not None:
                tick(int(1e3 * float(now["time"]) / self._end), 1000)
            look()
        if self.contacts.lasting:
            states = z, self._Z[0]
            spreads = spread, self._spread()
            self.contacts.add(scene, self._work, states, self._now - began, spreads)
        return stop, who

    def _flush(self) -> None:
        """Hand on the samples that were taken."""
        now = self.progress[0]
        first, last = int(now["written"]), int(now["samples"])
        if last > first:
            states, spreads = (part[: last - first] for part in self._sampled)
            self._samples.take(self._scene, slice(first, last), states, spreads)
            now["written"] = last

    @property
    def _now(self) -> float:
        """The time, in units of the basis."""
        now = self.progress[0]
        return float(now["time"] + now["time_rest"])

    def _spread(self) -> Floats:
        return spread_of(self._Z[1:], self._scene.basis.flow.rotations)

    def _check(self, still: int) -> None:
        """Refuse a motion that does not get on, or switches more often than any plan expects."""
        self._switches += 1
        time = self._now / self._structure.scale
        if still > _SWITCHES:
            raise ConvergenceError(f"stops keep switching at t = {time!r}, which rounding decides")
        if self._switches > _MOST:
            message = f"{self._switches} switchings of stops until t = {time!r} are too many"
            raise ConvergenceError(f"{message}: ask for a motion that ends before")

    def _close(self) -> None:
        """End what lasts at the end of the motion."""
        for a, code in enumerate(self._scene.states):
            if abs(code) == LOADED:
                self.contacts.stop(a, self._end, 0.0)
            elif abs(code) == RELEASED:
                self.contacts.end_release(a, *self._indentation(a, code))

    # -- switchings --

    def _switch(self, who: int) -> None:
        """Let the stop whose form is zero change its state."""
        scene, count = self._scene, len(self._scene.states)
        forced = who >= count
        a = scene.forces[who - count] if forced else who
        code = scene.states[a]
        new = self._next(a, code, forced)
        if self.contacts.wanted:
            self._account(a, code, new, self._time_error(who))
        self._change((*scene.states[:a], new, *scene.states[a + 1 :]), a)

    def _account(self, a: int, code: int, new: int, error: float) -> None:
        """Enter a switching at a time that is known to an error into the table of contacts."""
        if abs(code) == RELEASED:
            self.contacts.end_release(a, *self._indentation(a, code))
        if abs(code) == LOADED:
            self.contacts.stop(a, self._now, error)
        if abs(new) == RELEASED:
            self.contacts.release(a, *self._indentation(a, new))
        if abs(new) == LOADED:
            self._start(a, _side(new), error)

    def _start(self, a: int, side: int, error: float) -> None:
        """Begin a contact phase at a time that is known to an error."""
        scene, z = self._scene, self._Z[0]
        slides = scene.kernel.watched.velocity[a]
        speed, bends = float((slides * z).sum()), 0.0
        if self._structure.damping[a] > 0.0:
            # As far as the time is unknown, the speed is, and the first force with it.
            rate = scene.basis.rates_of(slides[np.newaxis])[0]
            bends = float((rate * z).sum() + slides[1] @ scene.basis.push)
        self.contacts.start(a, side, self._now, error, speed, abs(bends) * error)

    def _next(self, a: int, code: int, forced: bool) -> int:
        """Return the state of a stop after one of its forms became zero."""
        if code == OPEN:
            if (only := self._structure.only_side[a]) != 0:
                return only * LOADED
            lower, upper = self._structure.walls[:, a].tolist()
            y = self._coordinate(a)
            return LOADED if abs(y - upper) <= abs(y + lower) else -LOADED
        if abs(code) == LOADED:
            # Without a dashpot the force is lost at the wall itself.
            return _side(code) * RELEASED if self._structure.damping[a] > 0.0 else OPEN
        return _side(code) * LOADED if forced else OPEN

    def _coordinate(self, a: int) -> float:
        form = self._scene.kernel.watched.coordinate[a]
        return float((form * self._Z[0]).sum() + self._scene.placed.levels[a])

    def _indentation(self, a: int, code: int) -> tuple[float, float]:
        """Return how far a coordinate is beyond its wall, and the error of that."""
        form, side = self._scene.kernel.watched.coordinate[a], _side(code)
        placed = self._scene.placed
        error = error_of(form, self._spread())
        if abs(self._scene.states[a]) == LOADED:
            return side * float((form * self._Z[0]).sum()) + float(placed.indentations[a]), error
        return side * self._coordinate(a) - self._structure.wall(a, side), error

    def _time_error(self, who: int) -> float:
        """Return the error of the time at which a watched form became zero, just now."""
        scene, z = self._scene, self._Z[0].ravel()
        slope = float(scene.kernel.watched.velocity[who].ravel() @ z + scene.rises[who])
        sizes = scene.sizes[0, who]
        terms = float(sizes @ np.abs(z)) + float(scene.kernel.walls[who]["size"])
        error = SAMPLED * EPS * float(sizes @ self._spread().ravel())
        error += (_FOUND + self._room) * EPS * terms
        return error / max(abs(slope), _SLOWEST)

    def _change(self, states: States, a: int) -> None:
        """Go on in another state of the stops, of which a has switched."""
        before, after = self._scene, self._structure.scene(states)
        passage = self._structure.passage(before, after)
        flat = self._Z.reshape(len(self._Z), -1)
        moved = flat @ passage.matrix.T
        moved[0] += passage.offset
        if self._columns:
            self._add_errors(after, flat, moved, passage, a)
        pairs = self._Z.shape[2]
        self._Z = moved.reshape(len(moved), 2, -1)
        if self._Z.shape[2] != pairs:
            self._buffer()
        if self._columns and after.basis.load_places.size:
            after.basis.doubt_loads(self._Z)  # their responses err as those of this structure do
        self._enter(after)
        place = a if states[a] == OPEN else len(states) + after.forces.index(a)
        leaves = self._leaves(place)
        self.progress[0]["released"] = -1 if leaves else place
        self._room = 0.0 if leaves else 2.0 * SIMULTANEOUS

    def _leaves(self, place: int) -> bool:
        """Return whether a form that is zero moves away from it, whatever rounding makes of it.

        Otherwise it is given some room, so that the motion gets on (`next_impact`).
        """
        kernel = self._scene.kernel
        form, z, rises = kernel.watched.velocity[place].ravel(), self._Z[0].ravel(), 0.0
        if self._scene.pushed:
            rises = float(self._scene.rises[place])
        slope = float(form @ z) + rises
        walls = kernel.walls[place]
        lower, upper = float(walls["lower"]), float(walls["upper"])
        if math.isfinite(lower) and math.isfinite(upper):
            y = float(kernel.watched.coordinate[place].ravel() @ z)
            slope = slope if abs(y - upper) > abs(y + lower) else -slope
        elif math.isfinite(upper):
            slope = -slope
        return slope > _CLEAR * EPS * (float(np.abs(form) @ np.abs(z)) + abs(rises))

    def _add_errors(
        self, after: Scene, flat: Floats, moved: Floats, passage: Passage, a: int
    ) -> None:
        """Add roundings of a switching to deviations, and what a jump of a force makes of them."""
        structure, before = self._structure, self._scene
        c, signs = structure.damping[a] / structure.scale, after.basis.signs
        if before.states[a] == OPEN and c > 0.0:
            # A dashpot that begins to push earlier has pushed by c times the way till then.
            form = before.kernel.watched.coordinate[a].ravel()
            wall = before.kernel.walls["size"][a]
            terms = float(np.abs(form * flat[0]).sum() + wall)
            place = (_FOUND + self._room) * terms
            off = flat[1:] @ form + place * signs[: len(moved) - 1, 0, 0]
            moved[1:] -= np.outer(c * off, after.kernel.watched.kick[a].ravel())
        size, state = _CONVERTED * passage.rounding(flat[0]), flat[0].reshape(2, -1)
        fixed = _CONVERTED * np.abs(moved[0])
        if before.placed.mixing is not None:
            missed = before.placed.mixed(state)
            fixed = fixed + passage.sizes @ np.broadcast_to(missed, state.shape).ravel() / EPS
        if after.placed.mixing is not None:
            missed = after.placed.mixed(moved[0].reshape(2, -1))
            fixed = fixed + np.broadcast_to(missed, (2, after.basis.pairs)).ravel() / EPS
        rows = signs.reshape(len(signs), -1)
        moved[1:] += size * rows[(self._switches + _APART * _EACH) % len(rows)]
        # Errors of the modes themselves are the same at every switching.
        moved[1:] += np.copysign(fixed, moved[0]) * rows[1 : 1 + self._columns]


def _side(code: int) -> int:
    return 1 if code > 0 else -1


_NOTHING: Final = np.zeros((2, 0))
