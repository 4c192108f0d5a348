"""Computes a slow flow as its plan says, and its differences from the exact motion."""

from __future__ import annotations

import time
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import Floats, nothing
from vibroimpact_solvers.plan import Plan, Stage, Tick
from vibroimpact_solvers.results.slow_flow import Result
from vibroimpact_solvers.slow_flow.motion import Motion
from vibroimpact_solvers.slow_flow.problem import Problem

_STATE: Final = ("gamma", "omega", "phi", "A", "B")
_MEASURED: Final = (
    "measured: differences from the exact motion from the same start, at the times asked for and "
    "at its impacts"
)
_EXACT: Final = "the exact motion; its only errors are roundings"
_ROUNDING: Final = 1e-12
"""Rounding of the exact displacements, relative to the largest."""
_UNKNOWN: Final = "not asked"


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
    requested = [*(_STATE if "state" in outputs else ()), *(outputs & {"x", "v"})]
    fields.update({name: getattr(motion, name) for name in requested})
    if "impulse" in outputs:
        p = fields["impulse"] = model.impulse(motion)
        if p is not None and motion.omega is not None:
            fields["momentum"] = 2.0 * p / motion.omega
    if problem.compares:
        errors = _errors(problem, plan, motion)
        if "error" in outputs:
            fields.update(errors)
        if problem.tolerance is not None:
            fields["within_tolerance"] = _within(problem, motion, errors["error_x"])
            fields["error_statement"] = errors["error_statement"]
    if tick is not None:
        tick(total, total)
    return Result(**fields)


def _within(problem: Problem, motion: Motion, error: Floats) -> NDArray[np.bool_]:
    """Return whether a variant is within the tolerance."""
    assert problem.tolerance is not None
    assert motion.x is not None
    if problem.variant == "exact":
        return np.array(problem.tolerance >= _ROUNDING)
    reach = float(np.abs(motion.x - error).max())
    return np.array(float(np.abs(error).max()) <= problem.tolerance * reach)


def _errors(problem: Problem, plan: Plan, motion: Motion) -> dict[str, Any]:
    """Return the exact impacts and the differences from the exact motion."""
    model, variant = problem.moving, problem.variant
    exact, seconds = motion, None
    if plan.step(Stage.FREE_MOTION) is not None:
        started = time.perf_counter()
        exact = model.motion("exact", problem.t)
        seconds = np.array(time.perf_counter() - started)
    assert motion.x is not None
    assert exact.x is not None
    errors: dict[str, Any] = {
        "error_x": motion.x - exact.x,
        "seconds_exact": seconds,
        "error_statement": _EXACT if variant == "exact" else _MEASURED,
    }
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
            "error_phi": zeros,
            "error_gamma": None if impacts.gamma is None else zeros,
        }
    at = model.motion(variant, impacts.time, shapes=False)
    if at.phi is not None:
        errors["error_phi"] = at.phi - impacts.phi
    if impacts.gamma is not None and at.gamma is not None:
        errors["error_gamma"] = at.gamma - impacts.gamma
    return errors
