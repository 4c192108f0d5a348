"""Motions with as many digits as are asked for, where double precision cannot hold them."""

from vibroimpact_solvers.time_history.extended.solving import solve

__all__ = ["solve"]
