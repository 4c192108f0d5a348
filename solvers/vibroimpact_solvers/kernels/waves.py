"""The triangular sine and its square wave as functions of the phase."""

from __future__ import annotations

import math

from vibroimpact_solvers.kernels.jit import inline


@inline
def fold(phi: float) -> tuple[float, float]:
    """Return tau(phi) and e(phi) = tau'(phi): period 4, tau = phi and e = 1 on [-1, 1)."""
    half = math.floor(0.5 * (phi + 1.0))
    odd = half - 2.0 * math.floor(0.5 * half)
    e = 1.0 - 2.0 * odd
    return e * (phi - 2.0 * half), e
