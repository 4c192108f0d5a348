"""Slow flows: closed forms at a million times."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

import numpy as np

from benchmarks.harness import measure
from benchmarks.tables import Goal, Table
from vibroimpact_solvers import presets, slow_flow
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.slow_flow import Initial, Problem, Result

_POINTS = 1_000_000
_GOAL = 0.2


def solve(system: System, model: str, variant: str, initial: Initial, t: Floats) -> Result:
    """Plan and solve, as the service does."""
    outputs = frozenset({"state", "x", "v"})
    problem = Problem(system, model, variant, initial, t, outputs, None)
    return slow_flow.solve(problem, slow_flow.plan(problem))


def closed_forms() -> Table:
    """Evaluate each closed form, state and reconstruction included."""
    damped = presets.oscillator([Constraint.at(0, 1.0)], 1.0, 0.01)
    lossy = presets.oscillator([Constraint.at(0, 1.0, 0.95)], 1.0)
    ball = presets.bouncing_ball([Constraint((0,), (1.0,), 0.0, None, 0.9)], 9.81)
    cases: list[tuple[System, str, str, Initial, float]] = [
        (damped, "damped", "truncated", Initial(gamma=0.2), 110.0),
        (damped, "damped", "leading", Initial(gamma=0.2), 110.0),
        (lossy, "restitution", "corrected", Initial(omega=5.0), 100.0),
        (lossy, "restitution", "high_energy", Initial(omega=5.0), 100.0),
        (lossy, "restitution", "grazing", Initial(omega=5.0), 100.0),
        (ball, "bouncing_ball", "nstt", Initial(x=1.0), 9.0),
    ]
    rows: list[tuple[Any, ...]] = []
    for system, model, variant, initial, end in cases:
        t = np.linspace(0.0, end, _POINTS)
        timing = measure(work=partial(solve, system, model, variant, initial, t))["work"]
        rows.append((model, variant, timing.wall, timing.processor, _GOAL))
    return Table(
        "Closed forms at a million times",
        ("model", "variant", "wall [s]", "processor [s]", "goal [s]"),
        rows,
        "State, displacement and velocity.",
        Goal("processor [s]", "goal [s]"),
    )


TABLES: Final = (closed_forms,)
