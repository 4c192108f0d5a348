"""Long motions window by window: what is known of a window is all that is held in memory.

The state at the end of a window is the seed of the next one, together with the deviations that
go along with it, so that the windows are one motion and its errors those of one motion. Where
windows end is up to the plan alone: a motion has the same numbers whether its windows are
computed by one call or by many, and whatever was interrupted.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Floats, Integers, Quantity, quantities
from vibroimpact_solvers.plan import Plan, Stage
from vibroimpact_solvers.time_history import solving
from vibroimpact_solvers.time_history.history import History, conserves
from vibroimpact_solvers.time_history.planning import Flight, windows
from vibroimpact_solvers.time_history.problem import Problem
from vibroimpact_solvers.time_history.result import Result
from vibroimpact_solvers.time_history.run import Rest, Run, Tick
from vibroimpact_solvers.time_history.start import initial_state
from vibroimpact_solvers.time_history.structure import Contact, Structure


@dataclass(frozen=True, eq=False, slots=True)
class Window:
    """A part of the time of a motion.

    Parameters
    ----------
    problem : Problem
        The whole motion.
    index : int
        Which window it is.
    count : int
        How many there are.
    """

    problem: Problem
    index: int
    count: int

    @property
    def stop(self) -> float:
        """Where it ends."""
        last = self.index + 1 == self.count
        return self.problem.t_end if last else self.problem.t_end * (self.index + 1) / self.count

    @property
    def times(self) -> slice:
        """The times of the history that lie in it, its end included."""
        times = self.problem.times
        start = self.problem.t_end * self.index / self.count
        first = 0 if self.index == 0 else int(np.searchsorted(times, start, "right"))
        last = self.index + 1 == self.count
        return slice(first, times.size if last else int(np.searchsorted(times, self.stop, "right")))


def _seed(name: str, *dims: str) -> Quantity:
    return Quantity(dims, "1", name)


@dataclass(frozen=True, eq=False)
class Part:
    """What a window yields, and the seed of the next one.

    Contacts stand in the window in which they begin; what becomes of them later, in that in
    which they end.

    Parameters
    ----------
    x, v, energy, impact_time, …
        As in `Result`, of the window.
    late_row, late_stop, late_impulse : array, shape (late,)
        Contacts of earlier windows that end in this one, by their rows in the whole table.
    seed_state : array, shape (1 + deviation, 2, pair)
    seed_clock, seed_counts : array
        What the compiled loop keeps.
    seed_open : array, shape (open, 5)
        Contacts that go on: constraint, side, row, time of rest, impulse so far.
    contacts : int
        Rows of the whole table of contacts until the end of the window.
    """

    x: Annotated[Floats | None, _seed("displacement", "time", "dof")]
    v: Annotated[Floats | None, _seed("velocity", "time", "dof")]
    energy: Annotated[Floats | None, _seed("energy", "time")]
    impact_time: Annotated[Floats | None, _seed("time", "impact")]
    impact_constraint: Annotated[Integers | None, _seed("constraint", "impact")]
    impact_side: Annotated[Integers | None, _seed("side", "impact")]
    impact_velocity: Annotated[Floats | None, _seed("velocity", "impact")]
    impact_impulse: Annotated[Floats | None, _seed("impulse", "impact")]
    impact_condition: Annotated[Floats | None, _seed("condition", "impact")]
    contact_start: Annotated[Floats | None, _seed("start", "contact")]
    contact_rest: Annotated[Floats | None, _seed("rest", "contact")]
    contact_stop: Annotated[Floats | None, _seed("stop", "contact")]
    contact_constraint: Annotated[Integers | None, _seed("constraint", "contact")]
    contact_side: Annotated[Integers | None, _seed("side", "contact")]
    contact_impulse: Annotated[Floats | None, _seed("impulse", "contact")]
    late_row: Annotated[Integers, _seed("row", "late")]
    late_stop: Annotated[Floats, _seed("stop", "late")]
    late_impulse: Annotated[Floats, _seed("impulse", "late")]
    seed_state: Annotated[Floats, _seed("state", "vector", "half", "pair")]
    seed_clock: Annotated[Floats, _seed("clock", "clock")]
    seed_counts: Annotated[Integers, _seed("counts", "counts")]
    seed_open: Annotated[Floats, _seed("open contacts", "open", "column")]
    contacts: int
    count_impacts: int
    count_grazings: int
    count_expansions: int
    error_condition: float
    error_penetration: float
    error_predictable_until: float
    error_tolerance: float
    error_statement: str


_ROWS: Final = tuple(
    name
    for name, meaning in quantities(Part).items()
    if meaning.dims[0] in {"time", "impact", "contact"}
)
"""Arrays of the result that windows make up."""


def split(problem: Problem, plan: Plan, seconds_each: float) -> list[Any]:
    """Return the windows of a long motion; a short one is one piece.

    Each window needs the one before: `follow` computes it.
    """
    count = windows(plan)
    return [problem] if count == 1 else [Window(problem, index, count) for index in range(count)]


def solve(problem: Problem, plan: Plan, tick: Tick | None = None) -> Result:
    """Compute what the plan lists.

    Parameters
    ----------
    problem : Problem
    plan : Plan
        The one that `plan(problem)` returned.
    tick : callable, optional
        Called with (done, total) thousandths of the motion; may raise `Cancelled`.
    """
    if problem.digits is not None:
        return _with_digits(problem, problem.digits, plan, tick)
    count = windows(plan)
    if count == 1:
        return solving.solve(problem, plan, tick)
    kept = _Lists()
    assembly = Assembly(problem, kept)
    part: Part | None = None
    for index in range(count):

        def tell(done: int, total: int, index: int = index) -> None:
            if tick is not None:
                tick(1000 * index // count + done // count, 1000)

        part = follow(Window(problem, index, count), plan, part, tell)
        assembly.add(part)
    if tick is not None:
        tick(1000, 1000)
    return assembly.result(kept.joined())


def _with_digits(problem: Problem, digits: int, plan: Plan, tick: Tick | None) -> Result:
    """Follow a motion in double precision and, where that does not hold, with more digits."""
    steps = (
        replace(step, method=Flight.MODAL) if step.stage is Stage.FLIGHT else step
        for step in plan.steps
    )
    found = solving.solve(problem, replace(plan, steps=tuple(steps)), tick)
    if found.error_predictable_until >= problem.t_end:
        return found
    # Its libraries load when they are needed.
    from vibroimpact_solvers.time_history import extended

    return extended.solve(problem, digits, found.error_tolerance, tick)


def follow(window: Window, plan: Plan, before: Part | None, tick: Tick | None = None) -> Part:
    """Compute a window from the one before; the first one has none before it.

    Parameters
    ----------
    window : Window
    plan : Plan
        Of the whole motion.
    before : Part, optional
    tick : callable, optional
        Called with (done, total) thousandths of the window; may raise `Cancelled`.
    """
    problem = _within(window.problem, window.times)
    step = plan.step(Stage.SPECTRUM)
    assert step is not None
    structure = Structure.of(
        problem.system, spectrum.Method(step.method), problem.t_end, problem.load
    )
    history = History(problem, structure)
    wanted = problem.times if plan.step(Stage.HISTORY) else np.zeros(0)
    run = _WindowRun(window, structure, wanted, history, before, tick)
    run.finish()
    return run.part(solving._result(problem, run, history), before)


def _within(problem: Problem, times: slice) -> Problem:
    """Return a problem with some of its times, which need not be there."""
    found = copy.copy(problem)
    object.__setattr__(found, "t", problem.times[times])
    return found


class _WindowRun(Run):
    """The run of one window."""

    def __init__(
        self,
        window: Window,
        structure: Structure,
        wanted: Floats,
        history: History,
        before: Part | None,
        tick: Tick | None,
    ) -> None:
        problem, scale = window.problem, structure.scale
        z = np.zeros((2, structure.scene().basis.pairs))
        if before is None:
            z = initial_state(problem, problem.initial, structure)
        super().__init__(
            structure,
            z,
            wanted * scale,
            window.stop * scale,
            history.take,
            keep="impacts" in problem.outputs,
            estimate=problem.estimate,
            tick=tick,
        )
        self._end = problem.t_end * self.scale
        self._last = window.index + 1 == window.count
        self._rows: dict[int, int] = {}
        self._carried: dict[Contact, Rest] = {}
        if before is not None:
            self._go_on(before)

    def _go_on(self, before: Part) -> None:
        """Take the state at the end of the window before."""
        for constraint, side, row, rest, impulse in before.seed_open:
            contact: Contact = (int(constraint), int(side))
            self.contacts[contact] = held = Rest(contact, math.nan, rest, impulse=impulse)
            self._rows[id(held)] = int(row)
        self._carried = dict(self.contacts)
        self.scene = self.structure.scene(frozenset(self.contacts))
        self._samples(self.scene)
        self.Z = before.seed_state.copy()
        stop = float(self.clock[2])
        self.clock[:] = before.seed_clock
        self.clock[2] = stop
        self.counts[:] = before.seed_counts
        self.counts[[0, 1, 4]] = 0
        self._switched = (-1.0, 0)

    def _hold(self, contact: Contact, lasts: float) -> None:
        super()._hold(contact, lasts)
        rest = self.contacts[contact]
        rest.rest = min(self.now + lasts, self._end)  # which may lie in the next window

    def part(self, found: Result, before: Part | None) -> Part:
        """Return what the window yields."""
        first = 0 if before is None else before.contacts
        places = {id(rest): first + place for place, rest in enumerate(self.rests)} | self._rows
        going = {} if self._last else self.contacts
        late = [rest for rest in self._carried.values() if rest not in going.values()]
        scale = self.scale
        values = {name: getattr(found, name) for name in _ROWS}
        if values["contact_stop"] is not None and values["contact_stop"].size:
            opened = [any(rest is other for other in going.values()) for rest in self.rests]
            values["contact_stop"] = np.where(opened, math.nan, values["contact_stop"])
        return Part(
            **values,
            late_row=np.array([places[id(rest)] for rest in late], dtype=np.int64),
            late_stop=np.array([rest.stop for rest in late], dtype=np.float64) / scale,
            late_impulse=np.array([rest.impulse for rest in late], dtype=np.float64) / scale,
            seed_state=self.Z,
            seed_clock=self.clock,
            seed_counts=self.counts,
            seed_open=np.array(
                [
                    [*contact, places[id(rest)], rest.rest, rest.impulse]
                    for contact, rest in sorted(going.items())
                ]
            ).reshape(-1, 5),
            contacts=first + len(self.rests),
            **{name: getattr(found, name) for name in _SCALARS if name != "contacts"},
        )


_SCALARS: Final = tuple(field.name for field in fields(Part) if field.name not in quantities(Part))


class Sink(Protocol):
    """Where the rows of windows go, one window after the other."""

    def append(self, name: str, rows: NDArray[Any]) -> None:
        """Take the next rows of an array."""

    def patch(self, name: str, row: int, value: float) -> None:
        """Replace a number of rows that were taken before."""


class Assembly:
    """Puts windows together in their order, holding none of their arrays.

    Parameters
    ----------
    problem : Problem
    sink : Sink
    """

    def __init__(self, problem: Problem, sink: Sink) -> None:
        self._problem, self._sink = problem, sink
        self._found: dict[str, Any] = {}
        self._energy = (math.nan, 0.0, 0.0)

    def add(self, part: Part) -> None:
        """Take the next window."""
        for name in _ROWS:
            rows = getattr(part, name)
            if rows is not None:
                self._sink.append(name, rows)
        if part.contact_stop is not None:
            for row, stop, impulse in zip(
                part.late_row.tolist(), part.late_stop, part.late_impulse, strict=True
            ):
                self._sink.patch("contact_stop", row, float(stop))
                self._sink.patch("contact_impulse", row, float(impulse))
        if part.energy is not None and part.energy.size:
            first, spread, size = self._energy
            first = float(part.energy[0]) if math.isnan(first) else first
            spread = max(spread, float(np.abs(part.energy - first).max()))
            self._energy = first, spread, max(size, float(np.abs(part.energy).max()))
        found, mine = self._found, {name: getattr(part, name) for name in _SCALARS}
        if found:
            mine["count_impacts"] += found["count_impacts"]
            mine["error_condition"] = max(mine["error_condition"], found["error_condition"])
            until = "error_predictable_until"
            mine[until] = min(mine[until], found[until])
        self._found = mine

    def plain(self) -> dict[str, Any]:
        """Return the fields of the result that are no arrays."""
        found = {name: value for name, value in self._found.items() if name != "contacts"}
        _, spread, size = self._energy
        drift = None
        if "energy" in self._problem.outputs and conserves(self._problem):
            drift = spread / size if size > 0.0 else 0.0
        return {
            **found,
            "error_energy_drift": drift,
            "error_difference": None,
            "error_digits": None,
        }

    def labels(self) -> dict[str, Any]:
        """Return the coordinates of the result."""
        outputs = self._problem.outputs
        timed, placed = outputs & {"x", "v", "energy"}, outputs & {"x", "v"}
        return {
            "t": self._problem.times if timed else None,
            "dof": self._problem.wanted_dofs if placed else None,
        }

    def result(self, arrays: dict[str, Any]) -> Result:
        """Return the result whose rows went to the sink."""
        absent: dict[str, Any] = dict.fromkeys(field.name for field in fields(Result))
        return Result(**absent | self.labels() | arrays | self.plain())


class _Lists:
    """Holds everything in memory."""

    def __init__(self) -> None:
        self._pieces: dict[str, list[NDArray[Any]]] = {}

    def append(self, name: str, rows: NDArray[Any]) -> None:
        """Take the next rows of an array."""
        self._pieces.setdefault(name, []).append(np.array(rows))

    def patch(self, name: str, row: int, value: float) -> None:
        """Replace a number of rows that were taken before."""
        for piece in self._pieces[name]:
            if row < piece.size:
                piece[row] = value
                return
            row -= piece.size

    def joined(self) -> dict[str, NDArray[Any]]:
        """Return the arrays."""
        return {name: np.concatenate(pieces) for name, pieces in self._pieces.items()}


def join(problem: Problem, plan: Plan, results: Sequence[Any]) -> Result:
    """Put the results of the pieces together."""
    if len(results) == 1 and isinstance(results[0], Result):
        return results[0]
    kept = _Lists()
    assembly = Assembly(problem, kept)
    for part in results:
        assembly.add(part)
    return assembly.result(kept.joined())
