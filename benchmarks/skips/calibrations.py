"""Calibrations: what their plans leave out."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.skips.scene import Scene, solve
from vibroimpact_solvers import calibration, natural_frequencies
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.calibration import OUTPUTS, Data, Point, Problem, Unknown
from vibroimpact_solvers.derivatives import MatrixRate, Parameter
from vibroimpact_solvers.model import System
from vibroimpact_solvers.presets import oscillator


def scenes() -> Iterator[Scene]:
    """Yield scenes of calibrations."""
    yield Scene(
        "no interval of a calibration requested",
        calibration,
        lambda: _problem(frozenset(OUTPUTS) - {"interval"}),
        lambda: solve(calibration, _problem(frozenset(OUTPUTS))),
        ("interval",),
    )


def _problem(outputs: frozenset[str]) -> Problem:
    """Return the search for the stiffness of an oscillator whose frequency was measured."""
    unknown = Unknown("system.Omega0", start=1.5)
    measured = Data("Omega", np.array([2.03]), np.array(0.01))
    return Problem(
        "natural-frequencies", _at, (unknown,), (measured,), _oscillator(1.0), outputs=outputs
    )


def _oscillator(Omega0: float) -> System:
    return oscillator([], Omega0=Omega0)


def _at(x: Floats, rates: bool) -> Point:
    """Return the natural frequency of an oscillator with that of a point."""
    by = Parameter("system.Omega0", K=MatrixRate(factor=2.0 / float(x[0])))
    base = natural_frequencies.Problem(
        _oscillator(float(x[0])),
        outputs=frozenset({"Omega"}),
        parameters=(by,) if rates else (),
    )
    return Point(base, np.ones(1))
