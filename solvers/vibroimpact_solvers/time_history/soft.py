"""Motions with soft limiters, by splitting; steps are halved until the motion stays the same."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.kernels.flow import propagators
from vibroimpact_solvers.kernels.splitting import FLIGHTS, advance
from vibroimpact_solvers.time_history.limiters import Power
from vibroimpact_solvers.time_history.run import Tick
from vibroimpact_solvers.time_history.structure import Structure

HALVINGS: Final = 8
"""Most halvings of the step."""
_FIRST = 0.15  # of a first step, over the shortest time of the limiters
_MOST_STEPS = 1e10  # of the first run; more would not end
_AT_A_TIME = 200_000  # steps between two looks at whether anybody still waits


@dataclass(frozen=True, eq=False)
class SoftRun:
    """States at the wanted times, and how well they are known.

    Parameters
    ----------
    states : array, shape (time, 2, pair)
    compression : float
        The largest coordinate over scale times its gap.
    difference : float
        Largest difference between the states of the last two step sizes, relative to the
        largest state.
    steps : int
        Steps of the last run.
    """

    states: Floats
    compression: float
    difference: float
    steps: int


def follow(
    structure: Structure,
    law: Power,
    z: Floats,
    wanted: Floats,
    t_end: float,
    tolerance: float,
    tick: Tick | None = None,
) -> SoftRun:
    """Follow a motion with soft limiters.

    Parameters
    ----------
    structure : Structure
    law : Power
    z : array, shape (2, pair)
        Initial state.
    wanted : array, shape (time,)
        Ascending times.
    t_end : float
    tolerance : float
        Difference of states, relative to the largest, at which steps are short enough.
    tick : callable, optional
    """
    scale = math.ldexp(1.0, structure.exponent)
    times = np.append(wanted, t_end) * scale
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):  # then there is no step
        step = _first_step(structure, law, z, t_end * scale)

    def pulse() -> None:
        if tick is not None:
            tick(0, HALVINGS + 1)

    before, _, _ = _follow(structure, law, z, times, step, pulse)
    for halving in range(1, HALVINGS + 1):
        if tick is not None:
            tick(halving, HALVINGS + 1)
        step *= 0.5
        states, deepest, steps = _follow(structure, law, z, times, step, pulse)
        own = structure.scene().basis.own
        difference = float((np.abs(states - before) * own).max())
        difference /= max(float((np.abs(states) * own).max()), 1e-300)
        # Order six: the finer of two runs is about 64 times better than their difference.
        if difference <= 32.0 * tolerance:
            break
        before = states
    if tick is not None:
        tick(HALVINGS + 1, HALVINGS + 1)
    return SoftRun(states[:-1], deepest, difference, steps)


def _first_step(structure: Structure, law: Power, z: Floats, t_end: float) -> float:
    """Return a step that resolves the stiffest state that the energy at the start allows."""
    scene, sizes = structure.scene(), law.sizes(structure.system)
    x, v = structure.place(scene, z)
    system = structure.system
    energy = 0.5 * (v @ (system.M @ v) * math.ldexp(1.0, 2 * structure.exponent))
    energy += abs(0.5 * x @ (system.K @ x) - structure.force @ x)
    energy += float(law.potential(structure.W @ x, sizes))
    p = law.exponent
    size = np.where(np.isfinite(sizes), sizes, np.inf).min(axis=0)
    # stiffness size/(p+1) u^(p+1) = energy at the turn, where the slope is stiffness p u^(p-1).
    u = (energy * (p + 1.0) / (law.stiffness * size)) ** (1.0 / (p + 1.0))
    slope = law.stiffness * p / size * np.maximum(u, 1.0) ** (p - 1.0)
    rate = float(np.sqrt((slope * structure.mobility.diagonal()).max(initial=0.0)))
    return min(_FIRST / max(rate / math.ldexp(1.0, structure.exponent), 0.3), t_end)


def _follow(
    structure: Structure,
    law: Power,
    z: Floats,
    times: Floats,
    step: float,
    pulse: Callable[[], None],
) -> tuple[Floats, float, int]:
    """Return the states at some times, the deepest compression and the number of steps.

    Raises
    ------
    ConvergenceError
        Where the limiters are too stiff to be followed.
    """
    if not step * _MOST_STEPS >= times[-1]:
        message = f"the limiters are so stiff that the motion needs more than {_MOST_STEPS:g} steps"
        raise ConvergenceError(message)
    scene, sizes = structure.scene(), law.sizes(structure.system)
    basis = scene.basis
    levels = structure.level(scene)
    stiffness = law.stiffness * math.ldexp(1.0, -2 * structure.exponent)
    Z, other = z[np.newaxis].copy(), np.empty((1, *z.shape))
    states, now, deepest, steps = np.empty((times.size, *z.shape)), 0.0, 0.0, 0
    P, made = np.empty((FLIGHTS.size, 2, basis.pairs)), -1.0
    for index, time in enumerate(times):
        span = float(time - now)
        count = max(1, math.ceil(span / step)) if span > 0.0 else 0
        h = span / max(count, 1)
        if count and abs(h - made) > 1e-15 * h:
            for stage, part in enumerate(FLIGHTS):
                propagators(basis.rates, basis.split, part * h, 0.0, P[stage])
            made = h
        for first in range(0, count, _AT_A_TIME):
            if first:
                pulse()
            deepest = max(
                deepest,
                advance(
                    basis.rates, basis.split, scene.forms, levels, sizes, law.exponent, stiffness,
                    P, h, min(_AT_A_TIME, count - first), Z, other,
                ),
            )  # fmt: skip
        states[index], now, steps = Z[0], float(time), steps + count
    return states, deepest, steps
