"""Products and powers of truncated power series, one coefficient after the other.

With ``u = u_0 + u_1 t + ...`` Cauchy's products are

    (u v)_k = sum_{j=0..k} u_j v_{k-j} ,

and ``f = c u^p``, for which ``u f' = p u' f``, has (Jorba and Zou 2005, proposition 2.1)

    k u_0 f_k = sum_{j=0..k-1} (p (k - j) - j) u_{k-j} f_j .

Coefficient k needs no more than the coefficients 0 ... k of its factors, so that series that
depend on one another grow together. A sum of products runs through one of its factors backwards:
this one is kept in reverse, coefficient j at the place ``LONGEST - j``, and both are read
forwards from the place of coefficient k on. The newest coefficients are added last, as they are
known last.

The roundings of a product are those of its terms. A rounding of a power grows like the
coefficients of ``(1 - |u_1 / u_0| t)^-(p + 1)``: its base must stay away from zero.
"""

from __future__ import annotations

from typing import Final

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.jit import fma, inline

FIRST, SECOND = 0, 1
"""Coefficients 0 and 1."""
LONGEST: Final = 27
"""Largest order of a series."""
TERMS: Final = LONGEST + 1
PADDED: Final = TERMS + 4
"""Numbers of a series, and with those after it, which `power` reads: zero in reverse."""


@inline
def place_of(k: int) -> int:
    """Return the place of coefficient k in reverse.

    Not negative, as the compiler would not know: it leaves out the look for negative indices.
    """
    return max(LONGEST - k, 0)


@inline
def raised(base: float, exponent: int) -> float:
    """Return a whole power, at least the first, by repeated squaring."""
    factor = 1.0
    while exponent > 1:
        if exponent % 2 == 1:
            factor *= base
        base *= base
        exponent //= 2
    return factor * base


@inline
def summed(u: Floats, last: int, at: float) -> float:
    """Return the sum of the coefficients 0 ... last of a series, last at least 1.

    By Horner's rule for even and for odd powers, side by side.
    """
    square, a, b = at * at, u[last], u[last - 1]
    for k in range(last - 2, 0, -2):
        a = fma(a, square, u[k])
        b = fma(b, square, u[k - 1])
    total = fma(a, at, b)
    return fma(total, at, u[FIRST]) if last % 2 == 0 else total


@inline
def rate(u: Floats, last: int, at: float) -> float:
    """Return the rate of a series with the coefficients 0 ... last."""
    total: float = last * u[last]
    for k in range(last - 1, 0, -1):
        total = fma(total, at, k * u[k])
    return total


@inline
def square(u: Floats, past: Floats, k: int) -> float:
    """Return coefficient k of the square of a series; past is u in reverse."""
    if k == 0:
        start: float = u[FIRST] * u[FIRST]
        return start
    place = place_of(k)
    s0, s1 = 0.0, 0.0
    half = (k + 1) // 2
    for j in range(1, half - 1, 2):
        s0 = fma(u[j], past[place + j], s0)
        s1 = fma(u[j + 1], past[place + j + 1], s1)
    if half > 1 and half % 2 == 0:
        s0 = fma(u[half - 1], past[place + half - 1], s0)
    middle = u[k // 2] * u[k // 2] if k % 2 == 0 else 0.0
    return fma(2.0, fma(u[FIRST], u[k], s0 + s1), middle)


@inline
def product(u: Floats, v: Floats, past: Floats, k: int) -> float:
    """Return coefficient k of the product of two series; past is v in reverse."""
    place = place_of(k)
    s0, s1 = 0.0, 0.0
    for j in range(0, k - 1, 2):
        s0 = fma(u[j], past[place + j], s0)
        s1 = fma(u[j + 1], past[place + j + 1], s1)
    if k % 2 == 1:
        s0 = fma(u[k - 1], past[place + k - 1], s0)
    return fma(u[k], v[FIRST], s0 + s1)


@inline
def power(
    q: float,
    slope: float,
    rising: Floats,
    past: Floats,
    f: Floats,
    k: int,
    exponent: float,
    part: float,
    inverse: float,
) -> float:
    """Return coefficient k >= 1 of ``f = c u^exponent``, whose coefficients before are there.

    The newest of them, u_k and f_{k-1}, come in last, apart from the sums. These take four terms
    at a time, however few are left: processors guess wrong where loops end that are longer by
    one each time, which would last as long as the sums.

    Parameters
    ----------
    q, slope : float
        u_k and u_1.
    rising, past : array, shape (`PADDED`,)
        In reverse ``j u_j`` and ``u_j``, with 0 in place of those of u_0 and u_1.
    f : array, shape (`PADDED`,)
        Finite also from coefficient k on.
    k : int
    exponent : float
    part, inverse : float
        1/k and 1/u_0.
    """
    place, factor = place_of(k), (exponent + 1.0) * part
    a0, a1, a2, a3 = 0.0, 0.0, 0.0, 0.0
    b0, b1, b2, b3 = 0.0, 0.0, 0.0, 0.0
    for block in range((k + 1) // 4):
        j = 4 * block + 1
        g0, g1, g2, g3 = f[j], f[j + 1], f[j + 2], f[j + 3]
        a0 = fma(rising[place + j], g0, a0)
        a1 = fma(rising[place + j + 1], g1, a1)
        a2 = fma(rising[place + j + 2], g2, a2)
        a3 = fma(rising[place + j + 3], g3, a3)
        b0 = fma(past[place + j], g0, b0)
        b1 = fma(past[place + j + 1], g1, b1)
        b2 = fma(past[place + j + 2], g2, b2)
        b3 = fma(past[place + j + 3], g3, b3)
    known = fma(factor, (a0 + a1) + (a2 + a3), -((b0 + b1) + (b2 + b3)))
    known = fma(exponent * f[FIRST], q, known) * inverse
    last = f[k - 1] if k > 1 else 0.0
    return fma((factor - 1.0) * slope * inverse, last, known)
