"""The exact flow of a linear structure in normal form, and derivatives of coordinates along it.

The state is a set of pairs z_j = (z1, z2), one pair for each mode or pair of complex modes:

- *rotations* ``z' = [[alpha, nu], [-nu, alpha]] z``, underdamped and undamped modes;
- *hyperbolas* ``z' = [[alpha, nu], [nu, alpha]] z``, overdamped and unstable ones;
- *parabolas* ``z' = [[alpha, 1], [0, alpha]] z + (0, push)``, rigid-body and critical ones.

A mode ``q'' + 2 delta q' + lambda q = push`` has alpha = -delta, z1 = nu q (q for parabolas)
and z2 = q' + delta q. Rotations come first, then hyperbolas, then parabolas.

With w = z1 - i z2, a rotation is ``w' = (alpha + i nu) w``. Another one, with all but the same
rate, may drive it: ``w' = (alpha + i nu) w + kappa l``, where l is the w of a load in resonance
with a mode, or of a mode that damping makes almost equal to it.
A load that varies linearly, the parabola (V, V'), may drive any pair: ``z' = A z + kappa V``.
A load that turns slowly may drive a rigid body, a hyperbola or a parabola without alpha:
``z2' = ... + Re(kappa l)``.

A state is an array of shape (2, pair), and so is a linear form on states, such as a watched
coordinate. Every pair is propagated in closed form: a free motion of any length carries the
rounding of one multiplication, not that of steps.

Arrays are passed whole and indexed in place, and none is made (`jit.inner`).
"""

from __future__ import annotations

import cmath
import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.jit import (
    fma,
    inline,
    inner,
    never_inlined,
    record,
    sums,
)
from vibroimpact_solvers.kernels.passages import LOW, ORDER
from vibroimpact_solvers.kernels.phases import sine_cosine

Z1: Final = 0
Z2: Final = 1
"""The two numbers of a pair."""
EVEN: Final = 0
ODD: Final = 1
"""The two numbers of a pair's propagator: e^(alpha s) (cos nu s, sin nu s) for rotations, cosh and
sinh for hyperbolas, (1, s) for parabolas."""
DRIVE: Final = record(
    [("driven", "i8"), ("driving", "i8"), ("kappa_real", "f8"), ("kappa_imaginary", "f8")]
)
"""A pair that another one drives: their indices, and kappa, of a ramp for z1 and z2."""


_UNEQUAL = 0.125  # part of one sum of a pair that another is, below which it is near a saddle
_APART = 0.5
"""Half the distance of both rates of a hyperbola, over their mean, from which on they are apart."""
_TERMS = 20  # of the series of `_averages`, for |x| <= 1
_VERY_LONG = 256  # and those for the coordinates whose passages are searched for


class Flow(NamedTuple):
    """How the pairs move; nu + rest is nu to more than double precision."""

    alpha: Floats  # (pair,)
    nu: Floats  # (pair,)
    rest: Floats  # (pair,)
    push: Floats  # (pair,)
    drives: NDArray[np.void]  # (drive,), of `DRIVE`
    rotations: int
    hyperbolas_end: int
    damped: bool  # whether any alpha is not zero
    growth: float  # the largest alpha of the rotations, at least 0


class Watched(NamedTuple):
    """Linear forms whose passages through walls are searched for, and bounds of their growth."""

    coordinate: Floats  # (watched, 2, pair)
    velocity: Floats  # (watched, 2, pair)
    kick: Floats  # (watched, 2, pair): change of the state by a unit impulse
    kick_rate: Floats  # (watched, 2, pair): its rate
    size: Floats  # (watched, pair): |coordinate_j|
    size_high: Floats  # (watched, pair): |coordinate_j| rate_j^ORDER
    size_low: Floats  # (watched, pair): |coordinate_j| rate_j^LOW


@inline
def set_propagator(flow: Flow, s: float, ds: float, propagator: Floats) -> None:
    """Fill in the propagator, shape (2, pair), by a time s + ds, ds being the rest of s."""
    alpha, nu, rest = flow.alpha, flow.nu, flow.rest
    even, odd = propagator[EVEN], propagator[ODD]
    for j in range(flow.rotations):
        phase = nu[j] * s
        lost = fma(nu[j], s, -phase)
        odd[j], even[j] = sine_cosine(phase, fma(nu[j], ds, fma(rest[j], s, lost)))
    if flow.damped:
        for j in range(flow.rotations):
            decay = math.exp(alpha[j] * s + alpha[j] * ds)
            odd[j] *= decay
            even[j] *= decay
    time = s + ds
    for j in range(flow.rotations, flow.hyperbolas_end):
        # Of the exponentials of (alpha + nu) s and (alpha - nu) s the first is the larger one.
        larger = math.exp(((alpha[j] + nu[j]) + rest[j]) * time)
        odd[j] = -0.5 * larger * math.expm1(-2.0 * nu[j] * time)
        even[j] = larger - odd[j]
    for j in range(flow.hyperbolas_end, alpha.size):
        even[j] = math.exp(alpha[j] * time)
        odd[j] = even[j] * time


