r"""All solutions with one impact per cell, in closed form.

With the response g(t) to one unit impulse per cell, the coordinate at the impact is
``y = level + y_F(theta) + p g(0)``, and Newton's law gives p as a multiple of the velocity that
the load alone would cause,

    p = c y_F'(theta),   c = -(1 + k) / (mu + (1 + k) g'(cell)),   mu = w^T M^-1 w,

so that the phases theta of the impact are the roots of one trigonometric polynomial,

    level + Re sum_h Q_h e^(i h theta) = wall,   Q_h = Y_h (1 + i h Omega c g),

with the amplitudes Y_h of y_F: two or none for one harmonic, at most two for each order of the
highest. Without load, a motion keeps its energy only where mu + (1 + k) g' vanishes (k = 1 and no
damping); then p = (wall - level) / g, at any phase.
"""

from __future__ import annotations

import math

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.problem import Impact
from vibroimpact_solvers.periodic_motions.solutions import Cells, Solutions

_ROUNDINGS = 16.0 * EPS
_HALVINGS = 54  # to the last bit


def solutions(driven: Driven, cells: Cells, impact: Impact) -> Solutions:
    """Return all solutions with one impact per cell, shape (solution, 1) each."""
    a, side = impact.constraint, impact.side
    k = driven.structure.system.constraints[a].restitution
    form, slope = driven.position[a], driven.velocity[a]
    response = driven.pairs.impulse_response(cells.length, cells.rest, cells.sign, driven.kick[a])
    inexact = response.error + 2.0 * driven.shape_error
    g = np.einsum("sj,fsj->f", form, response.after)
    g_error = np.einsum("sj,fsj,fj->f", np.abs(form), np.abs(response.after), inexact)
    rate = np.einsum("sj,fsj->f", slope, response.before)
    rate_error = np.einsum("sj,fsj,fj->f", np.abs(slope), np.abs(response.before), inexact)
    mu = driven.mobility[a, a]
    wall = driven.walls[1 if side > 0 else 0, a] - driven.level[a]
    denominator = mu + (1.0 + k) * rate
    doubt = (1.0 + k) * rate_error + _ROUNDINGS * (mu + (1.0 + k) * np.abs(rate))
    with np.errstate(divide="ignore", invalid="ignore"):
        c = -(1.0 + k) / denominator
        c_error = np.abs(c) * (doubt / np.abs(denominator) + _ROUNDINGS)
    if driven.harmonics.size == 0:
        index = np.flatnonzero(np.isfinite(g) & (np.abs(denominator) <= doubt) & (g != 0.0))
        phase = np.zeros(index.size)
        p = wall / g[index]
        p_error = np.abs(p) * (g_error / np.abs(g) + _ROUNDINGS)[index]
        phase_error = np.zeros(index.size)
    else:
        Y = np.einsum("sj,fhsj->fh", form, cells.steady)
        Y_error = np.einsum(
            "sj,fhsj,fhj->fh", np.abs(form), np.abs(cells.steady),
            cells.steady_error + 2.0 * driven.shape_error,
        )  # fmt: skip
        turning = cells.Omega[:, np.newaxis] * driven.harmonics
        Q = Y * (1.0 + 1j * turning * (c * g)[:, np.newaxis])
        relative = turning * (np.abs(c) * g_error + c_error * np.abs(g))[:, np.newaxis]
        Q_error = np.abs(Y) * relative + Y_error * np.abs(
            1.0 + 1j * turning * (c * g)[:, np.newaxis]
        )
        Q_error += _ROUNDINGS * np.abs(Y) * (1.0 + turning * np.abs(c * g)[:, np.newaxis])
        clear = np.isfinite(Q).all(axis=1) & (np.abs(denominator) > doubt)
        index, phase, phase_error = _phases(
            Q, Q_error, np.full(g.size, wall), driven.harmonics, clear
        )
        turned = np.exp(1j * phase[:, np.newaxis] * driven.harmonics)
        pull = (1j * turning[index] * Y[index] * turned).real.sum(axis=1)
        bend = (turning[index] * driven.harmonics * np.abs(Y[index])).sum(axis=1)
        pull_error = (turning * Y_error)[index].sum(axis=1) + bend * phase_error
        pull_error += _ROUNDINGS * (turning * np.abs(Y))[index].sum(axis=1)
        p = c[index] * pull
        p_error = np.abs(c[index]) * pull_error + c_error[index] * np.abs(pull)
    velocity = -p * mu / (1.0 + k)
    state = p[:, np.newaxis, np.newaxis] * response.after[index]
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(p == 0.0, 0.0, p_error / np.abs(p))
    state_error = inexact[index] + relative[:, np.newaxis]
    velocity_error = p_error * mu / (1.0 + k) + np.abs(velocity) * (2.0 * driven.shape_error)
    one = np.newaxis  # impact, or free motion
    return Solutions(
        index, phase[:, one], p[:, one], velocity[:, one], state[:, one],
        cells.length[index, one], phase_error[:, one], p_error[:, one], velocity_error[:, one],
        state_error,
    )  # fmt: skip


