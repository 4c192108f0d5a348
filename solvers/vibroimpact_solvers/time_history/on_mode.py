"""Displacements and velocities of impact modes, from which many motions may start."""

from __future__ import annotations

import math

import numpy as np

from vibroimpact_solvers.model import System
from vibroimpact_solvers.time_history.planning import plan
from vibroimpact_solvers.time_history.problem import ImpactMode, Problem, State
from vibroimpact_solvers.time_history.windows import solve


def state_of(system: System, mode: ImpactMode) -> State:
    """Return the state of an impact mode at tau = 0, half-way between its impacts.

    Raises
    ------
    ModelError
        Where there is no such motion, with the pointer from the request of a time history.
    """
    positive = math.isfinite(mode.Omega) and mode.Omega > 0.0
    motion = Problem(
        system,
        mode,
        1.0 / mode.Omega if positive else 1.0,
        np.zeros(1),
        outputs=frozenset({"x", "v"}),
        estimate=False,
    )
    result = solve(motion, plan(motion))
    assert result.x is not None
    assert result.v is not None
    return State(result.x[0], result.v[0])
