"""A damped oscillator between elastic walls: its impacts, and closed forms of its slow flow.

Between impacts ``x'' + 2 delta x' + Omega0^2 x = 0`` has its elementary solution. The coordinate
rises towards a wall until its velocity vanishes, at a time known in closed form: up to there it is
monotonic, and Newton's method with bisection finds the impact to the last bit. The slow flow is
that of eq. 10.13-10.18: the elastic solution, eq. 10.14, with gamma as it decreases. The
series of eq. 10.18 is cut off where its terms are below rounding.
"""

from __future__ import annotations

import math

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.jit import fma, inner, kernel
from vibroimpact_solvers.kernels.phases import sine_cosine
from vibroimpact_solvers.kernels.waves import fold

_LANES = 64  # times of a block


@inner
def state(
    x: float, v: float, delta: float, root: float, square: float, s: float
) -> tuple[float, float]:
    """Return (x, v) of ``x'' + 2 delta x' + square x = 0`` a time s after a state.

    `root` is the damped frequency, ``root^2 = square - delta^2``.
    """
    decay, sine, cosine = math.exp(-delta * s), math.sin(root * s), math.cos(root * s)
    pull = (delta * v + square * x) / root
    return (
        decay * (x * cosine + (v + delta * x) / root * sine),
        decay * (v * cosine - pull * sine),
    )


@inner
def crossing(x: float, v: float, delta: float, root: float, square: float, wall: float) -> float:
    """Return when x reaches a wall above it from a state with v > 0; -1 where it turns before."""
    top = math.atan2(v * root, delta * v + square * x) / root
    highest, _ = state(x, v, delta, root, square, top)
    if highest <= wall:
        return -1.0
    low, high = 0.0, top
    # Without damping the walls would be met at the middle of the phase plane's arc.
    s = min(0.5 * top, (wall - x) / v)
    for _ in range(200):
        here, speed = state(x, v, delta, root, square, s)
        if here < wall:
            low = s
        else:
            high = s
        step = (wall - here) / speed if speed > 0.0 else math.inf
        following = s + step
        if not low < following < high:
            following = 0.5 * (low + high)
        if abs(following - s) <= 1e-16 * following or following in (low, high):
            return following
        s = following
    return s


@kernel
def impacts(
    x: float, v: float, delta: float, root: float, square: float, wall: float,
    until: float, times: Floats, speeds: Floats,
) -> int:  # fmt: skip
    """Fill in times and speeds of impacts, shape (impact,); return their number, v > 0 at first.

    Minus their number where there are more after `until`.
    """
    t = 0.0
    for n in range(times.size):
        s = crossing(x, v, delta, root, square, wall)
        if s < 0.0:
            return n
        t += s
        if t > until:
            return -n
        _, v = state(x, v, delta, root, square, s)
        times[n], speeds[n] = t, v
        # Seen from the other side the motion starts anew from the lower wall.
        x = -wall
    return -times.size


@kernel
def truncated(
    clock: Floats, zeta: float, r0: float, coefficients: Floats, gamma: Floats, phi: Floats
) -> None:
    """Evaluate eq. 10.17 and 10.18; `clock` is Omega0 t, shape (time,), phi = 0 at 0.

    Eq. 10.18 in the form ``F(r0) - exp(-2 zeta Omega0 t) F(r)`` with F = 2F1(-1/4, -1/4; 3/4; r)
    by its power series, shape (term,); r stays below 0.36 up to gamma = pi/2.
    """
    last = coefficients.size - 1
    first = 0.0
    for k in range(last, -1, -1):
        first = first * r0 + coefficients[k]
    scale = math.sqrt(math.sqrt(4.0 / (45.0 * r0))) / (2.0 * zeta)
    growth, r, total = np.empty(_LANES), np.ones(_LANES), np.empty(_LANES)
    for start in range(0, clock.size, _LANES):
        stop = min(start + _LANES, clock.size)
        some, some_gamma, some_phi = clock[start:stop], gamma[start:stop], phi[start:stop]
        for lane in range(some.size):
            growth[lane] = math.exp(2.0 * zeta * some[lane])
        for lane in range(some.size):
            square = growth[lane] * growth[lane]
            r[lane] = r0 * square * square
        # All times of a block for one term after the other: vector loops.
        for lane in range(_LANES):
            total[lane] = coefficients[last]
        for k in range(last - 1, -1, -1):
            for lane in range(_LANES):
                total[lane] = fma(total[lane], r[lane], coefficients[k])
        for lane in range(some.size):
            some_gamma[lane] = growth[lane] * math.sqrt(math.sqrt(11.25 * r0 / (1.0 - r[lane])))
            some_phi[lane] = scale * (first - total[lane] / growth[lane])


@kernel
def elastic_shapes(gamma: Floats, phi: Floats, x: Floats, v: Floats) -> None:
    """Evaluate x/Delta and v/(Omega0 Delta), eq. 10.14; all shapes (time,)."""
    for i in range(gamma.size):
        tau, e = fold(phi[i])
        s, c = sine_cosine(gamma[i] * tau, 0.0)
        sine, _ = sine_cosine(gamma[i], 0.0)
        x[i] = s / sine
        v[i] = c / sine * e
