"""Impact modes: the periodic motions of a structure that strikes its limiters once a period.

Every active constraint strikes its upper wall at tau = 1 and its lower one at tau = -1. Each
frequency has one member of the family, real or phantom.
"""

from vibroimpact_solvers.impact_modes.planning import (
    allows_partial,
    cell_flops,
    content,
    partial_plan,
    plan,
    split,
)
from vibroimpact_solvers.impact_modes.problem import KIND, OUTPUTS, Problem
from vibroimpact_solvers.impact_modes.result import REASONS, Reason, Result
from vibroimpact_solvers.impact_modes.solving import Tick, join, partial_waves, solve

__all__ = [
    "KIND",
    "OUTPUTS",
    "REASONS",
    "Problem",
    "Reason",
    "Result",
    "Tick",
    "allows_partial",
    "cell_flops",
    "content",
    "join",
    "partial_plan",
    "partial_waves",
    "plan",
    "solve",
    "split",
]
