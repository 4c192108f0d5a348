"""Sums of many terms as vector loops, which no compiler may make of plain ones."""

from __future__ import annotations

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.jit import inner, sums


@inner
def folded(terms: Floats) -> float:
    """Return the sum of some terms, which are overwritten.

    The last half is added to the first one until few are left: rounding grows with the
    logarithm of their number instead of with the number.
    """
    count = terms.size
    while count > 8:
        half = count // 2
        first, last = terms[:half], terms[count - half : count]
        for j in range(half):
            first[j] += last[j]
        count -= half
    total = 0.0
    for j in range(count):
        total += terms[j]
    return total


@sums
def scalar_product(a: Floats, b: Floats) -> float:
    """Return ``a . b``, whose rounding is counted by all that its terms are sums of."""
    total = 0.0
    for j in range(a.size):
        total += a[j] * b[j]
    return total
