"""Errors of histories and impacts, by the lengths of the errors of their states."""

from __future__ import annotations

import math
from typing import Final

from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.kernels.jit import bare, inline
from vibroimpact_solvers.kernels.rigid_state import Rows

CONVERTED: Final = 2.0  # roundings of a state when displacements are made of it
_PLACE, _RATE, _BEND, _PUSH, _WALL, _MASS = range(6)


@bare
def passage(off: float, speed: float, bend: float) -> float:
    """Return by how much a passage may be early or late; infinite where it may not take place.

    Parameters
    ----------
    off, speed, bend : float
        Error of what passes, its rate, and a bound of how fast that changes.
    """
    late, swing = 2.0 * bend * off, speed * speed
    return 2.0 * off / (speed + math.sqrt(swing - late)) if late < swing else math.inf


@inline
def _known(length: float, largest: float, until: float, tolerance: float) -> float:
    """Return the error of a state before the horizon, its length being in units of 2^-52."""
    known = EPS * length
    # The horizon is where the error exceeds the tolerance.
    if until < math.inf and known > tolerance * largest:
        known = tolerance * largest
    return known + CONVERTED * EPS * largest


@bare
def state_errors(
    lengths: Floats, times: Floats, largest: Floats, until: Floats, tolerance: float, out: Floats
) -> None:
    """Fill in the errors of the states of motions, shape (motion, time), infinite from horizons on.

    Parameters
    ----------
    lengths : array, shape (motion, time)
        Of the errors, in units of 2^-52.
    times : array, shape (time,)
    largest, until : array, shape (motion,)
        Lengths of the largest states, and the horizons.
    tolerance : float
    out : array, shape (motion, time)
    """
    for m in range(lengths.shape[0]):
        for i in range(times.size):
            known = _known(lengths[m, i], largest[m], until[m], tolerance)
            out[m, i] = known if times[i] < until[m] else math.inf


@bare
def impact_errors(
    impacts: Rows,
    counts: Integers,
    motions: tuple[Floats, Floats, Floats],
    tolerance: float,
    reach: Floats,
    fastest: float,
    out: tuple[Floats, Floats, Floats],
) -> None:
    """Fill in the errors of times, velocities and impulses of the impacts of motions.

    Parameters
    ----------
    impacts : array of `rigid_state.IMPACT`
        Those of all motions, one after the other, in the units of x.
    counts : array of int, shape (motion,)
    motions : tuple of arrays, shape (motion,)
        Lengths of the largest states, horizons, largest distances from a wall at an impact.
    tolerance : float
    reach : array, shape (6, constraint)
        What a unit error of the state makes of a coordinate and its velocity; what its acceleration
        is at most by a unit of the state, and by loads; the rounding of the walls; mass and
        restitution, by which a velocity is an impulse.
    fastest : float
        How fast accelerations change, relative to their bounds.
    out : tuple of arrays, shape (impact,)
    """
    every_largest, horizons, gaps = motions
    times, velocities, impulses = out
    first = 0
    for m in range(counts.size):
        largest, until, gap = every_largest[m], horizons[m], gaps[m]
        for i in range(first, first + counts[m]):
            row = impacts[i]
            c, speed = row.constraint, abs(row.velocity)
            state = _known(row.before, largest, until, tolerance)
            off = state * reach[_PLACE, c] + reach[_WALL, c] + 2.0 * gap
            # A displacement and a velocity are forms of different numbers of the state.
            own = state * reach[_RATE, c]
            most = reach[_BEND, c] * largest + reach[_PUSH, c]
            late = passage(off, speed, most)
            if late < math.inf:
                bend, there = most, abs(row.acceleration) + fastest * late * most
                if not there >= most:
                    bend = there
                velocity = math.hypot(bend * late, own)
            else:
                velocity = math.sqrt(speed * speed + 2.0 * most * off) + own
            taken = abs(row.impulse) / speed if speed > 0.0 else 0.0
            times[i] = late + EPS * row.time
            velocities[i] = velocity
            impulses[i] = max(reach[_MASS, c], taken) * velocity
            if until < math.inf and not row.time < until:
                times[i] = velocities[i] = impulses[i] = math.inf
        first += counts[m]
