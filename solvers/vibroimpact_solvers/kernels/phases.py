"""Sines and cosines of large phases, written so that loops over them become vector loops."""

from __future__ import annotations

from typing import Final

from vibroimpact_solvers.kernels.jit import fma, inline, is_odd_bit

LARGEST: Final = 2.0**50
"""Phases beyond it are not reduced: neighbouring numbers are a radian apart."""

_TURNS = 0.6366197723675814  # 2/pi
# pi/2 in three parts: products with whole numbers up to 2^50 lose nothing that matters.
_HIGH, _MIDDLE, _LOW = 1.5707963267948966, 6.123233995736766e-17, -1.4973849048591833e-33
# Adding it and taking it away rounds to a whole number.
_WHOLE = 6755399441055744.0
# Minimax polynomials on [-pi/4, pi/4] (Sun's fdlibm, within 0.6 units in the last place).
_S1, _S2, _S3 = -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04
_S4, _S5, _S6 = 2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10
_C1, _C2, _C3 = 4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05
_C4, _C5, _C6 = -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11

# tan(y)/y as a quotient of polynomials of y^2 on [-pi/4, pi/4]: minimax, relative error 1.9e-17.
_T1, _T2, _T3 = -0.12828347015729352849, 0.0028059182130710982273, -7.4836346950550730807e-06
_B1, _B2, _B3 = -0.46161680349062402781, 0.023344852709876219597, -0.00020844804018878226448


@inline
def quarter_turns(x: float) -> tuple[float, float]:
    """Return the whole number k nearest to ``x / (pi/2)`` and ``x - k pi/2`` to full precision."""
    k = (x * _TURNS + _WHOLE) - _WHOLE
    # The first step is exact, the other two round a number that is small already.
    return k, fma(-k, _LOW, fma(-k, _MIDDLE, fma(-k, _HIGH, x)))


@inline
def small_sine(y: float) -> float:
    """Return sin(y), abs(y) <= pi/4."""
    z = y * y
    tail = fma(z, fma(z, fma(z, fma(z, fma(z, _S6, _S5), _S4), _S3), _S2), _S1)
    return fma(z * y, tail, y)


@inline
def small_cosine(y: float) -> float:
    """Return cos(y), abs(y) <= pi/4."""
    z = y * y
    tail = fma(z, fma(z, fma(z, fma(z, fma(z, _C6, _C5), _C4), _C3), _C2), _C1)
    return fma(z * z, tail, fma(z, -0.5, 1.0))


@inline
def tangent(x: float, rest: float) -> float:
    """Return tan(x + rest), abs(x) <= LARGEST, of a phase and what rounding took from it.

    For phases up to 1e12, which are known to 1e-4, the relative error is below 4.4e-16, apart
    from what an error of 1e-32 of the phase makes. Never infinite, as no sum of two numbers is
    a pole.
    """
    shifted = fma(x, _TURNS, _WHOLE)
    k = shifted - _WHOLE
    # The first step is exact. Phases are not known to where a third part of pi/2 would matter.
    y = fma(-k, _MIDDLE, fma(-k, _HIGH, x)) + rest
    z = y * y
    sine = y * fma(z, fma(z, fma(z, _T3, _T2), _T1), 1.0)
    cosine = fma(z, fma(z, fma(z, _B3, _B2), _B1), 1.0)
    odd = is_odd_bit(shifted)
    # Both branches are cheap and a choice of numbers, unlike one of paths, can be vectorised.
    return (-cosine if odd else sine) / (sine if odd else cosine)


@inline
def sine_cosine(x: float, rest: float) -> tuple[float, float]:
    """Return sin(x + rest) and cos(x + rest), abs(x) <= LARGEST, without branches.

    rest is what rounding took from the phase, 0 where that is not known.
    """
    k, y = quarter_turns(x)
    y += rest
    sine, cosine = small_sine(y), small_cosine(y)
    half = 0.5 * k
    whole = (half + _WHOLE) - _WHOLE
    odd = whole != half
    # k mod 4 from the parity of k and of its half.
    floor = (half - 0.25 + _WHOLE) - _WHOLE
    pair = 0.5 * floor
    flip = ((pair + _WHOLE) - _WHOLE) != pair
    sign = -1.0 if flip else 1.0
    return sign * (cosine if odd else sine), sign * (-sine if odd else cosine)
