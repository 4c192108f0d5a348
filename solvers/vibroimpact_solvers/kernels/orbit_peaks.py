"""Extremes of displacements between the nodes of their quadrature (`kernels.orbits`).

A displacement that is at a node no smaller than at both of its neighbours has a peak beside it,
which Newton's method finds where it may be the highest so far.
"""

from __future__ import annotations

import math

from vibroimpact_solvers.kernels.flow import Z1, Z2, Flow
from vibroimpact_solvers.kernels.jit import fma, inner
from vibroimpact_solvers.kernels.orbits import DEAD, Forms, Mesh, Motions, Room, Sums
from vibroimpact_solvers.kernels.phases import sine_cosine

_STEPS = 5  # of Newton's method for a peak
_SETTLED = 1e-5  # of an interval: after such a step the parabola tells the peak to rounding


@inner
def _displacement(
    flow: Flow, forms: Forms, m: Motions, mesh: Mesh, k: int, leg: int, t: float, d: int,
    room: Room,
) -> tuple[float, float, float]:  # fmt: skip
    """Return a displacement, its velocity and its acceleration at a time."""
    x = forms.trend[0, d] + (forms.trend[1, d] + 0.5 * forms.trend[2, d] * t) * t
    v, a = forms.trend[1, d] + forms.trend[2, d] * t, forms.trend[2, d]
    f, z = m.of[k], m.state[k, leg]
    for h in range(m.harmonics.size):
        rate = m.harmonics[h] * m.Omega[f]
        sine, cosine = sine_cosine(m.harmonics[h] * (m.phase[k, leg] + m.Omega[f] * t), 0.0)
        real, imaginary = forms.steady[f, 2 * h, d], forms.steady[f, 2 * h + 1, d]
        there = real * cosine + imaginary * sine
        x += there
        v += rate * (imaginary * cosine - real * sine)
        a -= rate * rate * there
    for i in range(room.counts[1]):
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
    flow: Flow, forms: Forms, m: Motions, mesh: Mesh, k: int, leg: int, d: int, sign: float,
    low: float, near: float, high: float, room: Room,
) -> float:  # fmt: skip
    """Return the highest displacement times sign that Newton's method finds in an interval."""
    best = -math.inf
    for _ in range(_STEPS):
        x, v, a = _displacement(flow, forms, m, mesh, k, leg, near, d, room)
        x, v, a = sign * x, sign * v, sign * a
        best = max(best, x)
        if not a < 0.0:
            break
        there = min(max(near - v / a, low), high)
        step = there - near
        if abs(step) <= _SETTLED * (high - low):
            best = max(best, x + (v + 0.5 * a * step) * step)
            break
        near = there
    return best


@inner
def raise_peaks(
    flow: Flow, forms: Forms, m: Motions, mesh: Mesh, k: int, leg: int, n: int, sums: Sums,
    room: Room,
) -> None:  # fmt: skip
    """Raise the highest displacements by those at n nodes, and by peaks beside them.

    A displacement rises from a node to a peak beside it by less than twice what the parabola
    through the node and its neighbours does. Before the first node and after the last one there
    are none: times are then those of the node itself.
    """
    dofs = forms.trend.shape[1]
    x = room.x[: n * dofs].reshape(n, dofs)
    for i in range(n):
        # The node in the middle of three is looked at: the last one of a free motion by itself.
        t0, t1, t2 = room.last_times[0], room.last_times[1], room.times[i]
        last = t2 == m.length[k, leg]
        for turn in range(2):
            sign, best = 1.0 - 2.0 * turn, sums.peaks[k, turn]
            for d in range(dofs):
                best[d] = max(best[d], sign * x[i, d])
            for d in range(dofs if t1 >= 0.0 else 0):
                a, b, c = sign * room.last[0, d], sign * room.last[1, d], sign * x[i, d]
                if b >= a and b >= c and (b > a or b > c):
                    rise, vertex = b - c if t0 == t1 else 0.0, t1
                    if t0 < t1:
                        up, down = (b - a) / (t1 - t0), (c - b) / (t2 - t1)
                        slope = (up * (t2 - t1) + down * (t1 - t0)) / (t2 - t0)
                        bend = 2.0 * (up - down) / (t2 - t0)
                        rise, vertex = slope * slope / bend, t1 + slope / bend
                    if b + rise >= best[d]:
                        top = _peak(flow, forms, m, mesh, k, leg, d, sign, t0, vertex, t2, room)
                        best[d] = max(best[d], top)
                if last and c > b and c + (c - b) >= best[d]:
                    top = _peak(flow, forms, m, mesh, k, leg, d, sign, t1, t2, t2, room)
                    best[d] = max(best[d], top)
        for d in range(dofs):
            room.last[0, d] = room.last[1, d] if t1 >= 0.0 else x[i, d]
            room.last[1, d] = x[i, d]
        room.last_times[0], room.last_times[1] = t1 if t1 >= 0.0 else t2, t2
