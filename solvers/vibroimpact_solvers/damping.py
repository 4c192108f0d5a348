"""Damping as engineers know it, as a matrix C: ratios, Rayleigh's, structural, dashpots.

    ratio        C = M E diag(2 zeta_j Omega_j) E^T M ,  so that  E^T C E = diag(2 zeta_j Omega_j)
    Rayleigh     C = alpha M + beta K ,  zeta_j = (alpha/Omega_j + beta Omega_j)/2
    structural   C = (eta/Omega) K ,  which loses as much as K (1 + i eta) at one frequency Omega
    dashpot      C = c w w^T ,  a force c times the velocity of the coordinate w^T x

Degrees of freedom without mass follow the others statically. They have no damping of their own:
K stands for the condensed stiffness there (`condensation`), to which the damping of springs that
are proportional to K condenses exactly.

Examples
--------
>>> from vibroimpact_solvers import damping
>>> from vibroimpact_solvers.presets import chain
>>> damped = damping.damped(chain(2, []), damping.Ratio((0.05,)))
>>> damped.C.to_dense().round(6)  # frequencies 1 and the root of 3
array([[ 0.136603, -0.036603],
       [-0.036603,  0.136603]])
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy.sparse

from vibroimpact_solvers import condensation, spectrum
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.matrices import SymmetricMatrix, frozen
from vibroimpact_solvers.model import RANGE, System

LARGEST: Final = 512
"""Degrees of freedom with mass up to which ratios are taken: C is full, and takes all modes."""

_SAME: Final = 1e-9
"""Relative distance of two natural frequencies below which their modes need the same ratio."""


@dataclass(frozen=True, slots=True)
class Ratio:
    """Parts of the critical damping of the natural modes."""

    values: tuple[float, ...]  # one for all modes, or one for each, ascending

    def matrix(self, system: System) -> SymmetricMatrix:
        """Return C, shape (n, n)."""
        count = system.n - system.massless.size
        if not all(math.isfinite(value) and value >= 0.0 for value in self.values):
            message = "a damping ratio is not a finite number from 0"
            raise ModelError(("damping", "ratio"), message, code="out_of_range")
        if count > LARGEST:
            message = (
                f"damping ratios take all {count} natural modes and make a full matrix: up to "
                f"{LARGEST} degrees of freedom; give Rayleigh damping instead, or reduce the "
                "structure to its modes"
            )
            raise ModelError(("damping", "ratio"), message, code="too_many_dofs")
        if len(self.values) not in {1, count}:
            message = f"give one ratio, or {count}, one for each mode, not {len(self.values)}"
            raise ModelError(("damping", "ratio"), message, code="wrong_length")
        natural = spectrum.spectrum(system)
        roots, modes = natural.roots, natural.modes
        if roots[0] < 0.0:
            message = "the structure is unstable: its growing modes have no damping ratio"
            raise ModelError(("damping", "ratio"), message, code="unstable")
        ratios = np.broadcast_to(np.array(self.values), roots.shape)
        close = (np.diff(roots) <= _SAME * roots[1:]) & (roots[1:] > 0.0)
        if (mixed := close & (np.diff(ratios) != 0.0)).any():
            place = int(mixed.argmax())
            message = (
                f"modes {place} and {place + 1} have the same natural frequency, so that they are "
                "not told apart: give them the same ratio"
            )
            raise ModelError(("damping", "ratio", place + 1), message, code="repeated_frequency")
        heavy = (system.M @ modes) * np.sqrt(2.0 * ratios * roots)
        return SymmetricMatrix.dense(heavy @ heavy.T)


@dataclass(frozen=True, slots=True)
class Rayleigh:
    """Damping by the masses, alpha (1/time), and by the springs, beta (time)."""

    alpha: float
    beta: float

    @classmethod
    def through(cls, ratios: Sequence[float], frequencies: Sequence[float]) -> Rayleigh:
        """Return the one with given damping ratios at two angular frequencies.

        Raises
        ------
        ModelError
            Where a coefficient is negative: modes elsewhere would gain energy.
        """
        (first, second), (low, high) = ratios, frequencies
        for place, each in enumerate(frequencies):
            _check_frequency(each, ("damping", "rayleigh", "at", place))
        if low == high:
            message = "the two frequencies are equal"
            raise ModelError(("damping", "rayleigh", "at"), message, code="equal_frequencies")
        scale = 2.0 / (high - low) / (high + low)
        alpha = scale * low * high * (first * high - second * low)
        beta = scale * (second * high - first * low)
        for name, value, where in (("alpha", alpha, "below"), ("beta", beta, "above")):
            if value < 0.0:
                message = (
                    f"{name} would be {value:.3g}, negative, so that modes far {where} these "
                    "frequencies gain energy: bring the two ratios closer together"
                )
                pointer = ("damping", "rayleigh", "ratios")
                raise ModelError(pointer, message, code="negative_damping")
        return cls(alpha, beta)

    def matrix(self, system: System) -> SymmetricMatrix:
        """Return C, shape (n, n)."""
        return _scaled(system.M, self.alpha).plus(self.beta, _stiffness(system))


@dataclass(frozen=True, slots=True)
class Structural:
    """Viscous damping that loses as much in a cycle as a loss factor at one angular frequency."""

    factor: float
    frequency: float

    def __post_init__(self) -> None:
        _check_frequency(self.frequency, ("damping", "at"))

    def matrix(self, system: System) -> SymmetricMatrix:
        """Return C, shape (n, n)."""
        return _scaled(_stiffness(system), self.factor / self.frequency)


@dataclass(frozen=True, slots=True)
class Dashpot:
    """A viscous damper of the coordinate ``sum(weight * x[dof])``."""

    dofs: tuple[int, ...]
    weights: tuple[float, ...]
    c: float

    def check(self, system: System) -> None:
        """Raise `ModelError` with a pointer from itself where it does not fit a structure."""
        if len(set(self.dofs)) != len(self.dofs) or not self.dofs:
            message = "a dashpot needs at least one dof, and all of them distinct"
            raise ModelError(("dofs",), message, code="duplicate_dof")
        if len(self.weights) != len(self.dofs):
            message = f"{len(self.dofs)} degrees of freedom need as many weights"
            raise ModelError(("weights",), message, code="wrong_length")
        if not all(map(math.isfinite, self.weights)):
            raise ModelError(("weights",), "a weight is not finite", code="not_finite")
        largest = max(map(abs, self.weights))
        if largest > RANGE[1]:
            message = f"the largest weight is {largest!r}, above {RANGE[1]}"
            raise ModelError(("weights",), message, code="out_of_range")
        if not (math.isfinite(self.c) and self.c >= 0.0):
            message = f"the coefficient is {self.c!r}, not a finite number from 0"
            raise ModelError(("c",), message, code="out_of_range")
        if not math.isfinite(self.c * largest * largest):
            message = f"its product with the squares of the weights is too large: {self.c!r}"
            raise ModelError(("c",), message, code="out_of_range")
        for place, (dof, weight) in enumerate(zip(self.dofs, self.weights, strict=True)):
            if not 0 <= dof < system.n:
                message = f"dof {dof} is none of 0 to {system.n - 1}: they count from 0"
                raise ModelError(("dofs", place), message, code="index_out_of_range")
            if weight and dof in system.massless:
                message = f"dof {dof} has no mass: give it one, or no dashpot"
                raise ModelError(("dofs", place), message, code="massless_damping")


Law = Ratio | Rayleigh | Structural


def damped(system: System, law: Law | None = None, dashpots: Sequence[Dashpot] = ()) -> System:
    """Return a structure with damping by a law and by dashpots, in addition to its own.

    Raises
    ------
    ModelError
        Naming the invalid field, `damping` or `dashpots`.
    """
    if law is not None:
        system = _with(system, law.matrix(system), "damping")
    if dashpots:
        for place, dashpot in enumerate(dashpots):
            try:
                dashpot.check(system)
            except ModelError as error:
                raise error.under("dashpots", place) from None
        system = _with(system, _of_dashpots(system.n, dashpots), "dashpots")
    return system


def _of_dashpots(n: int, dashpots: Sequence[Dashpot]) -> SymmetricMatrix:
    """Return the sum of ``c w w^T``, shape (n, n)."""
    rows, columns, entries = [], [], []
    for dashpot in dashpots:
        dofs, weights = np.array(dashpot.dofs), np.array(dashpot.weights)
        rows.append(np.repeat(dofs, dofs.size))
        columns.append(np.tile(dofs, dofs.size))
        entries.append((dashpot.c * np.outer(weights, weights)).ravel())
    places = np.concatenate(rows), np.concatenate(columns)
    return SymmetricMatrix.sparse((n, n), *places, np.concatenate(entries))


def _with(system: System, more: SymmetricMatrix, field: str) -> System:
    """Return a system with more damping."""
    try:
        return system.damped(more if system.C is None else system.C.plus(1.0, more))
    except ModelError as error:
        raise ModelError((field,), error.message, code=error.code) from None


def _check_frequency(value: float, pointer: Sequence[str | int]) -> None:
    if not RANGE[0] <= value <= RANGE[1]:
        message = f"the frequency is {value!r}, not between {RANGE[0]} and {RANGE[1]}"
        raise ModelError(tuple(pointer), message, code="out_of_range")


def _scaled(matrix: SymmetricMatrix, factor: float) -> SymmetricMatrix:
    return replace(matrix, data=frozen(factor * matrix.data))


def _stiffness(system: System) -> SymmetricMatrix:
    """Return K, shape (n, n), condensed to the degrees of freedom with mass."""
    if not system.massless.size:
        return system.K
    condensed = condensation.of(system)
    places = condensed.massive
    place = scipy.sparse.csr_array(
        (np.ones(places.size), (places, np.arange(places.size))), shape=(system.n, places.size)
    )
    return SymmetricMatrix.leanest(
        scipy.sparse.csr_array(place @ condensed.K.to_sparse() @ place.T)
    )
