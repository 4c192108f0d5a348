"""Loads that vary, as additional pairs of the state that drive the structure.

A harmonic load ``F cos(omega t + phase)`` is the pair (cos, -sin)(omega t + phase), a rotation;
the steady response of every mode is a linear form on it. A load that varies linearly between
samples is the pair (V, V') of its value and its slope, a parabola, whose slope is another one from
each sample on. A constant load on a damped rigid-body mode makes it move at a constant velocity:
the pair (t, 1), a parabola.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ModelError

SLOW_TURN: Final = 1.0
"""Turn until the end below which a rigid body's steady response to a load is larger than what the
load moves it by."""
_MOST_RADIANS: Final = 2.0**52
"""Phase of a load at the end from which on a rounding of t_end is a turn."""


@dataclass(frozen=True, slots=True)
class Harmonic:
    """A load ``amplitude cos(frequency t + phase)`` on one degree of freedom.

    Parameters
    ----------
    dof : int
    amplitude, frequency, phase : float
        frequency is not negative, rad per unit of time.
    """

    dof: int
    amplitude: float
    frequency: float
    phase: float = 0.0


@dataclass(frozen=True, eq=False, slots=True)
class Sampled:
    """A load ``direction value(t)``, its value varying linearly between samples.

    Parameters
    ----------
    direction : array, shape (dof,)
        A base that moves with the acceleration a is the load ``-M r a`` on the displacements
        relative to it, r being those of the structure by a unit displacement of the base.
    t, values : array, shape (sample,)
        Ascending times from at most 0 to at least the end of the motion.
    """

    direction: Floats
    t: Floats
    values: Floats


Load = Harmonic | Sampled


@dataclass(frozen=True, eq=False, slots=True)
class HarmonicLoads:
    """The harmonic loads of a motion, one pair for each frequency.

    Parameters
    ----------
    frequencies : array, shape (load,)
        Positive, ascending, each once.
    cosine, sine : array, shape (dof, load)
        The force is the sum of ``cosine cos(omega t) - sine sin(omega t)``.
    """

    frequencies: Floats
    cosine: Floats
    sine: Floats

    @classmethod
    def of(cls, loads: Sequence[Load], n: int) -> HarmonicLoads:
        """Collect the terms that vary, by their frequencies."""
        terms = [term for term in loads if isinstance(term, Harmonic) and term.frequency > 0.0]
        frequencies = np.unique([term.frequency for term in terms])
        cosine, sine = np.zeros((2, n, frequencies.size))
        for term in terms:
            k = int(np.searchsorted(frequencies, term.frequency))
            cosine[term.dof, k] += term.amplitude * math.cos(term.phase)
            sine[term.dof, k] += term.amplitude * math.sin(term.phase)
        return cls(frequencies.astype(np.float64), cosine, sine)


@dataclass(frozen=True, eq=False, slots=True)
class Ramps:
    """The sampled loads of a motion, which vary linearly between the samples of all.

    Parameters
    ----------
    directions : array, shape (dof, ramp)
    times : array, shape (sample,)
    values : array, shape (sample, ramp)
    """

    directions: Floats
    times: Floats
    values: Floats

    @classmethod
    def of(cls, loads: Sequence[Load], n: int) -> Ramps:
        """Collect the sampled loads."""
        terms = [term for term in loads if isinstance(term, Sampled)]
        if not terms:
            return cls(np.zeros((n, 0)), np.zeros(0), np.zeros((0, 0)))
        times = np.unique(np.concatenate([term.t for term in terms]))
        values = [np.interp(times, term.t, term.values) for term in terms]
        return cls(np.stack([t.direction for t in terms], 1), times, np.stack(values, 1))

    @property
    def count(self) -> int:
        """Number of the loads."""
        return int(self.directions.shape[1])

    def segment(self, time: float) -> int:
        """Return the index of the last sample not after a time."""
        return int(np.clip(np.searchsorted(self.times, time, "right") - 1, 0, self.times.size - 2))

    def state(self, segment: int, time: float) -> Floats:
        """Return values and slopes at a time of a segment, shape (2, ramp)."""
        if not self.count:
            return np.zeros((2, 0))
        (t, until), (low, high) = (
            self.times[segment : segment + 2],
            self.values[segment : segment + 2],
        )
        slopes = (high - low) / (until - t)
        return np.stack([low + slopes * (time - t), slopes])


def turns_slowly(term: Load, t_end: float) -> bool:
    """Return whether a load turns by less than `SLOW_TURN` until the end."""
    return isinstance(term, Harmonic) and 0.0 < term.frequency * t_end < SLOW_TURN


def constant(loads: Sequence[Load], n: int) -> Floats:
    """Return the part of the harmonic loads that does not vary, shape (dof,)."""
    force = np.zeros(n)
    for term in loads:
        if isinstance(term, Harmonic) and term.frequency == 0.0:
            force[term.dof] += term.amplitude * math.cos(term.phase)
    return force


def largest_frequency(loads: Sequence[Load]) -> float:
    """Return the largest frequency of harmonic loads."""
    return max((term.frequency for term in loads if isinstance(term, Harmonic)), default=0.0)


def samples(loads: Sequence[Load], t_end: float) -> int:
    """Return how many samples of loads lie within a motion."""
    given = (term.t for term in loads if isinstance(term, Sampled))
    return sum(int(((t > 0.0) & (t < t_end)).sum()) for t in given)


def require_phases(load: tuple[Load, ...], t_end: float) -> None:
    """Refuse loads of so many periods that double precision does not resolve their phase.

    Raises
    ------
    ModelError
    """
    for place, term in enumerate(load):
        if isinstance(term, Sampled):
            continue
        radians = term.frequency * t_end
        if radians > _MOST_RADIANS:
            message = (
                f"the load turns by {radians:.2g} rad until t_end = {t_end!r}, where "
                "neighbouring numbers in double precision are more than 1 rad apart"
            )
            raise ModelError(("load", place, "frequency"), message, code="out_of_range")
