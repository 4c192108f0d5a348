"""Computes a motion as its plan says, by the method that the plan names."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.rigid_state import IMPACT
from vibroimpact_solvers.plan import Plan, Stage
from vibroimpact_solvers.results.time_history import Result
from vibroimpact_solvers.time_history import reference
from vibroimpact_solvers.time_history.history import History
from vibroimpact_solvers.time_history.planning import Method
from vibroimpact_solvers.time_history.problem import ImpactMode, Problem, State
from vibroimpact_solvers.time_history.result_values import (
    EPS,
    TOLERANCE,
    UNKNOWN,
    checked_penetration,
    default_values,
    set_condition,
    values_of_exact_motion,
)
from vibroimpact_solvers.time_history.run import Run, Tick
from vibroimpact_solvers.time_history.single_call import SingleCall, Unfinished
from vibroimpact_solvers.time_history.soft import SoftHistory, SoftMotion
from vibroimpact_solvers.time_history.start import initial_state
from vibroimpact_solvers.time_history.structure import Structure

_TWICE = (
    "estimate: difference to the same motion with longer steps, a hundred times the error each, "
    "and with the initial state, frequencies and limiters off by their roundings, relative to "
    "the largest state; penetration is the largest coordinate over scale times its gap"
)
_NONE = "none: the integrator's own control of its steps; it can miss impacts"


class Prepared:
    """Everything that motions of one problem from different initial states share.

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
        step, motion_step = plan.step(Stage.SPECTRUM), plan.step(Stage.FREE_MOTION)
        assert step is not None
        assert motion_step is not None
        method = spectrum.Method(step.method)
        self.structure = Structure.of(problem.system, method, problem.t_end, problem.load)
        self._solver = _METHODS.get(Method(motion_step.method), _integrated)
        self.output_times = problem.times if plan.step(Stage.HISTORY) else np.zeros(0)
        self._single_call = None
        if self._solver is _exact:
            self._single_call = SingleCall.of(self.structure, problem, self.output_times)
        self.soft, self._light = None, "energy" not in problem.outputs
        if self._solver is _soft:
            assert problem.limiter is not None
            self.soft = SoftMotion(
                self.structure,
                problem.limiter,
                self.output_times,
                problem.t_end,
                TOLERANCE if problem.tolerance is None else problem.tolerance,
                problem.estimate,
            )

    def solve(self, initial: State | ImpactMode | None = None, tick: Tick | None = None) -> Result:
        """Compute the motion from an initial state; absent: from that of the problem.

        Raises
        ------
        ModelError
            Where the initial state is not finite, or outside of the limits.
        """
        start = self.problem.initial if initial is None else initial
        if self._single_call is not None and isinstance(start, State):
            outcome = self._single_call.solve(start)
            if isinstance(outcome, Unfinished):
                return _continued(self, outcome, tick)
            if outcome is not None:
                if tick is not None:
                    tick(1000, 1000)
                return outcome
        if self.soft is not None and isinstance(start, State) and self._light:
            history_only = self.soft.single_call(start.x, start.v, self.problem.output_dofs)
            if history_only is not None:
                return _soft_history(self, history_only, tick)
        history = History(self.problem, self.structure)
        return self._solver(self, start, history, tick)


def prepare(problem: Problem, plan: Plan) -> Prepared:
    """Prepare the motion of a problem for any number of initial states."""
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


def _continued(prepared: Prepared, unfinished: Unfinished, tick: Tick | None) -> Result:
    """Return the result of a motion that the single call did not compute to its end."""
    problem, arrays = prepared.problem, unfinished.arrays
    history = History(problem, prepared.structure)
    run = _run(prepared, arrays.Z[0], history, tick)
    run.adopt(arrays.Z, arrays.progress, arrays.table, arrays.samples)
    run.finish(unfinished.stop)
    return result_of(problem, run, history)


def _soft_history(prepared: Prepared, soft_history: SoftHistory, tick: Tick | None) -> Result:
    """Return the result of a motion with soft limiters from a single call."""
    outputs, values = prepared.problem.outputs, values_of_exact_motion(prepared.problem)
    if tick is not None:
        tick(1000, 1000)
    if "x" in outputs:
        values["x"] = soft_history.x
    if "v" in outputs:
        values["v"] = soft_history.v
    values["error_penetration"], values["count_expansions"] = (
        soft_history.compression,
        soft_history.steps,
    )
    return Result(**values)


def _run(prepared: Prepared, z: Floats, history: History, tick: Tick | None) -> Run:
    problem, structure = prepared.problem, prepared.structure
    return Run(
        structure,
        z,
        prepared.output_times * structure.scale,
        problem.t_end * structure.scale,
        history.take,
        estimate=problem.estimate,
        tick=tick,
    )


