"""Derivatives of answers by numbers of their problems.

A `Parameter` says how the structure, its stops, its loads and the frequency change with one number
of a request, to first order: ``K + t dK`` and so on, t being the change of the number. `ModeRates`
follow for the natural modes. The kinds of computation differentiate their own equations by them, so
that no answer is computed twice.
"""

from vibroimpact_solvers.derivatives.modes import ModeRates, mode_rates, touched
from vibroimpact_solvers.derivatives.parameter import (
    LoadRate,
    MatrixRate,
    Parameter,
    StopRate,
    check_parameters,
    named,
)

__all__ = [
    "LoadRate",
    "MatrixRate",
    "ModeRates",
    "Parameter",
    "StopRate",
    "check_parameters",
    "mode_rates",
    "named",
    "touched",
]
