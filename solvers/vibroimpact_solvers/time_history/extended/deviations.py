"""Growth of errors along a motion in extended precision: linearised deviations, in doubles."""

from __future__ import annotations

from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.time_history.extended.configuration import Configuration

_COLUMNS: Final = 4
_SURE: Final = 16.0
"""Factor on the estimate: roundings of a motion repeat, those of the samples are independent."""


class Deviations:
    """Deviations that obey the linearised motion, in units of the relative rounding.

    Parameters
    ----------
    configuration : Configuration
    q, rate : array, shape (mode,)
        State at the beginning.
    """

    def __init__(self, configuration: Configuration, q: Floats, rate: Floats) -> None:
        self._scene, self._random = configuration, np.random.default_rng(0)
        self._size = self._norm(q, rate)
        self._d = np.zeros((2, _COLUMNS, q.size))
        self._disturb(q, rate, 0.0)

    def advance(self, q: Floats, rate: Floats, s: float) -> None:
        """Advance through a free motion of duration s that ends in a state."""
        one, two = self._scene.rates.T
        a, b = self._d
        apart = np.where(one == two, 1.0, one - two)
        first, second = (b - two * a) / apart, (one * a - b) / apart
        up, down = np.exp(one * s), np.exp(two * s)
        free = one == two  # rigid-body modes
        self._d = np.stack(
            [
                np.where(free, a + b * s, (first * up + second * down).real),
                np.where(free, b, (first * one * up + second * two * down).real),
            ]
        )
        self._disturb(q, rate, s)

    def strike(self, row: Floats, before: Floats, after: Floats, factor: float,
               acceleration_before: Floats, acceleration_after: Floats) -> None:  # fmt: skip
        """Multiply by the saltation matrix of an impact.

        Parameters
        ----------
        row : array, shape (mode,)
            The constrained coordinate.
        before, after : array, shape (mode,)
            Rates.
        factor : float
            (1 + restitution) over |row|^2.
        falls, rises : array, shape (mode,)
            Accelerations before and after.
        """
        speed = float(row @ before)
        if speed == 0.0:
            return
        a, b = self._d
        late = (a @ row) / speed

        def law(v: Floats) -> Floats:
            return np.asarray(v - factor * np.multiply.outer(v @ row, row))

        # S = R + (F+ - R F-) grad y^T / (grad y . F-)
        self._d = np.stack(
            [
                a + np.multiply.outer(late, after - before),
                law(b) + np.multiply.outer(late, acceleration_after - law(acceleration_before)),
            ]
        )

    def transform(self, configuration: Configuration, inertia: Floats) -> None:
        """Transform to the modes of another configuration; inertia is M, shape (dof, dof)."""
        turn = configuration.shapes.T @ inertia @ self._scene.shapes
        self._d, self._scene = self._d @ turn.T, configuration

    @property
    def condition(self) -> float:
        """The error of the state relative to it, in units of the relative rounding."""
        sizes = [self._norm(a, b) for a, b in self._d.transpose(1, 0, 2)]
        return _SURE * max(sizes) / self._size if self._size > 0.0 else 1.0

    def _disturb(self, q: Floats, rate: Floats, s: float) -> None:
        self._size = max(self._size, self._norm(q, rate))
        noise = self._random.standard_normal(self._d.shape) / np.sqrt(max(1, q.size))
        weights = np.maximum(np.abs(self._scene.rates).max(axis=1, initial=0.0), 1e-300)
        turned = 1.0 + s * float(weights.max(initial=0.0))
        noise[0] /= np.where(weights > 1e-300, weights, 1.0)
        self._d = self._d + turned * self._size * noise

    def _norm(self, q: Floats, rate: Floats) -> float:
        weights = np.abs(self._scene.rates).max(axis=1, initial=0.0)
        return float(np.sqrt(((weights * q) ** 2 + rate**2).sum()))
