"""Periodic motions of which the stop is loaded for a given duration, whatever its force is.

With the duration d and the drive's phase theta at the beginning as they please, there is one
periodic motion. Its deviation at the beginning from the steady response of the open structure is

    a = s + Re(c e^(i theta)) ,    M(d) c = sign F0(T - d) P10 (F1(d) D - D e^(i Omega d)) ,

with the flows F0 and F1 of the open and the loaded structure, P10 what takes states from the
latter to the former, D the difference of both steady responses, and
``M = 1 - sign F0(T - d) P10 F1(d) P01``. As the loaded structure is the open one with the force f
at one coordinate, ``dM/dd = u v^T`` has rank one: u is the response of the open structure to an
impulse at the end of the phase, v the force at its end by the state at its beginning. So

    d(c, s)/dd = -M^-1 u (force at the end),

and a coordinate at the beginning is stationary in d where the force at the end is zero.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.problem import Problem
from vibroimpact_solvers.periodic_motions.stops.phases import Phases, Side

GONE: Final = 36.0  # e-folds after which a mode has decayed below rounding
_NUMBERS: Final = 2**21  # of matrices that are there at once
_TOGETHER: Final = 128  # motions, between two looks at the stop signal


@dataclass(frozen=True, eq=False, slots=True)
class Cells:
    """Periods at some frequencies, or their halves, in the basis' units.

    Parameters
    ----------
    Omega, length : array, shape (frequency,)
    sign : float
        -1 where the next cell mirrors this one, else 1.
    opened, loaded : array, shape (frequency, harmonic, 2 pair), complex
        Amplitudes of the steady responses.
    jump : array, shape (frequency, harmonic, 2 pair), complex
        Difference of both, as a state of the loaded structure.
    factor : array, shape (frequency, harmonic)
        Of the amplitudes of the load.
    """

    Omega: Floats
    length: Floats
    sign: float
    opened: Complexes
    loaded: Complexes
    jump: Complexes
    factor: Floats

    @classmethod
    def of(cls, phases: Phases, problem: Problem) -> Cells:
        """Return the cells of a problem's frequencies."""
        periods = 0.5 * problem.periods if problem.symmetric else float(problem.periods)
        Omega = problem.Omega / phases.scale
        rates = Omega[:, np.newaxis] * phases.harmonics
        factor = problem.Omega[:, np.newaxis] ** phases.powers

        def steady(side: Side) -> Complexes:
            response, _ = side.pairs.steady_response(rates, side.load)
            return np.asarray(response.reshape(*rates.shape, -1) * factor[..., np.newaxis])

        opened, loaded = steady(phases.open), steady(phases.loaded)
        jump = opened @ phases.to_loaded.T - loaded
        sign = -1.0 if problem.symmetric else 1.0
        length = periods * 2.0 * math.pi / Omega
        return cls(Omega, length, sign, opened, loaded, jump, factor)


@dataclass(frozen=True, eq=False, slots=True)
class Prescribed:
    """Motions of prescribed durations d at frequencies, in pieces of few modes.

    Parameters
    ----------
    index : array of int, shape (motion,)
        The frequency.
    d : array, shape (motion,)
    live, live_loaded : array of int
        Numbers of states that have not decayed in the open and in the loaded phase of all of them.
    inverse : array, shape (motion, live, live)
        Of M.
    a : array, shape (motion, 1 + harmonic, live), complex
        The constant part s and the amplitudes c of the state at the beginning.
    u : array, shape (motion, live)
    v : array, shape (motion, live_loaded)
        The force at the end by the loaded state at the beginning.
    """

    index: Integers
    d: Floats
    live: Integers
    live_loaded: Integers
    inverse: Floats
    a: Complexes
    u: Floats
    v: Floats

    def at(self, which: Integers) -> Prescribed:
        """Return some of the motions."""
        return Prescribed(
            self.index[which], self.d[which], self.live, self.live_loaded,
            self.inverse[which], self.a[which], self.u[which], self.v[which],
        )  # fmt: skip