@inline
def propagate(flow: Flow, propagator: Floats, s: float, z: Floats, out: Floats) -> None:
    """Fill in a deviation propagated by the time s that the propagator belongs to."""
    even, odd = propagator[EVEN], propagator[ODD]
    for j in range(flow.rotations):
        a, b = z[Z1, j], z[Z2, j]
        out[Z1, j] = fma(even[j], a, odd[j] * b)
        out[Z2, j] = fma(even[j], b, -(odd[j] * a))
    for j in range(flow.rotations, flow.hyperbolas_end):
        a, b = z[Z1, j], z[Z2, j]
        total, apart = abs(a + b), abs(a - b)
        if min(total, apart) > _UNEQUAL * max(total, apart):
            # A sliding body moves by a small part of the way that drag leaves to it.
            out[Z1, j] = even[j] * a + odd[j] * b
            out[Z2, j] = even[j] * b + odd[j] * a
        else:
            # One by one: near a saddle they are very unequal, and sums with cosh and sinh cancel.
            decay = math.exp(((flow.alpha[j] - flow.nu[j]) - flow.rest[j]) * s)
            plus = 0.5 * (even[j] + odd[j]) * (a + b)
            minus = 0.5 * decay * (a - b)
            out[Z1, j], out[Z2, j] = plus + minus, plus - minus
    for j in range(flow.hyperbolas_end, even.size):
        a, b = z[Z1, j], z[Z2, j]
        out[Z1, j] = even[j] * a + odd[j] * b
        out[Z2, j] = even[j] * b
    for k in range(flow.drives.size):
        first, second = _drive(flow, propagator, k, s, z)
        j = flow.drives[k].driven
        out[Z1, j] += first
        out[Z2, j] += second


@inline
def propagate_state(flow: Flow, propagator: Floats, s: float, z: Floats, out: Floats) -> None:
    """Do what `propagate` does, for a state: constant loads act on it."""
    propagate(flow, propagator, s, z, out)
    push = flow.push
    for j in range(flow.hyperbolas_end, push.size):
        out[Z1, j] += 0.5 * push[j] * s * s
        out[Z2, j] += push[j] * s


@inline
def two_sum(a: float, b: float) -> tuple[float, float]:
    """Return a + b rounded, and what rounding took from it."""
    s = a + b
    part = s - a
    return s, (a - (s - part)) + (b - part)


@inline
def _changed(factor: float, a: float, b: float, rest: float) -> tuple[float, float]:
    """Return ``factor (a + b + rest)`` rounded, and what rounding took from it."""
    total, lost = two_sum(a, b)
    change = factor * total
    return change, fma(factor, total, -change) + factor * (lost + rest)


@inline
def _carry(total: float, rest: float, change: float, more: float) -> tuple[float, float]:
    """Return ``total + rest + change + more`` as two numbers, the last two being small."""
    grown = total + change
    part = grown - total
    rest += ((total - (grown - part)) + (change - part)) + more
    total = grown + rest
    return total, rest - (total - grown)


@inline
def _lost(u: float, a: float, v: float, b: float, result: float) -> float:
    """Return what rounding took from ``result = u a + v b``."""
    p, q = u * a, v * b
    total = p + q
    part = total - p
    lost = (p - (total - part)) + (q - part)
    return (total - result) + (lost + (fma(u, a, -p) + fma(v, b, -q)))


@inline
def _longer_than_one(less: float, sine: float) -> float:
    """Return the square of the length of (1 + less, sine), less 1, in twice the precision."""
    p, q, twice = less * less, sine * sine, 2.0 * less
    total = twice + p
    part = total - twice
    lost = (twice - (total - part)) + (p - part)
    whole = total + q
    part = whole - total
    lost += (total - (whole - part)) + (q - part)
    return whole + (lost + (fma(less, less, -p) + fma(sine, sine, -q)))


@inline
def advance(
    flow: Flow, propagator: Floats, s: float, z: Floats, rest: Floats, moved: Floats
) -> None:
    """Advance a state, kept as z + rest, by the time s that the propagator belongs to.

    Between walls that are near motions are short, and many: each adds the rounding of its change
    of the state only, not of the state, which would have one sign as often as not.
    """
    even, odd, alpha, push = propagator[EVEN], propagator[ODD], flow.alpha, flow.push
    for j in range(alpha.size):
        # Loads by drives come with the whole motion.
        moved[Z1, j] = moved[Z2, j] = 0.0
    for k in range(flow.drives.size):
        first, second = _drive(flow, propagator, k, s, z)
        j = flow.drives[k].driven
        moved[Z1, j] += first
        moved[Z2, j] += second
    for j in range(flow.rotations):
        # e^(alpha s) cos(nu s) - 1, of which nothing cancels where the cosine is positive.
        gained = math.expm1(alpha[j] * s) if flow.damped else 0.0
        less = gained - odd[j] * odd[j] / (1.0 + gained + abs(even[j]))
        less = less if even[j] > 0.0 else even[j] - 1.0
        a, b, c, d = z[Z1, j], z[Z2, j], rest[Z1, j], rest[Z2, j]
        first, second = fma(less, a, odd[j] * b), fma(less, b, -(odd[j] * a))
        more, other = fma(less, c, odd[j] * d), fma(less, d, -(odd[j] * c))
        # What products and sums of these took is of the order of the change; where motions are
        # alike, it is the same in all, and so is what the length of (cosine, sine) lacks to 1.
        more += _lost(less, a, odd[j], b, first)
        other += _lost(less, b, -odd[j], a, second)
        if not flow.damped:
            short = -0.5 * _longer_than_one(less, odd[j])
            more += short * (a + first)
            other += short * (b + second)
        z[Z1, j], rest[Z1, j] = _carry(a, c, first, more + moved[Z1, j])
        z[Z2, j], rest[Z2, j] = _carry(b, d, second, other + moved[Z2, j])
    for j in range(flow.rotations, flow.hyperbolas_end):
        fast, slow = alpha[j] + flow.nu[j], alpha[j] - flow.nu[j]
        a, b, c, d = z[Z1, j], z[Z2, j], rest[Z1, j], rest[Z2, j]
        # What grows is a small difference where the other one decays, and the other way round.
        plus, plus_lost = _changed(math.expm1((fast + flow.rest[j]) * s), a, b, c + d)
        minus, minus_lost = _changed(math.expm1((slow - flow.rest[j]) * s), a, -b, c - d)
        first, lost = two_sum(plus, minus)
        second, other = two_sum(plus, -minus)
        more = 0.5 * (lost + plus_lost + minus_lost) + moved[Z1, j]
        z[Z1, j], rest[Z1, j] = _carry(a, c, 0.5 * first, more)
        more = 0.5 * (other + plus_lost - minus_lost) + moved[Z2, j]
        z[Z2, j], rest[Z2, j] = _carry(b, d, 0.5 * second, more)
    for j in range(flow.hyperbolas_end, alpha.size):
        less = math.expm1(alpha[j] * s)
        a, b, c, d = z[Z1, j], z[Z2, j], rest[Z1, j], rest[Z2, j]
        first = less * a + (odd[j] * b + 0.5 * push[j] * s * s)
        second = less * b + push[j] * s
        z[Z1, j], rest[Z1, j] = _carry(a, c, first, less * c + odd[j] * d + moved[Z1, j])
        z[Z2, j], rest[Z2, j] = _carry(b, d, second, less * d + moved[Z2, j])


