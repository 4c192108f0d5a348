"""Ensembles: motions of one structure from many initial states.

Examples
--------
>>> import numpy as np
>>> from vibroimpact_solvers import ensemble
>>> from vibroimpact_solvers.model import Constraint
>>> from vibroimpact_solvers.presets import oscillator
>>> system = oscillator([Constraint.at(0, gap=1.0)], Omega0=1.0)
>>> v = np.array([[0.5], [1.5], [3.0]])
>>> problem = ensemble.Problem(system, x=np.zeros_like(v), v=v, t_end=4.0)
>>> result = ensemble.solve(problem, ensemble.plan(problem))
>>> result.impact_count, result.impact_offset
(array([0, 3, 6]), array([0, 0, 3]))
>>> result.impact_time[:3].round(6)  # of member 1
array([0.729728, 2.189183, 3.648638])
"""

from vibroimpact_solvers.ensemble.planning import content, plan, split
from vibroimpact_solvers.ensemble.problem import KIND, Problem
from vibroimpact_solvers.ensemble.solving import join, solve
from vibroimpact_solvers.results.ensemble import Result

__all__ = ["KIND", "Problem", "Result", "content", "join", "plan", "solve", "split"]
