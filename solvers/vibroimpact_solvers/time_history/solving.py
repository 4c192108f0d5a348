"""Computes a motion as its plan says, by the method that the plan names."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.kernels.impact_law import NEWTON
from vibroimpact_solvers.plan import Plan, Stage
from vibroimpact_solvers.results.time_history import Result
from vibroimpact_solvers.time_history import reference, soft_contacts, soft_errors, soft_laws
from vibroimpact_solvers.time_history.history import requested_of_one
from vibroimpact_solvers.time_history.planning import Method
from vibroimpact_solvers.time_history.problem import ImpactMode, Problem, State, tolerance_of
from vibroimpact_solvers.time_history.result_values import (
    EPS,
    UNKNOWN,
    default_values,
    values_of_exact_motion,
)
from vibroimpact_solvers.time_history.rigid_motions import RigidMotions
from vibroimpact_solvers.time_history.run import Tick
from vibroimpact_solvers.time_history.soft import SoftHistory, SoftMotion
from vibroimpact_solvers.time_history.soft_laws import PowerStops, SoftLaws
from vibroimpact_solvers.time_history.start import initial_state
from vibroimpact_solvers.time_history.stated_errors import OF_IMPACTS, unknown_errors
from vibroimpact_solvers.time_history.stops import StoppedMotions
from vibroimpact_solvers.time_history.structure import Structure

_TWICE = (
    "estimate: difference to the same motion with longer steps, 32 times the error each, and with "
    "the initial state, frequencies and limiters off by their roundings, times the share of "
    "roundings in it, relative to the largest state; in each output its own largest difference, or "
    "half of what those of all modes may make of it, infinite from predictable_until on; "
    "penetration is the largest coordinate over scale times its gap, of soft limiters"
)
_OF_CONTACTS = (
    "of contacts the differences of their coordinates, by which times, forces and impulses may be "
    "off; the time of a contact that is less deep may be that of none"
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
        self.structure = Structure.of(problem.system, method, problem.t_end, problem.acting)
        self._solver = _METHODS.get(Method(motion_step.method), _integrated)
        self.output_times = problem.history_times
        self.soft: SoftMotion | None = None
        self.laws: SoftLaws | None = None
        self._light = not problem.outputs & {"energy", "force"}
        self.rigid: RigidMotions | None = None
        self.stopped: StoppedMotions | None = None
        if self._solver is _exact:
            self.rigid = RigidMotions(self.structure, problem)
        elif self._solver is _switched:
            self.stopped = StoppedMotions(self.structure, problem)
        elif self._solver is _soft:
            self.laws = soft_laws.of(problem)
            self.soft = SoftMotion(
                self.structure,
                self.laws,
                self.output_times,
                problem.t_end,
                tolerance_of(problem),
                problem.estimate,
                problem.output_dofs,
                isinstance(self.laws, PowerStops) and "contacts" in problem.outputs,
            )

    def solve(self, initial: State | ImpactMode | None = None, tick: Tick | None = None) -> Result:
        """Compute the motion from an initial state; absent: from that of the problem.

        Raises
        ------
        ModelError
            Where the initial state is not finite, or outside of the limits.
        """
        start = self.problem.initial if initial is None else initial
        if self.soft is not None and isinstance(start, State) and self._light:
            history_only = self.soft.single_call(start.x, start.v, tick)
            if history_only is not None:
                return _soft_history(self, history_only, tick)
        return self._solver(self, start, tick)


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


def _exact(prepared: Prepared, initial: State | ImpactMode, tick: Tick | None) -> Result:
    """Compute a motion with rigid limiters from impact to impact."""
    assert prepared.rigid is not None
    return prepared.rigid.solve(initial, tick)


def _switched(prepared: Prepared, initial: State | ImpactMode, tick: Tick | None) -> Result:
    """Compute a motion with stops of finite stiffness from switching to switching."""
    assert prepared.stopped is not None
    assert isinstance(initial, State)
    return prepared.stopped.solve(initial, tick)


def _soft(prepared: Prepared, initial: State | ImpactMode, tick: Tick | None) -> Result:
    """Compute a motion with soft limiters by Taylor series."""
    problem, structure = prepared.problem, prepared.structure
    assert prepared.soft is not None
    assert prepared.laws is not None
    laws, soft = prepared.laws, prepared.soft
    run = prepared.soft.follow(initial_state(problem, initial, structure), tick)
    basis, states = structure.configuration().basis, run.states[soft.places]
    dofs = slice(None) if problem.outputs & {"energy", "force"} else problem.output_dofs
    shapes, (q, rate) = basis.modes.shapes[dofs], basis.coordinates(states)
    x, v = (q + basis.still) @ shapes.T, structure.scale * rate @ shapes.T
    values = default_values(problem) | requested_of_one(problem, structure, laws, x, v)
    if run.distance is not None:
        values.update(soft_errors.stated(problem, structure, laws, run.distance, x, v))
    statement = _TWICE
    if isinstance(laws, PowerStops):
        statement = f"{_TWICE}; {_OF_CONTACTS}"
        if "force" in problem.outputs:
            values["force"] = np.abs(laws.forces(x @ structure.W.T))
        if "contacts" in problem.outputs:
            values |= soft_contacts.table(structure, laws, run, problem.t_end)
    values.update(
        error_penetration=run.compression,
        count_expansions=run.steps,
        error_condition=run.difference / EPS if problem.estimate else math.nan,
        error_predictable_until=run.known_until,
        error_difference=run.difference if problem.estimate else None,
        error_statement=statement if problem.estimate else UNKNOWN,
    )
    return Result(**values)


def _integrated(prepared: Prepared, initial: State | ImpactMode, tick: Tick | None) -> Result:
    """Step with an integrator of scipy."""
    problem, structure = prepared.problem, prepared.structure
    x, v = structure.displacements(
        structure.configuration(), initial_state(problem, initial, structure)
    )
    v = v * structure.scale
    tolerance = tolerance_of(problem)
    laws = None if problem.limiter is None else soft_laws.of(problem)
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
    values = default_values(problem) | requested_of_one(problem, structure, laws, run.x, run.v)
    values.update(unknown_errors(problem))
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
            impact_law=np.full(len(run.times), NEWTON),
            **dict.fromkeys(OF_IMPACTS, np.full(len(run.times), np.nan)),
        )
    values.update(
        count_impacts=len(run.times), count_expansions=run.evaluations, error_statement=_NONE
    )
    return Result(**values)


_METHODS: Final = {
    Method.MODAL: _exact,
    Method.SWITCHED: _switched,
    Method.TAYLOR: _soft,
    Method.POWERED: _soft,
}
