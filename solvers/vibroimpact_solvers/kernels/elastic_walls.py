"""Motion of a linear structure, one coordinate of which strikes elastic walls."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.jit import kernel

Complex = NDArray[np.complex128]


@kernel
def coordinate(weights: Complex, rates: Complex, s: float) -> tuple[float, float]:
    """Return the constrained coordinate and its rate; weights and rates have shape (2 n,)."""
    y, slope = 0.0, 0.0
    for j in range(rates.size):
        decay = math.exp(rates[j].real * s)
        turn = complex(math.cos(rates[j].imag * s), math.sin(rates[j].imag * s))
        part = weights[j] * decay * turn
        y += part.real
        slope += (rates[j] * part).real
    return y, slope


@kernel
def _halve(
    weights: Complex, rates: Complex, low: float, high: float, level: float, turning: bool
) -> float:
    """Return where the coordinate passes a level upwards, or turns from rising to falling."""
    for _ in range(200):
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        y, slope = coordinate(weights, rates, middle)
        early = slope > 0.0 if turning else y < level
        if early:
            low = middle
        else:
            high = middle
    return high


@kernel
def next_impact(weights: Complex, rates: Complex, wall: float, step: float, until: float) -> Any:
    """Return the time of the next impact and its side, or `until` and 0.

    Steps are short against the fastest vibration, so that at most one turn lies in each; a turn
    is located, so that a short stay beyond a wall is not missed.
    """
    y, slope = coordinate(weights, rates, 0.0)
    s = 0.0
    while s < until:
        following = min(s + step, until)
        y1, slope1 = coordinate(weights, rates, following)
        for side in (1.0, -1.0):
            end, top = following, side * y1
            if side * slope > 0.0 and side * slope1 <= 0.0:
                end = _halve(side * weights, rates, s, following, 0.0, True)
                top = side * coordinate(weights, rates, end)[0]
            # Just after an impact the coordinate is at the wall and leaves it.
            if top >= wall and side * y < wall:
                return _halve(side * weights, rates, s, end, wall, False), side
        s, y, slope = following, y1, slope1
    return until, 0.0


@kernel
def impacts(
    state: Floats, modes: Complex, inverse: Complex, rates: Complex, dof: int, wall: float,
    step: float, until: float, least: float, stiffness: Floats, times: Floats, states: Floats,
) -> int:  # fmt: skip
    """Follow a structure of unit mass from impact to impact; return the number of impacts.

    Parameters
    ----------
    state : array, shape (2 n,)
        Displacements and velocities at time 0.
    modes, inverse, rates : arrays, shape (2 n, 2 n) twice and (2 n,), complex
        Eigenvectors of the first-order system, their inverse, and its eigenvalues.
    dof : int
        The constrained degree of freedom.
    wall, step, until : float
        Distance of the walls, step of the search and last time.
    least : float
        Energy below which no wall is ever reached again.
    stiffness : array, shape (n, n)
        K, for the energy.
    times, states : arrays, shape (impact,) and (impact, 2 n)
        Written: times of impacts and the states after them.
    """
    n = state.size // 2
    y, now = state.copy(), 0.0
    for count in range(times.size):
        energy = 0.5 * (np.dot(y[n:], y[n:]) + np.dot(y[:n], np.dot(stiffness, y[:n])))
        if energy < least or now >= until:
            return count
        weights = np.dot(inverse, y.astype(np.complex128))
        seen = modes[dof] * weights
        s, side = next_impact(seen, rates, wall, step, until - now)
        if side == 0.0:
            return count
        y = np.dot(modes, weights * np.exp(rates * s)).real.copy()
        now += s
        y[dof] = side * wall
        y[n + dof] = -y[n + dof]
        times[count] = now
        states[count] = y
    return times.size
