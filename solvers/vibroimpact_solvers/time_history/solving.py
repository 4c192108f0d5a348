"""Does what a plan lists."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.plan import Plan, Stage
from vibroimpact_solvers.time_history import reference
from vibroimpact_solvers.time_history.answer import (
    EPS,
    TOLERANCE,
    UNKNOWN,
    bare,
    bare_of_flights,
    fill_condition,
    told_apart,
)
from vibroimpact_solvers.time_history.history import History
from vibroimpact_solvers.time_history.launcher import Launched, Launcher
from vibroimpact_solvers.time_history.planning import Flight
from vibroimpact_solvers.time_history.problem import Member, Problem, State
from vibroimpact_solvers.time_history.result import Result
from vibroimpact_solvers.time_history.run import Run, Tick
from vibroimpact_solvers.time_history.soft import SoftLaunch, SoftMotion
from vibroimpact_solvers.time_history.start import initial_state
from vibroimpact_solvers.time_history.structure import Structure

_TWICE = (
    "estimate: difference to the same motion with longer steps, a hundred times the error each, "
    "and with the initial state, frequencies and limiters off by their roundings, relative to "
    "the largest state; penetration is the largest coordinate over scale times its gap"
)
_NONE = "none: the integrator's own control of its steps; it can miss impacts"


class Prepared:
    """A motion prepared for any number of initial states: everything that they share.

    May be used by several threads at once, and motions without contacts leave the interpreter
    free while they last.

    Parameters
    ----------
    problem : Problem
    plan : Plan
        The one that `plan(problem)` returned.
    """

    def __init__(self, problem: Problem, plan: Plan) -> None:
        self.problem = problem
        step, flight = plan.step(Stage.SPECTRUM), plan.step(Stage.FLIGHT)
        assert step is not None
        assert flight is not None
        method = spectrum.Method(step.method)
        self.structure = Structure.of(problem.system, method, problem.t_end, problem.load)
        self._solver = _METHODS.get(Flight(flight.method), _integrated)
        self.wanted = problem.times if plan.step(Stage.HISTORY) else np.zeros(0)
        self._launcher = None
        if self._solver is _exact:
            self._launcher = Launcher.of(self.structure, problem, self.wanted)
        self.soft, self._light = None, "energy" not in problem.outputs
        if self._solver is _soft:
            assert problem.limiter is not None
            self.soft = SoftMotion(
                self.structure,
                problem.limiter,
                self.wanted,
                problem.t_end,
                TOLERANCE if problem.tolerance is None else problem.tolerance,
                problem.estimate,
            )

    def solve(self, initial: State | Member | None = None, tick: Tick | None = None) -> Result:
        """Compute the motion from an initial state; absent: from that of the problem.

        Raises
        ------
        ModelError
            Where the initial state is not finite, or outside of the limits.
        """
        start = self.problem.initial if initial is None else initial
        if self._launcher is not None and isinstance(start, State):
            flight = self._launcher.fly(start)
            if isinstance(flight, Launched):
                return _continued(self, flight, tick)
            if flight is not None:
                if tick is not None:
                    tick(1000, 1000)
                return flight
        if self.soft is not None and isinstance(start, State) and self._light:
            found = self.soft.launch(start.x, start.v, self.problem.wanted_dofs)
            if found is not None:
                return _launched_softly(self, found, tick)
        history = History(self.problem, self.structure)
        return self._solver(self, start, history, tick)


def prepare(problem: Problem, plan: Plan) -> Prepared:
    """Prepare what the plan lists, for any number of initial states."""
    return Prepared(problem, plan)


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
    return Prepared(problem, plan).solve(tick=tick)


def _continued(prepared: Prepared, flight: Launched, tick: Tick | None) -> Result:
    """Return what a motion yields that its launch did not follow to the end."""
    problem, scratch = prepared.problem, flight.scratch
    history = History(problem, prepared.structure)
    run = _run(prepared, scratch.Z[0], history, tick)
    run.adopt(scratch.Z, scratch.clock, scratch.counts, scratch.table, scratch.samples)
    run.finish(flight.stop)
    return _result(problem, run, history)


def _launched_softly(prepared: Prepared, flight: SoftLaunch, tick: Tick | None) -> Result:
    """Return what a motion between soft limiters in one call yields."""
    outputs, found = prepared.problem.outputs, bare_of_flights(prepared.problem)
    if tick is not None:
        tick(1000, 1000)
    if "x" in outputs:
        found["x"] = flight.x
    if "v" in outputs:
        found["v"] = flight.v
    found["error_penetration"], found["count_expansions"] = flight.compression, flight.steps
    return Result.of(found)


def _run(prepared: Prepared, z: Floats, history: History, tick: Tick | None) -> Run:
    problem, structure = prepared.problem, prepared.structure
    return Run(
        structure,
        z,
        prepared.wanted * structure.scale,
        problem.t_end * structure.scale,
        history.take,
        keep="impacts" in problem.outputs,
        estimate=problem.estimate,
        tick=tick,
    )


def _exact(
    prepared: Prepared, initial: State | Member, history: History, tick: Tick | None
) -> Result:
    """Fly from impact to impact."""
    problem, structure = prepared.problem, prepared.structure
    z = initial_state(problem, initial, structure)
    run = _run(prepared, z, history, tick)
    run.finish()
    return _result(problem, run, history)


def _soft(
    prepared: Prepared, initial: State | Member, history: History, tick: Tick | None
) -> Result:
    """Follow the Taylor series between the soft limiters."""
    problem = prepared.problem
    assert prepared.soft is not None
    run = prepared.soft.follow(initial_state(problem, initial, prepared.structure), tick)
    history.take(prepared.structure.scene(), run.states[:-1], 0)
    found = _with_history(problem, history)
    found.update(
        error_penetration=run.compression,
        count_expansions=run.steps,
        error_condition=run.difference / EPS if problem.estimate else math.nan,
        error_predictable_until=run.known_until,
        error_difference=run.difference if problem.estimate else None,
        error_statement=_TWICE if problem.estimate else UNKNOWN,
    )
    return Result.of(found)


def _integrated(
    prepared: Prepared, initial: State | Member, history: History, tick: Tick | None
) -> Result:
    """Step with an integrator of scipy."""
    problem, structure = prepared.problem, prepared.structure
    x, v = structure.place(structure.scene(), initial_state(problem, initial, structure))
    v = v * structure.scale
    tolerance = TOLERANCE if problem.tolerance is None else problem.tolerance
    run = reference.follow(
        structure,
        problem.limiter,
        x,
        v,
        prepared.wanted,
        problem.t_end,
        tolerance,
        problem.method,
        tick,
    )
    history.fill(run.x, run.v, slice(None))
    found = _with_history(problem, history)
    if "impacts" in problem.outputs:
        struck, blows = np.array(run.struck).reshape(-1, 2), np.array(run.blows).reshape(-1, 2)
        found.update(
            impact_time=np.array(run.times),
            impact_constraint=struck[:, 0].astype(np.int64),
            impact_side=struck[:, 1].astype(np.int64),
            impact_velocity=blows[:, 0].astype(np.float64),
            impact_impulse=blows[:, 1].astype(np.float64),
            impact_condition=np.full(len(run.times), np.nan),
        )
    found.update(
        count_impacts=len(run.times), count_expansions=run.evaluations, error_statement=_NONE
    )
    return Result.of(found)


_METHODS: Final = {Flight.MODAL: _exact, Flight.TAYLOR: _soft}


def _with_history(problem: Problem, history: History) -> dict[str, Any]:
    """Return the history and, for methods that know no more, empty tables."""
    found = bare(problem)
    _add_history(found, history)
    return found


def _add_history(found: dict[str, Any], history: History) -> None:
    found.update(x=history.x, v=history.v, energy=history.energy, error_energy_drift=history.drift)


def _result(problem: Problem, run: Run, history: History) -> Result:
    found, scale, table = bare_of_flights(problem), run.scale, run.impacts
    _add_history(found, history)
    at, growth = _joined(table.at, (0, 2)), _joined(table.growth, (0,))
    times = (at[:, 0] + at[:, 1]) / scale
    if "impacts" in problem.outputs:
        where, what = _joined(table.where, (0, 2)), _joined(table.what, (0, 3))
        found.update(
            impact_time=times,
            impact_constraint=where[:, 0].astype(np.int64),
            impact_side=where[:, 1].astype(np.int64),
            impact_velocity=what[:, 0] * scale,
            impact_impulse=what[:, 1] * scale,
            impact_condition=what[:, 2].copy(),
        )
    if "contacts" in problem.outputs and run.rests:
        rests = run.rests
        found.update(
            contact_start=np.array([r.start for r in rests]) / scale,
            contact_rest=np.array([r.rest for r in rests]) / scale,
            contact_stop=np.array([r.stop for r in rests]) / scale,
            contact_constraint=np.array([r.contact[0] for r in rests], dtype=np.int64),
            contact_side=np.array([r.contact[1] for r in rests], dtype=np.int64),
            contact_impulse=np.array([r.impulse for r in rests]) / scale,
        )
    _, _, expansions, _, _, _, _, _, grazings, _, _ = run.counts.tolist()
    found["count_impacts"] = table.count
    found["count_grazings"], found["count_expansions"] = grazings, expansions
    largest = max(1.0, run.growth, float(growth.max(initial=0.0)))
    found["error_penetration"] = told_apart(problem, float(run.clock[6]))
    if problem.estimate:
        fill_condition(found, largest, times, growth)
    elif "impacts" in problem.outputs:
        found["impact_condition"] = np.full(times.size, math.nan)
    return Result.of(found)


def _joined(pieces: list[Any], shape: tuple[int, ...]) -> Any:
    if len(pieces) == 1:
        return pieces[0]
    return np.concatenate(pieces) if pieces else np.zeros(shape)
