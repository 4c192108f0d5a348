"""Existence bands: the ranges of frequency in which members of a family are real motions.

With one bilateral limiter the bands are proved: no band can hide between those that are found.
"""

from vibroimpact_solvers.existence_bands.planning import plan, split
from vibroimpact_solvers.existence_bands.problem import KIND, OUTPUTS, Problem
from vibroimpact_solvers.existence_bands.result import EDGES, Edge, Result
from vibroimpact_solvers.existence_bands.solving import join, solve

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
