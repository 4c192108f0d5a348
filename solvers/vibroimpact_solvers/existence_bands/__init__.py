"""Existence bands: the frequency ranges in which the impact modes of a family exist.

With one bilateral limiter the bands are proved complete: none can be missed between them.

Examples
--------
>>> from vibroimpact_solvers import existence_bands
>>> from vibroimpact_solvers.model import Constraint
>>> from vibroimpact_solvers.presets import oscillator
>>> system = oscillator([Constraint.at(0, gap=1.0)], Omega0=1.0)
>>> problem = existence_bands.Problem(system, start=0.2, stop=3.0)
>>> result = existence_bands.solve(problem, existence_bands.plan(problem))
>>> result.band_start.round(6), result.band_stop
(array([1.]), array([3.]))
"""

from vibroimpact_solvers.existence_bands.planning import plan
from vibroimpact_solvers.existence_bands.problem import KIND, OUTPUTS, Problem
from vibroimpact_solvers.existence_bands.solving import solve
from vibroimpact_solvers.plan import join_only as join
from vibroimpact_solvers.plan import split_nothing as split
from vibroimpact_solvers.results.existence_bands import EDGES, Edge, Result

__all__ = [
    "EDGES",
    "KIND",
    "OUTPUTS",
    "Edge",
    "Problem",
    "Result",
    "join",
    "plan",
    "solve",
    "split",
]
