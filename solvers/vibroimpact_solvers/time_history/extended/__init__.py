"""Motions in extended precision, with any number of decimal digits."""

from vibroimpact_solvers.time_history.extended.solving import solve

__all__ = ["solve"]
