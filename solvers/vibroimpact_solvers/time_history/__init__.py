"""Time histories: motions from an initial state, exact between impacts, no impact missed."""

from vibroimpact_solvers.time_history.limiters import Power
from vibroimpact_solvers.time_history.loads import Harmonic
from vibroimpact_solvers.time_history.planning import plan, split
from vibroimpact_solvers.time_history.problem import EXACT, KIND, OUTPUTS, Member, Problem, State
from vibroimpact_solvers.time_history.result import Result
from vibroimpact_solvers.time_history.run import Tick
from vibroimpact_solvers.time_history.solving import TOLERANCE, join, solve
from vibroimpact_solvers.time_history.together import Outcome, together

__all__ = [
    "EXACT",
    "KIND",
    "OUTPUTS",
    "TOLERANCE",
    "Harmonic",
    "Member",
    "Outcome",
    "Power",
    "Problem",
    "Result",
    "State",
    "Tick",
    "join",
    "plan",
    "solve",
    "split",
    "together",
]