@inner
def set_changes(flow: Flow, propagator: Floats, s: float, z: Floats, changes: Floats) -> None:
    """Fill in the magnitudes that `advance` makes the changes of a state of, shape (2, pair)."""
    for j in range(flow.alpha.size):
        a, b, pushed = abs(z[Z1, j]), abs(z[Z2, j]), 0.0
        less, turned = abs(propagator[EVEN, j] - 1.0), abs(propagator[ODD, j])
        back = turned * a
        if j >= flow.hyperbolas_end:
            back = pushed = abs(flow.push[j]) * s
        changes[Z1, j] = less * a + turned * b + 0.5 * pushed * s
        changes[Z2, j] = less * b + back
    for k in range(flow.drives.size):
        first, second = _drive(flow, propagator, k, s, z)
        j = flow.drives[k].driven
        changes[Z1, j] += abs(first)
        changes[Z2, j] += abs(second)


@inner
def _drive(flow: Flow, propagator: Floats, row: int, s: float, z: Floats) -> tuple[float, float]:
    """Return what a drive adds to its pair in a time s.

    ``kappa l (e^(rho s) - e^(sigma s)) / (rho - sigma)``, rho being the rate of the driving pair,
    also where the denominator is small or zero: ``kappa l s e^(sigma s) (e^z - 1) / z``, z being
    s times the denominator.
    """
    never_inlined()
    drive, even, odd = flow.drives[row], propagator[EVEN], propagator[ODD]
    j, k = drive.driven, drive.driving
    if k >= flow.hyperbolas_end:
        return _ramped(flow, j, drive.kappa_real, drive.kappa_imaginary, s, z[Z1, k], z[Z2, k])
    if j >= flow.rotations:
        force = complex(drive.kappa_real, drive.kappa_imaginary) * complex(z[Z1, k], -z[Z2, k])
        return _swung(flow, j, force, flow.nu[k], s)
    x = (flow.alpha[k] - flow.alpha[j]) * s
    y = ((flow.nu[k] - flow.nu[j]) + (flow.rest[k] - flow.rest[j])) * s
    real, imaginary = 1.0 + 0.5 * x, 0.5 * y
    square = x * x + y * y
    if square > 1e-18:
        half = math.sin(0.5 * y)
        a = math.expm1(x) * math.cos(y) - 2.0 * half * half
        b = math.exp(x) * math.sin(y)
        real, imaginary = (a * x + b * y) / square, (b * x - a * y) / square
    # times s kappa, then the load, then e^(sigma s)
    u, v = s * drive.kappa_real, s * drive.kappa_imaginary
    real, imaginary = real * u - imaginary * v, real * v + imaginary * u
    u, v = z[Z1, k], -z[Z2, k]
    real, imaginary = real * u - imaginary * v, real * v + imaginary * u
    return real * even[j] - imaginary * odd[j], -(real * odd[j] + imaginary * even[j])


@inner
def _averages(x: complex) -> tuple[complex, complex]:
    """Return the averages of e^(x u) and of its average up to u, weighted by u, over [0, 1].

    ``(e^x - 1) / x`` and ``(e^x - 1 - x) / x^2``.
    """
    never_inlined()
    if abs(x) > 1.0:
        first = (cmath.exp(x) - 1.0) / x
        return first, (first - 1.0) / x
    second = 1.0 + 0.0j
    for n in range(_TERMS, 2, -1):
        second = 1.0 + second * x / n
    second *= 0.5
    return 1.0 + x * second, second


