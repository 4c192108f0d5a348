"""Frequency response ``(frequency^2 M - K)^(-1) W^T`` to harmonic forces at the constraints."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.linalg

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.errors import ConvergenceError
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
        # In coordinates with masses near 1: else rows would be exchanged for their units alone,
        # and light degrees of freedom would lose the digits by which heavy ones exceed them.
        # Powers of two change no digit.
        self._scale = np.exp2(np.round(-0.5 * np.log2(system.M.main_diagonal)))
        self._M, self._K = system.M.scaled(self._scale), system.K.scaled(self._scale)
        self._right = self._scale[:, np.newaxis] * directions
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

    def _factorized(self, frequency: float) -> Floats:
        for nudge in (0.0, 4e-16, -4e-16, 1e-15, -1e-15):
            stiffness = self._M.plus(-1.0 / (frequency * (1.0 + nudge)) ** 2, self._K)
            try:
                response = stiffness.factorize()(self._right) / frequency**2
                return self._scale[:, np.newaxis] * response
            except scipy.linalg.LinAlgError:
                # At a natural frequency to the last bit: take its neighbour instead.
                continue
        message = "the structure is resonant at neighbouring frequencies to the last bit"
        raise ConvergenceError(message)
