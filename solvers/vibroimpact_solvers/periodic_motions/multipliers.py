"""Floquet multipliers: the linearised motion over one period, with the jumps at its impacts.

Between impacts deviations move like the structure without load. At an impact, with the reset
``R = 1 - (1 + k)/mu kick (x) slope`` of the state and the rates F- and F+ of the motion before and
after it, a deviation jumps by the saltation matrix

    S = R + (F+ - R F-) (x) form / v-,    v- = form . F-,

form being the struck coordinate: the deviating motion arrives earlier or later. The multipliers
are the eigenvalues of the product over one period, or the squares of those over half of it.
"""

from __future__ import annotations

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.problem import Impact, Problem
from vibroimpact_solvers.periodic_motions.solutions import Cells, Solutions


def multipliers(
    problem: Problem, driven: Driven, cells: Cells, solved: Solutions
) -> tuple[Complexes, Floats]:
    """Return the multipliers by descending modulus and their errors, (solution, multiplier)."""
    moving = driven.pairs.moving
    count, size = solved.index.size, 2 * moving.size
    values = np.empty((count, size), dtype=np.complex128)
    errors = np.empty((count, size))
    legs = driven.pairs.propagators(np.ascontiguousarray(solved.length.ravel()))
    if not solved.phase.shape[1]:
        return _without_impacts(driven, legs, solved.length[:, :1])
    impacts = problem.impacts
    dense = _blocks(driven, legs).reshape(*solved.length.shape, size, size)
    loads = cells.at(solved.index).load_state(driven, solved.phase)
    turned = np.exp(1j * solved.phase[..., np.newaxis] * driven.harmonics)
    pushes = np.einsum("smh,hpj->smpj", turned, driven.load).real
    drift = np.tile(driven.pairs.drift[moving], 2)
    for row in range(count):
        whole, doubt = np.eye(size), np.zeros((size, size))
        for place, impact in enumerate(impacts):
            after = solved.state[row, place] + loads[row, place]
            jump, jump_error = _saltation(
                driven, impact, after, pushes[row, place],
                solved.impulse[row, place], solved.velocity[row, place],
                solved.velocity_error[row, place], solved.state_error[row],
            )  # fmt: skip
            # From after the impact before, by the free motion, through this impact.
            leg = dense[row, place - 1]
            leg_error = np.abs(leg) * (_ROUNDINGS + drift * solved.length[row, place - 1])
            step = cells.sign * jump @ leg
            inexact = (jump_error + _ROUNDINGS * np.abs(jump)) @ np.abs(leg)
            inexact += np.abs(jump) @ leg_error
            doubt = np.abs(step) @ doubt + inexact @ np.abs(whole)
            whole = step @ whole
        values[row], errors[row] = _eigenvalues(whole, doubt)
        if problem.symmetric:
            errors[row] *= 2.0 * np.abs(values[row]) + errors[row]
            values[row] = values[row] ** 2
        order = np.argsort(-np.abs(values[row]), kind="stable")
        values[row], errors[row] = values[row, order], errors[row, order]
    return values, errors


_ROUNDINGS = 8.0 * EPS


def _without_impacts(driven: Driven, legs: Floats, length: Floats) -> tuple[Complexes, Floats]:
    """Return the multipliers of the structure by itself, those of its modes."""
    pairs = driven.pairs
    even, odd = legs[:, 0].astype(np.complex128), legs[:, 1].astype(np.complex128)
    odd[:, pairs.rotations] *= 1j
    odd[:, pairs.parabolas] = 0.0
    values = np.concatenate([(even + odd)[:, pairs.moving], (even - odd)[:, pairs.moving]], axis=1)
    drift = np.tile(pairs.drift[pairs.moving], 2)
    errors = np.abs(values) * (_ROUNDINGS + drift * length)
    order = np.argsort(-np.abs(values), axis=1, kind="stable")
    return np.take_along_axis(values, order, axis=1), np.take_along_axis(errors, order, axis=1)


