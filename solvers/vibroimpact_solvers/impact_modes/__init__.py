"""Impact modes: periodic motions of a structure that hits its limiters once a period.

Every active constraint hits its upper wall at tau = 1 and its lower wall at tau = -1. A family
has one solution at each frequency, admissible or phantom.

Examples
--------
>>> import numpy as np
>>> from vibroimpact_solvers import impact_modes
>>> from vibroimpact_solvers.model import Constraint
>>> from vibroimpact_solvers.presets import oscillator
>>> system = oscillator([Constraint.at(0, gap=1.0)], Omega0=1.0)
>>> problem = impact_modes.Problem(system, omega=np.array([0.5, 1.0]))
>>> result = impact_modes.solve(problem, impact_modes.plan(problem))
>>> result.impulse[:, 0].round(6)  # p = omega^2 gamma cot(gamma), gamma = 1/omega
array([-0.228829,  0.642093])
>>> [impact_modes.REASONS[code] for code in result.reason]
['negative_impulse', 'ok']
"""

from vibroimpact_solvers.impact_modes.costs import interval_flops
from vibroimpact_solvers.impact_modes.family_solver import partial_modal_response
from vibroimpact_solvers.impact_modes.pieces import content, split
from vibroimpact_solvers.impact_modes.planning import (
    all_modes_plan,
    can_use_partial_modes,
    inactive_constraints,
    partial_modes_plan,
    plan,
    plan_in_doubles,
)
from vibroimpact_solvers.impact_modes.problem import KIND, OUTPUTS, Problem
from vibroimpact_solvers.impact_modes.solving import join, solve
from vibroimpact_solvers.results.impact_modes import REASONS, Reason, Result

__all__ = [
    "KIND",
    "OUTPUTS",
    "REASONS",
    "Problem",
    "Reason",
    "Result",
    "all_modes_plan",
    "can_use_partial_modes",
    "content",
    "inactive_constraints",
    "interval_flops",
    "join",
    "partial_modal_response",
    "partial_modes_plan",
    "plan",
    "plan_in_doubles",
    "solve",
    "split",
]
