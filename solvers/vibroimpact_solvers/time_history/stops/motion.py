"""A motion with stops of finite stiffness: the compiled loop, and what it needs on the way."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.kernels.contact_phases import MARKS, NONE, PHASE
from vibroimpact_solvers.kernels.rigid_state import IMPACT, PROGRESS, Rows, workspace
from vibroimpact_solvers.kernels.scene_changes import COURSE, spare_size
from vibroimpact_solvers.kernels.switchings import Stop, follow
from vibroimpact_solvers.meter import hold, look
from vibroimpact_solvers.time_history.basis import COLUMNS
from vibroimpact_solvers.time_history.problem import Problem, State, tolerance_of
from vibroimpact_solvers.time_history.run import WORK, Tick
from vibroimpact_solvers.time_history.stops.configurations import StoppedStructure
from vibroimpact_solvers.time_history.stops.samples import Samples
from vibroimpact_solvers.time_history.stops.scenes import Scene

_NUMBERS: Final = 2**16  # of samples that are taken at once, or
_ROWS: Final = 16  # so many samples, however many pairs there are
_PHASES: Final = 64  # rows of the first table of contacts
_KEPT: Final = 4  # states besides that of the motion
_NO_IMPACTS: Final = np.empty(0, IMPACT)


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
    progress, course : array, shape (1,)
        Of `rigid_state.PROGRESS` and `scene_changes.COURSE`.
    """

    def __init__(self, structure: StoppedStructure, problem: Problem, samples: Samples) -> None:
        self._structure, self._samples, self._table = structure, samples, structure.table
        self._times = problem.history_times * structure.scale
        self._end = problem.t_end * structure.scale
        self._columns = COLUMNS if problem.estimate else 0
        self.progress, self.course = np.zeros(1, PROGRESS), np.zeros(1, COURSE)
        now, at = self.progress[0], self.course[0]
        now["budget"], now["growth"], now["known_until"] = WORK, 1.0, math.inf
        now["released"], now["end"], now["tolerance"] = -1, self._end, tolerance_of(problem)
        now["scale"] = structure.scale
        at["columns"], at["wanted"] = self._columns, "contacts" in problem.outputs
        stops = len(structure.rows)
        rows = _PHASES + stops if at["wanted"] else 0
        self._phases = np.zeros(rows, PHASE), np.full((MARKS, stops), NONE)
        self._pairs = self._watched = 0

    @property
    def contacts(self) -> Rows:
        """The contact phases, of `contact_phases.PHASE`."""
        return self._phases[0][: self.course[0]["phases"]]

    def follow(self, initial: State, tick: Tick | None = None) -> None:
        """Follow the motion from an initial state to its end.

        Raises
        ------
        ConvergenceError
            Where stops keep switching, or more often than any plan expects.
        """
        self._begin(initial)
        ramps, now, at = self._structure.structure.ramps, self.progress[0], self.course[0]
        segment = self._begin_segment(ramps.segment(0.0)) if ramps.count else -1
        at["last"] = now["end"] >= self._end
        while True:
            motion = self._Z, self.progress, self.course, _NO_IMPACTS, self._times
            stop = follow(self._table.arrays, motion, self._work, self._taken, self._phases)
            self._flush()
            if tick is not None:
                tick(int(1e3 * float(now["time"]) / self._end), 1000)
            look()
            if stop == Stop.SCENE:
                self._prepare()
            elif stop == Stop.PHASES:
                self._extend()
            elif stop == Stop.END:
                if at["last"]:
                    break
                segment = self._begin_segment(segment + 1)
                at["last"] = now["end"] >= self._end
            elif stop in {Stop.STILL, Stop.MANY}:
                self._refuse(stop)
        if tick is not None:
            tick(1000, 1000)

    def _begin(self, initial: State) -> None:
        """Set the state, and the magnitudes of what it is the sum of."""
        structure = self._structure
        y, rate = structure.structure.W @ initial.x, structure.structure.W @ initial.v
        self.course[0]["scene"] = self._table.place(structure.initial_states(y, rate))
        self._make_room()
        scene = self._scene
        basis, modes = scene.basis, scene.basis.modes
        moves = initial.x - modes.base, initial.v / structure.scale
        q, speed = np.stack(moves) @ modes.weighted
        state = basis.pairs_of(q - basis.still, speed, basis.loads_at_start())
        self._Z[: state.size] = state.ravel()
        now = self.progress[0]
        now["unresolved"], now["longest"] = modes.neglected / EPS, basis.longest
        if self._columns:
            terms = (np.abs(initial.x) + np.abs(modes.base)) @ np.abs(modes.weighted)
            size = scene.placed.sizes_of(terms + scene.placed.terms)
            *_, kept = self._work
            kept[: size.size] = size

    @property
    def _scene(self) -> Scene:
        return self._table.scenes[self.course[0]["scene"]]

    def _make_room(self) -> None:
        """Make room for the largest scene; the state and the stage of the loop are kept."""
        table = self._table
        if table.most_pairs <= self._pairs and table.most_watched <= self._watched:
            return
        self._pairs = pairs = max(table.most_pairs, self._pairs)
        self._watched = watched = max(table.most_watched, self._watched)
        room, marks, struck, piece = workspace(pairs, watched, table.most_modes, 0)
        size = 2 * pairs
        Z, kept = np.zeros((1 + self._columns) * size), np.zeros(_KEPT * size)
        if self.course[0]["switches"] or self.progress[0]["begun"]:
            *_, former, _, last = self._work
            piece = former
            Z[: self._Z.size], kept[: last.size] = self._Z, last
        self._Z = Z
        spare = np.zeros(spare_size(self._columns, pairs))
        self._work = room, marks.ravel(), struck, piece, spare, kept
        rows = min(max(_ROWS, _NUMBERS // size), self._times.size)
        states = np.empty((rows, size)), np.empty((rows, size))
        self._taken: tuple[Any, ...] = *states, np.zeros(rows, np.int64)

    def _prepare(self) -> None:
        """Prepare the scene that the motion goes on in."""
        at, table = self.course[0], self._structure.table
        if table is not self._table:
            at["scene"] = table.place(self._scene.states)
            self._table = table
        table.prepare(int(at["scene"]), int(at["a"]), int(at["new"]))
        self._make_room()

    def _extend(self) -> None:
        """Make room for as many contact phases again."""
        rows, marks = self._phases
        hold(rows.nbytes)
        self._phases = np.concatenate([rows, np.zeros_like(rows)]), marks

    def _begin_segment(self, segment: int) -> int:
        """Let loads vary as they do between two samples."""
        ramps, structure, now = self._structure.structure.ramps, self._structure, self.progress[0]
        basis = self._scene.basis
        states = self._Z[: (1 + self._columns) * 2 * basis.pairs].reshape(-1, 2, basis.pairs)
        time = float(now["time"] + now["time_rest"])
        basis.set_ramps(states, ramps.state(segment, time / structure.scale))
        until = math.inf
        if segment + 2 < ramps.times.size:
            until = float(ramps.times[segment + 1]) * structure.scale
        now["end"] = min(until, self._end)
        return segment

    def _flush(self) -> None:
        """Hand on the samples that were taken."""
        now = self.progress[0]
        first, last = int(now["written"]), int(now["samples"])
        if last == first:
            return
        states, spreads, places = (part[: last - first] for part in self._taken)
        for place in np.unique(places):
            scene, rows = self._table.scenes[place], np.flatnonzero(places == place)
            shape = rows.size, 2, scene.basis.pairs
            size = 2 * scene.basis.pairs
            given: list[Floats] = [part[rows, :size].reshape(shape) for part in (states, spreads)]
            self._samples.take(scene, first + rows, *given)
        now["written"] = last

    def _refuse(self, stop: int) -> None:
        """Refuse a motion that does not get on, or switches more often than any plan expects."""
        now = self.progress[0]
        time = float(now["time"] + now["time_rest"]) / self._structure.scale
        if stop == Stop.STILL:
            raise ConvergenceError(f"stops keep switching at t = {time!r}, which rounding decides")
        count = int(self.course[0]["switches"])
        message = f"{count} switchings of stops until t = {time!r} are too many"
        raise ConvergenceError(f"{message}: ask for a motion that ends before")
