"""The Taylor series of a motion in one configuration, with a bound of what is left out.

With the size ``|z|^2 = sum (w q)^2 + q'^2`` and the norm a of the equations of motion, the scaled
coefficients of ``z = sum z_k sigma^k``, ``sigma = s/h``, satisfy

    (k + 1) |z_(k+1)| <= a h |z_k| + h |f_k| ,

so that for ``a h <= 4`` the terms after ``z_p`` sum to ``(theta |z_p| + h |f_p|/((p + 1)(1 -
theta)))/(1 - theta)`` at most, ``theta = 4/(p + 1)``, and their derivatives to ``4 (p + 4)`` times
that each.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import flint
import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.time_history.extended.precision import (
    Matrix,
    Real,
    above,
    column,
    joined,
    real,
    widened,
    within,
)
from vibroimpact_solvers.time_history.extended.structure import REACH, Configuration, Watch

_EPS: Final = 2.0**-52
CELLS: Final = 64
"""Cells in which a step is searched in double precision."""


@lru_cache(maxsize=64)
def terms_of(bits: int) -> int:
    """Return the number of terms whose remainder is below the precision."""
    k, term = 0, 1.0
    log = 0.0
    while k < 12 or log > -bits * math.log(2.0):
        k += 1
        term = REACH / k
        log += math.log(term)
    return k


class FreeMotion:
    """The motion from a state, for one step.

    Parameters
    ----------
    configuration : Configuration
    q, v : matrix of one column
        Modal coordinates and their rates.
    now : arb
        The time.
    """

    def __init__(self, configuration: Configuration, q: Matrix, v: Matrix, now: Real) -> None:
        self.configuration, self.now = configuration, now
        self.h = h = real(configuration.step)
        count = self.count = terms_of(flint.ctx.prec)
        body = configuration.body
        self.forces = body.force_series(now, configuration.step, count)
        columns = [q, v * h]
        for k in range(count):
            a = configuration.stiff_step * columns[k]
            if k < len(self.forces):
                a += configuration.onto_step * self.forces[k]
            if k == 0:
                a += configuration.push_step
            if configuration.damp_step is not None:
                a += configuration.damp_step * columns[k + 1] * (k + 1)
            columns.append(a / ((k + 1) * (k + 2)))
        self.series = joined(columns)
        self._last = columns[count], columns[count + 1] * ((count + 1) / h)
        self.weights = [real(w) for w in configuration.weights.tolist()]
        self.size = self._size(q, v)
        self.tail = self._tail()

    def _size(self, q: Matrix, v: Matrix) -> Real:
        total = flint.arb(0)
        for w, a, b in zip(self.weights, q.entries(), v.entries(), strict=True):
            total += (w * a) ** 2 + b**2
        return total.abs_upper().sqrt().upper()

    def _tail(self) -> Real:
        """Return a bound of the size of all terms after the last."""
        p = self.count
        theta = flint.arb(REACH) / (p + 1)
        load = (
            flint.arb(self.configuration.loads_size) * flint.arb(REACH) ** p / flint.arb(p).gamma()
        )
        load = load / p  # p! = p gamma(p)
        left = theta * self._size(*self._last) + self.h * load / ((p + 1) * (1 - theta))
        return (left / (1 - theta)).upper()

    @property
    def speed(self) -> Real:
        """A bound of the rate of change of the state, in the size of states, at any time."""
        configuration = self.configuration
        growth = flint.arb(math.exp(REACH) * (1.0 + 1e-9))
        pushed = sum((above(v) for v in configuration.push.entries()), 0.0)
        driven = configuration.loads_size + sum(
            above(v) for v in (configuration.onto * self.configuration.body.force).entries()
        )
        force = flint.arb(pushed + driven)
        rate = flint.arb(configuration.rate)
        return (rate * growth * (self.size + self.h * force) + force).upper()

    def state(self, sigma: Real) -> tuple[Matrix, Matrix]:
        """Return q and q' after a part of the step."""
        powers, rates, power = [flint.arb(1)], [flint.arb(0)], flint.arb(1)
        for k in range(1, self.count + 2):
            rates.append(power * k)
            power = power * sigma
            powers.append(power)
        q = widened(self.series * column(powers), [self.tail / w for w in self.weights])
        v = self.series * column(rates) / self.h
        return q, widened(v, [self.tail] * len(self.weights))

    def force(self, sigma: Real) -> Matrix:
        """Return the forces after a part of the step, shape (dof, 1)."""
        return self.configuration.body.force_series(self.now + sigma * self.h, 1.0, 1)[0]


@dataclass(frozen=True, slots=True)
class Event:
    """A coordinate that reaches its wall, or may touch it.

    Parameters
    ----------
    watch : Watch
    sigma : arb
        The time, in steps; exact.
    tight : arb
        The centre's own time is no further away.
    wide : arb
        Nor is that of any of the enclosed motions.
    least : arb
        Bound of the velocity there from below, per step; none for a touch.
    most : arb or None
        Of a touch: bound of the velocity at the wall from above, per step.
    """

    watch: Watch
    sigma: Real
    tight: Real
    wide: Real
    least: Real
    most: Real | None = None


