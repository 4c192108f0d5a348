"""Products and powers of truncated power series, one coefficient after the other.

Series stand in memory, each named by the address of its first coefficient (`jit.address`).
Coefficient k needs no more than the coefficients 0 ... k of its factors, so that series
that depend on one another grow together.
"""

from __future__ import annotations

from vibroimpact_solvers.kernels.jit import fma, inline, item


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
def summed(u: int, count: int, at: float) -> float:
    """Return the sum of the first coefficients of a series, by Horner's rule."""
    total = item(u, count - 1)
    for k in range(count - 2, -1, -1):
        total = fma(total, at, item(u, k))
    return total


@inline
def square(u: int, k: int) -> float:
    """Return coefficient k of the square of a series."""
    s0, s1 = 0.0, 0.0
    half = (k + 1) // 2
    for j in range(0, half - half % 2, 2):
        s0 = fma(item(u, j), item(u, k - j), s0)
        s1 = fma(item(u, j + 1), item(u, k - j - 1), s1)
    if half % 2 == 1:
        s0 = fma(item(u, half - 1), item(u, k - half + 1), s0)
    total = 2.0 * (s0 + s1)
    if k % 2 == 0:
        total = fma(item(u, k // 2), item(u, k // 2), total)
    return total


@inline
def product(u: int, v: int, k: int) -> float:
    """Return coefficient k of the product of two series."""
    s0, s1 = 0.0, 0.0
    count = k + 1
    for j in range(0, count - count % 2, 2):
        s0 = fma(item(u, j), item(v, k - j), s0)
        s1 = fma(item(u, j + 1), item(v, k - j - 1), s1)
    if count % 2 == 1:
        s0 = fma(item(u, k), item(v, 0), s0)
    return s0 + s1


@inline
def power(
    u: int, v: int, w: int, f: int, k: int, exponent: float, part: float, inverse: float
) -> float:
    """Return coefficient k >= 1 of ``f = c u^exponent``, whose coefficients before are there.

    ``u f' = exponent u' f``: ``k u_0 f_k = sum_{j=1..k} ((exponent + 1) j - k) u_j f_{k-j}``. A
    rounding grows like the coefficients of ``(1 - |u_1 / u_0| t)^-(exponent + 1)``: the base must
    stay away from zero.

    The sums take four terms at a time, however few are left: processors guess wrong where loops
    end that are longer by one each time, which would last as long as the sums.

    Parameters
    ----------
    u, v, w, f : int
        The series u, that of ``j u_j``, u without u_0, and f. Before v and w there are three
        zeros, and the three numbers of f from k on are finite.
    k : int
    exponent : float
    part, inverse : float
        1/k and 1/u_0.
    """
    a0, a1, a2, a3 = 0.0, 0.0, 0.0, 0.0
    b0, b1, b2, b3 = 0.0, 0.0, 0.0, 0.0
    for block in range((k + 2) // 4):
        j = 4 * block + 1
        g0, g1, g2, g3 = item(f, j), item(f, j + 1), item(f, j + 2), item(f, j + 3)
        a0 = fma(item(v, k - j), g0, a0)
        a1 = fma(item(v, k - j - 1), g1, a1)
        a2 = fma(item(v, k - j - 2), g2, a2)
        a3 = fma(item(v, k - j - 3), g3, a3)
        b0 = fma(item(w, k - j), g0, b0)
        b1 = fma(item(w, k - j - 1), g1, b1)
        b2 = fma(item(w, k - j - 2), g2, b2)
        b3 = fma(item(w, k - j - 3), g3, b3)
    last = fma(exponent * item(u, k), item(f, 0), -((b0 + b1) + (b2 + b3)))
    return fma((exponent + 1.0) * part, (a0 + a1) + (a2 + a3), last) * inverse
