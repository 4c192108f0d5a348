"""States of a motion at the drive's phase 0, and after how many periods they return."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.attractors.problem import Problem

SMALL: Final = 1e-3
"""Least scale of distances, of the structure's length."""


def states_of(problem: Problem, x: Floats, v: Floats) -> tuple[Floats, float]:
    """Return states, shape (section, 2 dof), and what distances are relative to.

    States are displacements, and velocities over the drive's frequency, of shape (section, dof).
    """
    states = np.concatenate([x, v / float(problem.Omega[0])], axis=1)
    scale = max(float(np.abs(states).max()), SMALL * problem.length) or 1.0  # or all is still
    return states, scale


def recurrence(states: Floats, longest: int, close: float) -> tuple[int, float]:
    """Return the smallest period of the last states, or 0, and how far they are from returning."""
    last = states.shape[0] - 1
    for n in range(1, longest + 1):
        now = np.arange(last - longest + 1, last + 1)
        apart = float(np.abs(states[now] - states[now - n]).max())
        if apart <= close:
            before = states[last - 2 * n + 1 : last - n + 1]
            return n, float(np.abs(states[last - n + 1 :] - before).max())
    return 0, math.inf
