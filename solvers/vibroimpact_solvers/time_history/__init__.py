"""Time histories: motions from an initial state, exact between impacts, no impact missed."""

from vibroimpact_solvers.time_history.answer import TOLERANCE
from vibroimpact_solvers.time_history.limiters import Power
from vibroimpact_solvers.time_history.loads import Harmonic
from vibroimpact_solvers.time_history.planning import plan
from vibroimpact_solvers.time_history.problem import EXACT, KIND, OUTPUTS, Member, Problem, State
from vibroimpact_solvers.time_history.result import Result
from vibroimpact_solvers.time_history.run import Tick
from vibroimpact_solvers.time_history.solving import Prepared, prepare
from vibroimpact_solvers.time_history.together import Outcome, from_states, together
from vibroimpact_solvers.time_history.windows import (
    Assembly,
    Part,
    Window,
    follow,
    join,
    solve,
    split,
)

__all__ = [
    "EXACT",
    "KIND",
    "OUTPUTS",
    "TOLERANCE",
    "Assembly",
    "Harmonic",
    "Member",
    "Outcome",
    "Part",
    "Power",
    "Prepared",
    "Problem",
    "Result",
    "State",
    "Tick",
    "Window",
    "follow",
    "from_states",
    "join",
    "plan",
    "prepare",
    "solve",
    "split",
    "together",
]
