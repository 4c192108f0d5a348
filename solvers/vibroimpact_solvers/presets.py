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

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import (
    RANGE,
    ChainShape,
    Constraint,
    SymmetricMatrix,
    System,
    Units,
    within_range,
)

PARAMETERS: Final[Mapping[str, Mapping[str, str]]] = {
    "chain": {"M": "mass", "K": "stiffness"},
    "oscillator": {"K": "Omega0", "C": "zeta"},
    "two_mass": {"K": "coupling", "C": "zeta"},
    "double_pendulum": {"M": "mu", "K": "mu"},
    "bouncing_ball": {"force": "g"},
    "absorber": {"M": "ratio", "K": "tuning"},
    "beam": {"M": "rhoA", "K": "EI"},
}
"""Presets -> a part of their system -> the parameter that makes it, and is to be blamed."""


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
    K = {0: np.full(n, _entry("stiffness", "K", 2.0 * stiffness))}
    if n > 1:
        K[1] = np.full(n - 1, -stiffness)
    with _blamed("chain"):
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
    square = _square("Omega0", Omega0)
    damping = _entry("zeta", "C", 2.0 * zeta * Omega0)
    with _blamed("oscillator"):
        C = SymmetricMatrix.diagonal([damping]) if zeta else None
        one, K = SymmetricMatrix.diagonal([1.0]), SymmetricMatrix.diagonal([square])
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
    square = _square("Omega0", Omega0)
    damping = _entry("zeta", "C", 2.0 * zeta * Omega0)
    _entry("coupling", "K", square * (1.0 + abs(coupling)))
    with _blamed("two_mass"):
        K = square * np.array([[1.0 + coupling, -coupling], [-coupling, 1.0 + coupling]])
        C = SymmetricMatrix.diagonal([damping, 0.0]) if zeta else None
        one = SymmetricMatrix.diagonal([1.0, 1.0])
        return System(one, SymmetricMatrix.dense(K), tuple(constraints), C=C, units=units)


def double_pendulum(
    constraints: Sequence[Constraint], mu: float, units: Units | None = None
) -> System:
    """Return the linearised double pendulum, M = [[mu^2, 1], [1, 1]], K = diag(mu^2, 1) (10.33)."""
    if not mu > 1.0:
        raise ModelError(("mu",), f"mu is {mu!r}, not above 1", code="out_of_range")
    square = _square("mu", mu)
    with _blamed("double_pendulum"):
        M = SymmetricMatrix.dense([[square, 1.0], [1.0, 1.0]])
        return System(M, SymmetricMatrix.diagonal([square, 1.0]), tuple(constraints), units=units)


def bouncing_ball(
    constraints: Sequence[Constraint], g: float = 9.81, units: Units | None = None
) -> System:
    """Return a ball over a floor: M = 1, K = 0, force -g (eq. 10.124)."""
    _require_positive(("g",), g)
    one, zero = SymmetricMatrix.diagonal([1.0]), SymmetricMatrix.diagonal([0.0])
    with _blamed("bouncing_ball"):
        return System(one, zero, tuple(constraints), force=np.array([-g]), units=units)


def absorber(
    constraints: Sequence[Constraint],
    Omega0: float,
    ratio: float = 0.05,
    tuning: float = 1.0,
    units: Units | None = None,
) -> System:
    """Return a mass on a spring that carries a small one on a spring of its own.

    M = diag(1, r), K = Omega0^2 [[1 + r t^2, -r t^2], [-r t^2, r t^2]] with the ratio r of the
    masses and the tuning t, the frequency of the small mass alone over that of the large one.
    Without its spring, t = 0, it is held by its stops only, as in an impact damper.
    """
    _require_positive(("Omega0",), Omega0)
    _require_positive(("ratio",), ratio)
    _entry("ratio", "M", ratio)
    if not tuning >= 0.0:
        raise ModelError(("tuning",), f"tuning is {tuning!r}, not at least 0", code="out_of_range")
    square = _square("Omega0", Omega0)
    small = _entry("tuning", "K", square * ratio * tuning * tuning)
    with _blamed("absorber"):
        K = np.array([[square + small, -small], [-small, small]])
        return System(
            SymmetricMatrix.diagonal([1.0, ratio]),
            SymmetricMatrix.dense(K),
            tuple(constraints),
            units=units,
        )


