"""Mean numbers of impacts, or of contacts, per period of the drive."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.attractors.problem import Problem
from vibroimpact_solvers.attractors.verdicts import Verdict
from vibroimpact_solvers.results.attractors import Verification

_PARTS: Final = 10  # of the observation, whose means are compared


def rate(
    problem: Problem, one: Verdict, times: Floats, count: int, verification: Verification
) -> tuple[float, float]:
    """Return a mean number per period of the drive, and its error.

    Periodic motions have so many in each of their periods, whenever they are observed. Of others
    the error is that of one at an end of the observation and of the mean of parts, three standard
    errors. Where bodies rest, impacts before that are as many as rounding lets be told.

    Parameters
    ----------
    problem : Problem
    one : Verdict
    times : array
        At which they happen while the motion is observed.
    count : int
        Those in one period of a periodic motion.
    verification : Verification
    """
    periods = one.motion.periods
    observed = times.size / periods
    if one.period and not one.motion.rests:
        mean = count / one.period
        exact = verification is Verification.CONFIRMED
        return mean, 0.0 if exact else abs(mean - observed)
    begin, T, parts = float(problem.sections[0]), problem.period, min(_PARTS, periods)
    ends = begin + T * np.linspace(0.0, periods, parts + 1)
    numbers = np.histogram(times, ends)[0] * (parts / periods)
    spread = 0.0 if one.period or parts < 2 else float(numbers.std(ddof=1)) / math.sqrt(parts)
    return observed, 1.0 / periods + 3.0 * spread
