"""Truncation and coefficients of the power series of `receptance.series`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats

IMPULSES: Final = 1e-18
"""Relative truncation error of the series for sums at the times of the impulses."""
ENTRYWISE: Final = 1e-48
"""Relative truncation error where entries 1e-30 times the largest must keep their digits."""

_FAST = 0.5  # rate of convergence below which another harmonic costs more than it saves


@dataclass(frozen=True, slots=True)
class Truncation:
    """Where the two sums stop."""

    harmonics: int  # H
    terms: int  # terms of the series
    rate: float  # rate of convergence of the series

    @property
    def remainder(self) -> float:
        """Bound of the omitted terms, relative to the first term of the series."""
        return self.rate**self.terms / (1.0 - self.rate)


def truncations(
    bound: float, Omega: Floats, depth: float, harmonics: int | None = None
) -> tuple[Floats, Floats, Floats]:
    """Return numbers of harmonics and terms, and rates, each (frequency,).

    The numbers are floating-point, as they may exceed the range of integers. `bound` is one of the
    natural frequencies, `depth` the relative truncation error; unless the number of harmonics is
    given there are as few as make the series fast.
    """
    ratio = bound / Omega
    if harmonics is None:
        needed = np.maximum(0.0, np.ceil((ratio / math.sqrt(_FAST) - 1.0) / 2.0))
    else:
        needed = np.full(ratio.shape, float(harmonics))
    rate = np.minimum((ratio / (2.0 * needed + 1.0)) ** 2, 1.0 - 1e-6)
    terms = np.ones(rate.shape)
    some = rate > 0.0
    terms[some] = np.ceil(np.log(depth * (1.0 - rate[some])) / np.log(rate[some]))
    return needed, np.maximum(1.0, terms), rate


def coefficients(harmonics: int, terms: int, tau: Floats) -> Floats:
    """Return ``kappa_(H+1)^(2m) c_m(tau)``, bounded for all m, shape (term, tau)."""
    times = tuple(float(t) for t in tau)
    return _coefficients(harmonics, terms, times)


@lru_cache(maxsize=64)
def _coefficients(harmonics: int, terms: int, times: tuple[float, ...]) -> Floats:
    tau = np.array(times)
    table = np.empty((terms, tau.size))
    for m in range(terms):
        table[m] = _closed_form(harmonics, m, tau) if m < 2 else _summed(harmonics, m, tau)
    table.setflags(write=False)
    return table


def _closed_form(harmonics: int, m: int, tau: Floats) -> Floats:
    """Return one of the first two coefficients: its closed form minus the first H harmonics.

    Extended precision keeps the digits of these small differences of large numbers.
    """
    t = tau.astype(np.longdouble)
    half_pi = np.longdouble("1.5707963267948966192313216916397514421")
    total = t if m == 0 else 0.5 * (t - t**3 / 3.0)
    for k in range(1, harmonics + 1):
        kappa = (2 * k - 1) * half_pi
        total = total - (-1.0) ** (k - 1) * 2.0 * np.sin(kappa * t) / kappa ** (2 * m + 2)
    return np.asarray(total * ((2 * harmonics + 1) * half_pi) ** (2 * m), dtype=np.float64)


def _summed(harmonics: int, m: int, tau: Floats) -> Floats:
    """Return a later coefficient, summed until the remainder is below rounding."""
    first = harmonics + 1
    reach = (2 * first - 1) * 10.0 ** (17.0 / (2 * m + 2))
    k = np.arange(first, first + math.ceil(reach / 2.0) + 1)
    kappa = (2 * k - 1) * (0.5 * np.pi)
    weights = np.where(k % 2 == 1, 2.0, -2.0) * (kappa[0] / kappa) ** (2 * m) / kappa**2
    return np.asarray(weights @ np.sin(np.outer(kappa, tau)))