def _phases(
    Q: Complexes, Q_error: Floats, wall: Floats, harmonics: Floats, clear: np.ndarray
) -> tuple[Integers, Floats, Floats]:
    """Return the frequencies, phases and their errors of all roots of ``Re sum Q_h e^(ih) = wall``.

    Each root once: where all harmonics are multiples of a number, the load repeats itself within
    the period of the drive, and so do the roots.
    """
    common = math.gcd(*harmonics.astype(np.int64).tolist())
    orders = harmonics / common
    if orders.size == 1:
        index, phase = _two(Q[:, 0], wall, clear)
    else:
        index, phase = _many(Q, wall, orders.astype(np.int64), clear)
    # One step of Newton's method, and the error by the bound of the second derivative.
    turned = Q[index] * np.exp(1j * phase[:, np.newaxis] * orders)
    value = turned.real.sum(axis=1) - wall[index]
    slope = -(turned.imag * orders).sum(axis=1)
    bend = (np.abs(Q[index]) * orders**2).sum(axis=1)
    size = np.abs(wall[index]) + np.abs(Q[index]).sum(axis=1)
    doubt = Q_error[index].sum(axis=1) + _ROUNDINGS * size * orders[-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        step = np.where(slope**2 > 4.0 * bend * np.abs(value), -value / slope, 0.0)
        doubt = doubt + np.where(step == 0.0, np.abs(value), 0.5 * bend * step**2)
        square = slope**2 - 2.0 * bend * doubt
        error = np.where(
            square > 0.0,
            2.0 * doubt / (np.abs(slope) + np.sqrt(np.maximum(square, 0.0))),
            2.0 * np.sqrt(2.0 * doubt / bend) + np.abs(slope) / bend,
        )
    phase = np.mod(phase + step, 2.0 * np.pi) / common
    return index, phase, (error + 4.0 * EPS) / common


def _two(Q: Complexes, wall: Floats, clear: np.ndarray) -> tuple[Integers, Floats]:
    """Return the frequencies and the phases of the roots of ``|Q| cos(arg Q + phase) = wall``."""
    size = np.abs(Q)
    reached = np.flatnonzero(clear & (size >= np.abs(wall)) & (size > 0.0))
    half = np.arccos(wall[reached] / size[reached])
    turn = -np.angle(Q[reached])
    return np.repeat(reached, 2), np.stack([turn - half, turn + half], axis=1).ravel()


def _many(
    Q: Complexes, wall: Floats, orders: Integers, clear: np.ndarray
) -> tuple[Integers, Floats]:
    """Return the frequencies and phases of the roots on the unit circle, ascending at each."""
    highest = int(orders[-1])
    indices, phases = [np.empty(0, np.int64)], [np.empty(0)]
    for k in np.flatnonzero(clear):
        polynomial = np.zeros(2 * highest + 1, dtype=np.complex128)
        polynomial[highest] = -wall[k]
        for order, amplitude in zip(orders, Q[k], strict=True):
            polynomial[highest - order] += 0.5 * amplitude
            polynomial[highest + order] += 0.5 * amplitude.conjugate()
        angles: Floats = np.angle(np.roots(polynomial)).astype(np.float64)
        roots = _real_roots(Q[k], float(wall[k]), orders, angles)
        indices.append(np.full(roots.size, k))
        phases.append(roots)
    return np.concatenate(indices), np.concatenate(phases)


def _real_roots(Q: Complexes, wall: float, orders: Integers, angles: Floats) -> Floats:
    """Return the roots of ``f = Re sum Q_h e^(i h phase) - wall`` in [0, 2 pi), by sign changes.

    The angles of the roots of the polynomial, and those in the middle between neighbours, divide
    the circle so finely that a sign change is between two of them.
    """

    def f(phase: Floats) -> Floats:
        return np.asarray((Q * np.exp(1j * phase[:, np.newaxis] * orders)).real.sum(axis=1) - wall)

    angles = np.sort(np.mod(angles, 2.0 * np.pi))
    middle = 0.5 * (angles + np.append(angles[1:], angles[0] + 2.0 * np.pi))
    low, high = middle, np.append(middle[1:], middle[0] + 2.0 * np.pi)
    below, above = f(low), f(high)
    crossed = np.signbit(below) != np.signbit(above)
    low, high, below = low[crossed], high[crossed], below[crossed]
    for _ in range(_HALVINGS):
        between = 0.5 * (low + high)
        same = np.signbit(f(between)) == np.signbit(below)
        low, high = np.where(same, between, low), np.where(same, high, between)
    return np.asarray(0.5 * (low + high))
