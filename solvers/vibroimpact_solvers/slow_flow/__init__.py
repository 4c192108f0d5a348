"""Slow flows: motions whose impacts change slowly, by damping or by losses at the walls.

Each system of the chapter is a model with several descriptions of its motion, the variants: the
exact one, and closed forms and averaged equations that are compared with it.

Examples
--------
>>> import numpy as np
>>> from vibroimpact_solvers import slow_flow
>>> from vibroimpact_solvers.model import Constraint
>>> from vibroimpact_solvers.presets import oscillator
>>> system = oscillator([Constraint.at(0, gap=1.0)], Omega0=1.0, zeta=0.01)
>>> initial, t = slow_flow.Initial(gamma=0.2), np.array([0.0, 50.0])
>>> problem = slow_flow.Problem(system, "damped", "averaged", initial, t)
>>> result = slow_flow.solve(problem, slow_flow.plan(problem))
>>> result.gamma.round(6)
array([0.2     , 0.544764])
>>> float(result.t_max.round(2)), float(result.t_max_exact.round(2))  # end of the impacts
(92.55, 91.69)
"""

from vibroimpact_solvers.plan import join_only as join
from vibroimpact_solvers.plan import split_nothing as split
from vibroimpact_solvers.results.slow_flow import STAGES, Result, Stage
from vibroimpact_solvers.slow_flow.motion import Initial, Variant
from vibroimpact_solvers.slow_flow.planning import plan
from vibroimpact_solvers.slow_flow.problem import KIND, MODELS, OUTPUTS, Problem
from vibroimpact_solvers.slow_flow.solving import solve

__all__ = [
    "KIND",
    "MODELS",
    "OUTPUTS",
    "STAGES",
    "Initial",
    "Problem",
    "Result",
    "Stage",
    "Variant",
    "join",
    "plan",
    "solve",
    "split",
]
