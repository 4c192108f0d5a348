"""Points of Poincare sections: states at the drive's phase 0, or impacts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.attractors.problem import Problem
from vibroimpact_solvers.attractors.verdicts import Verdict, sequence

_PHASE = ("x", "v")
_IMPACTS = ("constraint", "side", "phase", "velocity")


def sections(problem: Problem, shown: Sequence[Verdict], dofs: Integers) -> dict[str, Any]:
    """Return the table of points: those of one period, of others the last ones."""
    columns: dict[str, Any] = dict.fromkeys(
        (
            *(f"section_{name}" for name in ("attractor", *_PHASE, *_IMPACTS)),
            *(f"error_section_{name}" for name in (*_PHASE, "phase", "velocity")),
        )
    )
    if "section" not in problem.outputs:
        return columns
    points = [_points(problem, one, dofs) for one in shown]
    kinds = {"constraint": np.int64, "side": np.int64}
    names = _PHASE if problem.section == "phase" else _IMPACTS
    for name in names:
        shape = (0, dofs.size) if name in _PHASE else (0,)
        empty = np.zeros(shape, kinds.get(name, np.float64))
        columns[f"section_{name}"] = np.concatenate([empty, *(p[name] for p in points)])
    sizes = [part[names[0]].shape[0] for part in points]
    columns["section_attractor"] = rows = np.repeat(np.arange(len(points)), sizes)
    left = np.array([one.distance * one.scale for one in shown], dtype=np.float64)[rows]
    return columns | _errors(problem, columns, left, np.array([one.scale for one in shown])[rows])


def _errors(
    problem: Problem, columns: dict[str, Any], left: Floats, scale: Floats
) -> dict[str, Floats]:
    """Return the errors of points by what is left of the transient, infinite of no periodic one.

    That of an impact is late by its coordinate's over its speed, and meanwhile accelerated as a
    motion of that size with the drive's frequency.
    """
    Omega = float(problem.Omega[0])
    if problem.section == "phase":
        each = np.repeat(left[:, np.newaxis], columns["section_x"].shape[1], axis=1)
        return {"error_section_x": each, "error_section_v": Omega * each}
    rows = problem.system.directions(range(len(problem.system.constraints)))
    off = left * np.abs(rows).sum(axis=1)[columns["section_constraint"]]
    speed = np.abs(columns["section_velocity"])
    late = np.divide(off, speed, np.full(off.size, np.inf), where=speed > 0.0)
    return {
        "error_section_phase": Omega * late,
        "error_section_velocity": Omega * off + Omega**2 * scale * late,
    }


def _points(problem: Problem, one: Verdict, dofs: Integers) -> dict[str, Any]:
    """Return the points of one attractor."""
    if problem.section == "phase":
        last = slice(-min(problem.points, one.period or problem.points), None)
        return {"x": one.motion.x[last][:, dofs], "v": one.motion.v[last][:, dofs]}
    if problem.stopped:
        return _contact_points(problem, one)
    impacts, last = one.motion.impacts, slice(-problem.points, None)
    if one.period:
        impacts, last = sequence(problem, one), slice(problem.points)
    phase = np.mod(float(problem.Omega[0]) * impacts.time, 2.0 * np.pi)
    return {
        "constraint": impacts.constraint[last],
        "side": impacts.side[last],
        "phase": phase[last],
        "velocity": impacts.velocity[last],
    }


def _contact_points(problem: Problem, one: Verdict) -> dict[str, Any]:
    """Return the points of one attractor at which stops of finite stiffness begin to push."""
    table, start = one.motion.contacts, float(problem.sections[0])
    end = float(problem.sections[one.motion.periods])
    last = slice(-problem.points, None)
    if one.period:
        start, last = end - one.period * problem.period, slice(problem.points)
    kept = np.flatnonzero((table["start"] >= start) & (table["start"] < end))[last]
    return {
        "constraint": table["constraint"][kept],
        "side": table["side"][kept],
        "phase": np.mod(float(problem.Omega[0]) * table["start"][kept], 2.0 * np.pi),
        "velocity": table["velocity"][kept],
    }