@inner
def _differences(x: complex, y: complex, h: float) -> tuple[complex, complex]:
    """Return how the `_averages` of two numbers x = y + h differ.

    Relative to h: where drag is faint, or damping almost critical, it is all that moves.
    """
    never_inlined()
    if max(abs(x), abs(y)) <= 1.0:
        first, second, power, apart, factorial = 0.0j, 0.0j, 1.0 + 0.0j, h + 0.0j, 1.0
        for n in range(1, _TERMS):
            # apart is x^n - y^n
            factorial *= n + 1
            first += apart / factorial
            second += apart / (factorial * (n + 2))
            power *= y
            apart = x * apart + h * power
        return first, second
    if abs(x) < abs(y):
        one, two = _averages(x)
        first = -(cmath.exp(x) * math.expm1(-h) + h * one) / y
        return first, (first - h * two) / y
    one, two = _averages(y)
    first = (cmath.exp(y) * math.expm1(h) - h * one) / x
    return first, (first - h * two) / x


@inner
def _ramped(
    flow: Flow, j: int, first: float, second: float, s: float, value: float, slope: float
) -> tuple[float, float]:
    """Return what a load ``value + slope t`` adds to a pair in a time s.

    Of the rate sigma a component gains ``s value (e^x - 1) / x + s^2 slope (e^x - 1 - x) / x^2``,
    x being sigma s.
    """
    never_inlined()
    alpha, nu, whole = flow.alpha[j], flow.nu[j], s * s * slope
    if j < flow.rotations:
        one, two = _averages(complex(alpha * s, nu * s))
        w = complex(first, -second) * (s * value * one + whole * two)
        return w.real, -w.imag
    if j < flow.hyperbolas_end:
        x, y = ((alpha + nu) + flow.rest[j]) * s, ((alpha - nu) - flow.rest[j]) * s
        one, two = _averages(complex(x, 0.0))
        h = 2.0 * (nu + flow.rest[j]) * s
        of_one, of_two = _differences(complex(x, 0.0), complex(y, 0.0), h)
        both = (s * value * (one - 0.5 * of_one) + whole * (two - 0.5 * of_two)).real
        apart = 0.5 * (s * value * of_one + whole * of_two).real
        return first * both + second * apart, first * apart + second * both
    # Of rigid bodies.
    gained = s * value + 0.5 * whole
    return first * gained + second * s * (0.5 * s * value + whole / 6.0), second * gained


@inner
def _swung(flow: Flow, j: int, force: complex, turning: float, s: float) -> tuple[float, float]:
    """Return what a load ``Re(force e^(i turning t))`` adds to a rigid body in a time s.

    Of the rate sigma a component gains ``s e^(i turning s) (e^x - 1) / x``, x being
    ``(sigma - i turning) s``, and what moves a body with faint drag is the difference of two.
    """
    never_inlined()
    if j < flow.hyperbolas_end:
        alpha, nu, rest = flow.alpha[j], flow.nu[j], flow.rest[j]
        turned = force * cmath.exp(complex(0.0, turning * s))
        x = complex(((alpha + nu) + rest) * s, -turning * s)
        y = complex(((alpha - nu) - rest) * s, -turning * s)
        one, _ = _averages(x)
        of_one, _ = _differences(x, y, 2.0 * (nu + rest) * s)
        first = 0.5 * s * (turned * of_one).real
        return first, s * (turned * one).real - first
    one, two = _averages(complex(0.0, turning * s))
    return s * s * (force * two).real, s * (force * one).real


@inline
def _driven_by_swing(flow: Flow, row: int, form: Floats, z: Floats, d: Floats) -> None:
    """Add what a load that drives a rigid body does to derivatives of a coordinate."""
    drive = flow.drives[row]
    j, k = drive.driven, drive.driving
    alpha, there, back = flow.alpha[j], 1.0, 0.0
    if j < flow.hyperbolas_end:
        there = back = flow.nu[j]
    force = complex(drive.kappa_real, drive.kappa_imaginary) * complex(z[Z1, k], -z[Z2, k])
    a, b = 0.0, force.real
    for n in range(1, d.size):
        d[n] += form[Z1, j] * a + form[Z2, j] * b
        force *= complex(0.0, flow.nu[k])
        a, b = alpha * a + there * b, alpha * b + back * a + force.real


@inline
def _driven_by_ramp(flow: Flow, row: int, form: Floats, z: Floats, d: Floats) -> None:
    """Add what a ramp does to derivatives of a coordinate."""
    drive = flow.drives[row]
    j, k = drive.driven, drive.driving
    alpha, there = flow.alpha[j], 1.0
    back = 0.0
    if j < flow.hyperbolas_end:
        there = flow.nu[j]
        back = -there if j < flow.rotations else there
    a, b = drive.kappa_real * z[Z1, k], drive.kappa_imaginary * z[Z1, k]
    more, other = drive.kappa_real * z[Z2, k], drive.kappa_imaginary * z[Z2, k]
    for n in range(1, d.size):
        d[n] += form[Z1, j] * a + form[Z2, j] * b
        a, b = alpha * a + there * b + more, alpha * b + back * a + other
        more = other = 0.0