def pieces(phases: Phases, cells: Cells, index: Integers, d: Floats) -> list[Integers]:
    """Return motions grouped such that matrices of a group are small: indices of each group."""
    live = live_counts(phases, cells, index, d)
    order = np.lexsort((d, live))
    groups: list[Integers] = []
    first = 0
    while first < order.size:
        size = max(8, int(live[order[first]]))
        last = first
        most = min(_TOGETHER, max(1, _NUMBERS // (size * max(size, 2 * phases.loaded.size))))
        while last < order.size and live[order[last]] <= 2 * size and last - first < most:
            last += 1
        groups.append(order[first:last])
        first = last
    return groups


def live_counts(phases: Phases, cells: Cells, index: Integers, d: Floats) -> Integers:
    """Return the numbers of modes that have not decayed in the open phase, (motion,)."""
    rest = cells.length[index] - d
    own = phases.open.growth[phases.open.pairs.moving]
    return np.asarray((own * rest[:, np.newaxis] > -GONE).sum(axis=1))


def _live(side: Side, times: Floats) -> Integers:
    """Return the numbers of states that have not decayed after the shortest of some times."""
    moving = side.pairs.moving
    shortest = float(times.min()) if times.size else 0.0
    live = moving[side.growth[moving] * shortest > -GONE]
    return np.concatenate([live, live + side.size])


def apply(flow: tuple[Floats, ...], z: Floats) -> Floats:
    """Return flat states after the times of a flow, (motion, …, 2 pair)."""
    n = flow[0].shape[-1]
    even, odd, back = (part.reshape(len(part), *[1] * (z.ndim - 2), n) for part in flow)
    first, second = z[..., :n], z[..., n:]
    return np.concatenate([even * first + odd * second, even * second + back * first], axis=-1)


def apply_form(flow: tuple[Floats, Floats, Floats], form: Floats) -> Floats:
    """Return flat forms of states before a flow, of those after it, (motion, 2 pair)."""
    even, odd, back = flow
    first, second = np.split(form, 2)
    return np.concatenate([first * even + second * back, first * odd + second * even], axis=-1)


def motions(phases: Phases, cells: Cells, index: Integers, d: Floats) -> Prescribed:
    """Return the motions of prescribed durations; all of them at once, see `pieces`."""
    look()
    opened, loaded = phases.open, phases.loaded
    rest = cells.length[index] - d
    F0, F1 = opened.propagators(rest), loaded.propagators(d)
    live, live_loaded = _live(opened, rest), _live(loaded, d)
    n, m = live.size // 2, live_loaded.size // 2
    few0 = tuple(part[:, live[:n]] for part in F0)
    few1 = tuple(part[:, live_loaded[:m]] for part in F1)
    # F1 P01, then P10 of it, then F0
    to = phases.to_loaded[np.ix_(live_loaded, live)]
    back = phases.to_open[np.ix_(live, live_loaded)]
    even, odd, other = (part[..., np.newaxis] for part in few1)
    through = np.concatenate([even * to[:m] + odd * to[m:], even * to[m:] + other * to[:m]], axis=1)
    product = back @ through
    even, odd, other = (cells.sign * part[..., np.newaxis] for part in few0)
    M = -np.concatenate(
        [even * product[:, :n] + odd * product[:, n:],
         even * product[:, n:] + other * product[:, :n]], axis=1,
    )  # fmt: skip
    M[:, np.arange(2 * n), np.arange(2 * n)] += 1.0
    inverse = np.linalg.inv(M) if n else M
    jump = cells.jump[index]
    turned = np.exp(1j * (cells.Omega[index] * d)[:, np.newaxis] * phases.harmonics)
    both = np.empty((index.size, 1 + jump.shape[1], jump.shape[2]), dtype=np.complex128)
    both[:, 0], both[:, 1:] = phases.offset, jump
    ends = apply(F1, both)
    ends[:, 0] -= phases.offset
    ends[:, 1:] -= jump * turned[..., np.newaxis]
    rhs = cells.sign * apply(few0, ends @ phases.to_open[live].T)
    a = np.einsum("mij,mhj->mhi", inverse, rhs)
    unit = math.ldexp(1.0, -2 * phases.stopped.exponent)
    kick = phases.impact.side * unit * phases.open.kick[phases.impact.constraint]
    u = cells.sign * apply(F0, np.broadcast_to(kick, (index.size, kick.size)))[:, live]
    v = apply_form(F1, loaded.force)[:, live_loaded]
    return Prescribed(index, d, live, live_loaded, inverse, a, u, v)


def drift(side: Side, live: Integers, z: Floats, *, form: bool) -> Floats:
    """Return rates of live states, or forms of the rates of states, last axis (2 live pair)."""
    n = live.size // 2
    own = live[:n]
    pairs = side.pairs
    there = np.where(own < pairs.hyperbolas.stop, pairs.nu[own], 1.0)
    back = np.where(own < pairs.hyperbolas.stop, pairs.nu[own], 0.0)
    back[own < pairs.rotations.stop] *= -1.0
    if form:
        there, back = back, there
    alpha, first, second = pairs.alpha[own], z[..., :n], z[..., n:]
    return np.concatenate([alpha * first + there * second, alpha * second + back * first], axis=-1)
