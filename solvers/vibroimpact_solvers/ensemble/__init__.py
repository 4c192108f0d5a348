"""Ensembles: motions of one structure from many initial states."""

from vibroimpact_solvers.ensemble.planning import content, plan, split
from vibroimpact_solvers.ensemble.problem import KIND, Problem
from vibroimpact_solvers.ensemble.result import Result
from vibroimpact_solvers.ensemble.solving import join, solve

__all__ = ["KIND", "Problem", "Result", "content", "join", "plan", "solve", "split"]
