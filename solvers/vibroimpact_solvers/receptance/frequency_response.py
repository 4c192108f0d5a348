"""Frequency response ``(frequency^2 M - K)^(-1) W^T`` to harmonic forces at the constraints."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import scipy.linalg

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.matrices import SymmetricMatrix
from vibroimpact_solvers.model import System
from vibroimpact_solvers.receptance.coordinates import Coordinates

_KEPT = 2**22  # numbers in the responses that are kept


@dataclass(frozen=True, eq=False, slots=True)
class ConstraintReceptance:
    """Receptance between the constraints, each array (constraint, constraint)."""

    value: Floats  # ``R(z) = W (z M - K)^(-1) W^T`` with ``z = frequency^2``
    slope: Floats  # ``-dR/dz = W (z M - K)^(-1) M (z M - K)^(-1) W^T``
    error: Floats  # bound of the error of R, rounding of single terms apart


class DirectFrequencyResponse:
    """Frequency response by one factorization at each frequency.

    `directions` are ``W^T``, (dof, constraint). The rounding of the factors is relative to the
    square of `bound`, an upper bound of the natural frequencies.
    """

    def __init__(self, system: System, directions: Floats, bound: float) -> None:
        self.system, self.directions, self.bound = system, directions, bound
        # Impulses, energy and limits of one solution need the same responses.
        kept = max(1, _KEPT // directions.size)
        self._response = lru_cache(kept)(self._factorized)

    def displacements(self, frequency: float, at: Coordinates) -> Floats:
        """Return the response of some coordinates, shape (coordinate, constraint)."""
        return at(self._response(frequency))

    def receptance(self, frequency: float) -> ConstraintReceptance:
        """Return the receptance between the constraints."""
        response = self._response(frequency)
        slope = response.T @ (self.system.M @ response)
        error = 2.0 * EPS * self.bound**2 * np.abs(slope)
        return ConstraintReceptance(self.directions.T @ response, slope, error)

    @cached_property
    def _scaled(self) -> tuple[Floats, SymmetricMatrix, SymmetricMatrix]:
        """Scales of the coordinates, and M and K in them; many a series needs no factors.

        With masses near 1. Else rows would be exchanged for their units alone, and light degrees
        of freedom would lose the digits by which heavy ones exceed them. Powers of two change no
        digit.
        """
        K, M = self.system.K, self.system.M
        scale = np.exp2(np.round(-0.5 * np.log2(M.main_diagonal)))
        return scale, M.scaled(scale), K.scaled(scale)

    def _factorized(self, frequency: float) -> Floats:
        scale, M, K = self._scaled
        column = scale[:, np.newaxis]
        for nudge in (0.0, 4e-16, -4e-16, 1e-15, -1e-15):
            stiffness = M.plus(-1.0 / (frequency * (1.0 + nudge)) ** 2, K)
            try:
                return column * stiffness.factorize()(column * self.directions) / frequency**2
            except scipy.linalg.LinAlgError:
                # At a natural frequency to the last bit: take its neighbour instead.
                continue
        message = "the structure is resonant at neighbouring frequencies to the last bit"
        raise ConvergenceError(message)
