"""Does what a plan lists."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.plan import Plan, Stage
from vibroimpact_solvers.time_history import reference, soft
from vibroimpact_solvers.time_history.history import History
from vibroimpact_solvers.time_history.planning import Flight
from vibroimpact_solvers.time_history.problem import Member, Problem, State
from vibroimpact_solvers.time_history.result import Result, empty
from vibroimpact_solvers.time_history.run import Run, Tick
from vibroimpact_solvers.time_history.start import initial_state
from vibroimpact_solvers.time_history.structure import Structure

TOLERANCE: Final = 1e-6
"""Meant where none is asked for."""

_EPS = float(np.finfo(np.float64).eps)
_STATEMENT = (
    "estimate: roundings of the initial state and of every flight, carried along by the "
    "linearised motion and its impacts, relative to the state; between impacts the motion is "
    "exact, and no impact can be missed but for grazings within rounding"
)


_HALVED = (
    "estimate: difference to the same motion with steps of twice the length, relative to the "
    "largest state; penetration is the largest coordinate over scale times its gap"
)
_UNKNOWN = "none: no estimate was asked for"
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

    def solve(self, initial: State | Member | None = None, tick: Tick | None = None) -> Result:
        """Compute the motion from an initial state; absent: from that of the problem.

        Raises
        ------
        ModelError
            Where the initial state is not finite, or outside of the limits.
        """
        start = self.problem.initial if initial is None else initial
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


def _exact(
    prepared: Prepared, initial: State | Member, history: History, tick: Tick | None
) -> Result:
    """Fly from impact to impact."""
    problem, structure = prepared.problem, prepared.structure
    z = initial_state(problem, initial, structure)
    run = Run(
        structure,
        z,
        prepared.wanted * structure.scale,
        problem.t_end * structure.scale,
        history.take,
        keep="impacts" in problem.outputs,
        estimate=problem.estimate,
        tick=tick,
    )
    run.finish()
    return _result(problem, run, history)


def _soft(
    prepared: Prepared, initial: State | Member, history: History, tick: Tick | None
) -> Result:
    """Split into exact flow and kicks of the soft limiters."""
    problem, structure = prepared.problem, prepared.structure
    assert problem.limiter is not None
    z = initial_state(problem, initial, structure)
    tolerance = TOLERANCE if problem.tolerance is None else problem.tolerance
    run = soft.follow(
        structure, problem.limiter, z, prepared.wanted, problem.t_end, tolerance, tick
    )
    history.take(structure.scene(), run.states, 0)
    found = _bare(problem, history)
    found.update(
        error_penetration=run.compression,
        error_difference=run.difference,
        count_expansions=run.steps,
        error_statement=_HALVED,
    )
    return Result(**found)


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
    found = _bare(problem, history)
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
    return Result(**found)


_METHODS: Final = {Flight.MODAL: _exact, Flight.SPLITTING: _soft}


def join(problem: Problem, plan: Plan, results: Sequence[Result]) -> Result:
    """Return the one result there is."""
    (result,) = results
    return result


def _bare(problem: Problem, history: History) -> dict[str, Any]:
    """Return the history and, for methods that know no more, empty tables."""
    found, outputs = dict(_NOTHING), problem.outputs
    if outputs & {"x", "v", "energy"}:
        found.update(t=problem.times, x=history.x, v=history.v, energy=history.energy)
    if outputs & {"x", "v"}:
        found["dof"] = problem.wanted_dofs
    for table in outputs & {"impacts", "contacts"}:
        found.update(_TABLES[table])
    found.update(
        count_impacts=0,
        count_grazings=0,
        count_expansions=0,
        error_condition=1.0,
        error_penetration=0.0,
        error_predictable_until=problem.t_end,
        error_tolerance=TOLERANCE if problem.tolerance is None else problem.tolerance,
        error_energy_drift=history.drift,
        error_statement="",
    )
    return found


_NOTHING: Final = empty()
_TABLES: Final = {
    table: {
        name: np.zeros(0, np.int64 if name.endswith(("_constraint", "_side")) else np.float64)
        for name in _NOTHING
        if name.startswith(table[:-1] + "_")
    }
    for table in ("impacts", "contacts")
}


def _result(problem: Problem, run: Run, history: History) -> Result:
    outputs, scale = problem.outputs, run.scale
    found = _bare(problem, history)
    at = _joined(run.impacts.at, (0, 2))
    times = (at[:, 0] + at[:, 1]) / scale
    growth = _joined(run.impacts.growth, (0,))
    if "impacts" in outputs:
        where = _joined(run.impacts.where, (0, 2)).astype(np.int64, copy=False)
        what = _joined(run.impacts.what, (0, 3))
        found.update(
            impact_time=times,
            impact_constraint=where[:, 0],
            impact_side=where[:, 1],
            impact_velocity=what[:, 0] * scale,
            impact_impulse=what[:, 1] * scale,
            impact_condition=growth if problem.estimate else np.full(growth.size, np.nan),
        )
    if "contacts" in outputs and run.rests:
        rests = run.rests
        found.update(
            contact_start=np.array([r.start for r in rests]) / scale,
            contact_rest=np.array([r.rest for r in rests]) / scale,
            contact_stop=np.array([r.stop for r in rests]) / scale,
            contact_constraint=np.array([r.contact[0] for r in rests], dtype=np.int64),
            contact_side=np.array([r.contact[1] for r in rests], dtype=np.int64),
        )
    found.update(
        count_impacts=run.impacts.count,
        count_grazings=int(run.counts[8]),
        count_expansions=int(run.counts[2]),
        error_penetration=float(run.clock[6]),
        error_statement=_STATEMENT if problem.estimate else _UNKNOWN,
    )
    if problem.estimate:
        lost = np.flatnonzero(~(growth * _EPS <= found["error_tolerance"]))
        found.update(
            error_condition=max(1.0, float(growth.max(initial=0.0)), run.growth),
            error_predictable_until=float(times[lost[0]]) if lost.size else problem.t_end,
        )
    else:
        found.update(error_condition=np.nan, error_predictable_until=np.nan)
    return Result(**found)


def _joined(pieces: list[Any], shape: tuple[int, ...]) -> Any:
    if len(pieces) == 1:
        return pieces[0]
    return np.concatenate(pieces) if pieces else np.zeros(shape)
