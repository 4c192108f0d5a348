"""Confidence intervals by profile of the likelihood.

The profile of an unknown is the least sum of squares over all others, for each of its values. The
95 % interval ends where it lies 3.84 above its minimum. The root of that difference is nearly
linear, so that a secant meets the end in a few steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.stats

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.calibration.fitting import least_squares
from vibroimpact_solvers.calibration.model import Evaluation, Model
from vibroimpact_solvers.errors import SolverError

CONFIDENCE: Final = 0.95
_ROOT: Final = float(np.sqrt(scipy.stats.chi2.ppf(CONFIDENCE, 1)))
_STEPS: Final = 25
"""Values of an unknown that are tried for one end."""
_DOUBLINGS: Final = 12
"""Steps outwards, each twice as long as the last, after which an interval has no end."""
_ACCURACY: Final = 1e-5
_INNER: Final = 1e-9
_INNER_EVALUATIONS: Final = 20


class LowerError(Exception):
    """A profile came below the best fit; `better` is where."""

    def __init__(self, better: Evaluation) -> None:
        super().__init__("there is a better fit")
        self.better = better


@dataclass(frozen=True, slots=True)
class End:
    """One end of an interval; infinite where there is none."""

    value: float
    error: float


@dataclass(eq=False, slots=True)
class Profile:
    """The profile of one unknown on one side of the best fit.

    Parameters
    ----------
    model : Model
    best : Evaluation
        The best fit, with the Jacobian.
    place : int
        Index of the unknown.
    side : int
        1 above the best fit, -1 below.
    others : array, shape (unknown,)
        How the others change with it to first order.
    """

    model: Model
    best: Evaluation
    place: int
    side: int
    others: Floats
    last: Evaluation | None = None

    def root(self, distance: float) -> float:
        """Return the root of the rise of the profile at a distance; infinite where none is."""
        bounds = self.model.problem.bounds
        previous = self.best if self.last is None else self.last
        x = previous.x + self.others * (
            self.side * distance - (previous.x[self.place] - self.best.x[self.place])
        )
        x = np.clip(x, *bounds)
        x[self.place] = self.value(distance)
        first = self.model.evaluate(x, rates=True)
        if isinstance(first, SolverError):
            return np.inf
        free = np.ones(x.size, dtype=bool)
        free[self.place] = False
        end = first
        if free.any():
            end = least_squares(
                self.model,
                first,
                bounds,
                self.model.problem.scale,
                _INNER_EVALUATIONS,
                free,
                _INNER,
            ).end
        rise = end.chi2 - self.best.chi2
        if rise < -1e-3:
            raise LowerError(end)
        self.last = end
        return float(np.sqrt(max(0.0, rise)))

    def value(self, distance: float) -> float:
        """Return the value of the unknown at a distance, not beyond its bound."""
        low, high = self.model.problem.bounds
        value = self.best.x[self.place] + self.side * distance
        return float(np.clip(value, low[self.place], high[self.place]))

    def end(self, guess: float) -> End:
        """Return the end of the interval, near a guess of its distance."""
        low, high = self.model.problem.bounds
        bound = (high if self.side > 0 else low)[self.place]
        most = abs(bound - self.best.x[self.place])
        if most == 0.0:
            return End(float(bound), 0.0)
        inside, outside = (0.0, 0.0), (np.inf, np.inf)
        distance, doublings = min(guess, most), 0
        for _ in range(_STEPS):
            root = self.root(distance)
            if abs(root - _ROOT) <= _ACCURACY:
                slope = root / distance
                return End(
                    self.value(distance), 2.0 * abs(root - _ROOT) / slope + _ACCURACY * distance
                )
            if root < _ROOT:
                inside = (distance, root)
                if distance == most:
                    return End(float(bound), 0.0)
            else:
                outside = (distance, root)
            if np.isinf(outside[0]):
                doublings += 1
                if doublings > _DOUBLINGS:
                    return End(self.side * np.inf, np.inf)
                further = inside[0] * _ROOT / max(inside[1], 1e-300)
                distance = min(most, float(np.clip(further, 1.1 * inside[0], 4.0 * inside[0])))
                continue
            distance = _between(inside, outside)
            if outside[0] - inside[0] <= 1e-9 * outside[0]:
                break
        # Where the model ends, or the profile jumps, so does the interval.
        return End(self.value(outside[0]), outside[0] - inside[0])


def _between(inside: tuple[float, float], outside: tuple[float, float]) -> float:
    """Return the next distance between two whose roots are on both sides."""
    middle = 0.5 * (inside[0] + outside[0])
    if np.isinf(outside[1]):
        return middle
    part = (_ROOT - inside[1]) / (outside[1] - inside[1])
    distance = inside[0] + part * (outside[0] - inside[0])
    margin = 1e-3 * (outside[0] - inside[0])
    return float(np.clip(distance, inside[0] + margin, outside[0] - margin))


def intervals(
    model: Model, best: Evaluation, covariance: Floats, report: Callable[[], None]
) -> list[tuple[End, End]]:
    """Return the interval of each unknown.

    Parameters
    ----------
    model, best
    covariance : array, shape (unknown, unknown)
        nan of unknowns that the data does not tell, or that are at a bound.
    report : callable
        Called after each end.

    Raises
    ------
    LowerError
        Where the best fit is none.
    """
    ends: list[tuple[End, End]] = []
    low, high = model.problem.bounds
    for place in range(best.x.size):
        pair = []
        for side, bound in ((-1, low[place]), (1, high[place])):
            variance = covariance[place, place]
            others = np.zeros(best.x.size)
            if np.isfinite(variance) and variance > 0.0:
                others = np.nan_to_num(covariance[:, place]) / variance
                guess = _ROOT * float(np.sqrt(variance))
            elif best.x[place] in (low[place], high[place]):
                guess = _guess_at_bound(model, best, place)
            else:
                pair.append(End(float(bound), 0.0 if np.isfinite(bound) else np.inf))
                report()
                continue
            pair.append(Profile(model, best, place, side, others).end(guess))
            report()
        ends.append((pair[0], pair[1]))
    return ends


def _guess_at_bound(model: Model, best: Evaluation, place: int) -> float:
    """Return about how far an interval reaches from a bound."""
    assert best.jacobian is not None
    column = best.jacobian[:, place]
    slope, curvature = abs(float(column @ best.residuals)), float(column @ column)
    if curvature == 0.0:
        return float(model.problem.scale[place])
    return float((np.sqrt(slope**2 + curvature * _ROOT**2) - slope) / curvature)