def _exact(
    prepared: Prepared, initial: State | ImpactMode, history: History, tick: Tick | None
) -> Result:
    """Compute a motion with rigid limiters from impact to impact."""
    problem, structure = prepared.problem, prepared.structure
    z = initial_state(problem, initial, structure)
    run = _run(prepared, z, history, tick)
    run.finish()
    return result_of(problem, run, history)


def _soft(
    prepared: Prepared, initial: State | ImpactMode, history: History, tick: Tick | None
) -> Result:
    """Compute a motion with soft limiters by Taylor series."""
    problem = prepared.problem
    assert prepared.soft is not None
    run = prepared.soft.follow(initial_state(problem, initial, prepared.structure), tick)
    history.take(prepared.structure.configuration(), run.states[:-1], 0)
    values = _with_history(problem, history)
    values.update(
        error_penetration=run.compression,
        count_expansions=run.steps,
        error_condition=run.difference / EPS if problem.estimate else math.nan,
        error_predictable_until=run.known_until,
        error_difference=run.difference if problem.estimate else None,
        error_statement=_TWICE if problem.estimate else UNKNOWN,
    )
    return Result(**values)


def _integrated(
    prepared: Prepared, initial: State | ImpactMode, history: History, tick: Tick | None
) -> Result:
    """Step with an integrator of scipy."""
    problem, structure = prepared.problem, prepared.structure
    x, v = structure.displacements(
        structure.configuration(), initial_state(problem, initial, structure)
    )
    v = v * structure.scale
    tolerance = TOLERANCE if problem.tolerance is None else problem.tolerance
    run = reference.follow(
        structure,
        problem.limiter,
        x,
        v,
        prepared.output_times,
        problem.t_end,
        tolerance,
        problem.method,
        tick,
    )
    history.fill(run.x, run.v, slice(None))
    values = _with_history(problem, history)
    if "impacts" in problem.outputs:
        struck, strengths = (
            np.array(run.struck).reshape(-1, 2),
            np.array(run.velocities_and_impulses).reshape(-1, 2),
        )
        values.update(
            impact_time=np.array(run.times),
            impact_constraint=struck[:, 0].astype(np.int64),
            impact_side=struck[:, 1].astype(np.int64),
            impact_velocity=strengths[:, 0].astype(np.float64),
            impact_impulse=strengths[:, 1].astype(np.float64),
            impact_condition=np.full(len(run.times), np.nan),
        )
    values.update(
        count_impacts=len(run.times), count_expansions=run.evaluations, error_statement=_NONE
    )
    return Result(**values)


_METHODS: Final = {Method.MODAL: _exact, Method.TAYLOR: _soft}


def _with_history(problem: Problem, history: History) -> dict[str, Any]:
    """Return the history and empty tables."""
    values = default_values(problem)
    _add_history(values, history)
    return values


def _add_history(values: dict[str, Any], history: History) -> None:
    values.update(x=history.x, v=history.v, energy=history.energy, error_energy_drift=history.drift)


def result_of(problem: Problem, run: Run, history: History) -> Result:
    """Return the result of a motion with rigid limiters that reached its end."""
    values, scale = values_of_exact_motion(problem), run.scale
    _add_history(values, history)
    impacts = np.concatenate(run.impacts) if run.impacts else np.zeros(0, IMPACT)
    times, growth = (impacts["time"] + impacts["time_rest"]) / scale, impacts["deviation"].copy()
    if "impacts" in problem.outputs:
        values.update(
            impact_time=times,
            impact_constraint=impacts["constraint"].copy(),
            impact_side=impacts["side"].copy(),
            impact_velocity=impacts["velocity"] * scale,
            impact_impulse=impacts["impulse"] * scale,
            impact_condition=growth,
        )
    if "contacts" in problem.outputs and run.intervals:
        intervals = run.intervals
        values.update(
            contact_start=np.array([r.start for r in intervals]) / scale,
            contact_rest=np.array([r.rest for r in intervals]) / scale,
            contact_stop=np.array([r.stop for r in intervals]) / scale,
            contact_constraint=np.array([r.contact[0] for r in intervals], dtype=np.int64),
            contact_side=np.array([r.contact[1] for r in intervals], dtype=np.int64),
            contact_impulse=np.array([r.impulse for r in intervals]) / scale,
        )
    values["count_impacts"], values["count_grazings"] = (
        impacts.size,
        int(run.progress_row["grazings"]),
    )
    values["count_expansions"] = int(run.progress_row["expansions"])
    values["error_penetration"] = checked_penetration(
        problem, float(run.progress_row["penetration"])
    )
    if problem.estimate:
        largest = max(1.0, run.growth, float(growth.max(initial=0.0)))
        set_condition(values, largest, times, growth)
    return Result(**values)
