"""Attractors: what the motions of a driven, damped structure with stops settle on.

Examples
--------
>>> import numpy as np
>>> from vibroimpact_solvers import attractors
>>> from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
>>> from vibroimpact_solvers.periodic_motions import Force
>>> one = SymmetricMatrix.diagonal([1.0])
>>> wall = Constraint((0,), (1.0,), lower=None, upper=0.5, restitution=0.8)
>>> system = System(one, one, (wall,), C=SymmetricMatrix.diagonal([0.1]))
>>> v = np.linspace(-2.0, 2.0, 5)[:, np.newaxis]
>>> problem = attractors.Problem(
...     system, np.array([1.2]), np.zeros_like(v), v, (Force((0,), (1.0,), 1.0),)
... )
>>> result = attractors.solve(problem, attractors.plan(problem))
>>> result.attractor_period, result.attractor_impacts, result.attractor_motions
(array([1]), array([1]), array([5]))
>>> result.attractor_fraction_low.round(2)
array([0.57])
"""

from vibroimpact_solvers.attractors import continued
from vibroimpact_solvers.attractors.planning import plan
from vibroimpact_solvers.attractors.problem import KIND, OUTPUTS, SECTIONS, Problem
from vibroimpact_solvers.attractors.solving import solve
from vibroimpact_solvers.periodic_motions import Force
from vibroimpact_solvers.plan import join_only as join
from vibroimpact_solvers.plan import split_nothing as split
from vibroimpact_solvers.results.attractors import Nature, Result, Verification

__all__ = [
    "KIND",
    "OUTPUTS",
    "SECTIONS",
    "Force",
    "Nature",
    "Problem",
    "Result",
    "Verification",
    "continued",
    "join",
    "plan",
    "solve",
    "split",
]
