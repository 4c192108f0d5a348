"""The inverse tangent integral against mpmath, and its inverse against the integral."""

from __future__ import annotations

import mpmath
import numpy as np

from tests.solvers.kernels.compiled import compiled
from vibroimpact_solvers.kernels import arctangent

log_tangent = compiled(arctangent.log_tangent)


def exact(z: float) -> mpmath.mpf:
    with mpmath.workdps(30):
        return mpmath.im(mpmath.polylog(2, mpmath.mpc(0, z)))


def test_integral() -> None:
    z = np.concatenate([10.0 ** np.arange(-8, 13), [0.0099, 0.0101, 0.5, 0.999, 1.001, 2.0]])
    found = arctangent.inverse_tangent_integral(z)
    for at, value in zip(z, found, strict=True):
        assert abs(value / exact(at) - 1) < 1e-15


def test_the_inverse_solves_the_integral() -> None:
    rows = arctangent.table()
    for y in np.concatenate([10.0 ** np.arange(-6.0, 0.0), np.linspace(0.05, 40.0, 157)]):
        w = log_tangent(y, rows)
        with mpmath.workdps(30):
            z = mpmath.exp(w)
            miss = (exact(z) - mpmath.mpf(y)) / mpmath.atan(z)
        assert abs(miss) < 2e-14
