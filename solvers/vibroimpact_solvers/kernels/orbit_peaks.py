"""Extremes of displacements between the nodes of their quadrature (`kernels.orbits`).

A displacement that is at a node no smaller than at both of its neighbours has a peak beside it,
which Newton's method finds where it may be the highest so far. So has one that falls from node to
node and rises at one of them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from vibroimpact_solvers.arrays import Floats
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

_STEPS = 20  # towards a peak; Newton's method mostly takes three
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
    """Return the highest displacement times sign that is met on the way to a peak in an interval.

    Newton's method seeks it; where that leads away, as beside an inflection soon after an impact,
    the interval, in which the displacement rises first and falls last, is halved.
    """
    best, low, near, high = -math.inf, at.low, at.near, at.high
    for _ in range(_STEPS):
        x, v, a = _displacement(flow, forms, m, mesh, near, d, room)
        x, v, a = sign * x, sign * v, sign * a
        best = max(best, x)
        low, high = (near, high) if v > 0.0 else (low, near)
        there = near - v / a if a < 0.0 else math.nan
        newton = low <= there <= high
        if not newton:
            there = 0.5 * (low + high)
        step = there - near
        if abs(step) <= _SETTLED * (at.high - at.low):
            if newton:
                best = max(best, x + (v + 0.5 * a * step) * step)
            break
        near = there
    return best


@inline
def _vertex(a: float, b: float, c: float, at: Interval) -> float:
    """Return where the parabola through three displacements is highest.

    The first two are one where nothing is known before.
    """
    if at.low == at.near:
        return at.near
    up, down = (b - a) / (at.near - at.low), (c - b) / (at.high - at.near)
    whole = at.high - at.low
    slope = (up * (at.high - at.near) + down * (at.near - at.low)) / whole
    return at.near + 0.5 * slope * whole / (up - down)


@inner
def _set_ranges(x: Floats, room: Room) -> None:
    """Fill in the least and the largest displacements of nodes, and of the two before."""
    low, high, later = room.least, room.largest, room.progress[0].latest >= 0.0
    for d in range(x.shape[1]):
        low[d], high[d] = math.inf, -math.inf
    for i in range(2 if later else 0):
        for d in range(x.shape[1]):
            low[d], high[d] = min(low[d], room.last[i, d]), max(high[d], room.last[i, d])
    for i in range(x.shape[0]):
        for d in range(x.shape[1]):
            here = x[i, d]  # choices, unlike min and max, make a vector loop
            low[d] = here if here < low[d] else low[d]
            high[d] = here if here > high[d] else high[d]


@inner
def _highest(
    flow: Flow, forms: Forms, m: Motions, mesh: Mesh, n: int, d: int, sign: float, best: float,
    room: Room,
) -> float:  # fmt: skip
    """Return the highest of a displacement times sign beside n nodes, and of best, that at them.

    It rises from a node to a peak beside it by less than from a neighbour to the node. The node in
    the middle of three is looked at; the last one of a free motion by itself.
    """
    dofs, progress = forms.trend.shape[1], room.progress[0]
    x = room.x[: n * dofs].reshape(n, dofs)
    length = m.length[progress.solution, progress.leg]
    before, latest = progress.before, progress.latest
    a, b = sign * room.last[_BEFORE, d], sign * room.last[_LATEST, d]
    for i in range(n):
        c, now = sign * x[i, d], room.times[i]
        if latest < 0.0:
            a, before = c, now
        else:
            if b >= a and b >= c and (b > a or b > c):
                if 2.0 * b - min(a, c) >= best:
                    at = Interval(before, _vertex(a, b, c, Interval(before, latest, now)), now)
                    best = max(best, _peak(flow, forms, m, mesh, d, sign, at, room))
            elif b + abs(a - 2.0 * b + c) >= best and a != b:
                # Between nodes that fall it rises where its velocity does: two peaks are near.
                _, v, _ = _displacement(flow, forms, m, mesh, latest, d, room)
                if sign * v > 0.0 and c < b:
                    at = Interval(latest, 0.5 * (latest + now), now)
                    best = max(best, _peak(flow, forms, m, mesh, d, sign, at, room))
                elif sign * v < 0.0 and a < b:
                    at = Interval(before, 0.5 * (before + latest), latest)
                    best = max(best, _peak(flow, forms, m, mesh, d, sign, at, room))
            if now == length and c > b and c + (c - b) >= best:
                at = Interval(latest, now, now)
                best = max(best, _peak(flow, forms, m, mesh, d, sign, at, room))
            a, before = b, latest
        b, latest = c, now
    return best


@inner
def raise_peaks(
    flow: Flow, forms: Forms, m: Motions, mesh: Mesh, n: int, sums: Sums, room: Room
) -> None:
    """Raise the highest displacements by those at n nodes, and by peaks beside them.

    No peak beside nodes is farther above the highest of them than that is above the lowest.
    """
    dofs, progress = forms.trend.shape[1], room.progress[0]
    if dofs == 0:
        return
    x = room.x[: n * dofs].reshape(n, dofs)
    _set_ranges(x, room)
    peaks = sums.peaks[progress.solution]
    for d in range(dofs):
        low, high = room.least[d], room.largest[d]
        for turn in range(2):
            sign, top = (1.0, high) if turn == 0 else (-1.0, -low)
            if top + (high - low) >= peaks[turn, d]:
                best = max(peaks[turn, d], top)
                peaks[turn, d] = _highest(flow, forms, m, mesh, n, d, sign, best, room)
    for i in range(n):
        begins = progress.latest < 0.0
        for d in range(dofs if i >= n - 2 or begins else 0):
            room.last[_BEFORE, d] = x[i, d] if begins else room.last[_LATEST, d]
            room.last[_LATEST, d] = x[i, d]
        progress.before = room.times[i] if begins else progress.latest
        progress.latest = room.times[i]
