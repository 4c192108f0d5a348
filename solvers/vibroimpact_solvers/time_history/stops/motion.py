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
from vibroimpact_solvers.time_history.problem import Problem, State, tolerance_of
from vibroimpact_solvers.time_history.run import WORK, Tick
from vibroimpact_solvers.time_history.stops.configurations import StoppedStructure
from vibroimpact_solvers.time_history.stops.samples import Samples
from vibroimpact_solvers.time_history.stops.scene_table import SceneTable
from vibroimpact_solvers.time_history.stops.scenes import Scene

_NUMBERS: Final = 2**14  # modal coordinates of samples that are taken at once, or
_ROWS: Final = 16  # so many samples, however many pairs there are
_PHASES: Final = 64  # rows of the first table of contacts
_KEPT: Final = 4  # states besides that of the motion
_ENDED, _FETCH, _SCENE, _FULL, _STUCK = map(
    int, (Stop.END, Stop.SAMPLES, Stop.SCENE, Stop.PHASES, Stop.STILL)
)
_REFUSED: Final = (_STUCK, int(Stop.MANY))
_NO_IMPACTS: Final = np.empty(0, IMPACT)


class StoppedMotion:
    """A motion of a structure with stops of finite stiffness, and then another one.

    Parameters
    ----------
    structure : StoppedStructure
    columns : int
        Number of deviations that are carried along for error estimates.
    rows : int
        Output times, of which many are taken in parts.

    Attributes
    ----------
    progress, course : array, shape (1,)
        Of `rigid_state.PROGRESS` and `scene_changes.COURSE`.
    """

    def __init__(self, structure: StoppedStructure, columns: int, rows: int) -> None:
        self._structure, self._columns, self._rows = structure, columns, rows
        self._table, self._pairs, self._watched = structure.table, 0, 0
        self.progress, self.course = np.zeros(1, PROGRESS), np.zeros(1, COURSE)
        self._row, self._at = self.progress[0], self.course[0]
        self._begin, self._course = np.zeros(1, PROGRESS), np.zeros(1, COURSE)
        begin = self._begin[0]
        begin["budget"], begin["growth"], begin["known_until"] = WORK, 1.0, math.inf
        begin["released"], begin["scale"] = -1, structure.scale
        self._course[0]["columns"] = columns
        stops = len(structure.rows)
        self._marks, self._none = np.full((MARKS, stops), NONE), np.zeros(0, PHASE)
        self._phases = np.zeros(_PHASES + stops, PHASE)
        self._working = False
        self._Z: Floats = np.zeros(0)
        self._work: tuple[Any, ...] = ()
        self._taken: tuple[Any, ...] = ()

    @property
    def contacts(self) -> Rows:
        """The contact phases, of `contact_phases.PHASE`."""
        return self._phases[: self._at["phases"]]

    def follow(
        self, problem: Problem, initial: State, samples: Samples, tick: Tick | None = None
    ) -> None:
        """Follow a motion from an initial state to its end.

        Parameters
        ----------
        problem : Problem
        initial : State
        samples : Samples
            What becomes of the states at the output times.
        tick : callable, optional

        Raises
        ------
        ConvergenceError
            Where stops keep switching, or more often than any plan expects.
        """
        self._start(problem, initial)
        self._samples = samples
        now, at, ramps = self._row, self._at, self._structure.structure.ramps
        segment = self._begin_segment(ramps.segment(0.0)) if ramps.count else -1
        at["last"] = now["end"] >= self._end
        times = problem.history_times * self._structure.scale
        motion = self.progress, self.course, _NO_IMPACTS, times
        while True:
            phases = self._phases if at["wanted"] else self._none, self._marks
            work = self._Z, *self._work
            stop = follow(self._table.arrays, motion, work, self._taken, phases)
            if tick is not None:
                tick(int(1e3 * float(now["time"]) / self._end), 1000)
            look()
            if stop == _FETCH:
                self._flush()
            elif stop == _SCENE:
                self._prepare()
            elif stop == _FULL:
                hold(self._phases.nbytes)
                self._phases = np.concatenate([self._phases, np.zeros_like(self._phases)])
            elif stop == _ENDED:
                if at["last"]:
                    self._flush()
                    break
                segment = self._begin_segment(segment + 1)
                at["last"] = now["end"] >= self._end
            elif stop in _REFUSED:
                self._refuse(stop)
        if tick is not None:
            tick(1000, 1000)

    def _start(self, problem: Problem, initial: State) -> None:
        """Set the state, and the magnitudes of what it is the sum of."""
        structure, now, at = self._structure, self._row, self._at
        self._table, self._working = structure.table, False
        self.progress[:], self.course[:], self._marks[:] = self._begin, self._course, NONE
        self._end = problem.t_end * structure.scale
        now["end"], now["tolerance"] = self._end, tolerance_of(problem)
        at["wanted"] = "contacts" in problem.outputs
        away, leaving = structure.course.at_start(structure.structure.ramps)
        y = structure.structure.W @ initial.x - away
        rate = structure.structure.W @ initial.v - leaving
        at["scene"] = self._table.place(structure.initial_states(y, rate))
        self._make_room()
        scene = self._scene
        basis, modes = scene.basis, scene.basis.modes
        q = (initial.x - modes.base) @ modes.weighted - basis.still
        speed = (initial.v / structure.scale) @ modes.weighted
        state = basis.pairs_of(q, speed, basis.loads_at_start())
        self._Z[: state.size] = state.ravel()
        now["unresolved"], now["longest"] = modes.neglected / EPS, basis.longest
        if self._columns:
            terms = (np.abs(initial.x) + np.abs(modes.base)) @ np.abs(modes.weighted)
            size = scene.placed.sizes_of(terms + scene.placed.terms)
            *_, kept = self._work
            kept[: size.size] = size
            self._Z[state.size : (1 + self._columns) * state.size] = 0.0
        self._working = True

    @property
    def _scene(self) -> Scene:
        return self._table.scenes[int(self._at["scene"])]

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
        if self._working:
            *_, former, _, last = self._work
            piece = former
            Z[: self._Z.size], kept[: last.size] = self._Z, last
        self._Z = Z
        spare = np.zeros(spare_size(self._columns, pairs))
        self._work = room, marks.ravel(), struck, piece, spare, kept
        # Products of many states are rounded otherwise than those of few: how many are taken
        # together goes by the structure alone.
        rows = min(max(_ROWS, _NUMBERS // len(self._structure.eigenvalues)), self._rows)
        states, spreads = np.empty((rows, size)), np.empty((rows, size))
        places = np.zeros(rows, np.int64)
        if self._working:
            former, more, at = self._taken
            states[:, : former.shape[1]], spreads[:, : former.shape[1]] = former, more
            places[:] = at
        self._taken = states, spreads, places

    def _prepare(self) -> None:
        """Prepare the scene that the motion goes on in."""
        at, table = self._at, self._structure.table
        if table is not self._table:
            self._go_on_in(table)
        table.prepare(int(at["scene"]), int(at["a"]), int(at["new"]))
        self._make_room()

    def _go_on_in(self, table: SceneTable) -> None:
        """Go on with another table: scenes that are still needed are prepared there."""
        former, (_, _, places) = self._table, self._taken
        at = self._at
        at["scene"] = table.place(former.scenes[at["scene"]].states)
        waiting = places[: int(self._row["samples"]) - int(self._row["written"])]
        waiting[:] = [table.place(former.scenes[place].states) for place in waiting.tolist()]
        self._table = table

    def _begin_segment(self, segment: int) -> int:
        """Let loads vary as they do between two samples."""
        ramps, structure, now = self._structure.structure.ramps, self._structure, self._row
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
        first, last = int(self._row["written"]), int(self._row["samples"])
        count = last - first
        if count == 0:
            return
        states, spreads, places = self._taken
        places = places[:count]
        each = set(places.tolist())
        for place in each:
            # Of several scenes, the samples are picked out.
            rows: Any = (places == place).nonzero()[0] if len(each) > 1 else slice(count)
            scene = self._table.scenes[place]
            size = 2 * scene.basis.pairs
            at = first + rows if len(each) > 1 else slice(first, last)
            self._samples.take(scene, at, states[rows, :size], spreads[rows, :size])
        self._row["written"] = last

    def _refuse(self, stop: int) -> None:
        """Refuse a motion that does not get on, or switches more often than any plan expects."""
        now = self._row
        time = float(now["time"] + now["time_rest"]) / self._structure.scale
        if stop == _STUCK:
            raise ConvergenceError(f"stops keep switching at t = {time!r}, which rounding decides")
        count = int(self._at["switches"])
        message = f"{count} switchings of stops until t = {time!r} are too many"
        raise ConvergenceError(f"{message}: ask for a motion that ends before")
