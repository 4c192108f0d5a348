"""Derivatives of the state after an event by that before, with bounds of their errors.

Each is a matrix of doubles in the sizes of states and another one of the errors of its entries:
roundings, and how much the derivative varies over the enclosed motions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import flint
import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.time_history.extended.enclosure import flow
from vibroimpact_solvers.time_history.extended.free_motion import Event, FreeMotion
from vibroimpact_solvers.time_history.extended.impact_law import Blow
from vibroimpact_solvers.time_history.extended.places import Places
from vibroimpact_solvers.time_history.extended.precision import (
    Real,
    above,
    doubles,
    norm,
    undecided,
)
from vibroimpact_solvers.time_history.extended.structure import Configuration

_EPS: Final = 2.0**-52


def flow_map(free_motion: FreeMotion, sigma: Real, wide: Real) -> tuple[Floats, Floats]:
    """Return the derivative of the state after a part of the step by that at its start."""
    configuration = free_motion.configuration
    F, errors = flow(configuration.matrix, configuration.step * float(sigma.mid()))
    rounded = wide + 16.0 * _EPS * sigma  # also of the matrix
    return F, errors + _shift(configuration, np.abs(F) + errors, rounded, free_motion.now)


def _shift(configuration: Configuration, sizes: Floats, wide: Real, now: Real) -> Floats:
    """Return how a derivative changes within the time of an event."""
    late = above(wide) * configuration.step * (1.0 + 1e-9)
    most = np.abs(configuration.matrix) * late
    if float(most.sum(axis=1).max()) > 0.5:
        raise undecided("when an impact is", now)
    # exp(M) - 1 <= M/(1 - M), entry by entry.
    return np.asarray(1.01 * most @ np.abs(np.linalg.inv(np.eye(len(most)) - most)) @ sizes)


def saltation(
    configuration: Configuration,
    given: list[Blow],
    speeds: list[Real],
    state: Places,
    wide: Real,
    size: float,
    now: Real,
) -> tuple[Floats, Floats]:
    """Return the derivative of the state after the impacts by that before, and its errors.

    ``S = J_0 + (F+ - J_0 F-) grad(y)^T / (grad(y) . F-)``. Two impacts at once that do not
    change each other's velocities have the product in any order, but for accelerations in
    between, which then count as unknown.
    """
    before = state.configuration
    old, new = before.weights, configuration.weights
    acceleration = before.accelerations(state.all_q, state.all_v, state.force)
    later = configuration.accelerations(*state.all_after(configuration, given), state.force)
    place = configuration.transform(before)
    rate = place
    for blow in given:
        rate -= (configuration.T * blow.changes) * (blow.impulses * before.E)
    m, k = len(new), len(old)
    J = np.zeros((2 * m, 2 * k))
    errors = J.copy()
    J[:m, :k] = doubles(place) * new[:, np.newaxis] / old
    J[m:, k:] = doubles(rate)
    jump = later - rate * acceleration
    for blow, speed in zip(given, speeds, strict=True):
        row = doubles(before.body.row(blow.contact) * before.E)[0] / old
        struck = blow.impulses * before.E * state.all_v
        step = -(configuration.T * blow.changes) * struck / speed
        kick = jump / speed if len(given) == 1 else flint.arb_mat(m, 1)
        g = np.concatenate([doubles(step)[:, 0] * new, doubles(kick)[:, 0]])
        J[:, :k] += np.multiply.outer(g, row)
        off = [above(w * s.rad()) for w, s in zip(new.tolist(), step.entries(), strict=True)]
        off += [above(value.rad()) for value in kick.entries()]
        if len(given) > 1:
            between = [above(a) for a in (*later.entries(), *acceleration.entries())]
            damping = 0.0 if before.C is None else norm(doubles(before.C))
            unknown = 2.0 * (math.hypot(*between) + damping * size)
            off[m:] = [unknown * above(1 / speed)] * m
        errors[:, :k] += np.multiply.outer(off, np.abs(row)) * (1.0 + 1e-9)
    errors += 16.0 * (m + k) * _EPS * np.abs(J)
    return J, errors + _shift(configuration, np.abs(J) + errors, wide, now)


def release(
    configuration: Configuration,
    events: Sequence[Event],
    state: Places,
    h: Real,
    wide: Real,
    now: Real,
) -> tuple[Floats, Floats]:
    """Return the derivative of the state after releases by that before, and its errors."""
    before = state.configuration
    m, k = len(configuration.weights), len(before.weights)
    J = np.zeros((2 * m, 2 * k))
    turn = doubles(configuration.transform(before))
    J[:m, :k] = turn * configuration.weights[:, np.newaxis] / before.weights
    J[m:, k:] = turn
    errors = 16.0 * (m + k) * _EPS * np.abs(J)
    # The forces that vanish do so within the time of the event only.
    jump = configuration.accelerations(*state.all_after(configuration), state.force)
    acceleration = before.accelerations(state.all_q, state.all_v, state.force)
    jump -= configuration.transform(before) * acceleration
    apart = np.array([0.0] * m + [above(value) for value in jump.entries()])
    for event in events:
        felt = np.zeros(2 * k)
        felt[:k] = [above(value) for value in event.watch.by_q.entries()]
        felt[:k] /= before.weights
        if event.watch.by_v is not None:
            felt[k:] = [above(value) for value in event.watch.by_v.entries()]
        errors += np.multiply.outer(apart, felt) * above(h / event.least)
    return J, errors + _shift(configuration, np.abs(J) + errors, wide, now)


def product(one: tuple[Floats, Floats], other: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    """Return the product of two matrices with errors, and its errors."""
    (J, e), (F, f) = one, other
    rounding = 2.0 * max(J.shape) * _EPS
    sizes = np.abs(F) + f
    return J @ F, (e @ sizes + np.abs(J) @ (f + rounding * np.abs(F))) * (1.0 + 1e-9)
