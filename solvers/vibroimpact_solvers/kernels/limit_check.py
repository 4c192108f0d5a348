"""Proof that a free motion between impacts keeps all limits, or when it passes one.

In a free motion a limited coordinate is

    y(t) = level + form . z(t) + (rate + bend t / 2) t + Re sum_h Y_h e^(i h Omega t),

z being the response to the impulses, rate and bend what constant loads do to rigid bodies. From
its value, velocity and acceleration at one time and a bound B of its third derivative after it,

    y(t + h) <= y + y' h + y''/2 h^2 + B/6 h^3,

which is below the wall for all h up to a length that the roots of the cubic give. One such step
after the other covers the free motion. At its two ends, where a coordinate is at its wall, the
factor h is divided out. B is the sum of the moduli of all terms, with the cubes of their rates:
what decays is counted as it is at the beginning of the step.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.flow import EVEN, ODD, Z1, Z2, Flow, set_propagator
from vibroimpact_solvers.kernels.jit import inner, kernel, record

KEPT: Final = 0
TOUCHED: Final = 1
BEYOND: Final = 2
PASSED: Final = 3
"""Verdicts, the worse the larger; within the error of a wall, likely before or beyond it, none is
sure."""

VERDICT: Final = record([("kind", "i8"), ("constraint", "i8"), ("time", "f8")])
"""A verdict, the constraint that it is about, and when its limit is passed or touched."""

LOWER: Final = 0
UPPER: Final = 1
"""Rows of walls."""

SLOPE: Final = 0
BEND: Final = 1
"""Rows of the trends of coordinates: velocities and accelerations."""

_SHORT = 1e-7  # of the free motion: steps that the search takes without proof near a touch
_MOST = 1_000_000  # steps
_LIKELY = 1.0 / 16.0  # of the stated error, which the true one is mostly a hundredth of


class Coordinates(NamedTuple):
    """The limited coordinates as forms on the state."""

    position: Floats  # (constraint, 2, pair)
    velocity: Floats  # (constraint, 2, pair)
    acceleration: Floats  # (constraint, 2, pair)
    size: Floats  # (constraint, 2, pair): bounds of the third derivative by |z1| and |z2|
    growth: Floats  # (pair,): rates at which they grow, 0 for those that do not
    level: Floats  # (constraint,)
    walls: Floats  # (2, constraint): positions of the walls, infinite where there is none
    trend: Floats  # (2, constraint): velocities and accelerations by loads on rigid bodies


class FreeMotions(NamedTuple):
    """Free motions of any number of solutions."""

    state: Floats  # (free motion, 2, pair): response to the impulses, just after the first impact
    length: Floats  # (free motion,)
    rates: Floats  # (free motion, harmonic): h Omega
    cosine: Floats  # (free motion, constraint, harmonic): y has cosine cos - sine sin of the load
    sine: Floats  # (free motion, constraint, harmonic)
    first: Integers  # (free motion,): constraint with the impact at its beginning, -1 for none
    last: Integers  # (free motion,): that at its end
    first_side: Integers  # (free motion,): their walls, LOWER or UPPER
    last_side: Integers  # (free motion,)
    error: Floats  # (free motion, constraint): absolute error of the coordinate


class Motion(NamedTuple):
    """Position, velocity, acceleration and the bound of all coordinates at one time."""

    y: Floats
    v: Floats
    a: Floats
    bound: Floats


@inner
def _keeps(m: float, v: float, a: float, bound: float, h: float) -> bool:
    """Whether ``m - v s - a/2 s^2 - bound/6 s^3`` is positive for all s in (0, h].

    m = 0 stands for a coordinate at its wall.
    """
    if m > 0.0:
        least = min(m, m - h * (v + h * (0.5 * a + h * bound / 6.0)))
        square = a * a - 2.0 * bound * v
        if square > 0.0 and bound > 0.0:
            root = math.sqrt(square)
            for s in ((-a + root) / bound, (-a - root) / bound):
                if 0.0 < s < h:
                    least = min(least, m - s * (v + s * (0.5 * a + s * bound / 6.0)))
        return least > 0.0
    if v < 0.0:
        least = min(-v, -v - h * (0.5 * a + h * bound / 6.0))
        return least > 0.0
    return v == 0.0 and a < 0.0 and -0.5 * a - h * bound / 6.0 > 0.0


@inner
def _set_motion(
    flow: Flow, c: Coordinates, f: FreeMotions, k: int, t: float, propagator: Floats, motion: Motion
) -> None:
    """Fill in the motion of free motion k at time t."""
    set_propagator(flow, t, 0.0, propagator)
    even, odd, z = propagator[EVEN], propagator[ODD], f.state[k]
    left = f.length[k] - t
    for i in range(c.level.size):
        slope, bend = c.trend[SLOPE, i], c.trend[BEND, i]
        y, v, a, bound = c.level[i] + (slope + 0.5 * bend * t) * t, slope + bend * t, bend, 0.0
        p, s, u, g = c.position[i], c.velocity[i], c.acceleration[i], c.size[i]
        for j in range(even.size):
            back = odd[j]
            if j < flow.rotations:
                back = -back
            elif j >= flow.hyperbolas_end:
                back = 0.0
            z1 = even[j] * z[Z1, j] + odd[j] * z[Z2, j]
            z2 = even[j] * z[Z2, j] + back * z[Z1, j]
            y += p[Z1, j] * z1 + p[Z2, j] * z2
            v += s[Z1, j] * z1 + s[Z2, j] * z2
            a += u[Z1, j] * z1 + u[Z2, j] * z2
            grows = 1.0 if c.growth[j] == 0.0 else math.exp(c.growth[j] * left)
            bound += (g[Z1, j] * abs(z1) + g[Z2, j] * abs(z2)) * grows
        for h in range(f.rates.shape[1]):
            rate = f.rates[k, h]
            cosine, sine = math.cos(rate * t), math.sin(rate * t)
            real, imaginary = f.cosine[k, i, h], f.sine[k, i, h]
            even_part = real * cosine - imaginary * sine
            y += even_part
            v -= rate * (real * sine + imaginary * cosine)
            a -= rate * rate * even_part
            bound += math.hypot(real, imaginary) * rate * rate * rate
        motion.y[i], motion.v[i], motion.a[i], motion.bound[i] = y, v, a, bound


@inner
def _step_keeps(
    c: Coordinates, f: FreeMotions, k: int, t: float, h: float, tail: float, motion: Motion
) -> bool:
    """Whether all coordinates keep their limits in a step, as far as it is before the tail.

    The tail is what is proved for the last impact's wall from the end of the free motion.
    """
    for i in range(c.level.size):
        for side in range(2):
            sign = 1.0 if side == UPPER else -1.0
            margin = sign * (c.walls[side, i] - motion.y[i]) + f.error[k, i]
            length = h
            if i == f.last[k] and side == f.last_side[k]:
                length = min(h, f.length[k] - tail - t)
            if t == 0.0 and i == f.first[k] and side == f.first_side[k]:
                margin = 0.0
            if length > 0.0 and not _keeps(
                margin, sign * motion.v[i], sign * motion.a[i], motion.bound[i], length
            ):
                return False
    return True


@inner
def _passed(
    c: Coordinates, f: FreeMotions, k: int, t: float, tail: float, motion: Motion
) -> tuple[int, int]:
    """Return the verdict at one time, and the constraint that it is about."""
    verdict, which = KEPT, -1
    for i in range(c.level.size):
        for side in range(2):
            if t == 0.0 and i == f.first[k] and side == f.first_side[k]:
                continue
            if i == f.last[k] and side == f.last_side[k] and t >= f.length[k] - tail:
                continue
            sign = 1.0 if side == UPPER else -1.0
            over = sign * (motion.y[i] - c.walls[side, i])
            if over > f.error[k, i]:
                return PASSED, i
            here = BEYOND if over > _LIKELY * f.error[k, i] else TOUCHED
            if over > -f.error[k, i] and here > verdict:
                verdict, which = here, i
    return verdict, which


@inner
def _tail(
    flow: Flow, c: Coordinates, f: FreeMotions, k: int, propagator: Floats, motion: Motion
) -> float:
    """Return how long before its last impact a free motion is proved to be within that wall."""
    i, length = f.last[k], f.length[k]
    if i < 0:
        return 0.0
    _set_motion(flow, c, f, k, length, propagator, motion)
    sign = 1.0 if f.last_side[k] == UPPER else -1.0
    v, a = sign * motion.v[i], sign * motion.a[i]
    _set_motion(flow, c, f, k, 0.0, propagator, motion)
    h = float(length)
    while h > _SHORT * length:
        if _keeps(0.0, -v, a, motion.bound[i], h):
            return h
        h *= 0.5
    return 0.0


@kernel
def check_limits(flow: Flow, c: Coordinates, f: FreeMotions, verdicts: NDArray[np.void]) -> int:
    """Decide for every free motion whether it keeps all limits.

    Parameters
    ----------
    flow : Flow
    c : Coordinates
    f : Free motions
    verdicts : array of `VERDICT`, shape (free motion,)
        Filled in.

    Returns
    -------
    int
        Number of times at which coordinates were evaluated.
    """
    count, total = c.level.size, 0
    propagator = np.empty((2, flow.alpha.size))
    motion = Motion(np.empty(count), np.empty(count), np.empty(count), np.empty(count))
    for k in range(f.length.size):
        length = f.length[k]
        tail = _tail(flow, c, f, k, propagator, motion)
        decided = verdicts[k]
        decided.kind, decided.constraint, decided.time = KEPT, -1, np.nan
        t, h, steps = 0.0, length, 0
        while t < length and steps < _MOST:
            _set_motion(flow, c, f, k, t, propagator, motion)
            steps += 1
            verdict, which = _passed(c, f, k, t, tail, motion)
            if verdict > decided.kind:
                decided.kind, decided.constraint, decided.time = verdict, which, t
            if verdict == PASSED:
                break
            h = min(4.0 * h, length - t)
            while h > _SHORT * length and not _step_keeps(c, f, k, t, h, tail, motion):
                h *= 0.5
            t += max(h, min(_SHORT * length, length - t))
        if steps == _MOST and decided.kind < TOUCHED:
            decided.kind = TOUCHED
        total += steps
    return total