@inner
def _driven(flow: Flow, row: int, form: Floats, z: Floats, d: Floats) -> None:
    """Add what a drive does to derivatives of a coordinate."""
    never_inlined()
    drive = flow.drives[row]
    j, k = drive.driven, drive.driving
    if k >= flow.hyperbolas_end:
        _driven_by_ramp(flow, row, form, z, d)
        return
    if j >= flow.rotations:
        _driven_by_swing(flow, row, form, z, d)
        return
    alpha, nu = flow.alpha[j], flow.nu[j]
    a, b = z[Z1, k], -z[Z2, k]
    # kappa rho^n l, and the sum of all that it and its predecessors have become.
    u = drive.kappa_real * a - drive.kappa_imaginary * b
    v = drive.kappa_real * b + drive.kappa_imaginary * a
    real, imaginary = u, v
    for n in range(1, d.size):
        d[n] += form[Z1, j] * real - form[Z2, j] * imaginary
        u, v = flow.alpha[k] * u - flow.nu[k] * v, flow.alpha[k] * v + flow.nu[k] * u
        grown = alpha * real - nu * imaginary + u
        imaginary = alpha * imaginary + nu * real + v
        real = grown


@inline
def set_rate(flow: Flow, z: Floats, out: Floats) -> None:
    """Fill in the rate of a state, pushes included."""
    alpha, nu, push = flow.alpha, flow.nu, flow.push
    for j in range(flow.rotations):
        a, b = z[Z1, j], z[Z2, j]
        out[Z1, j] = alpha[j] * a + nu[j] * b
        out[Z2, j] = alpha[j] * b - nu[j] * a
    for j in range(flow.rotations, flow.hyperbolas_end):
        a, b = z[Z1, j], z[Z2, j]
        out[Z1, j] = alpha[j] * a + nu[j] * b
        out[Z2, j] = alpha[j] * b + nu[j] * a
    for j in range(flow.hyperbolas_end, alpha.size):
        a, b = z[Z1, j], z[Z2, j]
        out[Z1, j] = alpha[j] * a + b
        out[Z2, j] = alpha[j] * b + push[j]
    for k in range(flow.drives.size):
        drive = flow.drives[k]
        if drive.driving >= flow.hyperbolas_end:
            out[Z1, drive.driven] += drive.kappa_real * z[Z1, drive.driving]
            out[Z2, drive.driven] += drive.kappa_imaginary * z[Z1, drive.driving]
            continue
        a, b = z[Z1, drive.driving], -z[Z2, drive.driving]
        if drive.driven >= flow.rotations:
            out[Z2, drive.driven] += drive.kappa_real * a - drive.kappa_imaginary * b
            continue
        out[Z1, drive.driven] += drive.kappa_real * a - drive.kappa_imaginary * b
        out[Z2, drive.driven] -= drive.kappa_real * b + drive.kappa_imaginary * a


@inline
def product(form: Floats, z: Floats) -> float:
    """Return the value of a linear form at a state."""
    s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
    t0, t1, t2, t3 = 0.0, 0.0, 0.0, 0.0
    n = z.shape[1]
    whole = n - n % 4
    for j in range(0, whole, 4):
        s0 += form[Z1, j] * z[Z1, j]
        s1 += form[Z1, j + 1] * z[Z1, j + 1]
        s2 += form[Z1, j + 2] * z[Z1, j + 2]
        s3 += form[Z1, j + 3] * z[Z1, j + 3]
        t0 += form[Z2, j] * z[Z2, j]
        t1 += form[Z2, j + 1] * z[Z2, j + 1]
        t2 += form[Z2, j + 2] * z[Z2, j + 2]
        t3 += form[Z2, j + 3] * z[Z2, j + 3]
    for j in range(whole, n):
        s0 += form[Z1, j] * z[Z1, j]
        t0 += form[Z2, j] * z[Z2, j]
    return ((s0 + t0) + (s1 + t1)) + ((s2 + t2) + (s3 + t3))


@sums
def magnitude(form: Floats, z: Floats) -> float:
    """Return the sum of the magnitudes that `product` is the sum of."""
    total = 0.0
    for j in range(z.shape[1]):
        total += abs(form[Z1, j] * z[Z1, j]) + abs(form[Z2, j] * z[Z2, j])
    return total


@inline
def _added(total: float, lost: float, factor: float, value: float) -> tuple[float, float]:
    """Return total + factor value rounded, and lost with what rounding took from it."""
    high = factor * value
    grown = total + high
    part = grown - total
    lost += (total - (grown - part)) + (high - part) + fma(factor, value, -high)
    return grown, lost


@inline
def exact_product(form: Floats, z: Floats) -> tuple[float, float]:
    """Return what `product` does and what rounding took from it (Dot2).

    The roundings of `product` are the same at every impact of a periodic motion, and so is what
    they take from its energy.
    """
    n = z.shape[1]
    s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
    l0, l1, l2, l3 = 0.0, 0.0, 0.0, 0.0
    for j in range(0, n - n % 2, 2):
        s0, l0 = _added(s0, l0, form[Z1, j], z[Z1, j])
        s1, l1 = _added(s1, l1, form[Z1, j + 1], z[Z1, j + 1])
        s2, l2 = _added(s2, l2, form[Z2, j], z[Z2, j])
        s3, l3 = _added(s3, l3, form[Z2, j + 1], z[Z2, j + 1])
    for j in range(n - n % 2, n):
        s0, l0 = _added(s0, l0, form[Z1, j], z[Z1, j])
        s2, l2 = _added(s2, l2, form[Z2, j], z[Z2, j])
    s0, l0 = _added(s0, l0, 1.0, s1)
    s2, l2 = _added(s2, l2, 1.0, s3)
    s0, l0 = _added(s0, l0, 1.0, s2)
    lost = (l0 + l1) + (l2 + l3)
    total = s0 + lost
    return total, lost - (total - s0)


