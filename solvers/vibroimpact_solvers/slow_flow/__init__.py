"""Slow flows: motions whose impacts change slowly, by damping or by losses at the walls.

Each system of the chapter is a model with several descriptions of its motion, the variants: the
exact one, and closed forms and averaged equations that are compared with it.
"""

from vibroimpact_solvers.slow_flow.models import MODELS
from vibroimpact_solvers.slow_flow.motion import STAGES, Initial, Stage, Variant
from vibroimpact_solvers.slow_flow.planning import plan, split
from vibroimpact_solvers.slow_flow.problem import KIND, OUTPUTS, Problem
from vibroimpact_solvers.slow_flow.result import Result
from vibroimpact_solvers.slow_flow.solving import Tick, join, solve

__all__ = [
    "KIND",
    "MODELS",
    "OUTPUTS",
    "STAGES",
    "Initial",
    "Problem",
    "Result",
    "Stage",
    "Tick",
    "Variant",
    "join",
    "plan",
    "solve",
    "split",
]
