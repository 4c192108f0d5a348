"""Natural frequencies: what their plans leave out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from benchmarks.cases import GAP, net
from benchmarks.skips.scene import Scene, solve
from vibroimpact_solvers import natural_frequencies, spectrum
from vibroimpact_solvers.derivatives import MatrixRate, Parameter
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.natural_frequencies import OUTPUTS, Problem

_SKIPPED: Final = ("damping", "walls", "shape", "participation", "effective_mass")
_FREQUENCIES: Final = frozenset({"Omega"})
STIFFNESS: Final = Parameter("system.K.scale", K=MatrixRate(1.0))
"""The parameter of scenes of derivatives."""


def scenes() -> Iterator[Scene]:
    """Yield scenes of natural frequencies."""
    yield Scene(
        "the five lowest modes of a sparse structure, N=400",
        natural_frequencies,
        lambda: Problem(net(20), count=5, outputs=_FREQUENCIES),
        lambda: spectrum.spectrum(net(20)),
        ("about 395 higher modes",),
    )
    yield Scene(
        "only natural frequencies requested, N=40",
        natural_frequencies,
        lambda: Problem(_damped(), count=10, outputs=_FREQUENCIES),
        lambda: solve(
            natural_frequencies,
            Problem(_damped(), count=10, outputs=frozenset(OUTPUTS), directions=np.ones((1, 40))),
        ),
        (*_SKIPPED, "residual_flexibility"),
    )
    yield Scene(
        "no derivatives of natural frequencies requested, N=40",
        natural_frequencies,
        lambda: Problem(_damped(), count=10, outputs=_FREQUENCIES),
        lambda: solve(
            natural_frequencies,
            Problem(_damped(), count=10, outputs=_FREQUENCIES, parameters=(STIFFNESS,)),
        ),
        ("derivatives",),
    )


def _damped() -> System:
    """Return a chain with damping and a stop that has no modes in closed form."""
    K = SymmetricMatrix.bands({0: np.full(40, 2.0), 1: np.full(39, -1.0)})
    M = SymmetricMatrix.diagonal(np.linspace(0.5, 1.5, 40))
    return System(M, K, (Constraint.at(7, GAP),), C=SymmetricMatrix.diagonal(np.full(40, 0.1)))
