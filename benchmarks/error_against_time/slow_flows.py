"""Slow flows: run time against error of every variant."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Final

import numpy as np

from benchmarks.harness import measure
from benchmarks.tables import Plot, Table
from vibroimpact_solvers import presets, slow_flow
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.slow_flow import MODELS, Initial, Problem, Result

_TIMES: Final = 1000


def solve(system: System, model: str, variant: str, initial: Initial, t: Floats) -> Result:
    """Plan and solve, as the service does."""
    outputs = frozenset({"state", "x", "v"})
    problem = Problem(system, model, variant, initial, t, outputs, None)
    return slow_flow.solve(problem, slow_flow.plan(problem))


def motions() -> list[tuple[str, System, Initial, float]]:
    """Return one motion of each model whose impacts change slowly, and its length."""
    return [
        (
            "damped",
            presets.oscillator([Constraint.at(0, 1.0)], 1.0, 0.01),
            Initial(gamma=0.3),
            80.0,
        ),
        (
            "two_oscillator",
            presets.two_mass([Constraint.at(0, 1.0)], 1.0, 0.05, 0.005),
            Initial(gamma=0.5, A=0.5, B=0.5),
            40.0,
        ),
        (
            "restitution",
            presets.oscillator([Constraint.at(0, 1.0, 0.95)], 1.0),
            Initial(omega=5.0),
            60.0,
        ),
        (
            "bouncing_ball",
            presets.bouncing_ball([Constraint((0,), (1.0,), 0.0, None, 0.9)], 9.81),
            Initial(x=1.0),
            8.0,
        ),
    ]


def slow_flow_variants() -> Table:
    """Run time against error of every variant of every model.

    The error is that of the displacement at 1000 times, relative to the largest; the reference
    is the exact motion, which the tests hold against extended precision.
    """
    rows: list[tuple[Any, ...]] = []
    for model, system, initial, end in motions():
        t = np.linspace(0.0, end, _TIMES)
        exact = solve(system, model, "exact", initial, t).x
        assert exact is not None
        runs: dict[str, Callable[[], Floats | None]] = {
            variant: partial(_displacement, system, model, variant, initial, t)
            for variant in MODELS[model].VARIANTS
        }
        for name, run in runs.items():
            x = run()
            assert x is not None
            error = float(np.abs(x - exact).max() / np.abs(exact).max())
            timed = measure(rounds=3, sample=0.0, run=run)["run"]
            shown = 1e-16 if name == "exact" else max(error, 1e-16)
            rows.append((model, name, timed.processor * 1e3, shown))
    return Table(
        "Run time against error: slow flows",
        ("model", "variant", "time [ms]", "error"),
        rows,
        f"Time of the processor for {_TIMES} times, planning included. 1e-16: the reference.",
        plots=(Plot("time [ms]", "error", by="variant", panel="model"),),
    )


def _displacement(
    system: System, model: str, variant: str, initial: Initial, t: Floats
) -> Floats | None:
    return solve(system, model, variant, initial, t).x
