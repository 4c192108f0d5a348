"""Periodic motions with stops of finite stiffness, one contact phase per period or half period.

All of them are roots of one equation in the duration of the phase (`prescribed`), which are
isolated with proof that none is missed (`isolation`, `kernels.durations`), or looked for where
that takes too long (`search`).
"""

from vibroimpact_solvers.periodic_motions.stops.planning import steps
from vibroimpact_solvers.periodic_motions.stops.solving import solve

__all__ = ["solve", "steps"]
