"""Time histories: motions from an initial state, exact between impacts, no impact missed."""

from vibroimpact_solvers.time_history.limiters import Power
from vibroimpact_solvers.time_history.loads import Harmonic
from vibroimpact_solvers.time_history.planning import plan, split
from vibroimpact_solvers.time_history.problem import KIND, OUTPUTS, Member, Problem, State
from vibroimpact_solvers.time_history.result import Result
from vibroimpact_solvers.time_history.run import Tick
from vibroimpact_solvers.time_history.solving import Prepared, join, prepare, solve

__all__ = [
    "KIND",
    "OUTPUTS",
    "Harmonic",
    "Member",
    "Power",
    "Prepared",
    "Problem",
    "Result",
    "State",
    "Tick",
    "join",
    "plan",
    "prepare",
    "solve",
    "split",
]
