"""Periodic motions of a driven, damped structure that hits its limiters.

All motions with one impact per period, or with one at each wall half a period apart, are found in
closed form, whatever the number of degrees of freedom; other sequences by Newton's method.

Examples
--------
>>> import numpy as np
>>> from vibroimpact_solvers import periodic_motions
>>> from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
>>> one = SymmetricMatrix.diagonal([1.0])
>>> wall = Constraint((0,), (1.0,), lower=None, upper=0.5, restitution=0.8)
>>> system = System(one, one, (wall,), C=SymmetricMatrix.diagonal([0.1]))
>>> drive = periodic_motions.Force((0,), (1.0,), amplitude=1.0)
>>> problem = periodic_motions.Problem(system, np.array([1.2]), (drive,))
>>> result = periodic_motions.solve(problem, periodic_motions.plan(problem))
>>> result.solution_impacts, result.solution_exists
(array([0, 1, 1]), array([False,  True, False]))
"""

from vibroimpact_solvers.periodic_motions.planning import plan
from vibroimpact_solvers.periodic_motions.problem import (
    KIND,
    OUTPUTS,
    SYMMETRIC,
    Force,
    Impact,
    Problem,
)
from vibroimpact_solvers.periodic_motions.solving import join, solve, split
from vibroimpact_solvers.results.periodic_motions import Bifurcation, Result

__all__ = [
    "KIND",
    "OUTPUTS",
    "SYMMETRIC",
    "Bifurcation",
    "Force",
    "Impact",
    "Problem",
    "Result",
    "join",
    "plan",
    "solve",
    "split",
]
