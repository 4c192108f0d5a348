"""Computes a motion in extended precision, and rounds it to a result in doubles."""

from __future__ import annotations

import math
from typing import Any, Final

import flint
import numpy as np

from vibroimpact_solvers.arrays import Floats, nothing
from vibroimpact_solvers.results.time_history import Result
from vibroimpact_solvers.time_history.extended.configuration import Body
from vibroimpact_solvers.time_history.extended.motion import Motion
from vibroimpact_solvers.time_history.extended.precision import Real, Row, middle, real, working
from vibroimpact_solvers.time_history.history import conserves
from vibroimpact_solvers.time_history.problem import Problem, State
from vibroimpact_solvers.time_history.run import Tick

_EPS: Final = 2.0**-52
_STATEMENT: Final = (
    "estimate: roundings of {digits} decimal digits, carried along by the linearised motion and "
    "its impacts, relative to the state; between impacts the motion is exact, no impact can be "
    "missed but for grazings within rounding, and the numbers are rounded to doubles in the end"
)


def motion(problem: Problem, digits: int, tick: Tick | None = None) -> Motion:
    """Compute a motion to its end; to be called within `precision.working` of these digits."""
    assert isinstance(problem.initial, State)
    body = Body(problem.system, problem.load, digits)
    x, v = ([real(value) for value in part] for part in (problem.initial.x, problem.initial.v))
    output_times = problem.times if problem.outputs & {"x", "v", "energy"} else np.zeros(0)
    run = Motion(body, x, v, problem.t_end, output_times, tick)
    run.finish()
    return run


def solve(problem: Problem, digits: int, tolerance: float, tick: Tick | None = None) -> Result:
    """Compute a motion with the given number of decimal digits.

    Parameters
    ----------
    problem : Problem
    digits : int
    tolerance : float
        Relative to the state; decides until when the motion is predictable.
    tick : callable, optional
        Called with (done, total) thousandths of the motion; may raise `Cancelled`.

    Raises
    ------
    PlanError
        Where damping couples modes or is critical, or a load is in resonance.
    """
    with working(digits):
        run = motion(problem, digits, tick)
        values = nothing(Result) | _history(problem, run)
        if "impacts" in problem.outputs:
            values.update(_impacts(run))
        if "contacts" in problem.outputs:
            values.update(_contacts(run))
    lost = [i.time for i in run.impacts if not i.condition <= tolerance]
    last = run.deviations.condition * run.unit
    largest = max([last, *(impact.condition for impact in run.impacts)])
    values.update(
        count_impacts=len(run.impacts),
        count_grazings=run.grazings,
        count_expansions=run.expansions,
        error_condition=largest / _EPS,
        error_penetration=0.0,
        error_predictable_until=float(middle(lost[0])) if lost else problem.t_end,
        error_tolerance=tolerance,
        error_statement=_STATEMENT.format(digits=digits),
        error_digits=digits,
    )
    return Result(**values)


def _history(problem: Problem, run: Motion) -> dict[str, Any]:
    outputs, values = problem.outputs, dict[str, Any]()
    if not outputs & {"x", "v", "energy"}:
        return values
    values["t"] = problem.times
    if outputs & {"x", "v"}:
        values["dof"] = dofs = problem.output_dofs
        places = [
            configuration.displacements(q, rate, dofs.tolist())
            for configuration, q, rate in run.samples
        ]
        shape = (len(places), dofs.size)
        for name, part in (("x", 0), ("v", 1)):
            if name in outputs:
                values[name] = np.array([_floats(p[part]) for p in places]).reshape(shape)
    if "energy" in outputs:
        energies = [_energy(run, place) for place in range(len(run.samples))]
        values["energy"] = np.array(_floats(energies))
        if conserves(problem) and energies:
            size = max(abs(energy) for energy in energies)
            drift = max(abs(energy - energies[0]) for energy in energies)
            values["error_energy_drift"] = float(middle(drift / size)) if size > 0 else 0.0
    return values


def _energy(run: Motion, place: int) -> Real:
    """Return kinetic and elastic energy and that of the constant load."""
    configuration, q, rate = run.samples[place]
    body = run.body
    x, v = configuration.displacements(q, rate, range(body.system.n))
    columns = [flint.arb_mat([[value] for value in values]) for values in (x, v)]
    kinetic = (columns[1].transpose() * body.M * columns[1])[0, 0] / 2
    elastic = (columns[0].transpose() * body.K * columns[0])[0, 0] / 2
    load = sum((f * value for f, value in zip(body.force, x, strict=True)), flint.arb(0))
    return middle(kinetic + elastic - load)


def _impacts(run: Motion) -> dict[str, Any]:
    impacts = run.impacts
    return {
        "impact_time": _column([i.time for i in impacts]),
        "impact_constraint": np.array([i.constraint for i in impacts], dtype=np.int64),
        "impact_side": np.array([i.side for i in impacts], dtype=np.int64),
        "impact_velocity": _column([i.velocity for i in impacts]),
        "impact_impulse": _column([i.impulse for i in impacts]),
        "impact_condition": np.array([i.condition / _EPS for i in impacts], dtype=np.float64),
    }


def _contacts(run: Motion) -> dict[str, Any]:
    intervals = run.intervals
    return {
        "contact_start": _column([r.start for r in intervals]),
        "contact_rest": _column([r.rest for r in intervals]),
        "contact_stop": _column([r.stop for r in intervals]),
        "contact_constraint": np.array([r.contact[0] for r in intervals], dtype=np.int64),
        "contact_side": np.array([r.contact[1] for r in intervals], dtype=np.int64),
        "contact_impulse": _column([r.impulse for r in intervals]),
    }


def _column(values: Row) -> Floats:
    return np.array(_floats(values), dtype=np.float64)


def _floats(values: Row) -> list[float]:
    doubles = [float(middle(value)) for value in values]
    assert all(map(math.isfinite, doubles))
    return doubles
