"""Slow flows: closed forms at a million times, and run time against error of every variant."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Final

import numpy as np

from benchmarks.harness import measure
from benchmarks.motions.peers import solve_ivp
from benchmarks.tables import Goal, Plot, Table
from vibroimpact_solvers import presets, slow_flow
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.slow_flow import Initial, Problem, Result
from vibroimpact_solvers.slow_flow.models import MODELS

_POINTS = 1_000_000
_GOAL = 0.2
_TIMES = 1000  # of the comparison of variants


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
        timing = measure(rounds=3, work=partial(solve, system, model, variant, initial, t))["work"]
        rows.append((model, variant, timing.wall, timing.processor, _GOAL))
    return Table(
        "Closed forms at a million times",
        ("model", "variant", "wall [s]", "processor [s]", "goal [s]"),
        rows,
        "State, displacement and velocity.",
        Goal("processor [s]", "goal [s]"),
    )


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


def work_precision() -> Table:
    """Run time against error of every variant of every model, and of a general integrator.

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
        if model == "restitution":
            for tolerance in (1e-6, 1e-9, 1e-12):
                runs[f"scipy DOP853, {tolerance:g}"] = partial(
                    _integrated, exact[0, 0], _speed(system, initial, model), t, tolerance
                )
        for name, run in runs.items():
            found = run()
            assert found is not None
            error = float(np.abs(found - exact).max() / np.abs(exact).max())
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


def _speed(system: System, initial: Initial, model: str) -> float:
    """Return the velocity at t = 0."""
    v = solve(system, model, "exact", initial, np.zeros(1)).v
    assert v is not None
    return float(v[0, 0])


def _integrated(x: float, v: float, t: Floats, tolerance: float) -> Floats:
    """Return the oscillator between lossy walls by a general integrator with events."""

    def wall(side: float) -> Any:
        def room(_: float, y: Floats) -> float:
            return float(side * y[0] - 1.0)

        room.terminal, room.direction = True, 1.0  # type: ignore[attr-defined]
        return room

    found = np.full((t.size, 1), np.nan)
    now, y = 0.0, np.array([x, v])
    while now < t[-1]:
        some = (t >= now) & np.isnan(found[:, 0])
        piece = solve_ivp(
            lambda _, y: [y[1], -y[0]],
            (now, t[-1]),
            y,
            method="DOP853",
            rtol=tolerance,
            atol=tolerance * 1e-2,
            events=[wall(1.0), wall(-1.0)],
            dense_output=True,
        )
        until = float(piece.t[-1])
        some &= t <= until
        if some.any():
            found[some, 0] = piece.sol(t[some])[0]
        if piece.status != 1:
            break
        y = np.array([np.clip(piece.y[0, -1], -1.0, 1.0), -0.95 * piece.y[1, -1]])
        now = until
    # What was missed beyond the last impact found is far off.
    return np.where(np.isnan(found), 1.0, found)


TABLES: Final = (closed_forms, work_precision)
