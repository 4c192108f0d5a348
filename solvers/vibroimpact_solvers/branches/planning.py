"""The plan of branches: one method, whose cost follows from the number of points."""

from __future__ import annotations

from dataclasses import replace

from vibroimpact_solvers import periodic_motions
from vibroimpact_solvers.branches.problem import KIND, Problem
from vibroimpact_solvers.errors import ModelError, PlanError
from vibroimpact_solvers.plan import Plan, Stage, Step

_EVALUATIONS = 6.0  # of the equations for one point
_POINT = 1e7  # operations of a contact at a point, whatever the structure is
_MATRICES = 150.0  # products of matrices for a contact at a point
_POINTS = 0.1  # of the most that are allowed, about what a branch takes


def plan(problem: Problem) -> Plan:
    """Choose how the branches are followed and what is left out."""
    base = problem.at(problem.start)
    try:
        of_motions = periodic_motions.plan(base)
    except (ModelError, PlanError) as error:
        raise error.under("base") from None
    expected = max(50.0, _POINTS * problem.points) * (2.0 + problem.switch)
    m, modes = float(len(base.impacts)), float(base.system.n)
    flops, method = 200.0 * _EVALUATIONS * expected * m * m * modes, "continuation"
    reason = (
        "pseudo-arclength in phases, impulses and the parameter; special points by bisection along "
        "the branch"
    )
    if problem.stopped:
        contacts = m * (2.0 if base.symmetric else 1.0)
        flops = expected * contacts * (_POINT + _MATRICES * (2.0 * modes) ** 3)
        method = "continuation in switchings"
        reason = (
            "pseudo-arclength in the times of all switchings; where contacts begin, or end to be, "
            "motions are followed with the switchings that they have then"
        )
    steps = []
    for step in of_motions.steps:
        if step.stage is Stage.SPECTRUM:
            spectra = 1.0 if problem.frequency else _EVALUATIONS * expected
            bounded = step.bounded and problem.frequency
            steps.append(replace(step, flops=step.flops * spectra, bounded=bounded))
        elif step.stage is Stage.IMPULSE:
            size = 16.0 * expected * m
            steps.append(Step(Stage.IMPULSE, method, reason, flops, size, bounded=False))
        else:
            steps.append(
                replace(step, flops=step.flops * expected / 3.0, bytes=step.bytes * expected / 3.0)
            )
    return Plan(KIND, tuple(steps), of_motions.skips)
