"""Zeros of one over distinct poles, each within a disc that is proved to contain it.

The equation is ``1 + sum_j R_j / (L - c_j) = 0``, with real poles c and residues R of any sign. It
has as many zeros as poles, real ones and conjugate pairs; one of them is known, and all are
measured from there: it is 0. With approximations z of the others, which are to be zeros of the
polynomial ``p(L)/L``, and

    W_k = p(z_k) / (z_k prod_(i /= k) (z_k - z_i)),

the zeros are those of ``1 + sum_k W_k / (L - z_k)``, by Lagrange's interpolation. Where the moduli
of the terms of this sum amount to less than 1 all along a circle, it encloses as many zeros as
approximations, by Rouché's theorem: one, if there is one. As all circles separate approximations
and zeros alike, no zero is outside all of them.

References
----------
Bini, D. A. (1996). Numerical computation of polynomial zeros by means of Aberth's method.
Numerical Algorithms 13, 179-200.
Tilli, P. (1998). Convergence conditions of some methods for the simultaneous computation of
polynomial zeros. Calcolo 35, 3-15 (Rouché's theorem with Weierstrass' corrections).
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.kernels.free_motion import Modes, effect
from vibroimpact_solvers.kernels.jit import inner, kernel, record, sums

_SWEEPS: Final = 60  # of Ehrlich's and Aberth's method
_SETTLED: Final = 1e-9  # relative correction after which a zero is left: it is then far smaller
_NEAR: Final = 0.4  # of the distance to the next pole, that an approximation starts from its own
_SLIGHT: Final = 0.1  # angle by which it starts off the real axis, where pairs may be born
_REAL: Final = 1e-3  # imaginary part, of the distance to the next one, that is taken for rounding
_FUNCTION: Final = 2.0 * EPS  # of a sine or cosine, relative to it
_DOUBLINGS: Final = 40  # of a radius, until a circle separates

# Stages, each of which all approximations go through.
_BEGIN, _APPROACH, _REALIZE, _BOUND, _SEPARATE, _DONE = range(6)

PIECE: Final = 500_000
"""Terms of sums over all modes that take some milliseconds."""

PROGRESS: Final = record([("stage", "i8"), ("sweeps", "i8"), ("row", "i8")])
"""How far the search for zeros is."""


class Equation(NamedTuple):
    """Poles by ascending size, residues, and what rounding does to both, each (pole,)."""

    pole: Floats
    pole_error: Floats
    residue: Floats
    residue_error: Floats


class Zeros(NamedTuple):
    """All zeros but the known one: approximations are pole[home] + (x + i y), each (pole - 1,)."""

    home: Integers
    x: Floats
    y: Floats
    correction: Floats  # bounds of the moduli of W
    radius: Floats  # of the circles, infinite where none separates
    alone: Integers  # 1 where a circle encloses one zero, else 0


@sums
def _other_terms(eq: Equation, home: int, x: float, y: float) -> tuple[float, float, float, float]:
    """Return the sums of ``R/(L - c)`` and of its derivative over all poles but one.

    L is x + i y from that pole.
    """
    level, level_y, slope, slope_y = 0.0, 0.0, 0.0, 0.0
    own = eq.pole[home]
    for j in range(eq.pole.size):
        u = (own - eq.pole[j]) + x
        length = u * u + y * y
        weight = 0.0 if j == home else 1.0 / length
        a, b = u * weight, -y * weight
        level += eq.residue[j] * a
        level_y += eq.residue[j] * b
        slope -= eq.residue[j] * (a * a - b * b)
        slope_y -= eq.residue[j] * 2.0 * a * b
    return level, level_y, slope, slope_y


@sums
def _pole_sum(eq: Equation, home: int, x: float, y: float) -> tuple[float, float]:
    """Return the sum of ``1/(L - c)`` over all poles but one."""
    total, total_y = 0.0, 0.0
    own = eq.pole[home]
    for j in range(eq.pole.size):
        u = (own - eq.pole[j]) + x
        weight = 0.0 if j == home else 1.0 / (u * u + y * y)
        total += u * weight
        total_y -= y * weight
    return total, total_y


@sums
def _zero_sum(eq: Equation, z: Zeros, k: int) -> tuple[float, float]:
    """Return the sum of ``1/(z_k - z)`` over all other zeros, the known one included."""
    own = eq.pole[z.home[k]]
    u, v = own + z.x[k], z.y[k]
    length = u * u + v * v
    total, total_y = u / length, -v / length
    for i in range(z.x.size):
        u, v = (own - eq.pole[z.home[i]]) + (z.x[k] - z.x[i]), z.y[k] - z.y[i]
        length = u * u + v * v
        weight = 1.0 / (length if length > 0.0 else math.inf)  # itself, and equal ones
        total += u * weight
        total_y -= v * weight
    return total, total_y


@inner
def _start(eq: Equation, z: Zeros, k: int) -> None:
    """Start from a pole, one but that nearest to the known zero, moved by its residue."""
    n, left_out = eq.pole.size, 0
    for j in range(n):
        if abs(eq.pole[j]) < abs(eq.pole[left_out]):
            left_out = j
    j = k if k < left_out else k + 1
    gap = math.inf
    if j > 0:
        gap = eq.pole[j] - eq.pole[j - 1]
    if j < n - 1:
        gap = min(gap, eq.pole[j + 1] - eq.pole[j])
    level, _, _, _ = _other_terms(eq, j, 0.0, 0.0)
    shift = -eq.residue[j] / (1.0 + level) if level != -1.0 else math.inf
    if gap < math.inf:
        shift = max(-_NEAR * gap, min(_NEAR * gap, shift))
    z.home[k], z.x[k], z.alone[k] = j, shift, 0
    z.y[k] = _SLIGHT * shift if k % 2 == 0 else -_SLIGHT * shift


@inner
def _settle_home(eq: Equation, z: Zeros, k: int) -> None:
    """Measure an approximation from the pole next to it."""
    home = z.home[k]
    while True:
        best = home
        for j in (home - 1, home + 1):
            if 0 <= j < eq.pole.size:
                away = abs((eq.pole[home] - eq.pole[j]) + z.x[k])
                if away < abs((eq.pole[home] - eq.pole[best]) + z.x[k]):
                    best = j
        if best == home:
            break
        z.x[k] += eq.pole[home] - eq.pole[best]
        home = best
    z.home[k] = home


@inner
def _change(eq: Equation, z: Zeros, k: int) -> complex:
    """Return the correction of one approximation by Ehrlich's and Aberth's method."""
    home, t = z.home[k], complex(z.x[k], z.y[k])
    level, level_y, slope, slope_y = _other_terms(eq, home, z.x[k], z.y[k])
    rest = complex(1.0 + level, level_y)
    value = t * rest + eq.residue[home]
    if value == 0.0:
        return complex(0.0, 0.0)
    poles, poles_y = _pole_sum(eq, home, z.x[k], z.y[k])
    zeros, zeros_y = _zero_sum(eq, z, k)
    total = (rest + t * complex(slope, slope_y)) / value
    total += complex(poles - zeros, poles_y - zeros_y)
    return 1.0 / total if total != 0.0 else complex(math.inf, 0.0)


@inner
def _approach(eq: Equation, z: Zeros, k: int) -> None:
    """Correct an approximation; where it does not come to rest, its circle will be large."""
    if z.alone[k]:  # it rests
        return
    change = _change(eq, z, k)
    size = math.hypot(z.x[k], z.y[k])
    if not abs(change) < math.inf:
        change = complex(0.0, _SLIGHT * (size + EPS))
    z.x[k] -= change.real
    z.y[k] -= change.imag
    z.alone[k] = int(abs(change) <= _SETTLED * size)
    _settle_home(eq, z, k)


@sums
def _nearest(eq: Equation, z: Zeros, k: int) -> float:
    """Return the square of the distance to the next approximation."""
    own, least = eq.pole[z.home[k]], math.inf
    for i in range(z.x.size):
        u, v = (own - eq.pole[z.home[i]]) + (z.x[k] - z.x[i]), z.y[k] - z.y[i]
        square = u * u + v * v if i != k else math.inf
        least = min(least, square)
    return least


@inner
def _make_real(eq: Equation, z: Zeros, k: int) -> None:
    """Put an approximation whose imaginary part is rounding on the real axis, and improve it."""
    if z.y[k] * z.y[k] > _REAL * _REAL * _nearest(eq, z, k):
        return
    z.y[k] = 0.0
    change = _change(eq, z, k).real
    if abs(change) < _REAL * abs(z.x[k]):
        z.x[k] -= change


@inner
def _bound_correction(modes: Modes, eq: Equation, z: Zeros, k: int) -> float:
    """Return a bound of the modulus of W, to first order in the errors of the modes."""
    home, x, y = z.home[k], z.x[k], z.y[k]
    own, away = eq.pole[home], math.hypot(x, y)
    level, level_y, size, error, moved = 1.0, 0.0, 1.0, 0.0, 0.0
    ratio = 1.0 / math.hypot(own + x, y)
    other = 0
    for j in range(eq.pole.size):
        if j == home:
            continue
        u = (own - eq.pole[j]) + x
        length = math.hypot(u, y)
        level += eq.residue[j] * (u / length) / length
        level_y -= eq.residue[j] * (y / length) / length
        term, off = abs(eq.residue[j]) / length, eq.pole_error[j] + eq.pole_error[home]
        size += term
        error += (eq.residue_error[j] + term * off) / length
        moved += (off + modes.phase_error[j] * abs(modes.sine[j])) / length
        if other == k:
            other += 1
        # One factor above and one below at a time: neither product overflows.
        ratio *= length
        if other < z.x.size:
            u = (own - eq.pole[z.home[other]]) + (x - z.x[other])
            ratio /= math.hypot(u, y - z.y[other])
        other += 1
    level, level_y = x * level - y * level_y + eq.residue[home], x * level_y + y * level
    value = math.hypot(level, level_y) + away * error + eq.residue_error[home]
    value += (away * EPS * (eq.pole.size + 16.0) + eq.pole_error[home]) * size
    value += 4.0 * EPS * abs(eq.residue[home]) + 1.01 * effect(modes, home, complex(x, y))
    return float(value * ratio * (1.0 + 1.1 * moved + 8.0 * EPS * eq.pole.size))


@sums
def _along_circle(eq: Equation, z: Zeros, k: int, radius: float) -> tuple[float, int]:
    """Return a bound of the sum along a circle, and how many approximations it encloses."""
    own, total, enclosed = eq.pole[z.home[k]], 0.0, 0
    for i in range(z.x.size):
        u, v = (own - eq.pole[z.home[i]]) + (z.x[k] - z.x[i]), z.y[k] - z.y[i]
        away = math.sqrt(u * u + v * v)
        gap = abs(away - radius)
        total += z.correction[i] / (gap if gap > 0.0 else 1e-300)
        enclosed += 1 if away < radius else 0
    return total * (1.0 + 4.0 * EPS * z.x.size), enclosed


@inner
def _separate(eq: Equation, z: Zeros, k: int) -> None:
    """Set the radius of a circle that separates an approximation and its zero from others."""
    z.radius[k], z.alone[k] = math.inf, 0
    radius = 2.0 * z.correction[k]
    if radius == 0.0:
        z.radius[k], z.alone[k] = 0.0, 1
        return
    for doubling in range(_DOUBLINGS):
        total, enclosed = _along_circle(eq, z, k, radius)
        if total < 1.0:
            z.radius[k], z.alone[k] = radius, int(enclosed == 1)
            if doubling == 0 and enclosed == 1:
                # With less than 1/2 by the others a smaller one does.
                others = total - z.correction[k] / radius
                z.radius[k] = z.correction[k] / (1.0 - max(others, 0.0))
            return
        radius *= 2.0


@inner
def _go_on(z: Zeros, progress: NDArray[np.void]) -> None:
    """Go on to the next sweep or stage, when all approximations are through one."""
    now = progress[0]
    now.row = 0
    if now.stage == _APPROACH:
        now.sweeps += 1
        moving = z.alone.size - z.alone.sum()
        if moving > 0 and now.sweeps < _SWEEPS:
            return
    now.stage += 1


@kernel
def find(modes: Modes, eq: Equation, z: Zeros, progress: NDArray[np.void], piece: int) -> bool:
    """Enclose all zeros but the known one; return whether that is done, or else to be gone on with.

    Parameters
    ----------
    modes : Modes
        At least two, of different poles.
    eq : Equation
        What `residues` makes of them.
    z : Zeros
        Filled in. A disc that encloses one zero, and has a real centre, encloses a real one. Radii
        are nan or infinite where nothing is known.
    progress : array of `PROGRESS`, shape (1,)
        Zeros at first.
    piece : int
        Terms of sums over all modes after which a call returns, such as `PIECE`.
    """
    count, now = z.x.size, progress[0]
    left = piece // count + 1
    while now.stage != _DONE and left > 0:
        stop = min(now.row + left, count)
        left -= stop - now.row
        for k in range(now.row, stop):
            if now.stage == _BEGIN:
                _start(eq, z, k)
            elif now.stage == _APPROACH:
                _approach(eq, z, k)
            elif now.stage == _REALIZE:
                _make_real(eq, z, k)
            elif now.stage == _BOUND:
                z.correction[k] = _bound_correction(modes, eq, z, k)
            else:
                _separate(eq, z, k)
        now.row = stop
        if stop == count:
            _go_on(z, progress)
    return bool(now.stage == _DONE)


@inner
def _join(modes: Modes, j: int) -> tuple[float, float]:
    """Return what all other modes contribute to the residue of a mode, and its rounding."""
    sine, reach, pull = modes.sine[j], modes.reach[j], modes.pull[j]
    total, size, error = 0.0, 0.0, 0.0
    for i in range(modes.weight.size):
        if i == j:
            continue
        ahead, behind = reach * modes.pull[i], pull * modes.reach[i]
        value = ahead + behind - 2.0 * sine * sine
        rounding = 2.0 * _FUNCTION * (abs(ahead) + abs(behind) + 2.0 * sine * sine)
        apart = modes.pole[j] - modes.pole[i]
        near = 2.0 * _FUNCTION * (abs(modes.pole[j]) + abs(modes.pole[i])) / abs(apart)
        near = near / (1.0 - near) if near < 1.0 else math.inf
        slope = modes.weight[i] * value / apart
        total += slope
        size += abs(slope)
        error += abs(slope) * near + modes.weight[i] * rounding / abs(apart) * (1.0 + near)
    return total, error + EPS * (modes.weight.size + 4.0) * size


@kernel
def residues(modes: Modes, eq: Equation) -> None:
    """Fill in the equation of impact modes (`stability.one_impact`).

    Parameters
    ----------
    modes : Modes
        No two of their poles are equal.
    eq : Equation
    """
    for j in range(modes.weight.size):
        weight = modes.weight[j]
        factor, error = _join(modes, j)
        bend, own = modes.curvature * modes.reach[j], 2.0 * weight * (modes.known + modes.pole[j])
        factor += own - bend
        error += 2.0 * _FUNCTION * (abs(bend) + 2.0 * weight + abs(factor))
        eq.residue[j] = weight * factor
        eq.residue_error[j] = weight * error + EPS * abs(eq.residue[j])
        eq.pole[j], eq.pole_error[j] = modes.pole[j], 2.0 * _FUNCTION * abs(modes.pole[j])
