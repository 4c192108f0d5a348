"""Long motions in windows of time, one of which is in memory at a time.

The state at the end of a window is the seed of the next one, together with the deviations that
are carried along, so that the windows are one motion and its errors those of one motion. The
plan alone decides where windows end: a motion has the same numbers whether its windows are
computed by one call or by many, with or without interruption.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.rigid_state import PROGRESS
from vibroimpact_solvers.meter import metered
from vibroimpact_solvers.plan import Plan, Stage
from vibroimpact_solvers.results.time_history import Result
from vibroimpact_solvers.time_history import accurate_start, solving
from vibroimpact_solvers.time_history.basis import COLUMNS
from vibroimpact_solvers.time_history.contact_errors import masked
from vibroimpact_solvers.time_history.contact_forces import Contact
from vibroimpact_solvers.time_history.history import History, new_history
from vibroimpact_solvers.time_history.parts import ROWS, SCALARS, Assembly, Part, RowLists
from vibroimpact_solvers.time_history.planning import Method, windows
from vibroimpact_solvers.time_history.problem import Problem, State
from vibroimpact_solvers.time_history.result_values import result_of, values_of_exact_motion
from vibroimpact_solvers.time_history.run import (
    Arrays,
    ContactInterval,
    Run,
    Tick,
    new_progress,
    work_arrays,
)
from vibroimpact_solvers.time_history.start import initial_state
from vibroimpact_solvers.time_history.stated_errors import StatedErrors
from vibroimpact_solvers.time_history.structure import Structure


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


def split(problem: Problem, plan: Plan, seconds_each: float) -> list[Any]:
    """Return the windows of a long motion; a short one is one piece.

    Each window needs the one before: `follow` computes it.
    """
    count = windows(plan)
    return [problem] if count == 1 else [Window(problem, index, count) for index in range(count)]


@metered
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
    if windows(plan) == 1:
        return solving.solve(problem, plan, tick)
    return solve_until(problem, plan, None, tick)


def solve_until(
    problem: Problem,
    plan: Plan,
    enough: Callable[[Result], bool] | None,
    tick: Tick | None = None,
) -> Result:
    """Compute an exact motion window by window, until so much of it is enough.

    Parameters
    ----------
    problem : Problem
        With displacements and velocities.
    plan : Plan
        Its plan.
    enough : callable, optional
        Called with the result until the end of each window, at the output times until then;
        contacts that go on have no end yet, nan. Where it returns true, that is the result.
    tick : callable, optional
        As of `solve`.
    """
    count, kept = windows(plan), RowLists()
    assembly = Assembly(problem, kept)
    part: Part | None = None
    for index in range(count):

        def report(done: int, total: int, index: int = index) -> None:
            if tick is not None:
                tick(1000 * index // count + done // count, 1000)

        window = Window(problem, index, count)
        part = follow(window, plan, part, report)
        assembly.add(part)
        if enough is not None:
            times = problem.times[: window.times.stop]
            so_far = replace(assembly.result(kept.joined()), t=times)
            if enough(so_far):
                return so_far
    if tick is not None:
        tick(1000, 1000)
    return assembly.result(kept.joined())


def _with_digits(problem: Problem, digits: int, plan: Plan, tick: Tick | None) -> Result:
    """Compute a motion in double precision and, where that does not suffice, with more digits."""
    steps = (
        replace(step, method=Method.MODAL) if step.stage is Stage.FREE_MOTION else step
        for step in plan.steps
    )
    result = solving.solve(problem, replace(plan, steps=tuple(steps)), tick)
    if result.error_predictable_until >= problem.t_end:
        return result
    # Its libraries load when they are needed.
    from vibroimpact_solvers.time_history import extended

    return extended.solve(problem, digits, result.error_tolerance, tick)


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
    history = new_history(problem, 1)
    run = _WindowRun(window, problem, structure, history, before, tick)
    run.finish()
    values = values_of_exact_motion(problem)
    errors = StatedErrors(problem, structure).of(run.used.values())
    result = result_of(
        values, problem, structure, run.progress_row, run.all_impacts, history, errors,
        run.intervals,
    )  # fmt: skip
    return run.part(result, before)


def _within(problem: Problem, times: slice) -> Problem:
    """Return the problem with the output times of one window, possibly none."""
    within = copy.copy(problem)
    object.__setattr__(within, "t", problem.times[times])
    return within


class _WindowRun(Run):
    """The run of one window."""

    def __init__(
        self,
        window: Window,
        problem: Problem,
        structure: Structure,
        history: History,
        before: Part | None,
        tick: Tick | None,
    ) -> None:
        dofs = problem.output_dofs.size
        arrays = Arrays(structure, COLUMNS if problem.estimate else 0, dofs)
        arrays.progress[:] = new_progress(structure, problem, window.stop)
        initial = problem.initial
        if before is None and isinstance(initial, State) and structure.natural.is_wide:
            accurate_start.begin(structure, arrays, initial.x, initial.v)
        elif before is None:
            arrays.start(initial_state(problem, initial, structure))
        super().__init__(structure, arrays, problem, history, tick)
        self._end = problem.t_end * self.scale
        self._last = window.index + 1 == window.count
        self._listed: dict[int, int] = {}
        self._carried: dict[Contact, ContactInterval] = {}
        if before is not None:
            self._go_on(before)

    def _go_on(self, before: Part) -> None:
        """Continue from the state at the end of the previous window."""
        for constraint, side, row, rest, impulse, error in before.seed_open:
            contact: Contact = (int(constraint), int(side))
            self.contacts[contact] = interval = ContactInterval(
                contact, math.nan, rest, impulse=impulse, impulse_error=error
            )
            self._listed[id(interval)] = int(row)
        self._carried = dict(self.contacts)
        self.configuration = self.structure.configuration(frozenset(self.contacts))
        self.used[self.configuration.contacts] = self.configuration
        self._work = work_arrays(self.configuration, self.dofs.size)
        self.Z = before.seed_state.copy()
        now, stop = self.progress_row, self.end
        for name, number in zip(PROGRESS.names or (), before.seed_progress, strict=True):
            now[name] = number
        now["end"], self._segment = stop, -1
        now["first_row"] = now["rows"] = now["samples"] = now["written"] = 0
        self._switched = (-1.0, 0)

    @property
    def _latest(self) -> float:
        return self._end  # a chatter may end in the next window

    def part(self, result: Result, before: Part | None) -> Part:
        """Return the result of the window."""
        first = 0 if before is None else before.contacts
        places = {
            id(rest): first + place for place, rest in enumerate(self.intervals)
        } | self._listed
        going = {} if self._last else self.contacts
        late = [rest for rest in self._carried.values() if rest not in going.values()]
        scale = self.scale
        values = {name: getattr(result, name) for name in ROWS}
        if values["contact_stop"] is not None and values["contact_stop"].size:
            opened = [any(rest is other for other in going.values()) for rest in self.intervals]
            values["contact_stop"] = np.where(opened, math.nan, values["contact_stop"])
        return Part(
            **values,
            late_row=np.array([places[id(rest)] for rest in late], dtype=np.int64),
            late_stop=np.array([rest.stop for rest in late], dtype=np.float64) / scale,
            late_impulse=np.array([rest.impulse for rest in late], dtype=np.float64) / scale,
            late_stop_error=self._of_known(late, "stop_error"),
            late_impulse_error=self._of_known(late, "impulse_error"),
            seed_state=self.Z,
            seed_progress=np.array(self.progress_row.tolist(), dtype=np.float64),
            seed_open=np.array(
                [
                    [*contact, places[id(rest)], rest.rest, rest.impulse, rest.impulse_error]
                    for contact, rest in sorted(going.items())
                ]
            ).reshape(-1, 6),
            contacts=first + len(self.intervals),
            **{name: getattr(result, name) for name in SCALARS},
        )

    def _of_known(self, late: Sequence[ContactInterval], name: str) -> Floats:
        until = float(self.progress_row["known_until"])
        latest = np.array([rest.stop / self.scale + rest.stop_error for rest in late])
        return masked(latest, np.array([getattr(rest, name) for rest in late]), until)
