r"""The largest Lyapunov exponent of observed motions, by their linearised motion.

A deviation moves between impacts like the structure without load, and jumps at each impact by the
saltation matrix (`periodic_motions.multipliers`)

    S = 1 - f kick (x) slope + f (a-/v- kick - A kick) (x) form,    f = (1 + k)/mu.

Impacts are those of the time history, and so is the motion: what is left of its state at the
beginning, and what the impulses since then made of it. The logarithm g of the deviation's length is
noted at the end of each period of the drive. The first quarter is left out, in which the deviation
turns towards the one that grows fastest. The exponent is the mean slope of the rest. Its error is
three times the range of g about that slope, over the time: of random steps that is 3.8 times the
standard error, and oscillations of g, which are bounded, change the mean by less.

Of regular motions, the mean of the slopes of g weighted by exp(-1/(s (1 - s))), s being the part of
the time, converges faster than any power of it. Three times its difference between both halves of
the time and the whole is the error of this mean, which tells whether an exponent is zero.

A motion without impacts has the exponent of the structure. One that rests at a wall has none: every
deviation in that coordinate ends there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.attractors.observed import Observed
from vibroimpact_solvers.attractors.problem import Problem
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.solutions import Cells

_SAFETY: Final = 3.0
_ROUNDING: Final = 1e-12  # of g, per observed period
_LOOK: Final = 64  # events between two reports
_SECTION: Final = -1  # in place of a constraint: the end of a period


@dataclass(frozen=True, eq=False, slots=True)
class _Events:
    """Impacts and ends of periods of several motions, filled up after the last one of each."""

    time: Floats  # (motion, event), from the beginning, in the basis' time
    constraint: Integers  # (motion, event)
    side: Floats
    velocity: Floats
    momentum: Floats
    count: Integers  # (motion,)


@dataclass(frozen=True, eq=False, slots=True)
class Growth:
    """Largest Lyapunov exponents of motions, and their errors; nan and inf: none.

    Parameters
    ----------
    mean, error : array, shape (motion,)
        From the mean slope.
    smooth, smooth_error : array, shape (motion,)
        From the weighted mean, for regular motions.
    """

    mean: Floats
    error: Floats
    smooth: Floats
    smooth_error: Floats


class Exponents:
    """Computes the largest Lyapunov exponents of motions of one problem.

    Parameters
    ----------
    problem : Problem

    Raises
    ------
    PlanError
        Where a constant load drives a rigid-body mode that no stop pushes back, or damping makes
        modes almost equal.
    """

    def __init__(self, problem: Problem) -> None:
        motions = problem.driven()
        self._problem = problem
        self._driven = driven = Driven.of(motions, spectrum.choose(problem.system))
        self._cells = cells = Cells.of(driven, motions)
        pairs, moving = driven.pairs, driven.pairs.moving
        self._own = np.zeros(pairs.alpha.size)
        self._own[moving] = 1.0
        self.structure = float(pairs.growth[moving].max()) * driven.scale
        """Exponent of the structure without impacts."""
        self.structure_error = float(pairs.drift[moving].max() + EPS * pairs.speed.max())
        self.structure_error *= driven.scale
        restitution = np.array([c.restitution for c in problem.system.constraints])
        self._factor = (1.0 + restitution) / np.diagonal(driven.mobility)
        self._kick_rate = pairs.rate(driven.kick)
        self._bend = driven.rates_of(driven.velocity)
        turning = float(cells.Omega[0]) * driven.harmonics
        Y = np.einsum("isj,hsj->ih", driven.position, cells.steady[0])
        self._pull = -(turning**2) * Y  # accelerations of coordinates by the load
        rng = np.random.default_rng(0)
        self._deviation = rng.standard_normal((2, pairs.alpha.size)) * self._own

    def of(self, motions: Sequence[Observed], report: Callable[[], None] | None = None) -> Growth:
        """Return the exponents of motions; calls `report` now and then, which may raise."""
        count = len(motions)
        growth = Growth(
            np.full(count, np.nan), np.full(count, np.inf),
            np.full(count, np.nan), np.full(count, np.inf),
        )  # fmt: skip
        struck = []
        for place, motion in enumerate(motions):
            if motion.rests:
                continue
            if motion.impacts.time.size:
                struck.append(place)
            else:
                growth.mean[place] = growth.smooth[place] = self.structure
                growth.error[place] = growth.smooth_error[place] = self.structure_error
        if struck:
            lengths = self._lengths([motions[k] for k in struck], report or _nobody)
            self._put(growth, np.array(struck), lengths)
        return growth

    def _put(self, growth: Growth, at: Integers, lengths: Floats) -> None:
        """Put in the exponents of motions whose deviations have these logarithms of lengths."""
        kept = lengths[:, (lengths.shape[1] - 1) // 4 :]
        period, count = self._problem.period, kept.shape[1] - 1
        with np.errstate(invalid="ignore"):
            slope = (kept[:, -1] - kept[:, 0]) / count
            about = kept - slope[:, np.newaxis] * np.arange(count + 1)
            error = _SAFETY * np.ptp(about, axis=1) / count + _ROUNDING
            steps = np.diff(kept, axis=1)
            smooth = _weighted(steps)
            halves = _weighted(steps[:, : count // 2]), _weighted(steps[:, count // 2 :])
            apart = np.maximum(*(np.abs(half - smooth) for half in halves))
        known = np.isfinite(kept).all(axis=1)  # a deviation may vanish
        growth.mean[at] = np.where(known, slope / period, np.nan)
        growth.error[at] = np.where(known, error / period, np.inf)
        growth.smooth[at] = np.where(known, smooth / period, np.nan)
        growth.smooth_error[at] = np.where(known, _SAFETY * apart / period, np.inf)

    def _lengths(self, motions: Sequence[Observed], report: Callable[[], None]) -> Floats:
        """Return logarithms of the lengths of deviations, shape (motion, section)."""
        events, driven, count = self._events(motions), self._driven, len(motions)
        z = self._free_states(motions)
        w = np.broadcast_to(self._deviation, z.shape).copy()
        lengths = np.zeros((count, self._problem.observe + 1))
        total, section, before = np.zeros(count), np.zeros(count, np.int64), np.zeros(count)
        for event in range(events.time.shape[1]):
            if event % _LOOK == 0:
                report()
            at = np.flatnonzero(event < events.count)
            time = events.time[at, event]
            flow = driven.pairs.propagators(np.ascontiguousarray(time - before[at]))
            moved = driven.pairs.move(flow, z[at])
            driven.balance.carry(moved, time - before[at])
            before[at] = time
            z[at], w[at] = moved, driven.pairs.move(flow, w[at])
            ends = events.constraint[at, event] == _SECTION
            self._strike(z, w, events, at[~ends], event)
            done = at[ends]
            with np.errstate(divide="ignore", invalid="ignore"):
                size = np.sqrt((w[done] ** 2 * self._own).sum(axis=(1, 2)))
                total[done] += np.log(size)
                w[done] /= size[:, np.newaxis, np.newaxis]
            section[done] += 1
            lengths[done, section[done]] = total[done]
        return lengths

    def _strike(self, z: Floats, w: Floats, events: _Events, at: Integers, event: int) -> None:
        """Let some motions strike: change their states and deviations in place."""
        if not at.size:
            return
        driven, a = self._driven, events.constraint[at, event]
        phase = float(self._cells.Omega[0]) * events.time[at, event]
        turned = np.exp(1j * phase[:, np.newaxis] * driven.harmonics)
        acceleration = np.einsum("msj,msj->m", self._bend[a], z[at])
        acceleration += driven.balance.trend()[1, a]
        acceleration += (self._pull[a] * turned).real.sum(axis=1)
        velocity = events.velocity[at, event]
        place = np.einsum("msj,msj->m", driven.position[a], w[at])
        slope = np.einsum("msj,msj->m", driven.velocity[a], w[at])
        factor = self._factor[a]
        with np.errstate(divide="ignore", invalid="ignore"):
            # A grazing deviates without bound: the exponent is then unknown.
            by_kick = factor * (acceleration / velocity * place - slope)
            w[at] += by_kick[:, np.newaxis, np.newaxis] * driven.kick[a]
            w[at] -= (factor * place)[:, np.newaxis, np.newaxis] * self._kick_rate[a]
        impulse = -events.side[at, event] * events.momentum[at, event]
        z[at] += impulse[:, np.newaxis, np.newaxis] * driven.kick[a]

    def _free_states(self, motions: Sequence[Observed]) -> Floats:
        """Return the states at the beginning less the response to the load, (motion, 2, pair)."""
        driven = self._driven
        unit = 1.0 / driven.scale
        configuration = replace(driven.structure.configuration(), basis=driven.basis)
        loads = configuration.basis.loads_at_start()
        states = [
            driven.structure.state_of(configuration, motion.x[0], unit * motion.v[0], loads)
            for motion in motions
        ]
        free = np.asarray(np.stack(states) - self._cells.load_state(driven, np.zeros(1))[0])
        driven.balance.creep(free, -1.0)
        return free

    def _events(self, motions: Sequence[Observed]) -> _Events:
        """Return what happens to motions in order of time, an impact before an end at once."""
        problem, scale = self._problem, self._driven.scale
        count, first = len(motions), float(problem.sections[0])
        ends = (problem.sections[1:] - first) * scale
        most = max(motion.impacts.time.size for motion in motions) + ends.size
        numbers = np.zeros((4, count, most))
        constraint = np.full((count, most), _SECTION)
        filled = np.zeros(count, dtype=np.int64)
        for row, motion in enumerate(motions):
            impacts = motion.impacts
            size = impacts.time.size + ends.size
            time = np.concatenate([(impacts.time - first) * scale, ends])
            order = np.argsort(time, kind="stable")
            still = np.zeros(ends.size)
            columns = impacts.side, impacts.velocity / scale, impacts.momentum / scale
            numbers[0, row, :size] = time[order]
            for column, values in zip(numbers[1:, row], columns, strict=True):
                column[:size] = np.concatenate([values, still])[order]
            struck = np.concatenate([impacts.constraint, np.full(ends.size, _SECTION)])
            constraint[row, :size], filled[row] = struck[order], size
        return _Events(numbers[0], constraint, numbers[1], numbers[2], numbers[3], filled)


def _nobody() -> None:
    """Report to nobody."""


def _weighted(steps: Floats) -> Floats:
    """Return means along the last axis, weighted by a bump that is flat at both ends."""
    s = (np.arange(steps.shape[-1]) + 0.5) / steps.shape[-1]
    weights = np.exp(-1.0 / (s * (1.0 - s)))
    return np.asarray(steps @ (weights / weights.sum()))


def contraction(exponent: float, duration: float) -> float:
    """Return what is left of a deviation after a time."""
    return math.exp(min(0.0, exponent * duration))