@inline
def _start(flow: Flow, form: Floats, z: Floats, j: int) -> Any:
    """Return the part y of a coordinate that pair j makes, y', and the numbers c1 and c0.

    Every pair obeys ``y'' = c1 y' + c0 y`` with c1 = 2 alpha and c0 = -(alpha^2 +- nu^2).
    """
    sign = 1.0 if j < flow.rotations else (-1.0 if j < flow.hyperbolas_end else 0.0)
    turn = flow.nu[j] if j < flow.hyperbolas_end else 1.0
    first, second, alpha = form[Z1, j], form[Z2, j], flow.alpha[j]
    a = first * z[Z1, j] + second * z[Z2, j]
    b = alpha * a + turn * (first * z[Z2, j] - sign * second * z[Z1, j])
    return a, b, 2.0 * alpha, -(alpha * alpha + sign * turn * turn)


@inline
def _is_apart(flow: Flow, j: int) -> bool:
    """Return whether a pair is two exponentials whose sum does not cancel: no near-critical one."""
    return bool(j < flow.hyperbolas_end and flow.nu[j] > _APART * abs(flow.alpha[j]))


@inline
def _both(flow: Flow, form: Floats, z: Floats, j: int) -> tuple[float, float, float, float]:
    """Return what both exponentials of a hyperbola make of a coordinate, and their rates.

    One may have decayed long before the other one, whose derivatives are then much smaller than
    the faster rate would let them be.
    """
    first, second = form[Z1, j], form[Z2, j]
    plus, minus = 0.5 * (z[Z1, j] + z[Z2, j]), 0.5 * (z[Z1, j] - z[Z2, j])
    one = (flow.alpha[j] + flow.nu[j]) + flow.rest[j]
    other = (flow.alpha[j] - flow.nu[j]) - flow.rest[j]
    return (first + second) * plus, (first - second) * minus, one, other


@inline
def _power(rate: float, order: int) -> float:
    """Return a rate to the power of `ORDER` or `LOW`."""
    fourth = rate * rate * rate * rate
    return fourth * fourth * fourth if order == ORDER else fourth


@inline
def _add_exponentials(flow: Flow, form: Floats, z: Floats, d: Floats) -> None:
    """Add what hyperbolas whose exponentials are apart do to derivatives.

    Of the place and the velocity these are large differences where a body has faint drag.
    """
    for j in range(flow.rotations, flow.hyperbolas_end):
        if _is_apart(flow, j):
            place, velocity, _, _ = _start(flow, form, z, j)
            d[0] += place
            d[1] += velocity
            a, b, one, other = _both(flow, form, z, j)
            a *= one
            b *= other
            for n in range(2, d.size):
                a *= one
                b *= other
                d[n] += a + b


@inline
def _add_loads(flow: Flow, form: Floats, z: Floats, d: Floats) -> None:
    """Add what pushes and drives do to derivatives."""
    for row in range(flow.drives.size):
        _driven(flow, row, form, z, d)
    for j in range(flow.hyperbolas_end, flow.push.size):
        if flow.push[j] != 0.0:
            # The push moves z2 alone; only parabolas without damping carry one.
            d[1] += form[Z2, j] * flow.push[j]
            d[2] += form[Z1, j] * flow.push[j]


@inline
def derivatives(flow: Flow, form: Floats, z: Floats, d: Floats) -> None:
    """Fill in the derivatives 0 ... 11 of a coordinate along the flow, shape (12,).

    The sums stand in variables of their own: in an array they would go through memory.
    """
    nu = flow.nu
    d0, d1, d2, d3, d4, d5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    d6, d7, d8, d9, d10, d11 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    turning = 0 if flow.damped else flow.rotations
    for j in range(turning):
        first, second = form[Z1, j], form[Z2, j]
        a = first * z[Z1, j] + second * z[Z2, j]
        b = nu[j] * (first * z[Z2, j] - second * z[Z1, j])
        square = -nu[j] * nu[j]
        d0 += a
        d1 += b
        a *= square
        b *= square
        d2 += a
        d3 += b
        a *= square
        b *= square
        d4 += a
        d5 += b
        a *= square
        b *= square
        d6 += a
        d7 += b
        a *= square
        b *= square
        d8 += a
        d9 += b
        a *= square
        b *= square
        d10 += a
        d11 += b
    for part in range(2):
        begin, end = (turning, flow.rotations) if part == 0 else (flow.rotations, nu.size)
        for j in range(begin, end):
            if part > 0 and _is_apart(flow, j):
                continue
            a, b, twice, square = _start(flow, form, z, j)
            d0 += a
            d1 += b
            a = twice * b + square * a
            b = twice * a + square * b
            d2 += a
            d3 += b
            a = twice * b + square * a
            b = twice * a + square * b
            d4 += a
            d5 += b
            a = twice * b + square * a
            b = twice * a + square * b
            d6 += a
            d7 += b
            a = twice * b + square * a
            b = twice * a + square * b
            d8 += a
            d9 += b
            a = twice * b + square * a
            b = twice * a + square * b
            d10 += a
            d11 += b
    d[0], d[1], d[2], d[3], d[4], d[5] = d0, d1, d2, d3, d4, d5
    d[6], d[7], d[8], d[9], d[10], d[11] = d6, d7, d8, d9, d10, d11
    _add_exponentials(flow, form, z, d)
    _add_loads(flow, form, z, d)