class Approach:
    """A watched quantity during a step: a polynomial, and how far enclosed motions are from it.

    Parameters
    ----------
    free_motion : FreeMotion
    watch : Watch
    box : list of arb
        Deviations of the enclosed motions at the beginning of the step.
    spread : arb
        Size of their deviations at any time of it.
    """

    def __init__(
        self, free_motion: FreeMotion, watch: Watch, box: Sequence[Real], spread: Real
    ) -> None:
        self.watch = watch
        configuration, h = free_motion.configuration, free_motion.h
        coefficients = (watch.by_q * free_motion.series).entries()
        by_q = [above(v) for v in watch.by_q.entries()]
        far = math.hypot(*(b / w for b, w in zip(by_q, configuration.weights, strict=True)))
        fast = float(configuration.step) * math.hypot(*by_q)
        loads = flint.arb(0)
        if watch.by_v is not None:
            for k, value in enumerate((watch.by_v * free_motion.series).entries()[1:], start=1):
                coefficients[k - 1] += value * k / h
            by_v = math.hypot(*(above(v) for v in watch.by_v.entries()))
            far, fast = far + by_v, fast + REACH * by_v
        if watch.drive is not None:
            for k, force in enumerate(free_motion.forces):
                coefficients[k] += (watch.drive * force)[0, 0]
            # What the series of the loads leave out.
            amplitude = sum(
                (abs((watch.drive * part)[0, 0]) for load in configuration.body.loads
                 for part in (load.cosine, load.sine)), flint.arb(0),
            )  # fmt: skip
            p = free_motion.count - 1
            loads = 2 * amplitude * flint.arb(REACH) ** p / flint.arb(p + 1).gamma()
        self.poly = flint.arb_poly(coefficients)
        self.first, self.second = self.poly.derivative(), self.poly.derivative().derivative()
        more = 4 * (free_motion.count + 4)
        tail, loads = free_motion.tail, loads * more * more
        place, rate = flint.arb(far * (1.0 + 1e-12)), flint.arb(fast * (1.0 + 1e-12))
        self.tight = (place * tail + loads).upper()
        q = [b / w for b, w in zip(box, free_motion.weights, strict=False)]
        v = box[len(free_motion.weights) :]
        start, left = _felt(watch.by_q, q), rate * spread
        if watch.by_v is None:
            left = _felt(watch.by_q, v) * h
        else:
            start += _felt(watch.by_v, v)
        # Deviations grow by those of the velocities, and these by what accelerates them.
        self._drift, self._curve = (left + rate * tail).upper(), (rate * REACH * spread).upper()
        self._errors = [
            (start + place * tail + loads).upper(),
            (left + rate * tail + loads).upper(),
            (rate * (REACH * spread + more * tail) + loads).upper(),
            (rate * (REACH * REACH * spread + more * more * tail) + loads).upper(),
        ]
        self.coefficients: Floats = np.array([float(c.mid()) for c in coefficients])
        # Bounds of the second, third and fourth derivatives over the step.
        rough = sum((c.rad() for c in coefficients), flint.arb(0))
        sizes: Floats = np.abs(self.coefficients)
        powers: Floats = np.arange(len(coefficients), dtype=np.float64)
        bounds, factor = list[Real](), powers
        for order in (2, 3, 4):
            factor = factor * np.maximum(powers - order + 1, 0)
            left_out = self._errors[min(order, 3)] * (REACH if order == 4 else 1)
            most = flint.arb(float(factor @ sizes) * (1.0 + 1e-12))
            bounds.append((most + left_out + rough * len(coefficients) ** order).upper())
        self.bend_bound, self.jerk_bound, self.snap_bound = bounds

    def clear_cells(self, nodes: Floats, slopes: Floats) -> list[bool]:
        """Return which cells the quantity certainly passes below its wall, by doubles.

        Parameters
        ----------
        nodes, slopes : array, shape (term, cell)
            Powers of the centres of the cells, and their derivatives.
        """
        c, half = self.coefficients, 0.5 / CELLS
        total = float(np.abs(c).sum())
        wall = float(self.watch.wall.mid())
        rounding = 4.0 * _EPS * c.size * (total * c.size + abs(wall))
        room = (
            wall
            - c @ nodes[: c.size]
            - rounding
            - above(self._errors[0] + self._drift + self._curve)
        )
        slope = np.abs(c @ slopes[: c.size]) + rounding
        slope += above(self._errors[1] + self._curve)
        return (room > slope * half + 0.5 * above(self.bend_bound) * half * half).tolist()  # type: ignore[no-any-return]

    def room(self, sigma: Real) -> Real:
        """Return the distance from the wall."""
        off = self._errors[0] + abs(sigma) * (self._drift + abs(sigma) * self._curve)
        return within(self.watch.wall - self.poly(sigma), off)

    def slope(self, sigma: Real) -> Real:
        """Return the velocity towards the wall, per step."""
        return within(self.first(sigma), self._errors[1] + abs(sigma) * self._curve)

    def bend(self, sigma: Real) -> Real:
        """Return the acceleration towards the wall, per step squared."""
        return within(self.second(sigma), self._errors[2])

    def jerk(self, sigma: Real) -> Real:
        """Return the third derivative, per step cubed."""
        return within(self.second.derivative()(sigma), self._errors[3])

    def integral(self, start: Real, stop: Real) -> Real:
        """Return the integral over a part of the step, in steps."""
        whole = self.poly.integral()
        return whole(stop) - whole(start)


def _felt(row: Matrix, deviations: Sequence[Real]) -> Real:
    """Return how far deviations move a linear form at most."""
    pairs = zip(row.entries(), deviations, strict=False)
    return sum((abs(c) * d for c, d in pairs), flint.arb(0))
