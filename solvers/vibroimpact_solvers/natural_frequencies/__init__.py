"""Natural frequencies and mode shapes of a structure, with some of its constraints held or none.

    K e_j = Omega_j^2 M e_j ,    e_i^T M e_j = delta_ij ,

without damping and without impacts; what constraints and motions of the base have to do with the
modes: participations ``w_a^T e_j``, effective masses ``(e_j^T M r)^2`` of a direction r, and the
flexibility ``W (K^-1 - sum_j e_j e_j^T / Omega_j^2) W^T`` that a modal model without the other
modes lacks.

Examples
--------
>>> from vibroimpact_solvers import natural_frequencies
>>> from vibroimpact_solvers.model import Constraint
>>> from vibroimpact_solvers.presets import chain
>>> problem = natural_frequencies.Problem(chain(3, [Constraint.at(1, gap=1.0)]), count=2)
>>> result = natural_frequencies.solve(problem, natural_frequencies.plan(problem))
>>> result.Omega.round(6)
array([0.765367, 1.414214])
>>> result.shape.round(6)
array([[ 0.5     ,  0.707107,  0.5     ],
       [ 0.707107,  0.      , -0.707107]])
"""

from vibroimpact_solvers.natural_frequencies.planning import KIND, plan
from vibroimpact_solvers.natural_frequencies.problem import OUTPUTS, Problem, mode_count
from vibroimpact_solvers.natural_frequencies.solving import solve
from vibroimpact_solvers.plan import join_only as join
from vibroimpact_solvers.plan import split_nothing as split
from vibroimpact_solvers.results.natural_frequencies import Result

__all__ = ["KIND", "OUTPUTS", "Problem", "Result", "join", "mode_count", "plan", "solve", "split"]
