r"""Extremes of motions with fast vibrations, by halving intervals that may have them.

Between two times h apart a displacement is beyond the values at both by at most

    sum_j min(|lambda_j|^2 h^2 / 8, 2) |f_j| a_j,

f_j being the factor of a vibration j, and a_j what it is at most from the first of them on: it
deviates from a straight line by no more. Intervals in which no displacement can exceed what is
known are left out, so that only those beside extremes become as short as the fastest vibrations.
Where the second derivative keeps its sign, by a bound of the third one, Newton's method finds the
extreme.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Booleans, Floats, Integers
from vibroimpact_solvers.kernels.chosen_products import FAST, chosen_products, set_bounds
from vibroimpact_solvers.kernels.orbits import TRENDS, Forms
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.solutions import Cells, Solutions

LEAST: Final = 32
"""Intervals of a free motion to begin with."""
_HALVINGS: Final = 60
_STEPS: Final = 8  # of Newton's method
_ROUNDED: Final = 4.0 * EPS
_FEW: Final = 0.1
"""Part of all displacements in all intervals, below which extremes themselves are sought."""
_BENDS: Final = 2
_JERKS: Final = 3  # derivatives that are bounded


@dataclass(frozen=True, eq=False, slots=True)
class _Motion:
    """A solution: displacements are ``rows @ forms.T``, rows being what moves at some times.

    Parameters
    ----------
    phase, length : array, shape (free motion,)
    state : array, shape (free motion, 2, pair)
    orders : array, shape (harmonic,)
        Of the load.
    Omega : float
    forms : array, shape (dof, row)
    rates : tuple of two arrays
        Of velocities and accelerations.
    moduli : array, shape (dof, row)
    """

    phase: Floats
    length: Floats
    state: Floats
    orders: Floats
    Omega: float
    forms: Floats
    rates: tuple[Floats, Floats]
    moduli: Floats


@dataclass(frozen=True, eq=False, slots=True)
class _Intervals:
    """Intervals of free motions, and displacements in them that may have an extreme.

    Parameters
    ----------
    leg, begin, width : array, shape (interval,)
    start : array, shape (interval, 2, pair)
        The response to the impulses at the beginning.
    place, dof : array, shape (candidate,)
        Intervals and degrees of freedom.
    first, last : array, shape (candidate,)
        Displacements at both ends.
    """

    leg: Integers
    begin: Floats
    width: Floats
    start: Floats
    place: Integers
    dof: Integers
    first: Floats
    last: Floats


class Peaks:
    """The search for extremes of displacements.

    Parameters
    ----------
    driven : Driven
    cells : Cells
    x : Forms
        Of displacements.
    """

    def __init__(self, driven: Driven, cells: Cells, x: Forms) -> None:
        self._driven, self._cells, self._x = driven, cells, x
        self._of, self._forms = -1, (x.trend, x.trend, x.trend)

    def of(self, solved: Solutions) -> Floats:
        """Return the highest displacements, and minus the lowest ones, (solution, 2, dof)."""
        peaks = np.empty((solved.index.size, 2, self._x.trend.shape[1]))
        for k in range(solved.index.size):
            peaks[k] = self._highest(self._motion(solved, k))
        return peaks

    def _motion(self, solved: Solutions, k: int) -> _Motion:
        f, length = solved.index[k], solved.length[k]
        phase = solved.phase[k] if solved.phase.size else np.zeros(length.size)
        if self._of != f:
            self._of, self._forms = f, self._at(f)
        displacement, velocity, acceleration = self._forms
        return _Motion(
            phase, length, solved.state[k], self._driven.harmonics, float(self._cells.Omega[f]),
            displacement, (velocity, acceleration), np.abs(displacement),
        )  # fmt: skip

    def _at(self, f: int) -> tuple[Floats, Floats, Floats]:
        """Return the factors of displacements, velocities and accelerations at a frequency."""
        speeds = np.repeat(self._driven.harmonics * self._cells.Omega[f], 2)[:, np.newaxis]
        trend, pairs, steady = self._x.trend, self._x.pairs.transpose(2, 1, 0), self._x.steady[f]
        every = []
        for _ in range(3):
            flat = pairs.transpose(2, 1, 0).reshape(2 * pairs.shape[2], -1)
            every.append(np.ascontiguousarray(np.concatenate([trend, flat, steady]).T))
            trend = np.concatenate([trend[1:], np.zeros((1, trend.shape[1]))])
            pairs = self._driven.rates_of(pairs)
            turned = steady.reshape(-1, 2, steady.shape[1])[:, ::-1] * np.array([[1.0], [-1.0]])
            steady = speeds * turned.reshape(steady.shape)
        displacement, velocity, acceleration = every
        return displacement, velocity, acceleration

    def _highest(self, m: _Motion) -> Floats:
        """Return the extremes of a solution, (2, dof)."""
        known, here = self._begin(m)
        for _ in range(_HALVINGS):
            look()
            if not here.place.size:
                break
            here = self._halved(m, here, known)
        return known

    def _begin(self, m: _Motion) -> tuple[Floats, _Intervals]:
        """Return what is known of extremes at first, and the intervals to look at."""
        legs, dofs = m.length.size, len(m.forms)
        leg = np.repeat(np.arange(legs), LEAST + 1)
        times = (m.length[:, np.newaxis] * np.arange(LEAST + 1) / LEAST).ravel()
        times[LEAST :: LEAST + 1] = m.length
        z = self._state(m, leg, times)
        every = np.divmod(np.arange(times.size * dofs), dofs)
        x = _products(self._rows(m, leg, times, z), m.forms, *every).reshape(-1, dofs)
        known = np.stack([x.max(axis=0), (-x).max(axis=0)])
        at = np.flatnonzero(np.arange(times.size) % (LEAST + 1) != LEAST)
        width = times[at + 1] - times[at]
        place, dof = np.divmod(np.arange(at.size * dofs), dofs)
        first, last = x[at].ravel(), x[at + 1].ravel()
        here = _Intervals(leg[at], times[at], width, z[at], place, dof, first, last)
        return known, self._kept(m, here, known)

    def _halved(self, m: _Motion, here: _Intervals, known: Floats) -> _Intervals:
        """Return the halves of intervals that may still exceed what is known, which is raised."""
        half = 0.5 * here.width
        middle = here.begin + half
        z = self._state(m, here.leg, middle)
        rows = self._rows(m, here.leg, middle, z)
        place, dof = here.place, here.dof
        x = _products(rows, m.forms, place, dof)
        _raise(known, dof, x)
        left = np.ones(place.size, dtype=bool)
        if place.size <= _FEW * here.leg.size * len(m.forms):
            left = ~self._bent(m, here, rows, x, known)
        count, place, dof, x = here.leg.size, place[left], dof[left], x[left]
        both = _Intervals(
            np.tile(here.leg, 2), np.concatenate([here.begin, middle]), np.tile(half, 2),
            np.concatenate([here.start, z]), np.concatenate([place, place + count]),
            np.tile(dof, 2), np.concatenate([here.first[left], x]),
            np.concatenate([x, here.last[left]]),
        )  # fmt: skip
        return self._kept(m, both, known)

    def _kept(self, m: _Motion, here: _Intervals, known: Floats) -> _Intervals:
        """Return what may exceed what is known."""
        rows = self._bounds(m, here, _BENDS)
        beyond = _products(rows, m.moduli, here.place, here.dof)
        room = _ROUNDED * np.abs(known).max(axis=0)[here.dof]
        high = np.maximum(here.first, here.last) + beyond > known[0, here.dof] + room
        low = beyond - np.minimum(here.first, here.last) > known[1, here.dof] + room
        some = np.flatnonzero(high | low)
        looked = np.zeros(here.leg.size, dtype=bool)
        looked[here.place[some]] = True
        used, place = np.flatnonzero(looked), (np.cumsum(looked) - 1)[here.place[some]]
        return _Intervals(
            here.leg[used], here.begin[used], here.width[used], here.start[used], place,
            here.dof[some], here.first[some], here.last[some],
        )  # fmt: skip

    def _bent(
        self, m: _Motion, here: _Intervals, rows: Floats, x: Floats, known: Floats
    ) -> Booleans:
        """Return where the second derivative keeps its sign; what is known is raised by extremes.

        rows and displacements x are those in the middle of the intervals.
        """
        v, a = (_products(rows, forms, here.place, here.dof) for forms in m.rates)
        jerk = _products(self._bounds(m, here, _JERKS), m.moduli, here.place, here.dof)
        least = np.abs(a) - 0.5 * jerk * here.width[here.place]
        bent = least > 0.0
        sign = np.where(a < 0.0, 1.0, -1.0)
        row = np.where(a < 0.0, 0, 1)
        gain = np.divide(0.5 * v * v, least, out=np.zeros(v.size), where=bent)
        room = _ROUNDED * np.abs(known).max(axis=0)[here.dof]
        some = np.flatnonzero(bent & (sign * x + gain > known[row, here.dof] + room))
        self._climb(m, here, some, (x, v, a), known)
        return bent

    def _climb(
        self, m: _Motion, here: _Intervals, some: Integers, at: tuple[Floats, Floats, Floats],
        known: Floats,
    ) -> None:  # fmt: skip
        """Raise what is known by the extremes in some intervals, whose values are those at times.

        By Newton's method, which stays in them; the last step is that of the parabola.
        """
        if not some.size:
            return
        x, v, a = (values[some] for values in at)
        place, dof = here.place[some], here.dof[some]
        leg, low, high = here.leg[place], here.begin[place], (here.begin + here.width)[place]
        times = 0.5 * (low + high)
        for step in range(_STEPS):
            there = np.clip(times - v / a, low, high)
            moved = there - times
            last = np.abs(0.5 * v * moved) <= 0.25 * EPS * np.abs(x)
            last |= step == _STEPS - 1
            _raise(known, dof, x + np.where(last, (v + 0.5 * a * moved) * moved, 0.0))
            more = ~last
            if not more.any():
                break
            leg, low, high, dof, times = leg[more], low[more], high[more], dof[more], there[more]
            own = np.arange(times.size)
            rows = self._rows(m, leg, times, self._state(m, leg, times))
            x, v, a = (_products(rows, forms, own, dof) for forms in (m.forms, *m.rates))

    # -- rows --

    def _state(self, m: _Motion, leg: Integers, times: Floats) -> Floats:
        """Return responses to the impulses, (time, 2, pair)."""
        pairs = self._driven.pairs
        return pairs.move(pairs.propagators(np.ascontiguousarray(times)), m.state[leg])

    def _rows(self, m: _Motion, leg: Integers, times: Floats, z: Floats) -> Floats:
        """Return what displacements are sums over, (time, row)."""
        trends = np.stack([np.ones(times.size), times, 0.5 * times * times], axis=1)
        return np.concatenate([trends, _flat(z), self._waves(m, leg, times)], axis=1)

    def _waves(self, m: _Motion, leg: Integers, times: Floats) -> Floats:
        """Return cosines and sines of the load in turn, (time, 2 harmonic)."""
        angle = m.orders * (m.phase[leg] + m.Omega * times)[:, np.newaxis]
        both = np.stack([np.cos(angle), np.sin(angle)], axis=2)
        return both.reshape(times.size, -1)

    # -- bounds --

    def _bounds(self, m: _Motion, here: _Intervals, derivative: int) -> Floats:
        """Return bounds of rows in intervals, (interval, row): see `set_bounds`."""
        width, rates = here.width[:, np.newaxis], np.repeat(m.orders * m.Omega, 2)
        count, pairs = here.width.size, self._driven.pairs
        out = np.zeros((count, m.forms.shape[1]))
        own = np.empty((count, 2 * pairs.alpha.size))
        set_bounds(pairs.flow, here.start, here.width, derivative, own)
        out[:, TRENDS : TRENDS + own.shape[1]] = own
        waves = out[:, TRENDS + own.shape[1] :]
        if derivative == _BENDS:
            out[:, TRENDS - 1] = here.width**2 / 8.0
            waves[:] = np.where(rates * width > FAST, 2.0, (rates * width) ** 2 / 8.0)
        else:
            waves[:] = rates**3
        return out


def _flat(z: Floats) -> Floats:
    """Return both numbers of pairs by turns, as forms have them, (time, 2 pair)."""
    return np.asarray(z.transpose(0, 2, 1).reshape(len(z), -1))


def _raise(known: Floats, dof: Integers, x: Floats) -> None:
    """Raise what is known by displacements."""
    np.maximum.at(known[0], dof, x)
    np.maximum.at(known[1], dof, -x)


def _products(rows: Floats, forms: Floats, place: Integers, dof: Integers) -> Floats:
    """Return ``rows[place] . forms[dof]`` of each candidate."""
    out = np.empty(place.size)
    chosen_products(rows, forms, place, dof, out)
    return out
