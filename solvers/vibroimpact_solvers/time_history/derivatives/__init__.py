"""Derivatives of motions with rigid limiters by numbers of their problems."""

from vibroimpact_solvers.time_history.derivatives.following import SAMPLES as SHAKEN_MOTIONS
from vibroimpact_solvers.time_history.derivatives.outputs import Reason, derived

__all__ = ["SHAKEN_MOTIONS", "Reason", "derived"]
