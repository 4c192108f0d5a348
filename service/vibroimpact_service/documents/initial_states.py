"""Documents of initial states to those of the solvers."""

from __future__ import annotations

import numpy as np

from vibroimpact_schema import motions
from vibroimpact_solvers import time_history as histories
from vibroimpact_solvers.arrays import Floats


def one(
    document: motions.InitialState | motions.InitialMode,
) -> histories.State | histories.ImpactMode:
    """Return what a motion starts from."""
    match document:
        case motions.InitialState(x=x, v=v):
            return histories.State(np.array(x), np.array(v))
        case motions.InitialMode(impact_mode=mode):
            return histories.ImpactMode(mode.Omega, tuple(mode.active or ()))


def many(document: motions.InitialStates) -> tuple[Floats, Floats]:
    """Return displacements and velocities of many motions, each shape (motion, dof)."""
    return np.array(document.x), np.array(document.v)
