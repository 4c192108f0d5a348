"""Calibrations: numbers of a computation from measurements of its outputs.

Least squares, weighted by the noise, with the derivatives of the computation; intervals by profile
of the likelihood; directions that the data does not tell; a test of the model against the noise.

Examples
--------
>>> import numpy as np
>>> from vibroimpact_solvers import calibration, natural_frequencies
>>> from vibroimpact_solvers.derivatives import MatrixRate, Parameter
>>> from vibroimpact_solvers.presets import oscillator
>>> def at(x, rates):
...     by = Parameter("system.Omega0", K=MatrixRate(factor=2.0 / float(x[0])))
...     system = oscillator([], Omega0=float(x[0]))
...     base = natural_frequencies.Problem(
...         system, outputs=frozenset({"Omega"}), parameters=(by,) if rates else ()
...     )
...     return calibration.Point(base, np.ones(1))
>>> data = calibration.Data("Omega", np.array([2.03]), np.array(0.01))
>>> unknown = calibration.Unknown("system.Omega0", start=1.5)
>>> problem = calibration.Problem(
...     "natural-frequencies", at, (unknown,), (data,), oscillator([], Omega0=1.0)
... )
>>> result = calibration.solve(problem, calibration.plan(problem))
>>> result.value.round(6), result.interval.round(4)
(array([2.03]), array([[2.0104, 2.0496]]))
"""

from vibroimpact_solvers.calibration.kinds import KINDS, named
from vibroimpact_solvers.calibration.planning import plan
from vibroimpact_solvers.calibration.problem import (
    KIND,
    OUTPUTS,
    Data,
    Point,
    Prior,
    Problem,
    Unknown,
)
from vibroimpact_solvers.calibration.solving import solve
from vibroimpact_solvers.plan import join_only as join
from vibroimpact_solvers.plan import split_nothing as split
from vibroimpact_solvers.results.calibration import ENDINGS, Ending, Result

__all__ = [
    "ENDINGS",
    "KIND",
    "KINDS",
    "OUTPUTS",
    "Data",
    "Ending",
    "Point",
    "Prior",
    "Problem",
    "Result",
    "Unknown",
    "join",
    "named",
    "plan",
    "solve",
    "split",
]
