"""What a motion settles on: its period by recurrence, chaos by its exponent against its error.

States at the drive's phase 0 are compared by the largest difference of displacements, and of
velocities over the drive's frequency, relative to the amplitude of the motion.

- periodic: the states of the last periods return after n periods of the drive, within the
  tolerance, for the smallest such n, and the exponent is not proved positive;
- chaotic: they do not, and the exponent is larger than its error;
- quasi-periodic: they do not, the weighted mean of the exponent is zero within an error of at most
  0.001 per period of the drive, and the spread of the states is the same, to 5 %, in both halves of
  the observation. Neither a slow transient nor a periodic motion longer than is looked for has this
  exponent;
- undecided: everything else, and motions without impacts that damping does not draw together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.attractors.growth import Growth, contraction
from vibroimpact_solvers.attractors.observed import Impacts, Observed
from vibroimpact_solvers.attractors.problem import Problem
from vibroimpact_solvers.attractors.recurrence import SMALL, recurrence, states_of
from vibroimpact_solvers.results.attractors import Nature

_FLAT: Final = 1e-3  # error per period of the drive of an exponent that is told to be zero
_ZERO: Final = 1e-4  # per period of the drive: no exponent is told from zero that is smaller
_SLOWEST: Final = 1e-3  # contraction per period that a transient is taken to have at least
_NEARER: Final = 0.95  # distance from returning, over that at first, of what is a transient
_EVENLY: Final = 0.75  # of the decay of a transient in two of its thirds, at most in one of them
_STEADY: Final = 0.05  # difference of the spreads of both halves


@dataclass(frozen=True, eq=False, slots=True)
class Verdict:
    """What a motion settles on.

    Parameters
    ----------
    nature : Nature
    period : int
        In periods of the drive; 0 where it is not periodic.
    exponent, error : float
        Largest Lyapunov exponent; nan and inf where there is none.
    distance : float
        How far the motion is from its limit, relative to the amplitude, as is estimated.
    states : array, shape (section, 2 dof)
        Displacements, and velocities over the drive's frequency, at the drive's phase 0.
    scale : float
        What distances are relative to.
    hint : str
        Why it is undecided, and what to ask for; empty where it is not.
    """

    motion: Observed
    nature: Nature
    period: int
    exponent: float
    error: float
    distance: float
    states: Floats
    scale: float
    hint: str = ""


def verdict(problem: Problem, motion: Observed, growth: Growth, place: int) -> Verdict:
    """Return what a motion settles on whose exponent has a place in these."""
    exponent, error = float(growth.mean[place]), float(growth.error[place])
    states, scale = states_of(problem, motion.x, motion.v)
    period, apart = recurrence(states / scale, problem.longest, problem.close)
    nature, T, hint = Nature.UNDECIDED, problem.period, ""
    if not motion.struck and not motion.rests and not exponent < -error:
        # Whatever it returns to, its neighbours do not come closer.
        hint = "no impact and no damping draws neighbouring motions to it"
    elif period and not exponent > error:
        nature = Nature.PERIODIC
    elif not period and exponent > error:
        nature = Nature.CHAOTIC
    elif not period and _zero(growth, place, T) and _steady(states):
        nature = Nature.QUASI_PERIODIC
    left = 1.0 - contraction(exponent, period * T) if math.isfinite(exponent) else 1.0
    distance = apart / max(left, _SLOWEST) + problem.rounding
    periodic = nature is Nature.PERIODIC
    return Verdict(
        motion, nature, period if periodic else 0, exponent, error,
        distance if periodic else math.inf, states, scale,
        (hint or _hint(problem, states / scale, scale)) if nature is Nature.UNDECIDED else "",
    )  # fmt: skip


def _hint(problem: Problem, states: Floats, scale: float) -> str:
    """Return what the states of an undecided motion tell: a transient, or too short a look.

    What is left of a transient fades by the same factor in each third of the observation.
    """
    last, longest = states.shape[0] - 1, problem.longest
    late = states[last - longest + 1 :]
    apart = [
        float(np.abs(late - states[last - longest + 1 - n : last + 1 - n]).max())
        for n in range(1, longest + 1)
    ]
    n = int(np.argmin(apart)) + 1
    left, sizes = _thirds(states[n:] - states[:-n]), _thirds(states)
    if left[2] > 0.0 and left[2] < _NEARER * left[0]:
        whole, half = math.log(left[2] / left[0]), math.log(left[2] / left[1])
        if _EVENLY * whole < half < (1.0 - _EVENLY) * whole:
            # A motion that fades altogether is compared with ever less, down to the least scale.
            fades = math.log(sizes[2] / sizes[0]) < 0.5 * whole
            least = min(scale, SMALL * problem.length) if fades else scale
            factor = math.exp(whole / (2.0 * ((states.shape[0] - n) // 3)))
            wanted = problem.close * least / (left[2] * scale)
            more = math.ceil(math.log(min(wanted, 1.0)) / math.log(factor)) + longest
            return (
                f"it still comes closer to a motion of period {n}, by a factor of {factor:.4g} in "
                f"each period of the drive: let it settle for about {more} periods more"
            )
    return (
        f"it has no period up to {longest}, and its exponent is not told from zero: observe it for "
        "longer, or look for longer periods"
    )


def _thirds(states: Floats) -> tuple[float, float, float]:
    """Return the largest magnitudes of the last three thirds of states."""
    third = states.shape[0] // 3
    rows = np.abs(states[states.shape[0] - 3 * third :]).reshape(3, -1).max(axis=1)
    first, second, last = (float(largest) for largest in rows)
    return first, second, last


def _zero(growth: Growth, place: int, period: float) -> bool:
    """Whether an exponent is zero, as far as that can be told."""
    size, error = abs(float(growth.smooth[place])), float(growth.smooth_error[place])
    return size <= max(error, _ZERO / period) and error <= _FLAT / period


def _steady(states: Floats) -> bool:
    """Whether states spread as far in the second half of the observation as in the first."""
    middle = states.shape[0] // 2
    first, second = states[:middle].std(axis=0), states[middle:].std(axis=0)
    largest = np.maximum(first, second)
    return bool((np.abs(first - second) <= _STEADY * largest.max()).all())


def sequence(problem: Problem, settled: Verdict) -> Impacts:
    """Return the impacts of the last period of a periodic motion, from between two impacts on."""
    impacts, end = settled.motion.impacts, float(problem.sections[settled.motion.periods])
    length = settled.period * problem.period
    before = impacts.between(end - 2.0 * length, end)
    early = before.time[before.time < end - length]
    if not early.size:
        return before.between(end - length, end)
    after = np.append(early[1:], before.time[early.size : early.size + 1])
    # Where the gap is widest, the beginning of the period does not divide impacts.
    gaps = after - early[: after.size]
    if not gaps.size:
        return before.between(end - length, end)
    widest = int(gaps.argmax())
    start = float(early[widest] + 0.5 * gaps[widest])
    return impacts.between(start, start + length)
