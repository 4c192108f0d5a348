"""Extremes of displacements between the nodes of their quadrature (`kernels.orbits`).

A displacement that is at a node no smaller than at both of its neighbours has a peak beside it,
which Newton's method finds where it may be the highest so far.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from vibroimpact_solvers.kernels.flow import Z1, Z2, Flow
from vibroimpact_solvers.kernels.jit import fma, inline, inner
from vibroimpact_solvers.kernels.orbits import (
    BEND,
    DEAD,
    LEVEL,
    RATE,
    Forms,
    Mesh,
    Motions,
    Room,
    Sums,
)
from vibroimpact_solvers.kernels.phases import sine_cosine

_STEPS = 5  # of Newton's method for a peak
_SETTLED = 1e-5  # of an interval: after such a step the parabola tells the peak to rounding
_BEFORE = 0
_LATEST = 1  # rows of displacements at the two nodes before


class Interval(NamedTuple):
    """Times between which a peak is sought, and where that begins."""

    low: float
    near: float
    high: float


@inner
def _displacement(
    flow: Flow, forms: Forms, m: Motions, mesh: Mesh, t: float, d: int, room: Room
) -> tuple[float, float, float]:
    """Return a displacement, its velocity and its acceleration at a time."""
    level, rate, bend = forms.trend[LEVEL, d], forms.trend[RATE, d], forms.trend[BEND, d]
    x, v, a = level + (rate + 0.5 * bend * t) * t, rate + bend * t, bend
    k, leg = room.progress[0].solution, room.progress[0].leg
    f, z = m.of[k], m.state[k, leg]
    for h in range(m.harmonics.size):
        rate = m.harmonics[h] * m.Omega[f]
        sine, cosine = sine_cosine(m.harmonics[h] * (m.phase[k, leg] + m.Omega[f] * t), 0.0)
        real, imaginary = forms.steady[f, 2 * h, d], forms.steady[f, 2 * h + 1, d]
        there = real * cosine + imaginary * sine
        x += there
        v += rate * (imaginary * cosine - real * sine)
        a -= rate * rate * there
    for i in range(room.progress[0].moving):
        j = room.moving[i]
        if mesh.growth[j] * t < -DEAD:
            continue
        alpha, nu, z1, z2 = flow.alpha[j], flow.nu[j], z[Z1, j], z[Z2, j]
        p, q = forms.pairs[j, Z1, d], forms.pairs[j, Z2, d]
        there, back = nu, nu
        if j < flow.rotations:
            phase = nu * t
            sine, cosine = sine_cosine(phase, fma(flow.rest[j], t, fma(nu, t, -phase)))
            decay = math.exp(alpha * t)
            z1, z2 = decay * (cosine * z1 + sine * z2), decay * (cosine * z2 - sine * z1)
            back = -nu
        elif j < flow.hyperbolas_end:
            larger = math.exp(((alpha + nu) + flow.rest[j]) * t)
            odd = -0.5 * larger * math.expm1(-2.0 * nu * t)
            even = larger - odd
            z1, z2 = even * z1 + odd * z2, even * z2 + odd * z1
        else:
            decay = math.exp(alpha * t)
            z1, z2 = decay * (z1 + t * z2), decay * z2
            there, back = 1.0, 0.0
        first, second = alpha * z1 + there * z2, alpha * z2 + back * z1
        x += p * z1 + q * z2
        v += p * first + q * second
        a += p * (alpha * first + there * second) + q * (alpha * second + back * first)
    return x, v, a


@inner
def _peak(
    flow: Flow,
    forms: Forms,
    m: Motions,
    mesh: Mesh,
    d: int,
    sign: float,
    at: Interval,
    room: Room,
) -> float:
    """Return the highest displacement times sign that Newton's method finds in an interval."""
    best, near = -math.inf, at.near
    for _ in range(_STEPS):
        x, v, a = _displacement(flow, forms, m, mesh, near, d, room)
        x, v, a = sign * x, sign * v, sign * a
        best = max(best, x)
        if not a < 0.0:
            break
        there = min(max(near - v / a, at.low), at.high)
        step = there - near
        if abs(step) <= _SETTLED * (at.high - at.low):
            best = max(best, x + (v + 0.5 * a * step) * step)
            break
        near = there
    return best


@inline
def _rise(a: float, b: float, c: float, at: Interval) -> tuple[float, float]:
    """Return twice what the parabola through three displacements rises to, and its vertex.

    The first two are one where nothing is known before: it may rise from there as it falls after.
    """
    if at.low == at.near:
        return b - c, at.near
    up, down = (b - a) / (at.near - at.low), (c - b) / (at.high - at.near)
    whole = at.high - at.low
    slope = (up * (at.high - at.near) + down * (at.near - at.low)) / whole
    bend = 2.0 * (up - down) / whole
    return slope * slope / bend, at.near + slope / bend


@inner
def raise_peaks(
    flow: Flow, forms: Forms, m: Motions, mesh: Mesh, n: int, sums: Sums, room: Room
) -> None:
    """Raise the highest displacements by those at n nodes, and by peaks beside them.

    A displacement rises from a node to a peak beside it by less than twice what the parabola
    through the node and its neighbours does. The node in the middle of three is looked at; the
    last one of a free motion by itself.
    """
    dofs, progress = forms.trend.shape[1], room.progress[0]
    x = room.x[: n * dofs].reshape(n, dofs)
    length = m.length[progress.solution, progress.leg]
    for i in range(n):
        at = Interval(progress.before, progress.latest, room.times[i])
        for turn in range(2):
            sign, best = 1.0 - 2.0 * turn, sums.peaks[progress.solution, turn]
            for d in range(dofs):
                c = sign * x[i, d]
                best[d] = max(best[d], c)
                if at.near < 0.0:
                    continue
                a, b = sign * room.last[_BEFORE, d], sign * room.last[_LATEST, d]
                if b >= a and b >= c and (b > a or b > c):
                    rise, vertex = _rise(a, b, c, at)
                    if b + rise >= best[d]:
                        here = Interval(at.low, vertex, at.high)
                        top = _peak(flow, forms, m, mesh, d, sign, here, room)
                        best[d] = max(best[d], top)
                if at.high == length and c > b and c + (c - b) >= best[d]:
                    here = Interval(at.near, length, length)
                    top = _peak(flow, forms, m, mesh, d, sign, here, room)
                    best[d] = max(best[d], top)
        for d in range(dofs):
            room.last[_BEFORE, d] = x[i, d] if at.near < 0.0 else room.last[_LATEST, d]
            room.last[_LATEST, d] = x[i, d]
        progress.before = at.high if at.near < 0.0 else at.near
        progress.latest = at.high
