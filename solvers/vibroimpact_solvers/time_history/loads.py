"""Harmonic and constant loads, as additional pairs of the state that drive the structure.

A harmonic load ``F cos(omega t + phase)`` is the pair (cos, -sin)(omega t + phase), a rotation;
the steady response of every mode is a linear form on it. A constant load on a damped rigid-body
mode makes it move at a constant velocity: the pair (t, 1), a parabola.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vibroimpact_solvers.arrays import Floats


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
    def of(cls, terms: tuple[Harmonic, ...], n: int) -> HarmonicLoads:
        """Collect the terms that vary, by their frequencies."""
        frequencies = np.unique([t.frequency for t in terms if t.frequency > 0.0])
        cosine, sine = np.zeros((2, n, frequencies.size))
        for term in terms:
            if term.frequency > 0.0:
                k = int(np.searchsorted(frequencies, term.frequency))
                cosine[term.dof, k] += term.amplitude * math.cos(term.phase)
                sine[term.dof, k] += term.amplitude * math.sin(term.phase)
        return cls(frequencies.astype(np.float64), cosine, sine)


def constant(terms: tuple[Harmonic, ...], n: int) -> Floats:
    """Return the part of the loads that does not vary, shape (dof,)."""
    force = np.zeros(n)
    for term in terms:
        if term.frequency == 0.0:
            force[term.dof] += term.amplitude * math.cos(term.phase)
    return force
