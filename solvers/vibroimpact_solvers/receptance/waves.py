"""Steady waves ``(frequency^2 M - K)^(-1) W^T``: the structure driven at one frequency."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.linalg

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.model import System
from vibroimpact_solvers.receptance.rows import Rows

_KEPT = 2**22  # numbers
_EPS = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False, slots=True)
class Response:
    """What the constraints feel of waves, each array (constraint, constraint).

    Parameters
    ----------
    value : array
        ``R(z) = W (z M - K)^(-1) W^T`` with ``z = frequency^2``.
    slope : array
        ``-dR/dz = W (z M - K)^(-1) M (z M - K)^(-1) W^T``.
    error : array
        Bound of the errors of R, apart from roundings of single terms.
    """

    value: Floats
    slope: Floats
    error: Floats


class Waves(Protocol):
    """A way to waves: `FactorizedWaves` or `receptance.cells.ModalWaves`."""

    def rows(self, frequency: float, rows: Rows) -> Floats:
        """Return some rows of a wave, shape (row, constraint)."""

    def response(self, frequency: float) -> Response:
        """Return what the constraints feel."""


class FactorizedWaves:
    """Waves by a factorization at each frequency.

    Parameters
    ----------
    system : System
    directions : array, shape (dof, constraint)
        ``W^T``.
    bound : float
        Upper bound of the natural frequencies: the roundings of the factors are relative to its
        square.
    """

    def __init__(self, system: System, directions: Floats, bound: float) -> None:
        self.system, self.directions, self.bound = system, directions, bound
        self._kept: OrderedDict[float, Floats] = OrderedDict()

    def rows(self, frequency: float, rows: Rows) -> Floats:
        """Return some rows of a wave, shape (row, constraint)."""
        return rows(self._wave(frequency))

    def response(self, frequency: float) -> Response:
        """Return what the constraints feel."""
        wave = self._wave(frequency)
        slope = wave.T @ (self.system.M @ wave)
        error = 2.0 * _EPS * self.bound**2 * np.abs(slope)
        return Response(self.directions.T @ wave, slope, error)

    def _wave(self, frequency: float) -> Floats:
        if frequency not in self._kept:
            # Impulses, energy and limits of one member ask for the same waves.
            if len(self._kept) * self.directions.size > _KEPT:
                self._kept.popitem(last=False)
            self._kept[frequency] = self._new_wave(frequency)
        return self._kept[frequency]

    def _new_wave(self, frequency: float) -> Floats:
        K, M = self.system.K, self.system.M
        for nudge in (0.0, 4e-16, -4e-16, 1e-15, -1e-15):
            stiffness = M.plus(-1.0 / (frequency * (1.0 + nudge)) ** 2, K)
            try:
                return stiffness.factorize()(self.directions) / frequency**2
            except scipy.linalg.LinAlgError:
                # The frequency is a natural one to the last bit; its neighbour is as good.
                continue
        message = "the structure is resonant at neighbouring frequencies to the last bit"
        raise ConvergenceError(message)
