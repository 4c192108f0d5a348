"""Computes a slow flow as its plan says, and its differences from the exact motion."""

from __future__ import annotations

import time
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import Floats, nothing
from vibroimpact_solvers.meter import metered
from vibroimpact_solvers.plan import Plan, Stage, Tick
from vibroimpact_solvers.results.slow_flow import Result
from vibroimpact_solvers.slow_flow.motion import Motion
from vibroimpact_solvers.slow_flow.problem import Problem
from vibroimpact_solvers.slow_flow.stated_errors import ROUNDING, durations, stated

_STATE: Final = ("gamma", "omega", "phi", "A", "B")
_MEASURED: Final = (
    "measured: differences from the exact motion from the same start, of x, v, A and B at the "
    "times asked for, of gamma and phi at its impacts before and after these times, and what they "
    "make of omega, impulse and momentum; and 1e-12 of the largest values for roundings of the "
    "exact motion"
)
_EXACT: Final = (
    "estimate: the exact motion; its only errors are roundings, up to 1e-12 of the largest values"
)
_UNKNOWN: Final = "not asked"


@metered
def solve(problem: Problem, plan: Plan, tick: Tick | None = None) -> Result:
    """Compute what the plan lists.

    Parameters
    ----------
    problem : Problem
    plan : Plan
        The one that `plan(problem)` returned.
    tick : callable, optional
        Called with (done, total) steps; may raise `Cancelled`.
    """
    model, outputs = problem.moving, problem.outputs
    total = len(plan.steps)
    shapes = bool(outputs & {"x", "v"}) or problem.compares
    started = time.perf_counter()
    motion = model.motion(problem.variant, problem.t, shapes=shapes)
    seconds = time.perf_counter() - started
    if tick is not None:
        tick(1, total)
    exists = model.exists()
    fields = nothing(Result)
    fields.update(
        t=problem.t,
        dof=np.arange(problem.system.n) if shapes else None,
        stage=motion.stage,
        t_max=np.array(model.duration(problem.variant)),
        t_max_exact=np.array(model.duration("exact")),
        exists=None if exists is None else np.array(exists),
        seconds=np.array(seconds),
        error_statement=_UNKNOWN,
    )
    fields.update(durations(fields["t_max"], fields["t_max_exact"]))
    requested = [*(_STATE if "state" in outputs else ()), *(outputs & {"x", "v"})]
    fields.update({name: getattr(motion, name) for name in requested})
    if "impulse" in outputs:
        p = fields["impulse"] = model.impulse(motion)
        if p is not None and motion.omega is not None:
            fields["momentum"] = 2.0 * p / motion.omega
    if problem.compares:
        exact, fields["seconds_exact"] = _exact(problem, plan, motion)
        errors = _differences(problem, motion, exact)
        if "error" in outputs:
            fields.update(errors)
            fields.update(stated(model, fields, motion, exact))
        if problem.tolerance is not None:
            fields["within_tolerance"] = _within(problem, motion, errors["difference_x"])
        fields["error_statement"] = _EXACT if exact is motion else _MEASURED
    if tick is not None:
        tick(total, total)
    return Result(**fields)


def _within(problem: Problem, motion: Motion, error: Floats) -> NDArray[np.bool_]:
    """Return whether a variant is within the tolerance."""
    assert problem.tolerance is not None
    assert motion.x is not None
    if problem.variant == "exact":
        return np.array(problem.tolerance >= ROUNDING)
    reach = float(np.abs(motion.x - error).max())
    return np.array(float(np.abs(error).max()) <= problem.tolerance * reach)


def _exact(problem: Problem, plan: Plan, motion: Motion) -> tuple[Motion, Any]:
    """Return the exact motion and the time that it takes, None where it is the motion itself."""
    if plan.step(Stage.FREE_MOTION) is None:
        return motion, None
    started = time.perf_counter()
    exact = problem.moving.motion("exact", problem.t)
    return exact, np.array(time.perf_counter() - started)


def _differences(problem: Problem, motion: Motion, exact: Motion) -> dict[str, Any]:
    """Return the exact impacts and the differences from the exact motion."""
    model, variant = problem.moving, problem.variant
    assert motion.x is not None
    assert exact.x is not None
    errors: dict[str, Any] = {"difference_x": motion.x - exact.x}
    impacts = model.impacts(float(problem.t.max()))
    if impacts.time.size == 0:
        return errors
    errors |= {
        "impact": np.arange(1, impacts.time.size + 1),
        "impact_time": impacts.time,
        "impact_velocity": impacts.velocity,
    }
    if variant == "exact":
        zeros: Floats = np.zeros(impacts.time.size)
        return errors | {
            "difference_phi": zeros,
            "difference_gamma": None if impacts.gamma is None else zeros,
        }
    at = model.motion(variant, impacts.time, shapes=False)
    if at.phi is not None:
        errors["difference_phi"] = at.phi - impacts.phi
    if impacts.gamma is not None and at.gamma is not None:
        errors["difference_gamma"] = at.gamma - impacts.gamma
    return errors
