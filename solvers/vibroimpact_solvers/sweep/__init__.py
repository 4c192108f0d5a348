"""Sweeps: one computation at every point of a parameter grid.

The points share every stage of the computation that their parameters do not invalidate: the axes
of the most expensive stages vary slowest. Results are those of the points alone, to the last bit.

Examples
--------
>>> import numpy as np
>>> from vibroimpact_solvers import impact_modes, sweep
>>> from vibroimpact_solvers.model import Constraint
>>> from vibroimpact_solvers.plan import Stage
>>> from vibroimpact_solvers.presets import oscillator
>>> gaps = np.array([0.5, 1.0, 2.0])
>>> def at(index):
...     system = oscillator([Constraint.at(0, float(gaps[index[0]]))], Omega0=1.0)
...     return impact_modes.Problem(system, omega=np.array([1.0]))
>>> axis = sweep.Axis("system.constraints.0.gap", "gap", gaps, stage=Stage.IMPULSE)
>>> problem = sweep.Problem("impact-modes", (axis,), at, at((0,)).system)
>>> result = sweep.solve(problem, sweep.plan(problem))
>>> result.arrays["impulse"].ravel().round(6)
array([0.321046, 0.642093, 1.284185])
"""

from vibroimpact_solvers.sweep.kinds import KINDS, meaning, rule
from vibroimpact_solvers.sweep.planning import content, plan, split
from vibroimpact_solvers.sweep.problem import KIND, Axis, Problem
from vibroimpact_solvers.sweep.result import Result
from vibroimpact_solvers.sweep.solving import join, solve

__all__ = [
    "KIND",
    "KINDS",
    "Axis",
    "Problem",
    "Result",
    "content",
    "join",
    "meaning",
    "plan",
    "rule",
    "solve",
    "split",
]
