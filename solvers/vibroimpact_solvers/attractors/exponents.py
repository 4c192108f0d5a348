r"""The largest Lyapunov exponent of observed motions, by their linearised motion.

A deviation moves between impacts like the structure without load, and jumps at each impact by the
saltation matrix (`periodic_motions.multipliers`)

    S = 1 - f kick (x) slope + f (a-/v- kick - A kick) (x) form,    f = (1 + k)/mu.

Impacts are those of the time history, and so is the motion: what is left of its state at the
beginning, and what the impulses since then made of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.attractors.growth import Exponents, Lengths
from vibroimpact_solvers.attractors.observed import Observed
from vibroimpact_solvers.attractors.problem import Problem
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.solutions import Cells

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


class OfImpacts(Exponents):
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
        self._driven = driven = Driven.of(motions, spectrum.choose(problem.system))
        self._cells = cells = Cells.of(driven, motions)
        pairs, moving = driven.pairs, driven.pairs.moving
        super().__init__(problem, pairs, driven.scale)
        self._own = np.zeros(pairs.alpha.size)
        self._own[moving] = 1.0
        restitution = np.array([c.restitution for c in problem.system.constraints])
        self._factor = (1.0 + restitution) / np.diagonal(driven.mobility)
        self._kick_rate = pairs.rate(driven.kick)
        self._bend = driven.rates_of(driven.velocity)
        turning = float(cells.Omega[0]) * driven.harmonics
        Y = np.einsum("isj,hsj->ih", driven.position, cells.steady[0])
        self._pull = -(turning**2) * Y  # accelerations of coordinates by the load
        rng = np.random.default_rng(0)
        self._deviation = rng.standard_normal((2, pairs.alpha.size)) * self._own

    def lengths(self, motions: Sequence[Observed], report: Callable[[], None]) -> Floats:
        """Return logarithms of the lengths of deviations, shape (motion, section)."""
        events, driven, count = self._events(motions), self._driven, len(motions)
        z = self._free_states(motions)
        w = np.broadcast_to(self._deviation, z.shape).copy()
        lengths = Lengths(count, self._problem.observe + 1)
        before = np.zeros(count)
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
            lengths.shorten(done, w, np.sqrt((w[done] ** 2 * self._own).sum(axis=(1, 2))))
        return lengths.logs

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
