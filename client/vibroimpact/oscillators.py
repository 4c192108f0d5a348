"""Oscillators that ride on a moving point: their largest responses, exact in each piece of time.

An oscillator of angular frequency w and damping ratio d on a point of velocity V(t) has the
deflection z from the point and the absolute velocity p::

    z' = p - V        p' = -2 d w (p - V) - w² z

V stays bounded where the point is struck, and z and p are continuous there. With
``s = w (-d + i sqrt(1 - d²))`` the complex number ``q = p - conj(s) z`` obeys ``q' = s (q - V)``,
which has a closed solution where V is a parabola.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Complexes = NDArray[np.complex128]
    Integers = NDArray[np.int64]

_STEP: Final = 0.25
"""Largest w h of a step: the cubic between its ends then misses a peak by less than 1e-5 of it."""
_TERMS: Final = 11
"""Terms of a Taylor series at 0.25: the first left out is 1e-17 of the first."""


@dataclass(frozen=True)
class Jumps:
    """Jumps of the velocity of a point, which are proportional to impulses.

    Parameters
    ----------
    time : array, shape (jump,)
        Their times in ascending order. At an output time, the velocity listed is that before.
    impulse : array, shape (jump,)
        Impulses, positive upwards.
    place : array, shape (jump,)
        Where they act: jumps by impulses at the same place have one ratio to them.
    """

    time: Floats
    impulse: Floats
    place: Integers

    @classmethod
    def none(cls) -> Self:
        """Return no jumps."""
        return cls(np.zeros(0), np.zeros(0), np.zeros(0, dtype=np.int64))

    def within(self, start: float, stop: float) -> Jumps:
        """Return those from one time to another, which is excluded."""
        chosen = (self.time >= start) & (self.time < stop)
        return Jumps(self.time[chosen], self.impulse[chosen], self.place[chosen])


@dataclass(frozen=True)
class Pieces:
    """The velocity of a point: a parabola in each piece of time.

    Parameters
    ----------
    length, velocity, slope, curvature : array, shape (piece,)
        Length of each piece, and V, V' and V'' at its beginning.
    """

    length: Floats
    velocity: Floats
    slope: Floats
    curvature: Floats

    def after(self, time: Floats) -> Pieces:
        """Return the same parabolas from some time after their beginnings on, shape (piece,)."""
        return Pieces(
            self.length - time,
            self.velocity + time * (self.slope + 0.5 * time * self.curvature),
            self.slope + time * self.curvature,
            self.curvature,
        )

    @classmethod
    def of(cls, t: Floats, x: Floats, v: Floats, jumps: Jumps) -> Self:
        """Return the pieces between samples and jumps: cubics of x through x and v.

        A jump by D at time a is the ramp D (t - a) in the displacement. Without the ramps, the
        displacement is a cubic between two samples.

        Parameters
        ----------
        t, x, v : array, shape (sample,)
            Ascending times, displacements and velocities.
        jumps : Jumps
            Jumps of the velocity.
        """
        jumps = jumps.within(t[0], t[-1])
        h = np.diff(t)
        interval = np.searchsorted(t, jumps.time, side="right") - 1
        begins, ends = _accelerations(h, np.diff(x), v[:-1], v[1:])
        left = (t[1:][interval] - jumps.time) / h[interval]
        by_begin, by_end = _accelerations(h[interval], left * h[interval], 0.0, 1.0)
        sizes = _sizes(jumps, interval, (by_begin, by_end), (begins, ends), h)
        np.subtract.at(begins, interval, sizes * by_begin)
        np.subtract.at(ends, interval, sizes * by_end)
        starts = np.concatenate([t[:-1], jumps.time])
        order = np.argsort(starts, kind="stable")
        at = np.concatenate([np.arange(h.size), interval])[order]
        starts = starts[order]
        passed = np.cumsum(np.concatenate([np.zeros(h.size), sizes])[order])
        passed -= passed[np.searchsorted(at, at)]  # those of former intervals are in v
        s, curvature = starts - t[at], ((ends - begins) / h)[at]
        return cls(
            np.diff(starts, append=t[-1]),
            v[at] + s * (begins[at] + 0.5 * s * curvature) + passed,
            begins[at] + s * curvature,
            curvature,
        )


def _accelerations(h: Floats, rise: Floats, v0: Any, v1: Any) -> tuple[Floats, Floats]:
    """Return the second derivatives of a cubic at both ends, from its rise and its slopes there."""
    mean = 6.0 * rise / h
    return (mean - 4.0 * v0 - 2.0 * v1) / h, (-mean + 2.0 * v0 + 4.0 * v1) / h


def _sizes(
    jumps: Jumps,
    interval: Integers,
    effects: tuple[Floats, Floats],
    accelerations: tuple[Floats, Floats],
    h: Floats,
) -> Floats:
    """Return the jumps: by least squares, the acceleration is continuous at the samples.

    The unknowns are the ratios of jumps to impulses at each place.

    Parameters
    ----------
    jumps, interval
        The jumps, and the intervals in which they are.
    effects : (array, array), shape (jump,)
        Acceleration at the beginning and at the end of the interval by a jump of 1 within.
    accelerations : (array, array), shape (interval,)
        The same of all of its motion.
    h : array, shape (interval,)
        Lengths of the intervals.
    """
    places, place = np.unique(jumps.place, return_inverse=True)
    samples = np.unique(np.concatenate([interval, interval + 1]))
    samples = samples[(samples > 0) & (samples < h.size)]
    if not samples.size:
        return np.zeros(jumps.time.size)
    rows = np.full(h.size + 1, samples.size)
    rows[samples] = np.arange(samples.size)
    matrix = np.zeros((samples.size + 1, places.size))  # the last row is not used
    np.add.at(matrix, (rows[interval + 1], place), jumps.impulse * effects[1])
    np.subtract.at(matrix, (rows[interval], place), jumps.impulse * effects[0])
    scale = np.minimum(h[samples - 1], h[samples])
    gap = scale * (accelerations[1][samples - 1] - accelerations[0][samples])
    ratios = np.linalg.lstsq(scale[:, np.newaxis] * matrix[:-1], gap, rcond=None)[0]
    return np.asarray(ratios[place] * jumps.impulse)


def largest(pieces: Pieces, frequency: float, damping: float) -> tuple[float, float]:
    """Return the largest deflection and the largest absolute acceleration of an oscillator.

    It starts without deflection, with the velocity of the point.

    Parameters
    ----------
    pieces : Pieces
        Velocity of the point.
    frequency : float
        Angular frequency without damping.
    damping : float
        Damping ratio, at least 0 and below 1.
    """
    rate = frequency * complex(-damping, math.sqrt(1.0 - damping**2))
    steps = max(1, math.ceil(frequency * float(pieces.length.max()) / _STEP))
    h = pieces.length / steps
    factor, weights = _weights(rate, h)
    push = np.zeros(h.size, dtype=np.complex128)
    for step in range(steps):
        push = factor * push + _push(weights, pieces.after(step * h))
    q = _states(factor**steps, push, complex(pieces.velocity[0]))
    first = _responses(q, pieces, rate)
    deflection = acceleration = 0.0
    for step in range(steps):
        q = factor * q + _push(weights, pieces.after(step * h))
        second = _responses(q, pieces.after((step + 1) * h), rate)
        deflection = max(deflection, _peak(first[:2], second[:2], h))
        acceleration = max(acceleration, _peak(first[2:], second[2:], h))
        first = second
    return deflection, acceleration


def _weights(rate: complex, h: Floats) -> tuple[Complexes, tuple[Complexes, ...]]:
    """Return the factor of q in steps, and the weights of V, V' and V'' in what V adds to it.

    They are ``exp(s h)`` and ``-s`` times the integrals of ``exp(s (h - t)) t^k / k!``.
    """
    x = rate * h
    third = np.zeros(h.size, dtype=np.complex128)
    for term in reversed(range(_TERMS)):
        third = x * third + 1.0 / math.factorial(term + 3)
    second = x * third + 0.5
    first = x * second + 1.0
    return x * first + 1.0, (-x * first, -x * h * second, -x * h**2 * third)


def _push(weights: tuple[Complexes, ...], at: Pieces) -> Complexes:
    """Return what the motion of the point adds to q in a step that begins here."""
    return weights[0] * at.velocity + weights[1] * at.slope + weights[2] * at.curvature


def _states(factor: Complexes, push: Complexes, start: complex) -> Complexes:
    """Return q at the beginning of each piece, by ``q[k + 1] = factor[k] q[k] + push[k]``.

    Pieces are joined to runs of 1, 2, 4, … of them.
    """
    factor, q = factor.copy(), push.copy()
    q[0] += factor[0] * start
    run = 1
    while run < q.size:
        q[run:] += factor[run:] * q[:-run]
        factor[run:] *= factor[:-run]
        run *= 2
    return np.concatenate([[start], q[:-1]])


def _responses(q: Complexes, at: Pieces, rate: complex) -> tuple[Floats, ...]:
    """Return the deflection, the absolute acceleration, and each followed by its rate."""
    square, twice_decay = abs(rate) ** 2, -2.0 * rate.real
    z = q.imag / rate.imag
    speed = q.real + rate.real * z - at.velocity
    acceleration = -twice_decay * speed - square * z
    change = -twice_decay * (acceleration - at.slope) - square * speed
    return z, speed, acceleration, change


def _peak(first: tuple[Floats, ...], second: tuple[Floats, ...], h: Floats) -> float:
    """Return the largest absolute value of cubics, from values and rates at both ends."""
    (y0, rate0), (y1, rate1) = first, second
    ends = float(max(np.abs(y0).max(), np.abs(y1).max()))
    above = np.maximum(np.abs(y0), np.abs(y1)) + 4.0 / 27.0 * h * (np.abs(rate0) + np.abs(rate1))
    chosen = above > ends  # a cubic passes the larger end by no more than that
    y0, d0, d1 = y0[chosen], (h * rate0)[chosen], (h * rate1)[chosen]
    rise = y1[chosen] - y0
    square, cube = 3.0 * rise - 2.0 * d0 - d1, d0 + d1 - 2.0 * rise
    root = np.sqrt(np.maximum(square**2 - 3.0 * cube * d0, 0.0))
    for below in (root - square, -root - square):
        s = np.clip(np.divide(d0, below, out=np.zeros_like(d0), where=below != 0.0), 0.0, 1.0)
        inside = np.abs(y0 + s * (d0 + s * (square + s * cube)))
        ends = max(ends, float(inside.max(initial=0.0)))
    return ends
