"""Time histories: motions from an initial state, exact between impacts, no impact missed.

Examples
--------
>>> import numpy as np
>>> from vibroimpact_solvers import time_history
>>> from vibroimpact_solvers.model import Constraint
>>> from vibroimpact_solvers.presets import oscillator
>>> system = oscillator([Constraint.at(0, gap=1.0, restitution=0.5)], Omega0=1.0)
>>> state = time_history.State(x=np.array([0.0]), v=np.array([2.0]))
>>> problem = time_history.Problem(system, state, t_end=3.0)
>>> result = time_history.solve(problem, time_history.plan(problem))
>>> result.impact_time.round(6)  # the first is arcsin(1/2)
array([0.523599, 2.237743])
>>> result.impact_velocity.round(6)
array([ 1.732051, -0.866025])
"""

from vibroimpact_solvers.results.time_history import Result
from vibroimpact_solvers.time_history import continued
from vibroimpact_solvers.time_history.continued import on_stops
from vibroimpact_solvers.time_history.limiters import Power
from vibroimpact_solvers.time_history.loads import Harmonic, Load, Sampled
from vibroimpact_solvers.time_history.many import (
    Outcome,
    Start,
    check_states,
    first_start,
    of_mean_speed,
    refuse_all,
    solve_many,
    solve_states,
)
from vibroimpact_solvers.time_history.on_mode import state_of
from vibroimpact_solvers.time_history.parts import Assembly, Part, join
from vibroimpact_solvers.time_history.planning import plan
from vibroimpact_solvers.time_history.problem import (
    EXACT,
    KIND,
    MOST_STOPPED,
    OUTPUTS,
    TOLERANCE,
    ImpactMode,
    Problem,
    State,
)
from vibroimpact_solvers.time_history.rigid_motions import Piece
from vibroimpact_solvers.time_history.run import Tick
from vibroimpact_solvers.time_history.solving import Prepared, prepare
from vibroimpact_solvers.time_history.structure import prepared
from vibroimpact_solvers.time_history.windows import Window, follow, solve, split

__all__ = [
    "EXACT",
    "KIND",
    "MOST_STOPPED",
    "OUTPUTS",
    "TOLERANCE",
    "Assembly",
    "Harmonic",
    "ImpactMode",
    "Load",
    "Outcome",
    "Part",
    "Piece",
    "Power",
    "Prepared",
    "Problem",
    "Result",
    "Sampled",
    "Start",
    "State",
    "Tick",
    "Window",
    "check_states",
    "continued",
    "first_start",
    "follow",
    "join",
    "of_mean_speed",
    "on_stops",
    "plan",
    "prepare",
    "prepared",
    "refuse_all",
    "solve",
    "solve_many",
    "solve_states",
    "split",
    "state_of",
]
