"""Sweeps: a computation at every point of a lattice of values of some of its fields.

What a stage yields is shared by all points that do not spoil it: axes are turned by stage, the
dearest slowest. Results are those of the points alone, to the last bit.
"""

from vibroimpact_solvers.sweep.planning import content, plan, split
from vibroimpact_solvers.sweep.problem import KIND, Axis, Problem
from vibroimpact_solvers.sweep.result import MOST_SENTENCES, STATUSES, Result, Status
from vibroimpact_solvers.sweep.solving import join, solve
from vibroimpact_solvers.sweep.stages import KINDS, meaning, rule

__all__ = [
    "KIND",
    "KINDS",
    "MOST_SENTENCES",
    "STATUSES",
    "Axis",
    "Problem",
    "Result",
    "Status",
    "content",
    "join",
    "meaning",
    "plan",
    "rule",
    "solve",
    "split",
]
