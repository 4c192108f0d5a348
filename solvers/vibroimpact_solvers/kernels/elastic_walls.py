"""Motion of a linear structure of unit mass, one coordinate of which strikes elastic walls.

Between impacts the first-order state is a sum of eigenvectors, and the constrained coordinate

    y(s) = Re sum_k w_k exp(rho_k s)

with the eigenvalues rho of the first-order system. The next impact is sought in steps that are
short against the fastest vibration, so that at most one turn lies in each, and located by
bisection to the last bit. Of all states with the coordinate at a wall one has the least energy:
below it no wall is ever reached again.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.jit import inner, kernel

Complex = NDArray[np.complex128]


class Structure(NamedTuple):
    """The free motion, and the energy."""

    modes: Complex  # eigenvectors of the first-order system, (2 n, 2 n)
    inverse: Complex  # of the modes, (2 n, 2 n)
    rates: Complex  # eigenvalues of the first-order system, (2 n,)
    stiffness: Floats  # (n, n)


class Walls(NamedTuple):
    """Walls on both sides, and the search for impacts."""

    dof: int  # the constrained degree of freedom
    distance: float  # of the walls
    least: float  # energy below which no wall is ever reached again
    step: float  # of the search
    until: float  # last time


@inner
def _coordinate(weights: Complex, rates: Complex, s: float) -> tuple[float, float]:
    """Return the constrained coordinate and its rate; weights and rates have shape (2 n,)."""
    y, slope = 0.0, 0.0
    for j in range(rates.size):
        decay = math.exp(rates[j].real * s)
        turn = complex(math.cos(rates[j].imag * s), math.sin(rates[j].imag * s))
        part = weights[j] * decay * turn
        y += part.real
        slope += (rates[j] * part).real
    return y, slope


@inner
def _halve(
    weights: Complex, rates: Complex, side: float, low: float, high: float, wall: float
) -> float:
    """Return where the coordinate passes a wall on one side, or turns back if it is infinite."""
    for _ in range(200):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        y, slope = _coordinate(weights, rates, middle)
        early = side * slope > 0.0 if wall == math.inf else side * y < wall
        if early:
            low = middle
        else:
            high = middle
    return high


@inner
def _next_impact(
    weights: Complex, rates: Complex, wall: float, step: float, until: float
) -> tuple[float, float]:
    """Return the time of the next impact and its side, or `until` and 0.

    A turn is located, so that a short stay beyond a wall is not missed.
    """
    y, slope = _coordinate(weights, rates, 0.0)
    s = 0.0
    while s < until:
        following = min(s + step, until)
        y1, slope1 = _coordinate(weights, rates, following)
        for k in range(2):
            side = 1.0 - 2.0 * k
            end, top = following, side * y1
            if side * slope > 0.0 and side * slope1 <= 0.0:
                end = _halve(weights, rates, side, s, following, math.inf)
                top, _ = _coordinate(weights, rates, end)
                top *= side
            # Just after an impact the coordinate is at the wall and leaves it.
            if top >= wall and side * y < wall:
                return _halve(weights, rates, side, s, end, wall), side
        s, y, slope = following, y1, slope1
    return until, 0.0


@inner
def _energy(y: Floats, stiffness: Floats) -> float:
    """Return the energy of a state."""
    n, energy = stiffness.shape[0], 0.0
    for i in range(n):
        force = 0.0
        for k in range(n):
            force += stiffness[i, k] * y[k]
        energy += 0.5 * (y[n + i] * y[n + i] + y[i] * force)
    return energy


@kernel
def impacts(
    state: Floats, structure: Structure, walls: Walls, times: Floats, states: Floats
) -> int:
    """Follow a structure from impact to impact; return the number of impacts.

    Parameters
    ----------
    state : array, shape (2 n,)
        Displacements and velocities at time 0.
    structure : Structure
    walls : Walls
    times, states : arrays, shape (impact,) and (impact, 2 n)
        Written: times of impacts and the states after them.
    """
    modes, inverse, rates, stiffness = structure
    dof, now, size = walls.dof, 0.0, state.size
    weights, seen = np.empty(size, np.complex128), np.empty(size, np.complex128)
    y = state
    for count in range(times.size):
        if _energy(y, stiffness) < walls.least or now >= walls.until:
            return count
        for j in range(size):
            weight = complex(0.0, 0.0)
            for k in range(size):
                weight += inverse[j, k] * y[k]
            weights[j], seen[j] = weight, modes[dof, j] * weight
        s, side = _next_impact(seen, rates, walls.distance, walls.step, walls.until - now)
        if side == 0.0:
            return count
        now += s
        for j in range(size):
            decay = math.exp(rates[j].real * s)
            weights[j] *= complex(
                decay * math.cos(rates[j].imag * s), decay * math.sin(rates[j].imag * s)
            )
        y = states[count]
        for i in range(size):
            y[i] = 0.0
            for j in range(size):
                y[i] += (modes[i, j] * weights[j]).real
        y[dof], y[size // 2 + dof] = side * walls.distance, -y[size // 2 + dof]
        times[count] = now
    return times.size
