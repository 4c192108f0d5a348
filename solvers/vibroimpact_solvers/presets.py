"""Preset structures, by name; the first are those of the book chapter.

Examples
--------
>>> from vibroimpact_solvers.model import Constraint
>>> from vibroimpact_solvers.presets import chain
>>> system = chain(13, [Constraint.at(5, gap=1.0)])
>>> system.n, system.chain.stiffness
(13, 1.0)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import ChainShape, Constraint, SymmetricMatrix, System, Units


def chain(
    n: int,
    constraints: Sequence[Constraint],
    mass: float = 1.0,
    stiffness: float = 1.0,
    units: Units | None = None,
) -> System:
    """Return n equal masses joined by equal springs between fixed ends (eq. 10.60)."""
    _require_positive(("n",), n)
    _require_positive(("mass",), mass)
    _require_positive(("stiffness",), stiffness)
    K = {0: np.full(n, 2.0 * stiffness)}
    if n > 1:
        K[1] = np.full(n - 1, -stiffness)
    return System(
        SymmetricMatrix.diagonal(np.full(n, mass)),
        SymmetricMatrix.bands(K),
        tuple(constraints),
        units=units,
        chain=ChainShape(n, mass, stiffness),
    )


def oscillator(
    constraints: Sequence[Constraint],
    Omega0: float,
    zeta: float = 0.0,
    units: Units | None = None,
) -> System:
    """Return one mass on a spring: M = 1, K = Omega0^2, C = 2 zeta Omega0 (eq. 10.1, 10.13)."""
    _require_positive(("Omega0",), Omega0)
    C = SymmetricMatrix.diagonal([2.0 * zeta * Omega0]) if zeta else None
    one, K = SymmetricMatrix.diagonal([1.0]), SymmetricMatrix.diagonal([Omega0**2])
    return System(one, K, tuple(constraints), C=C, units=units)


def two_mass(
    constraints: Sequence[Constraint],
    Omega0: float,
    coupling: float = 1.0,
    zeta: float = 0.0,
    units: Units | None = None,
) -> System:
    """Return two coupled oscillators, K = Omega0^2 [[1+c, -c], [-c, 1+c]] (eq. 10.22, 10.42)."""
    _require_positive(("Omega0",), Omega0)
    K = Omega0**2 * np.array([[1.0 + coupling, -coupling], [-coupling, 1.0 + coupling]])
    C = SymmetricMatrix.diagonal([2.0 * zeta * Omega0, 0.0]) if zeta else None
    one = SymmetricMatrix.diagonal([1.0, 1.0])
    return System(one, SymmetricMatrix.dense(K), tuple(constraints), C=C, units=units)


def double_pendulum(
    constraints: Sequence[Constraint], mu: float, units: Units | None = None
) -> System:
    """Return the linearised double pendulum, M = [[mu^2, 1], [1, 1]], K = diag(mu^2, 1) (10.33)."""
    if not mu > 1.0:
        raise ModelError(("mu",), f"mu is {mu!r}, not above 1", code="out_of_range")
    M = SymmetricMatrix.dense([[mu**2, 1.0], [1.0, 1.0]])
    return System(M, SymmetricMatrix.diagonal([mu**2, 1.0]), tuple(constraints), units=units)


def bouncing_ball(
    constraints: Sequence[Constraint], g: float = 9.81, units: Units | None = None
) -> System:
    """Return a ball over a floor: M = 1, K = 0, force -g (eq. 10.124)."""
    _require_positive(("g",), g)
    one, zero = SymmetricMatrix.diagonal([1.0]), SymmetricMatrix.diagonal([0.0])
    return System(one, zero, tuple(constraints), force=np.array([-g]), units=units)


def _require_positive(pointer: tuple[str], value: float) -> None:
    if not value > 0:
        raise ModelError(pointer, f"{pointer[0]} is {value!r}, not positive", code="out_of_range")