def _blocks(driven: Driven, propagators: Floats) -> Floats:
    """Return propagators as matrices (time, 2 mode, 2 mode) of the pairs that move."""
    moving = driven.pairs.moving
    n = moving.size
    unit = np.zeros((2, 2, driven.pairs.alpha.size))
    unit[0, 0] = unit[1, 1] = 1.0
    columns = [driven.pairs.move(propagators, unit[k])[..., moving] for k in range(2)]
    dense = np.zeros((propagators.shape[0], 2, n, 2, n))
    place = np.arange(n)
    for k, column in enumerate(columns):
        for row in range(2):
            dense[:, row, place, k, place] = column[:, row]
    return dense.reshape(propagators.shape[0], 2 * n, 2 * n)


def _saltation(
    driven: Driven,
    impact: Impact,
    after: Floats,
    push: Floats,
    impulse: float,
    velocity: float,
    velocity_error: float,
    state_error: Floats,
) -> tuple[Floats, Floats]:
    """Return the saltation matrix of an impact and the errors of its entries."""
    a, pairs = impact.constraint, driven.pairs
    k = driven.structure.system.constraints[a].restitution
    kick, slope, form = (
        part[a][:, pairs.moving].ravel() for part in (driven.kick, driven.velocity, driven.position)
    )
    before = after - impulse * driven.kick[a]
    leaving, arriving = (
        (pairs.rate(state) + push)[:, pairs.moving].ravel() for state in (after, before)
    )
    factor = (1.0 + k) / driven.mobility[a, a]
    jump = leaving - arriving + factor * float(slope @ arriving) * kick
    reset = np.eye(kick.size) - factor * np.outer(kick, slope)
    with np.errstate(divide="ignore", invalid="ignore"):
        late = np.outer(jump, form) / velocity
        relative = abs(velocity_error / velocity) + EPS * 16.0
    scales = pairs.speed[pairs.moving] + np.abs(pairs.alpha[pairs.moving])
    inexact = np.abs(after)[:, pairs.moving] * scales * state_error[pairs.moving]
    inexact = inexact + 16.0 * EPS * np.abs(push)[:, pairs.moving]
    spread = 2.0 * inexact.ravel() + factor * float(np.abs(slope) @ inexact.ravel()) * np.abs(kick)
    with np.errstate(divide="ignore", invalid="ignore"):
        late_error = np.abs(late) * relative + np.outer(spread, np.abs(form)) / abs(velocity)
    reset_error = (16.0 * EPS + 2.0 * driven.shape_error) * factor * np.abs(np.outer(kick, slope))
    return reset + late, reset_error + late_error


def _eigenvalues(matrix: Floats, doubt: Floats) -> tuple[Complexes, Floats]:
    """Return the eigenvalues of a matrix and their errors to first order.

    An eigenvalue with left and right vectors y and x moves by ``|y| doubt |x| / |y . x|``; where
    they are almost at right angles, two eigenvalues are almost equal and move by a root.
    """
    if not np.isfinite(matrix).all():
        missing = np.full(matrix.shape[0], np.nan)
        return missing.astype(np.complex128), np.full(matrix.shape[0], np.inf)
    values, right = np.linalg.eig(matrix)
    doubt = doubt + _ROUNDINGS * np.abs(matrix)
    norm = float(np.linalg.norm(doubt))
    try:
        left = np.linalg.inv(right)
    except np.linalg.LinAlgError:
        return values, np.full(values.size, np.sqrt(norm * np.linalg.norm(matrix)) + norm)
    errors = ((np.abs(left) @ doubt) * np.abs(right).T).sum(axis=1)
    size = float(np.linalg.norm(matrix))
    rooted = 2.0 * np.sqrt(norm * size) + norm
    return values, np.where(errors < rooted, errors, np.maximum(rooted, 1e-3 * errors))
