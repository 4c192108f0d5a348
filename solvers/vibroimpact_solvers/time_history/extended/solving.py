"""From a problem to a motion with all digits, and from that to its result."""

from __future__ import annotations

import math
from typing import Any, Final

import flint
import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.time_history.extended.motion import Motion
from vibroimpact_solvers.time_history.extended.precision import Real, Row, middle, real, working
from vibroimpact_solvers.time_history.extended.scene import Body
from vibroimpact_solvers.time_history.history import conserves
from vibroimpact_solvers.time_history.problem import Problem, State
from vibroimpact_solvers.time_history.result import Result, empty
from vibroimpact_solvers.time_history.run import Tick

_EPS: Final = 2.0**-52
_STATEMENT: Final = (
    "estimate: roundings of {digits} decimal digits, carried along by the linearised motion and "
    "its impacts, relative to the state; between impacts the motion is exact, no impact can be "
    "missed but for grazings within rounding, and the numbers are rounded to doubles in the end"
)


def motion(problem: Problem, digits: int, tick: Tick | None = None) -> Motion:
    """Follow a motion to its end; to be called while `precision.working` with these digits."""
    assert isinstance(problem.initial, State)
    body = Body(problem.system, problem.load, digits)
    x, v = ([real(value) for value in part] for part in (problem.initial.x, problem.initial.v))
    wanted = problem.times if problem.outputs & {"x", "v", "energy"} else np.zeros(0)
    found = Motion(body, x, v, problem.t_end, wanted, tick)
    found.finish()
    return found


def solve(problem: Problem, digits: int, tolerance: float, tick: Tick | None = None) -> Result:
    """Follow a motion with so many decimal digits.

    Parameters
    ----------
    problem : Problem
    digits : int
    tolerance : float
        Relative to the state; says until when the digits hold it.
    tick : callable, optional
        Called with (done, total) thousandths of the motion; may raise `Cancelled`.

    Raises
    ------
    PlanError
        Where damping couples modes or is critical, or a load is in resonance.
    """
    with working(digits):
        run = motion(problem, digits, tick)
        found = empty() | _history(problem, run)
        if "impacts" in problem.outputs:
            found.update(_impacts(run))
        if "contacts" in problem.outputs:
            found.update(_contacts(run))
    lost = [i.time for i in run.impacts if not i.condition <= tolerance]
    last = run.deviations.condition * run.unit
    largest = max([last, *(impact.condition for impact in run.impacts)])
    found.update(
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
    return Result(**found)


def _history(problem: Problem, run: Motion) -> dict[str, Any]:
    outputs, found = problem.outputs, dict[str, Any]()
    if not outputs & {"x", "v", "energy"}:
        return found
    found["t"] = problem.times
    if outputs & {"x", "v"}:
        found["dof"] = dofs = problem.wanted_dofs
        places = [scene.place(q, rate, dofs.tolist()) for scene, q, rate in run.samples]
        shape = (len(places), dofs.size)
        for name, part in (("x", 0), ("v", 1)):
            if name in outputs:
                found[name] = np.array([_floats(p[part]) for p in places]).reshape(shape)
    if "energy" in outputs:
        energies = [_energy(run, place) for place in range(len(run.samples))]
        found["energy"] = np.array(_floats(energies))
        if conserves(problem) and energies:
            size = max(abs(energy) for energy in energies)
            drift = max(abs(energy - energies[0]) for energy in energies)
            found["error_energy_drift"] = float(middle(drift / size)) if size > 0 else 0.0
    return found


def _energy(run: Motion, place: int) -> Real:
    """Return kinetic and elastic energy and that of the constant load."""
    scene, q, rate = run.samples[place]
    body = run.body
    x, v = scene.place(q, rate, range(body.system.n))
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
    rests = run.rests
    return {
        "contact_start": _column([r.start for r in rests]),
        "contact_rest": _column([r.rest for r in rests]),
        "contact_stop": _column([r.stop for r in rests]),
        "contact_constraint": np.array([r.contact[0] for r in rests], dtype=np.int64),
        "contact_side": np.array([r.contact[1] for r in rests], dtype=np.int64),
        "contact_impulse": _column([r.impulse for r in rests]),
    }


def _column(values: Row) -> Floats:
    return np.array(_floats(values), dtype=np.float64)


def _floats(values: Row) -> list[float]:
    found = [float(middle(value)) for value in values]
    assert all(map(math.isfinite, found))
    return found