@inline
def near_derivatives(flow: Flow, form: Floats, z: Floats, d: Floats) -> None:
    """Fill in the derivatives 0 ... 3 of a coordinate, shape (4,); see `derivatives`."""
    nu = flow.nu
    d1, d2, d3 = 0.0, 0.0, 0.0
    turning = 0 if flow.damped else flow.rotations
    for j in range(turning):
        first, second = form[Z1, j], form[Z2, j]
        a = first * z[Z1, j] + second * z[Z2, j]
        b = nu[j] * (first * z[Z2, j] - second * z[Z1, j])
        square = -nu[j] * nu[j]
        d1 += b
        d2 += square * a
        d3 += square * b
    for part in range(2):
        begin, end = (turning, flow.rotations) if part == 0 else (flow.rotations, nu.size)
        for j in range(begin, end):
            if part > 0 and _is_apart(flow, j):
                continue
            a, b, twice, square = _start(flow, form, z, j)
            d1 += b
            a = twice * b + square * a
            d2 += a
            d3 += twice * a + square * b
    if z.shape[1] < _VERY_LONG:
        value = product(form, z)
    else:
        value, _ = exact_product(form, z)
    d[0], d[1], d[2], d[3] = 0.0, d1, d2, d3
    _add_exponentials(flow, form, z, d)
    d[0] = value
    _add_loads(flow, form, z, d)


@inline
def set_lengths(flow: Flow, z: Floats, lengths: Floats) -> None:
    """Fill in |z_j| of every pair, shape (pair,); |z1| + |z2| where it is not a rotation."""
    for j in range(flow.rotations):
        lengths[j] = math.sqrt(z[Z1, j] * z[Z1, j] + z[Z2, j] * z[Z2, j])
    for j in range(flow.rotations, lengths.size):
        lengths[j] = abs(z[Z1, j]) + abs(z[Z2, j])


@inline
def weighted(sizes: Floats, lengths: Floats, n: int) -> float:
    """Return the sum of ``sizes_j lengths_j`` over the first n pairs."""
    s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
    whole = n - n % 4
    for j in range(0, whole, 4):
        s0 += sizes[j] * lengths[j]
        s1 += sizes[j + 1] * lengths[j + 1]
        s2 += sizes[j + 2] * lengths[j + 2]
        s3 += sizes[j + 3] * lengths[j + 3]
    for j in range(whole, n):
        s0 += sizes[j] * lengths[j]
    return (s0 + s1) + (s2 + s3)


@inline
def bound(
    flow: Flow, watched: Watched, i: int, z: Floats, lengths: Floats, high: bool, H: float
) -> float:
    """Return a bound of a derivative of coordinate i in the next H, which is finite.

    Of order `ORDER` where high, otherwise `LOW`; lengths are those of z (`set_lengths`).
    """
    sizes, order = (watched.size_high, ORDER) if high else (watched.size_low, LOW)
    largest = weighted(sizes[i], lengths, flow.rotations)
    if flow.growth > 0.0:
        largest *= math.exp(flow.growth * H)
    if flow.rotations < lengths.size or flow.drives.size > 0:
        largest += _other_growth(flow, watched, i, z, lengths, order, H)
    return largest


@inline
def _moved_by_ramp(flow: Flow, row: int, H: float, value: float, slope: float) -> float:
    """Return a bound of what a load ``value + slope t`` adds to the length of a pair in H."""
    drive = flow.drives[row]
    j = drive.driven
    kappa = math.hypot(drive.kappa_real, drive.kappa_imaginary)
    moved = kappa * H * (value + H * slope)
    if j >= flow.hyperbolas_end:
        return moved * (1.0 + H)
    faster = flow.alpha[j] if j < flow.rotations else flow.alpha[j] + flow.nu[j]
    return 2.0 * moved * math.exp(max(0.0, faster) * H)


@inline
def _moved_by_load(flow: Flow, row: int, H: float, length: float) -> float:
    """Return a bound of what a turning pair of some length adds to the length of another in H."""
    drive, alpha = flow.drives[row], flow.alpha
    j, k = drive.driven, drive.driving
    moved = H * math.hypot(drive.kappa_real, drive.kappa_imaginary) * length
    if j >= flow.hyperbolas_end:
        return moved * (1.0 + H) * math.exp(max(0.0, alpha[k]) * H)
    if j >= flow.rotations:
        return 2.0 * moved * math.exp(max(0.0, alpha[j] + flow.nu[j], alpha[k]) * H)
    return moved * math.exp(max(0.0, alpha[j], alpha[k]) * H)


