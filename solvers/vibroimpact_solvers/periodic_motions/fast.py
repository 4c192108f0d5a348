r"""Integrals of products with fast vibrations along free motions, in closed form.

A fast vibration is ``Re(g w e^(lambda t))``, w = z1 - i z2 being the pair after the impact and
g = f1 + i f2 a linear form on it (`kernels.flow`). An overdamped pair is two of them whose rates
are real: w = (z1 +- z2)/2 and g = f1 +- f2. Whatever they are multiplied by,

    integral e^(lambda t) e^(mu t) dt = (e^((lambda + mu) L) - 1) / (lambda + mu)

over a free motion of length L; mu is the rate of another fast vibration, of its conjugate, of the
load, or of a slow pair z' = A z, for which it is a matrix. What is slow alone remains for the
quadrature (`along`), whose nodes then have to follow that only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Booleans, Floats, Integers
from vibroimpact_solvers.kernels.orbits import TRENDS, Dissipation, Forms
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.solutions import Cells, Solutions

_CLOSE: Final = 0.5
"""Turns times lengths below which the difference of an exponential from one is taken by itself."""


@dataclass(frozen=True, eq=False, slots=True)
class Shares:
    """What fast vibrations add to the integrals along solutions.

    Parameters
    ----------
    squares : array, shape (solution, dof)
        To the integrals of the squares of displacements.
    sizes : array, shape (solution, dof)
        Bounds of the root mean squares of sums of the moduli of fast vibrations.
    work, flow, dissipated : array, shape (solution,)
        To the work of the load, to a bound of the integral of its modulus, and to the losses.
    speeds : array, shape (solution, mode)
        To bounds of the integrals of the moduli of modal velocities.
    """

    squares: Floats
    sizes: Floats
    work: Floats
    flow: Floats
    dissipated: Floats
    speeds: Floats


class Fast:
    """The fast pairs of a structure, and linear forms on all of them.

    Parameters
    ----------
    driven : Driven
    fast : array of bool, shape (pair,)
        Rotations and hyperbolas that are faster than the load.
    cells : Cells
    x, v : Forms
        Of displacements and of modal velocities; of none that are not asked for.
    change : Dissipation
    """

    def __init__(
        self, driven: Driven, fast: Booleans, cells: Cells, x: Forms, v: Forms, change: Dissipation
    ) -> None:
        pairs = driven.pairs
        moves = np.zeros(fast.size, dtype=bool)
        moves[pairs.moving] = True
        self._driven, self._cells, self._x, self._change = driven, cells, x, change
        self._fast, self._slow = np.flatnonzero(fast), np.flatnonzero(moves & ~fast)
        rotate, apart = self._fast[self._fast < pairs.rotations.stop], self._fast
        apart = apart[rotate.size :]
        real = pairs.nu[apart] + pairs.rest[apart]
        self._rotate, self._real = rotate, apart
        self._rates = np.concatenate(
            [
                pairs.alpha[rotate] + 1j * (pairs.nu[rotate] + pairs.rest[rotate]),
                pairs.alpha[apart] + real,
                pairs.alpha[apart] - real,
            ]
        )
        rates = self._rates[:, np.newaxis]
        self._sum, self._apart = rates + self._rates, rates + self._rates.conj()
        form, rate_form = self._split(x.pairs), self._split(v.pairs)
        self._form = np.ascontiguousarray(np.stack([form.real, form.imag]).transpose(0, 2, 1))
        self._rate_form = rate_form
        self._slow_form = x.pairs[self._slow].reshape(2 * self._slow.size, -1)
        modes = v.trend.shape[1]
        damping = change.damping[:, :modes]
        if len(damping) == 1:
            damping = np.diag(damping[0])
        # Of the losses, and of the power of the load: what moves is dragged by fast vibrations.
        drag = self._rate_form @ damping if damping.size else 0.0 * self._rate_form
        slow = v.pairs[self._slow].reshape(2 * self._slow.size, -1)
        self._dragged = drag @ slow.T, drag @ v.trend.T, drag
        self._steady_rates = v.steady
        self._losses = drag @ self._rate_form.T, drag @ self._rate_form.conj().T
        self._power = self._rate_form @ change.load[:, :modes].T
        self._denominators = self._of_slow()

    def _split(self, forms: Floats) -> Complexes:
        """Return the factors g of fast vibrations in forms (pair, 2, form), (fast, form)."""
        first, second = forms[:, 0], forms[:, 1]
        rotate, real = self._rotate, self._real
        return np.concatenate(
            [
                first[rotate] + 1j * second[rotate],
                first[real] + second[real],
                first[real] - second[real],
            ]
        )

    def _of_slow(self) -> tuple[Complexes, Complexes]:
        """Return lambda + alpha, and what the inverse of lambda + A is divided by, of slow pairs.

        Shape (fast, slow) each.
        """
        pairs, slow = self._driven.pairs, self._slow
        shifted = np.asarray(self._rates[:, np.newaxis] + pairs.alpha[slow], dtype=np.complex128)
        turn = np.where(slow < pairs.rotations.stop, 1j, 1.0)
        nu = np.asarray((pairs.nu + pairs.rest)[slow] * turn, dtype=np.complex128)
        nu[slow >= pairs.hyperbolas.stop] = 0.0
        return shifted, (shifted + nu) * (shifted - nu)

    def shares(self, solved: Solutions) -> Shares:
        """Return what fast vibrations add to the integrals along solutions."""
        n, legs = solved.length.shape
        dofs, modes = self._x.trend.shape[1], self._steady_rates.shape[2]
        shares = Shares(
            np.zeros((n, dofs)), np.zeros((n, dofs)), np.zeros(n), np.zeros(n), np.zeros(n),
            np.zeros((n, modes)),
        )  # fmt: skip
        for k in range(n):
            for leg in range(legs):
                look()
                self._add(solved, k, leg, shares)
            shares.sizes[k] /= math.sqrt(solved.length[k].sum())
        return shares

    def _add(self, solved: Solutions, k: int, leg: int, shares: Shares) -> None:
        """Add what one free motion adds."""
        pairs, f, z = self._driven.pairs, solved.index[k], solved.state[k, leg]
        length = float(solved.length[k, leg])
        even, odd = pairs.propagators(np.array([length]))[0][:, self._rotate]
        moved = np.exp(self._rates * length)
        moved[: even.size] = even + 1j * odd  # which knows phases better
        rotate, real = z[:, self._rotate], z[:, self._real]
        w = np.concatenate(
            [rotate[0] - 1j * rotate[1], 0.5 * (real[0] + real[1]), 0.5 * (real[0] - real[1])]
        )
        lasts = _lasting(2.0 * self._rates.real, length)
        by_slow = self._with_slow(z, moved, length)
        by_trend = _with_trends(self._rates, moved, length)
        by_load = self._with_load(solved, k, leg, moved)
        every, conjugate = self._with_fast(moved, length)
        every, conjugate = w[:, np.newaxis] * every * w, w[:, np.newaxis] * conjugate * w.conj()
        f1, f2 = self._form
        if len(f1):
            products = ((f1 @ (0.5 * (conjugate + every).real)) * f1).sum(axis=1)
            if f2.any():
                products += ((f2 @ (0.5 * (conjugate - every).real)) * f2).sum(axis=1)
                products += ((f1 @ (conjugate - every).imag) * f2).sum(axis=1)
            others = np.concatenate([self._x.trend, self._x.steady[f], self._slow_form])
            by = (w[:, np.newaxis] * np.concatenate([by_trend, by_load, by_slow], axis=1)).T
            cross = (others * (by.real @ f1.T - by.imag @ f2.T)).sum(axis=0)
            shares.squares[k] += products + 2.0 * cross
            shares.sizes[k] += np.hypot(f1, f2) @ (np.abs(w) * np.sqrt(lasts))
        if self._steady_rates.shape[2]:
            factors = self._change.factors[f]
            lost = 0.5 * (every * self._losses[0] + conjugate * self._losses[1]).real.sum()
            to_slow, to_trend, drag = self._dragged
            by_rates = (by_slow * to_slow).sum(axis=1) + (by_trend * to_trend).sum(axis=1)
            by_rates += (by_load * (drag @ self._steady_rates[f].T)).sum(axis=1)
            shares.dissipated[k] += lost + 2.0 * (w * by_rates).sum().real
            power = self._power * factors
            shares.work[k] += (w * (by_load * power).sum(axis=1)).sum().real
            for_whole = np.abs(w) * _lasting(self._rates.real, length)
            shares.flow[k] += for_whole @ np.abs(power).sum(axis=1)
            shares.speeds[k] += for_whole @ np.abs(self._rate_form)

    def _with_fast(self, moved: Complexes, length: float) -> tuple[Complexes, Complexes]:
        """Return the integrals of products of fast vibrations, and with conjugates."""
        every = (moved[:, np.newaxis] * moved - 1.0) / self._sum
        apart = self._apart
        close = np.abs(apart) * length < _CLOSE
        conjugate = moved[:, np.newaxis] * moved.conj() - 1.0
        np.divide(conjugate, apart, out=conjugate, where=~close)
        exponent = apart[close] * length
        still = exponent == 0.0
        mean = np.expm1(exponent) / np.where(still, 1.0, exponent)
        conjugate[close] = length * np.where(still, 1.0, mean)
        own = np.arange(moved.size)
        conjugate[own, own] = _lasting(2.0 * self._rates.real, length)
        return every, conjugate

    def _with_slow(self, z: Floats, moved: Complexes, length: float) -> Complexes:
        """Return the integrals of products with both numbers of slow pairs, (fast, 2 slow)."""
        pairs, slow = self._driven.pairs, self._slow
        end = pairs.move(pairs.propagators(np.array([length])), z)[0][:, slow]
        first, second = moved[:, np.newaxis] * end[:, np.newaxis] - z[:, np.newaxis, slow]
        there, back = _turns(self._driven, slow)
        shifted, denominators = self._denominators
        both = shifted * first - there * second, shifted * second - back * first
        each: Complexes = np.stack(both, axis=2) / denominators[..., np.newaxis]
        return each.reshape(moved.size, -1)

    def _with_load(self, solved: Solutions, k: int, leg: int, moved: Complexes) -> Complexes:
        """Return the integrals of products with cosines and sines, (fast, 2 harmonic)."""
        orders = self._driven.harmonics
        speeds = orders * self._cells.Omega[solved.index[k]]
        start = orders * solved.phase[k, leg] if solved.phase.size else 0.0 * orders
        end = np.exp(1j * (start + speeds * solved.length[k, leg]))
        start = np.exp(1j * start)
        rates, moved = self._rates[:, np.newaxis], moved[:, np.newaxis]
        forth = (moved * end - start) / (rates + 1j * speeds)
        back = (moved * end.conj() - start.conj()) / (rates - 1j * speeds)
        both = 0.5 * (forth + back), -0.5j * (forth - back)
        return np.stack(both, axis=2).reshape(moved.size, -1)


def _turns(driven: Driven, some: Integers) -> tuple[Floats, Floats]:
    """Return what turns pairs: ``z' = alpha z + (there z2, back z1)``."""
    pairs = driven.pairs
    there = np.where(some < pairs.hyperbolas.stop, pairs.nu[some], 1.0)
    back = np.where(some < pairs.rotations.stop, -there, there)
    return there, np.where(some < pairs.hyperbolas.stop, back, 0.0)


def _with_trends(rates: Complexes, moved: Complexes, length: float) -> Complexes:
    """Return the integrals of products with 1, t and t^2/2, shape (fast, 3)."""
    out = np.empty((rates.size, TRENDS), dtype=np.complex128)
    out[:, 0] = (moved - 1.0) / rates
    out[:, 1] = (length * moved - out[:, 0]) / rates
    out[:, 2] = (0.5 * length * length * moved - out[:, 1]) / rates
    return out


def _lasting(growth: Floats, length: float) -> Floats:
    """Return the integrals of e^(growth t)."""
    still = growth == 0.0
    return np.where(still, length, np.expm1(growth * length) / np.where(still, 1.0, growth))
