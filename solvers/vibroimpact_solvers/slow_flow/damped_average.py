"""The averaged equations of the damped oscillator, eq. 10.16 without expansion, by quadrature.

    zeta Omega0 t = integral of dgamma / [(1 + sin(2 gamma)/(2 gamma)) tan(gamma)]
    zeta phi      = the same with 1/gamma under the integral

Both are Chebyshev series in ln(gamma); their inverses are series in the root of the time left.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.polynomial import Chebyshev

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.meter import look

_GRAZING: Final = 0.5 * math.pi
_MOST: Final = 512  # degree of a series
_AT_A_TIME: Final = 4096  # values between two looks at the meter
_ROUNDING: Final = 2e-15  # of the largest coefficient; less is noise of the values


def _series(function: Callable[[Floats], Floats], domain: tuple[float, float]) -> Chebyshev:
    """Return a function as a series whose last terms are rounding."""
    degree = 32
    while True:
        series = Chebyshev.interpolate(function, degree, list(domain))
        size = np.abs(np.asarray(series.coef, dtype=np.float64))
        if size[-4:].max() < _ROUNDING * size.max() or degree >= _MOST:
            return series
        degree *= 2


@dataclass(frozen=True, eq=False, slots=True)
class Average:
    """The averaged motion from gamma0 at t = 0 to gamma = pi/2."""

    end: float  # time of grazing
    # ln(gamma) and phi as functions of sqrt(end - t), in which they are smooth to the end
    log_gamma: Chebyshev
    phase: Chebyshev

    @classmethod
    def starting(cls, gamma0: float, zeta: float, Omega0: float) -> Average:
        """Return the motion from gamma0."""
        domain = (math.log(gamma0), math.log(_GRAZING))

        def rate(u: Floats) -> Floats:
            """Return zeta Omega0 dt/du."""
            gamma = np.exp(u)
            rates: Floats = gamma / ((1.0 + np.sinc(2.0 * gamma / np.pi)) * np.tan(gamma))
            return rates

        time, phase = _series(rate, domain), _series(lambda u: rate(u) * np.exp(-u), domain)
        left = -time.integ(lbnd=domain[1]) / (zeta * Omega0)
        phi = phase.integ(lbnd=domain[0]) / zeta
        end = float(left(domain[0]))
        span = (0.0, math.sqrt(end))
        log_gamma = _series(lambda root: _inverse(left, root, domain), span)
        return cls(end, log_gamma, _series(lambda root: phi(_inverse(left, root, domain)), span))

    def at(self, t: Floats) -> tuple[Floats, Floats]:
        """Return gamma and phi at times 0 to the end."""
        root = np.sqrt(np.maximum(0.0, self.end - t))
        return np.exp(_values(self.log_gamma, root)), _values(self.phase, root)


def _values(series: Chebyshev, x: Floats) -> Floats:
    """Return the values of a series, a few at a time."""
    values = np.empty_like(x)
    for start in range(0, x.size, _AT_A_TIME):
        look()
        values.flat[start : start + _AT_A_TIME] = series(x.flat[start : start + _AT_A_TIME])
    return values


def _inverse(left: Chebyshev, root: Floats, domain: tuple[float, float]) -> Floats:
    """Return ln(gamma) where sqrt(left) has given values, by Newton's method held in brackets."""
    low, high = np.full_like(root, domain[0]), np.full_like(root, domain[1])
    u, slope = 0.5 * (low + high), left.deriv()
    for _ in range(100):
        look()
        root_left = np.sqrt(np.maximum(0.0, left(u)))
        late = root_left < root
        low, high = np.where(late, low, u), np.where(late, u, high)
        with np.errstate(divide="ignore", invalid="ignore"):
            following = u - (root_left - root) * 2.0 * root_left / slope(u)
        inside = (following > low) & (following < high)
        following = np.where(inside, following, 0.5 * (low + high))
        if (np.abs(following - u) <= 4e-16 * np.maximum(1.0, np.abs(u))).all():
            return following
        u = following
    return u
