"""Contact phases of stops whose force grows with a power, summed up step by step.

Steps end where a coordinate reaches or leaves its wall (`kernels.soft_forces`), so that each lies
within a phase or outside of all. Within a step the series of the force is integrated, and the
largest indentation is that of the polynomial of the coordinate. Where the force is so small that
its series is left out, its impulse is a quadrature.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.jit import fma, inline, inner, record
from vibroimpact_solvers.kernels.series import FIRST, SECOND, rate, summed
from vibroimpact_solvers.kernels.soft_forces import NO_SERIES, Limiters, Q, form, size_of

_NODES: Final = 8  # parts of a step, at whose ends a maximum is looked for
_HALVINGS: Final = 40
_THIRD: Final = 2

PHASE: Final = record(
    [
        ("wall", np.int64),  # which limiter
        ("start", np.float64),
        ("stop", np.float64),  # nan while it lasts
        ("velocity", np.float64),  # rates of the coordinate at both ends
        ("leaving", np.float64),
        ("bend", np.float64),  # second rates at both ends
        ("bend_at_stop", np.float64),
        ("impulse", np.float64),
        ("deepest", np.float64),
        ("unsure", np.float64),  # by how much the impulse may be off, as series miss the force
    ]
)
"""A contact phase, in the units of the state and its time."""


@inline
def is_touched(law: Any, now: Any) -> bool:
    """Return whether a coordinate is beyond the wall of a stop that pushes."""
    touched: bool = now.side > 0.0 and law.above != 0.0
    return touched


@inner
def note_switchings(
    limiters: Limiters, branches: Any, z: Floats, h: float, time: float, phases: Any,
    lasting: Integers, count: int,
) -> int:  # fmt: skip
    """Begin and end phases at the start of a step; return how many there are.

    Parameters
    ----------
    limiters : Limiters
    branches : array of `soft_forces.BRANCH`
        With the coefficients of the step.
    z : array, shape (2, pair)
    h : float
        Over which coefficients are scaled.
    time : float
    phases : array of `PHASE`
        With room for one more of each limiter.
    lasting : array of int, shape (wall,)
        The phase of each limiter that lasts, or -1.
    count : int
        Number of phases so far.
    """
    for i in range(limiters.laws.size):
        law, now, row = limiters.laws[i], branches[i], lasting[i]
        inside = is_touched(law, now)
        if inside == (row >= 0):
            continue
        speed, bend = form(limiters.slopes, i, z), 2.0 * now.powers[Q, _THIRD] / (h * h)
        if inside:
            lasting[i] = count
            phase = phases[count]
            count += 1
            phase.wall, phase.start, phase.stop = i, time, np.nan
            phase.velocity, phase.bend = speed, bend
            phase.leaving, phase.bend_at_stop, phase.impulse = 0.0, 0.0, 0.0
            phase.unsure = 0.0
            phase.deepest = max(now.powers[Q, FIRST], 0.0)
        else:
            phase = phases[row]
            phase.stop, phase.leaving, phase.bend_at_stop = time, speed, bend
            lasting[i] = -1
    return count


@inner
def _largest(u: Floats, last: int, s: float) -> float:
    """Return the largest value of a series in [0, s]."""
    best: float = u[FIRST]
    at = 0.0
    for node in range(1, _NODES + 1):
        t = s * node / _NODES
        value = summed(u, last, t)
        if value > best:
            best, at = value, t
    low, high = max(at - s / _NODES, 0.0), min(at + s / _NODES, s)
    if rate(u, last, low) > 0.0 and rate(u, last, high) < 0.0:
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if rate(u, last, middle) > 0.0:
                low = middle
            else:
                high = middle
        best = max(best, summed(u, last, low))
    return best


@inline
def _integral(force: Floats, last: int, s: float) -> float:
    """Return the integral of a series from 0 to s."""
    total = 0.0
    for k in range(last, -1, -1):
        total = fma(total, s, force[k] / (k + 1))
    integral: float = total * s
    return integral


@inner
def _faint_integral(u: Floats, last: int, s: float, law: Any) -> float:
    """Return the integral of a force whose series is left out, by Simpson's rule."""
    total = 0.0
    for node in range(_NODES + 1):
        weight = 1.0 if node in (0, _NODES) else 2.0 * (1 + node % 2)
        q = max(summed(u, last, s * node / _NODES), 0.0)
        total += weight * size_of(q, law.exponent, law.whole)
    integral: float = law.above * total * s / (3.0 * _NODES)
    return integral


@inner
def sum_up(
    limiters: Limiters, branches: Any, order: int, s: float, h: float, phases: Any,
    lasting: Integers,
) -> None:  # fmt: skip
    """Add the part s of a step to the phases that last."""
    for i in range(limiters.laws.size):
        row = lasting[i]
        if row < 0:
            continue
        law, now, phase = limiters.laws[i], branches[i], phases[row]
        u = now.powers[Q]
        if now.way == NO_SERIES:
            pushed = _faint_integral(u, order, s, law)
            phase.unsure -= h * pushed
        else:
            pushed = _integral(now.force, order - 1, s)
        phase.impulse -= h * pushed
        phase.unsure += h * s * abs(now.missed)
        if u[SECOND] > 0.0 or u[FIRST] > phase.deepest:
            phase.deepest = max(phase.deepest, _largest(u, order, s))
