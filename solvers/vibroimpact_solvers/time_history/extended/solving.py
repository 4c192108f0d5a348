"""Computes a motion in extended precision, and rounds it to a result in doubles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import Floats, nothing
from vibroimpact_solvers.kernels.impact_law import NEWTON
from vibroimpact_solvers.results.time_history import Result
from vibroimpact_solvers.time_history.extended.motion import Motion
from vibroimpact_solvers.time_history.extended.precision import Real, above, working
from vibroimpact_solvers.time_history.extended.structure import Body
from vibroimpact_solvers.time_history.history import conserves
from vibroimpact_solvers.time_history.loads import Harmonic
from vibroimpact_solvers.time_history.problem import Problem, State
from vibroimpact_solvers.time_history.result_values import OF_CONTACTS
from vibroimpact_solvers.time_history.run import Tick

_EPS: Final = 2.0**-52
_STATEMENT: Final = (
    "bound: all motions that roundings of {digits} decimal digits cannot be told from are enclosed "
    "and followed together, relative to the largest state in condition, absolute in each output; "
    "every impact and contact is certain for all of them, and the numbers are rounded to doubles "
    "in the end"
)


def motion(problem: Problem, tick: Tick | None = None) -> Motion:
    """Compute a motion to its end; to be called within `precision.working`."""
    assert isinstance(problem.initial, State)
    harmonic = tuple(term for term in problem.load if isinstance(term, Harmonic))
    body = Body(problem.system, harmonic, problem.t_end)
    x, v = problem.initial.x, problem.initial.v
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
        Where the digits do not tell what happens at a constraint.
    """
    with working(digits):
        run = motion(problem, tick)
        values = nothing(Result) | _history(problem, run)
        if "impacts" in problem.outputs:
            values.update(_impacts(run))
        if "contacts" in problem.outputs:
            values.update(_contacts(run))
    lost = [time for time, condition in run.errors if not condition <= tolerance]
    largest = max(run.condition, *(condition for _, condition in run.errors))
    values.update(
        count_impacts=len(run.impacts),
        count_grazings=run.grazings,
        count_expansions=run.expansions,
        error_condition=largest / _EPS,
        error_penetration=0.0,
        error_predictable_until=float(lost[0].mid()) if lost else problem.t_end,
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
        for name, part in (("x", 0), ("v", 1)):
            if name in outputs:
                samples = (run.body.whole(sample[part]) for sample in run.samples)
                rows = [[sample[dof] for dof in dofs.tolist()] for sample in samples]
                for field, taken in ((name, _floats), (f"error_{name}", _errors)):
                    values[field] = np.array(list(map(taken, rows))).reshape(-1, dofs.size)
    if "energy" in outputs:
        energies = [_energy(run, place) for place in range(len(run.samples))]
        values["energy"], values["error_energy"] = _column(energies), _column_errors(energies)
        if conserves(problem) and energies:
            size = max(abs(energy) for energy in energies)
            drift = max(abs(energy - energies[0]) for energy in energies)
            values["error_energy_drift"] = float((drift / size).mid()) if size > 0 else 0.0
    return values


def _energy(run: Motion, place: int) -> Real:
    """Return kinetic and elastic energy and that of the constant load."""
    (x, v), body = run.samples[place], run.body
    elastic = (x.transpose() * (body.K * x / 2 - body.force))[0, 0]
    return elastic + (v.transpose() * body.M * v)[0, 0] / 2


def _impacts(run: Motion) -> dict[str, Any]:
    impacts = run.impacts
    return {
        "impact_time": _column([i.time for i in impacts]),
        "impact_constraint": np.array([i.constraint for i in impacts], dtype=np.int64),
        "impact_side": np.array([i.side for i in impacts], dtype=np.int64),
        "impact_velocity": _column([i.velocity for i in impacts]),
        "impact_impulse": _column([i.impulse for i in impacts]),
        "error_impact_time": _column_errors([i.time for i in impacts]),
        "error_impact_velocity": _column_errors([i.velocity for i in impacts]),
        "error_impact_impulse": _column_errors([i.impulse for i in impacts]),
        "impact_condition": np.array([i.condition / _EPS for i in impacts], dtype=np.float64),
        # Coupled ones at one instant are refused.
        "impact_law": np.full(len(impacts), NEWTON),
    }


def _contacts(run: Motion) -> dict[str, Any]:
    intervals = run.contacts.intervals
    return {
        "contact_start": _column([r.start for r in intervals]),
        "contact_rest": _column([r.rest for r in intervals]),
        "contact_stop": _column([r.stop for r in intervals]),
        "contact_constraint": np.array([r.contact[0] for r in intervals], dtype=np.int64),
        "contact_side": np.array([r.contact[1] for r in intervals], dtype=np.int64),
        "contact_impulse": _column([r.impulse for r in intervals]),
        **dict.fromkeys(OF_CONTACTS, np.full(len(intervals), np.inf)),
    }


def _column(values: Sequence[Real]) -> Floats:
    return np.array(_floats(values), dtype=np.float64)


def _column_errors(values: Sequence[Real]) -> Floats:
    return np.array(_errors(values), dtype=np.float64)


def _errors(values: Sequence[Real]) -> list[float]:
    """Return bounds of what is off by the numbers of `_floats`."""
    return [above(value - float(value.mid())) for value in values]


def _floats(values: Sequence[Real]) -> list[float]:
    doubles = [float(value.mid()) for value in values]
    assert all(map(math.isfinite, doubles))
    return doubles
