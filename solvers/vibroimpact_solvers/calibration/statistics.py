"""What the data tells at the best fit: covariance, directions, and the test of the model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.stats

from vibroimpact_solvers.arrays import EPS, Booleans, Floats
from vibroimpact_solvers.calibration.fitting import LEVEL, at_bounds, rank_limit
from vibroimpact_solvers.calibration.model import Evaluation, Model

_UNTOLD: Final = 1.0
"""Deviation along a direction, in parts of the sizes of the unknowns, from which on the data does
not tell it: the values could be twice as large, or zero."""
_NAMED: Final = 0.05
"""Component, relative to the largest, from which on an unknown belongs to a direction."""
_SHARE: Final = 1e-3
"""Component of an undetermined direction from which on an unknown is not told."""


@dataclass(frozen=True, eq=False, slots=True)
class Directions:
    """Principal directions of the covariance, the least known first.

    Components and deviations are parts of the sizes of the unknowns.
    """

    vector: Floats  # (direction, unknown)
    deviation: Floats  # (direction,), infinite where nothing tells it
    vector_error: Floats
    deviation_error: Floats

    @property
    def told(self) -> Booleans:
        """Directions that the equations determine, shape (direction,)."""
        return np.isfinite(self.deviation)


@dataclass(frozen=True, eq=False, slots=True)
class Fisher:
    """The least squares at the best fit, made linear.

    Parameters
    ----------
    at : Evaluation
    scale : array, shape (unknown,)
        Sizes of the unknowns.
    free : array of bool, shape (unknown,)
        Unknowns that are not at a bound.
    step : array, shape (unknown,)
        How far the next step of the search would go.
    limit : float
        Singular value, relative to the largest, below which nothing is told.
    """

    at: Evaluation
    scale: Floats
    free: Booleans
    step: Floats
    limit: float

    @classmethod
    def of(cls, model: Model, at: Evaluation, step: Floats) -> Fisher:
        """Return that of the best fit."""
        scale = np.maximum(np.abs(at.x), model.problem.scale)
        return cls(at, scale, ~at_bounds(model.problem, at.x), step, rank_limit(model))

    @property
    def scaled(self) -> Floats:
        """Jacobian by the free unknowns in parts of their sizes, (residual, free)."""
        assert self.at.jacobian is not None
        return self.at.jacobian[:, self.free] * self.scale[self.free]

    @property
    def doubt(self) -> Floats:
        """Errors of it."""
        assert self.at.rate_errors is not None
        errors = np.nan_to_num(self.at.rate_errors, nan=0.0, posinf=0.0)
        return np.asarray(errors[:, self.free] * self.scale[self.free])

    def directions(self) -> Directions:
        """Return the principal directions."""
        J = self.scaled
        size = J.shape[1]
        if not size:
            none = np.zeros((0, self.scale.size))
            return Directions(none, np.zeros(0), none, np.zeros(0))
        # As many rows as columns at least, for all directions.
        square = np.concatenate([J, np.zeros((max(0, size - len(J)), size))])
        _, values, rows = np.linalg.svd(square, full_matrices=False)
        largest = values.max(initial=0.0)
        told = values > self.limit * largest
        with np.errstate(divide="ignore"):
            deviation = np.where(told & (values > 0.0), 1.0 / values, np.inf)
        slack = float(np.linalg.norm(self.doubt)) + 8.0 * EPS * size * largest
        order = np.argsort(values, kind="stable")
        values, deviation, rows = values[order], deviation[order], rows[order]
        signs = np.where(rows[np.arange(size), np.abs(rows).argmax(axis=1)] < 0.0, -1.0, 1.0)
        rows = rows * signs[:, np.newaxis]
        apart = np.array(
            [np.abs(np.delete(values, k) - values[k]).min(initial=np.inf) for k in range(size)]
        )
        turned = np.where(apart > 2.0 * slack, 2.0 * slack / np.maximum(apart, 1e-300), np.nan)
        vector = np.zeros((size, self.scale.size))
        vector[:, self.free] = rows
        errors = np.broadcast_to(turned[:, np.newaxis], vector.shape).copy()
        errors[:, ~self.free] = 0.0
        finite = np.where(np.isfinite(deviation), deviation, 0.0)
        relative = np.where(np.isfinite(deviation), 2.0 * slack * finite, np.inf)
        return Directions(vector, deviation, errors, relative * deviation)

    def covariance(self, directions: Directions) -> tuple[Floats, Floats]:
        """Return the covariance and its error, nan of unknowns that are not told."""
        told = directions.told
        spread = directions.vector[told] * directions.deviation[told, np.newaxis]
        scaled = spread.T @ spread
        J, doubt = np.abs(self.scaled), self.doubt
        change = np.zeros_like(scaled)
        inner = np.abs(scaled[np.ix_(self.free, self.free)])
        # First order: C (dJ' J + J' dJ) C.
        product = doubt.T @ J
        rounding = 16.0 * EPS * (J.T @ J) * self.scale.size
        change[np.ix_(self.free, self.free)] = inner @ (product + product.T + rounding) @ inner
        moved = float(np.abs(self.step / self.scale).max(initial=0.0))
        change += 4.0 * moved * np.sqrt(np.outer(np.diag(scaled), np.diag(scaled)))
        size = np.outer(self.scale, self.scale)
        unknown = self.untold(directions) | ~self.free
        covariance, error = scaled * size, change * size
        for each in (covariance, error):
            each[unknown] = np.nan
            each[:, unknown] = np.nan
        return covariance, error

    def untold(self, directions: Directions) -> Booleans:
        """Return which unknowns belong to a direction that nothing tells, shape (unknown,)."""
        share = np.abs(directions.vector[~directions.told]).max(axis=0, initial=0.0)
        return np.asarray(share > _SHARE)

    def error(self, of_computed: Floats) -> Floats:
        """Return the error of the values: of the last step, and of the model's own errors.

        of_computed are those errors in parts of the deviations, shape (measurement,).
        """
        pseudo = np.abs(np.linalg.pinv(self.scaled, rcond=self.limit))
        whole = np.zeros(pseudo.shape[1])
        whole[: of_computed.size] = of_computed
        own = np.zeros(self.scale.size)
        parts = np.where(pseudo > 0.0, pseudo * whole, 0.0)
        own[self.free] = self.scale[self.free] * parts.sum(axis=1)
        return 2.0 * self.step + own + 4.0 * EPS * np.abs(self.at.x)


def sentences(directions: Directions, names: Sequence[str]) -> list[str]:
    """Return the directions that the data does not tell, as sums of paths."""
    texts = []
    for vector, deviation in zip(directions.vector, directions.deviation, strict=True):
        if deviation < _UNTOLD:
            continue
        largest = vector[np.abs(vector).argmax()]
        parts = vector / largest
        order = np.argsort(-np.abs(parts), kind="stable")
        terms = [f"{parts[k]:+.3g} {names[k]}" for k in order if abs(parts[k]) >= _NAMED]
        how = "not at all" if math.isinf(deviation) else f"to {100.0 * deviation:.3g} %"
        texts.append(f"{' '.join(terms)}: {how}")
    return texts


@dataclass(frozen=True, slots=True)
class NoiseTest:
    """The test of the model against the noise."""

    chi2: float
    chi2_error: float
    freedom: int
    p: float | None
    p_error: float | None

    @property
    def fits(self) -> bool | None:
        """Whether the data does not reject the model; None: there is no test."""
        return None if self.p is None else self.p >= LEVEL


def noise_test(fisher: Fisher, directions: Directions, numbers: int, doubt: Floats) -> NoiseTest:
    """Return the test of the model.

    Parameters
    ----------
    fisher, directions
    numbers : int
        Measurements and priors.
    doubt : array, shape (residual,)
        Errors of the residuals.
    """
    chi2 = fisher.at.chi2
    error = float((2.0 * np.abs(fisher.at.residuals) * doubt + doubt * doubt).sum())
    error += 4.0 * EPS * len(doubt) * chi2
    if not math.isfinite(error):
        error = math.inf
    freedom = numbers - int(directions.told.sum())
    if freedom < 1:
        return NoiseTest(chi2, error, freedom, None, None)
    p = float(scipy.stats.chi2.sf(chi2, freedom))
    ends = scipy.stats.chi2.sf([max(0.0, chi2 - error), chi2 + error], freedom)
    return NoiseTest(chi2, error, freedom, p, float(np.abs(ends - p).max()) + 16.0 * EPS * p)