@inner
def _other_growth(
    flow: Flow, watched: Watched, i: int, z: Floats, lengths: Floats, order: int, H: float
) -> float:
    """Return what all but the rotations, and drives, add to the bound of a derivative."""
    never_inlined()
    alpha, nu, form = flow.alpha, flow.nu, watched.coordinate[i]
    sizes = watched.size_high[i] if order == ORDER else watched.size_low[i]
    largest = 0.0
    for j in range(flow.rotations, flow.hyperbolas_end):
        if _is_apart(flow, j):
            a, b, one, other = _both(flow, form, z, j)
            growth = math.exp(one * H) if one > 0.0 else 1.0
            largest += abs(a) * _power(one, order) * growth + abs(b) * _power(other, order)
        else:
            largest += sizes[j] * lengths[j] * math.exp(max(0.0, alpha[j] + nu[j]) * H)
    for j in range(flow.hyperbolas_end, alpha.size):
        rate = abs(alpha[j])
        if rate > 0.0:
            # (alpha + N)^order = alpha^order + order alpha^(order-1) N on e^(alpha h)(z1 + h z2).
            slides = abs(form[Z1, j] * z[Z2, j])
            first = abs(form[Z1, j] * z[Z1, j]) + H * slides
            first += abs(form[Z2, j] * z[Z2, j])
            growth = math.exp(max(0.0, alpha[j]) * H)
            largest += growth * rate ** (order - 1) * (rate * first + order * slides)
    for row in range(flow.drives.size):
        drive = flow.drives[row]
        j, k = drive.driven, drive.driving
        if k >= flow.hyperbolas_end:
            # A^(order-1) kappa V + A^(order-2) kappa V', and A^order on what V has moved.
            moved = _moved_by_ramp(flow, row, H, abs(z[Z1, k]), abs(z[Z2, k]))
            largest += sizes[j] * moved
            rate = abs(alpha[j]) + nu[j] if j < flow.hyperbolas_end else 0.0
            kappa = math.hypot(drive.kappa_real, drive.kappa_imaginary)
            high = rate * (abs(z[Z1, k]) + H * abs(z[Z2, k])) + abs(z[Z2, k])
            largest += watched.size[i, j] * kappa * rate ** (order - 2) * high
            continue
        if j >= flow.hyperbolas_end:
            # A b f^(order-2) and b f^(order-1), as A^2 = 0.
            force = math.hypot(drive.kappa_real, drive.kappa_imaginary) * lengths[k]
            largest += watched.size[i, j] * force * nu[k] ** (order - 2) * (1.0 + nu[k])
            continue
        force = math.hypot(drive.kappa_real, drive.kappa_imaginary) * lengths[k]
        own = math.hypot(alpha[j], nu[j]) if j < flow.rotations else abs(alpha[j]) + nu[j]
        rate = max(own, math.hypot(alpha[k], nu[k]))
        longest = watched.size[i, j] * order * rate ** (order - 1)
        largest += force * longest * math.exp(max(0.0, alpha[j], alpha[k]) * H)
        largest += sizes[j] * _moved_by_load(flow, row, H, lengths[k])
    return largest


@inline
def grows(flow: Flow) -> bool:
    """Return whether a coordinate may come to be larger than the lengths of its pairs."""
    others = flow.rotations < flow.alpha.size or flow.drives.size > 0
    return bool(others or flow.growth > 0.0)


@inline
def reach(flow: Flow, watched: Watched, i: int, z: Floats, lengths: Floats, H: float) -> float:
    """Return a bound of the magnitude of coordinate i in the next H."""
    sizes, form = watched.size[i], watched.coordinate[i]
    largest, alpha, push = weighted(sizes, lengths, flow.rotations), flow.alpha, flow.push
    if flow.growth > 0.0:
        largest *= math.exp(flow.growth * H)
    for j in range(flow.rotations, flow.hyperbolas_end):
        if sizes[j] * lengths[j] > 0.0:
            largest += sizes[j] * lengths[j] * math.exp(max(0.0, alpha[j] + flow.nu[j]) * H)
    for j in range(flow.hyperbolas_end, alpha.size):
        if sizes[j] > 0.0:
            rate, pushed = abs(z[Z2, j]), H * abs(push[j])
            moved = abs(form[Z1, j]) * (abs(z[Z1, j]) + H * (rate + 0.5 * pushed))
            moved += abs(form[Z2, j]) * (rate + pushed)  # a response to a load's slope
            largest += math.exp(max(0.0, alpha[j]) * H) * moved
    for row in range(flow.drives.size):
        drive = flow.drives[row]
        j, k = drive.driven, drive.driving
        if k >= flow.hyperbolas_end:
            largest += sizes[j] * _moved_by_ramp(flow, row, H, abs(z[Z1, k]), abs(z[Z2, k]))
            continue
        largest += sizes[j] * _moved_by_load(flow, row, H, lengths[k])
    return largest


@inline
def grown(flow: Flow, sizes: Floats, spread: Floats, s: float) -> float:
    """Return how much more a deviation may make of a coordinate after a time s; see `reach`.

    spread are the lengths of its pairs; rotations without growth and all that decays add nothing.
    """
    more, alpha = 0.0, flow.alpha
    if flow.growth > 0.0:
        more = weighted(sizes, spread, flow.rotations) * math.expm1(flow.growth * s)
    for j in range(flow.rotations, flow.hyperbolas_end):
        more += sizes[j] * spread[j] * math.expm1(max(0.0, alpha[j] + flow.nu[j]) * s)
    for j in range(flow.hyperbolas_end, alpha.size):
        more += sizes[j] * spread[j] * (math.exp(max(0.0, alpha[j]) * s) * (1.0 + s) - 1.0)
    for row in range(flow.drives.size):
        drive = flow.drives[row]
        j, k = drive.driven, drive.driving
        if k >= flow.hyperbolas_end:
            more += sizes[j] * _moved_by_ramp(flow, row, s, spread[k], spread[k])
            continue
        more += sizes[j] * _moved_by_load(flow, row, s, spread[k])
    return more
