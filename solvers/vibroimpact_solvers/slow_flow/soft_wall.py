"""The two-oscillator system with soft walls in place of rigid ones, integrated in time.

The force is that of the chapter, ``(x1 / (alpha Delta))^17`` in units of m Omega0^2 Delta. Alpha is
chosen so that, without coupling, the soft oscillator has the period of the rigid one at its initial
energy; as the energy decreases, the walls appear stiffer.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import scipy  # its parts load as they are used: they are slow to load

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.slow_flow.coupled_rates import Coupled

POWER: Final = 17
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(400)
_U: Final = 0.5 * (_NODES + 1.0)


def half_period(alpha: float, energy: float) -> float:
    """Return half a period at an energy; Omega0, Delta and the mass are 1."""

    def potential(x: Floats) -> Floats:
        return 0.5 * x**2 + alpha / (POWER + 1) * (x / alpha) ** (POWER + 1)

    def left(x: float) -> float:
        return energy - float(potential(np.array(x)))

    top = scipy.optimize.brentq(left, 0.0, math.sqrt(2.0 * energy), xtol=1e-15)
    # x = top (1 - u^2) takes the root of the turning point away.
    x = top * (1.0 - _U**2)
    speed = np.sqrt(2.0 * np.maximum(energy - potential(x), 1e-300))
    return float(2.0 * np.sum(0.5 * _WEIGHTS * 2.0 * top * _U / speed))


def matched(gamma0: float) -> float:
    """Return alpha for the initial frequency ratio: the rigid half period is 2 gamma0."""
    energy = 0.5 / math.sin(gamma0) ** 2
    return float(
        scipy.optimize.brentq(lambda alpha: half_period(alpha, energy) - 2.0 * gamma0, 0.2, 1.2)
    )


def motion(of: Coupled, alpha: float, state: Floats, t: Floats) -> Floats:
    """Return (x1, x2, v1, v2) at given times, shape (time, 4)."""
    square, wall = of.Omega0**2, alpha * of.Delta

    def right(s: float, y: Floats) -> list[float]:
        x1, x2, v1, v2 = (float(part) for part in y)
        push = square * of.Delta * (x1 / wall) ** POWER
        pull = of.beta * (x1 - x2)
        damping = 2.0 * of.zeta * of.Omega0 * v1
        return [v1, v2, -square * x1 - damping - pull - push, -square * x2 + pull]

    # A step from one wall to the other would try places far beyond it.
    step = 0.2 * of.Delta / max(float(np.abs(state[2:]).max()), of.Omega0 * of.Delta)
    order = np.argsort(t, kind="stable")
    run = scipy.integrate.solve_ivp(
        right, (0.0, max(float(t.max()), 1e-12)), state, "DOP853",
        t_eval=t[order], rtol=1e-9, atol=1e-11, max_step=step,
    )  # fmt: skip
    if run.status != 0:
        raise ConvergenceError(f"the soft walls cannot be integrated: {run.message}")
    states = np.empty((t.size, 4))
    states[order] = run.y.T
    return states