def beam(
    constraints: Sequence[Constraint],
    elements: int,
    length: float = 1.0,
    EI: float = 1.0,
    rhoA: float = 1.0,
    units: Units | None = None,
) -> System:
    """Return a cantilever of equal Euler-Bernoulli elements with consistent masses.

    The degrees of freedom are deflection and rotation of each node in turn, from the clamp on: the
    deflection of the tip is the last but one.
    """
    for name, value in (("elements", elements), ("length", length), ("EI", EI), ("rhoA", rhoA)):
        _require_positive((name,), value)
    h = length / elements
    if not within_range(np.array([h, h * h, h * h * h])):
        message = f"of elements, whose length is {h!r}: a power of it is out of range"
        raise ModelError(("length",), message, code="out_of_range")
    scales = np.array([1.0, h, 1.0, h])
    stiffness = _entry("EI", "K", EI / (h * h * h)) * np.outer(scales, scales) * _BENDING
    mass = _entry("rhoA", "M", rhoA * h / 420.0) * np.outer(scales, scales) * _INERTIA
    with _blamed("beam"):
        return System(
            SymmetricMatrix.bands(_assembled(mass, elements)),
            SymmetricMatrix.bands(_assembled(stiffness, elements)),
            tuple(constraints),
            units=units,
        )


_BENDING: Final = np.array(
    [
        [12.0, 6.0, -12.0, 6.0],
        [6.0, 4.0, -6.0, 2.0],
        [-12.0, -6.0, 12.0, -6.0],
        [6.0, 2.0, -6.0, 4.0],
    ]
)
"""Stiffness of a beam element of length 1 and EI = 1; rows: w1, theta1, w2, theta2."""

_INERTIA: Final = np.array(
    [
        [156.0, 22.0, 54.0, -13.0],
        [22.0, 4.0, 13.0, -3.0],
        [54.0, 13.0, 156.0, -22.0],
        [-13.0, -3.0, -22.0, 4.0],
    ]
)
"""Mass of the same element, times 420, for rho A = 1."""


def _assembled(element: Floats, elements: int) -> dict[int, Floats]:
    """Return the diagonals of a chain of elements whose first node is clamped."""
    diagonals = {}
    for offset in range(4):
        whole = np.zeros(2 * elements + 2 - offset)
        for row in range(4 - offset):
            whole[row : row + 2 * elements - 1 : 2] += element[row, row + offset]
        diagonals[offset] = whole[2:]
    return {offset: row for offset, row in diagonals.items() if row.size}


@contextmanager
def _blamed(preset: str) -> Iterator[None]:
    """Let errors of matrices and forces point to the parameter that they are made of."""
    parameters = PARAMETERS[preset]
    try:
        yield
    except ModelError as error:
        part = str(error.pointer[0]) if error.pointer else ""
        if part not in parameters:
            raise
        message = f"of {part}, which it makes: {error.message}"
        raise ModelError((parameters[part],), message, code=error.code) from None


def _entry(name: str, part: str, value: float) -> float:
    """Return an entry that a parameter makes, refuse one that is too large for a matrix."""
    if not abs(value) <= RANGE[1]:  # nan is neither
        message = f"of {part}, which it makes: an entry is {value!r}, above {RANGE[1]}"
        raise ModelError((name,), message, code="out_of_range")
    return value


def _square(name: str, value: float) -> float:
    """Return the square of a parameter, refuse one that is out of range."""
    square = value * value  # a power would raise where it is too large
    if not within_range(np.array([square])):
        message = f"the square of {name} is {square!r}, not between {RANGE[0]} and {RANGE[1]}"
        raise ModelError((name,), message, code="out_of_range")
    return square


def _require_positive(pointer: tuple[str], value: float) -> None:
    if not value > 0:
        raise ModelError(pointer, f"{pointer[0]} is {value!r}, not positive", code="out_of_range")
