"""Branches of periodic motions: how motions change with one number of their problem.

A branch is followed by its arc length, through folds; special points are located on it, and the
branches that begin at flips and losses of symmetry are followed too.

Examples
--------
>>> import numpy as np
>>> from vibroimpact_solvers import branches
>>> from vibroimpact_solvers import periodic_motions as driven
>>> from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
>>> one = SymmetricMatrix.diagonal([1.0])
>>> wall = Constraint((0,), (1.0,), lower=None, upper=0.0, restitution=0.8)
>>> system = System(one, one, (wall,), C=SymmetricMatrix.diagonal([0.1]))
>>> load = (driven.Force((0,), (1.0,), amplitude=1.0),)
>>> def at(Omega):
...     return driven.Problem(system, np.array([Omega]), load, outputs=frozenset({"exists"}))
>>> problem = branches.Problem(at, 2.6, 2.7, system, frequency=True, step=0.2)
>>> result = branches.solve(problem, branches.plan(problem))
>>> flips = (result.point_type == branches.Type.FLIP) & result.point_exists
>>> result.point_parameter[flips].round(4)
array([2.6589])
"""

from vibroimpact_solvers.branches.planning import plan
from vibroimpact_solvers.branches.problem import KIND, Problem
from vibroimpact_solvers.branches.solving import join, solve, split
from vibroimpact_solvers.results.branches import TYPES, Result, Type

__all__ = ["KIND", "TYPES", "Problem", "Result", "Type", "join", "plan", "solve", "split"]
