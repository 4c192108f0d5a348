"""The growth of deviations from observed motions, and what it says of Lyapunov exponents.

The logarithm g of a deviation's length is noted at the end of each period of the drive. The first
quarter is left out, in which the deviation turns towards the one that grows fastest. The exponent
is the mean slope of the rest. Its error is three times the range of g about that slope, over the
time: of random steps that is 3.8 times the standard error, and oscillations of g, which are
bounded, change the mean by less.

Of regular motions, the mean of the slopes of g weighted by exp(-1/(s (1 - s))), s being the part of
the time, converges faster than any power of it. Three times its difference between both halves of
the time and the whole is the error of this mean, which tells whether an exponent is zero.

A motion without impacts or contacts has the exponent of the structure. One that rests at a wall has
none: every deviation in that coordinate ends there.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.attractors.observed import Observed
from vibroimpact_solvers.attractors.problem import Problem
from vibroimpact_solvers.periodic_motions.pairs import Pairs

_SAFETY: Final = 3.0
_ROUNDING: Final = 1e-12  # of g, per observed period


@dataclass(frozen=True, eq=False, slots=True)
class Growth:
    """Largest Lyapunov exponents of motions, and their errors; nan and inf: none.

    Parameters
    ----------
    mean, error : array, shape (motion,)
        From the mean slope.
    smooth, smooth_error : array, shape (motion,)
        From the weighted mean, for regular motions.
    """

    mean: Floats
    error: Floats
    smooth: Floats
    smooth_error: Floats


class Lengths:
    """Logarithms of the lengths of deviations, which become short again at each section.

    Parameters
    ----------
    motions, sections : int

    Attributes
    ----------
    logs : array, shape (motion, section)
    """

    def __init__(self, motions: int, sections: int) -> None:
        self.logs = np.zeros((motions, sections))
        self._section = np.zeros(motions, dtype=np.int64)

    def shorten(self, at: Integers, w: Floats, sizes: Floats) -> None:
        """Note the lengths of some motions' deviations w, shape (motion, …), and make them one."""
        before = self.logs[at, self._section[at]]
        self._section[at] += 1
        with np.errstate(divide="ignore", invalid="ignore"):
            self.logs[at, self._section[at]] = before + np.log(sizes)
            w[at] /= sizes.reshape(-1, *[1] * (w.ndim - 1))


class Exponents(ABC):
    """Computes the largest Lyapunov exponents of motions of one problem.

    Parameters
    ----------
    problem : Problem
    pairs : Pairs
        Of the structure without impacts or contacts.
    scale : float
        Units of the basis' time in one of time.

    Attributes
    ----------
    structure, structure_error : float
        Exponent of the structure without impacts or contacts.
    """

    def __init__(self, problem: Problem, pairs: Pairs, scale: float) -> None:
        self._problem, moving = problem, pairs.moving
        self.structure = float(pairs.growth[moving].max()) * scale
        error = float(pairs.drift[moving].max() + EPS * pairs.speed.max())
        self.structure_error = error * scale

    def of(self, motions: Sequence[Observed], report: Callable[[], None] | None = None) -> Growth:
        """Return the exponents of motions; calls `report` now and then, which may raise."""
        count = len(motions)
        growth = Growth(
            np.full(count, np.nan), np.full(count, np.inf),
            np.full(count, np.nan), np.full(count, np.inf),
        )  # fmt: skip
        struck = []
        for place, motion in enumerate(motions):
            if motion.rests:
                continue
            if motion.struck:
                struck.append(place)
            else:
                growth.mean[place] = growth.smooth[place] = self.structure
                growth.error[place] = growth.smooth_error[place] = self.structure_error
        if struck:
            lengths = self.lengths([motions[k] for k in struck], report or _nobody)
            self._put(growth, np.array(struck), lengths)
        return growth

    def _put(self, growth: Growth, at: Integers, lengths: Floats) -> None:
        """Put in the exponents of motions whose deviations have these logarithms of lengths."""
        kept = lengths[:, (lengths.shape[1] - 1) // 4 :]
        period, count = self._problem.period, kept.shape[1] - 1
        with np.errstate(invalid="ignore"):
            slope = (kept[:, -1] - kept[:, 0]) / count
            about = kept - slope[:, np.newaxis] * np.arange(count + 1)
            error = _SAFETY * np.ptp(about, axis=1) / count + _ROUNDING
            steps = np.diff(kept, axis=1)
            smooth = _weighted(steps)
            halves = _weighted(steps[:, : count // 2]), _weighted(steps[:, count // 2 :])
            apart = np.maximum(*(np.abs(half - smooth) for half in halves))
        known = np.isfinite(kept).all(axis=1)  # a deviation may vanish
        growth.mean[at] = np.where(known, slope / period, np.nan)
        growth.error[at] = np.where(known, error / period, np.inf)
        growth.smooth[at] = np.where(known, smooth / period, np.nan)
        growth.smooth_error[at] = np.where(known, _SAFETY * apart / period, np.inf)

    @abstractmethod
    def lengths(self, motions: Sequence[Observed], report: Callable[[], None]) -> Floats:
        """Return logarithms of the lengths of deviations, shape (motion, section)."""


def _nobody() -> None:
    """Report to nobody."""


def _weighted(steps: Floats) -> Floats:
    """Return means along the last axis, weighted by a bump that is flat at both ends."""
    s = (np.arange(steps.shape[-1]) + 0.5) / steps.shape[-1]
    weights = np.exp(-1.0 / (s * (1.0 - s)))
    return np.asarray(steps @ (weights / weights.sum()))


def contraction(exponent: float, duration: float) -> float:
    """Return what is left of a deviation after a time."""
    return math.exp(min(0.0, exponent * duration))
