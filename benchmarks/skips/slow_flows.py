"""Slow flows: what their plans leave out."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Final

import numpy as np

from benchmarks.error_against_time.slow_flows import motions
from benchmarks.skips.scene import Scene, solve
from vibroimpact_solvers import presets, slow_flow
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.slow_flow import OUTPUTS, Initial, Problem
from vibroimpact_solvers.slow_flow.models import MODELS

_TIMES: Final = 300


def scenes() -> Iterator[Scene]:
    """Yield scenes of slow flows: each variant of each model."""
    elastic = presets.oscillator([Constraint.at(0, 1.0)], 1.0)
    models = [*motions(), ("oscillator", elastic, Initial(gamma=0.5), 40.0)]
    for model, system, initial, end in models:
        for variant in MODELS[model].VARIANTS:
            requested = partial(_problem, model, variant, system, initial, end)
            name = f"{model}, {variant}"
            if variant == "exact":
                yield Scene(
                    f"{name}: its own error",
                    slow_flow,
                    partial(requested, frozenset({"x", "error"})),
                    partial(_twice, requested),
                    ("a second solution for the error",),
                )
                continue
            for outputs in ({"x"}, {"state"}):
                yield Scene(
                    f"{name}: only {min(outputs)} requested",
                    slow_flow,
                    partial(requested, frozenset(outputs)),
                    partial(_everything, requested),
                    tuple(sorted(set(OUTPUTS) - outputs)),
                )


def _problem(
    model: str,
    variant: str,
    system: System,
    initial: Initial,
    end: float,
    outputs: frozenset[str],
) -> Problem:
    t = np.linspace(0.0, end, _TIMES)
    return Problem(system, model, variant, initial, t, outputs)


def _everything(requested: partial[Problem]) -> object:
    return solve(slow_flow, requested(frozenset(OUTPUTS)))


def _twice(requested: partial[Problem]) -> object:
    """Compare the exact motion with itself."""
    problem = requested(frozenset({"x", "error"}))
    problem.moving.motion("exact", problem.t)
    return solve(slow_flow, problem)
