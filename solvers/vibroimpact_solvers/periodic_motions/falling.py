r"""One impact per cell that balances a constant load on a rigid body, in closed form.

The balance of momentum gives the impulse, ``p = -F T / (w . r)``, and Newton's law the velocity at
which the load has to arrive, so that the phases are the roots of

    y_F'(theta) = -(mu / (1 + k) + g'(cell)) p,

two or none for one harmonic; the mean position of the body then puts the impact at its wall. For a
ball of mass m on a table, ``A cos(Omega t)`` high, this is
``cos(phi) = (g T / 2) (1 - k) / (1 + k) / (A Omega)``. A small amplitude has none: the table has to
be as fast as the ball loses velocity.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import EPS, Booleans, Floats
from vibroimpact_solvers.kernels.periodic import Response
from vibroimpact_solvers.periodic_motions.balance import add_offset, directions
from vibroimpact_solvers.periodic_motions.closed_form import (
    WIDE,
    about_to_meet,
    lateness,
    left_over,
    newton_step,
    roots,
    turned_back,
)
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.problem import Impact
from vibroimpact_solvers.periodic_motions.solutions import Cells, Solutions

_ROUNDINGS = 4.0 * EPS  # of a few real operations, or of a complex product


def solutions(driven: Driven, cells: Cells, impact: Impact) -> tuple[Solutions, Booleans]:
    """Return all solutions with one impact per cell, shape (solution, 1) each.

    Also whether none can be missing at a frequency, shape (frequency,).
    """
    a, balance = impact.constraint, driven.balance
    k = driven.structure.system.constraints[a].restitution
    form, slope = driven.position[a], driven.velocity[a]
    each = driven.impulse_response(cells.length, cells.rest, cells.sign, driven.kick[a : a + 1])
    response = Response(*(part[:, 0] for part in each))
    more = 2.0 * driven.shape_error + driven.summed
    g, g_error, rate, rate_error = driven.pairs.seen(form, slope, response, more)
    floor = np.zeros((cells.length.size, 0))
    if driven.mixing:
        kicks = driven.kick[a : a + 1]
        floor = driven.mixing.of_response(cells.length, cells.sign, kicks, each.after)[:, 0]
        for of, (error, seen_by) in enumerate(((g_error, form), (rate_error, slope))):
            sizes = np.abs((response.after, response.before)[of]).sum(axis=1)
            bounded = np.where(np.isfinite(sizes), sizes, 0.0)
            error += bounded @ driven.doubts[of, a] + floor @ np.abs(seen_by).sum(axis=0)
    moved = balance.moved[a]
    rate = rate - balance.trend_of(moved, moved)[0] / cells.length
    along = directions(moved[np.newaxis])[:, 0]
    p = -cells.length * float(along @ balance.push) / float(along @ moved)
    p_relative = (driven.shape_error + driven.summed) * _carried(driven, a) + _ROUNDINGS
    inertia = driven.mobility[a, a] / (1.0 + k)
    target = -(inertia + rate) * p
    doubt = np.abs(p) * (rate_error + p_relative * (inertia + np.abs(rate)))
    finite = np.isfinite(g) & np.isfinite(rate)
    h = driven.harmonics
    if h.size:
        Y = np.einsum("sj,fhsj->fh", form, cells.steady)
        Y_error = cells.seen_error(driven, form[np.newaxis], driven.doubts[0, a : a + 1], more)[
            ..., 0
        ]
        turning = cells.Omega[:, np.newaxis] * h
        V = 1j * turning * Y
        finite &= np.isfinite(V).all(axis=1)
        index, rough = roots(V, target, h, finite)
        late_by = (turning * Y_error).sum(axis=1) + doubt
        complete = finite & ~about_to_meet(V, target, h, late_by, finite)
        phase, late = _refined(V[index], target[index], h, late_by[index], rough)
        turned = np.exp(1j * phase[:, np.newaxis] * h)
        place = (Y[index] * turned).real.sum(axis=1)
        speed = np.abs(target / cells.Omega)[index] + (np.abs(Y[index]) @ h**2) * late
        place_error = Y_error[index].sum(axis=1) + speed * late
    else:  # a motion that loses nothing may begin at any time
        index = np.flatnonzero(finite & (np.abs(target) <= doubt))
        complete = finite
        phase = late = place = place_error = np.zeros(index.size)
    p = p[index]
    velocity, p_error = -p * inertia, np.abs(p) * p_relative
    state = response.after[index] * p[:, np.newaxis, np.newaxis]
    wall = driven.walls[1 if impact.side > 0 else 0, a] - driven.level[a]
    left = wall - place - g[index] * p
    offset = left[:, np.newaxis] * along / float(along @ moved)
    balance.place(state, offset)
    error = place_error + g_error[index] * np.abs(p) + np.abs(g[index]) * p_error
    error += driven.level_error[a] + _ROUNDINGS * (abs(wall) + np.abs(place) + np.abs(g[index] * p))
    pair_error = response.error[index] + more
    relative = np.full(index.size, p_relative)
    offset_error = np.abs(error[:, np.newaxis] * along / float(along @ moved))
    add_offset(pair_error, state[:, np.newaxis], balance, offset_error)
    one = np.newaxis  # impact, or free motion
    velocity_error = p_error * inertia + np.abs(velocity) * (2.0 * driven.shape_error + EPS)
    return Solutions(
        index, phase[:, one], p[:, one], velocity[:, one], state[:, one],
        cells.length[index, one], late[:, one], p_error[:, one], velocity_error[:, one],
        pair_error, relative, floor[index] * np.abs(p)[:, one],
    ), complete  # fmt: skip


def _carried(driven: Driven, a: int) -> float:
    """Return the relative error of the impulse per error of the rigid-body modes.

    It is larger than 2 where other modes have parts of the load, or of the impulse.
    """
    structure = driven.structure
    rigid = structure.shapes[:, structure.natural.roots == 0.0]
    struck, load = structure.W[a] @ rigid, structure.force @ rigid
    reached = float(np.linalg.norm(struck))
    whole = math.sqrt(float(structure.force @ structure.mass_solve(structure.force)))
    along = abs(float(struck @ load)) / reached
    return math.sqrt(float(structure.mobility[a, a])) / reached + whole / along


def _refined(
    V: Complexes, target: Floats, h: Floats, doubt: Floats, rough: Floats
) -> tuple[Floats, Floats]:
    """Return phases at which ``Re sum V_h e^(i h phase)`` is the target, and their errors.

    One step of Newton's method; near a double root the error is that of the second derivative.
    """
    size = np.abs(V)
    bend = size @ h**2

    def seen(phases: NDArray[np.longdouble]) -> tuple[Floats, Floats]:
        angles = phases[:, np.newaxis] * h
        terms = V * (np.cos(angles) + 1j * np.sin(angles))
        value = terms.real.sum(axis=1) - target
        return value.astype(np.float64), -(h * terms.imag).sum(axis=1).astype(np.float64)

    wide = rough.astype(np.longdouble)
    value, slope = seen(wide)
    step = newton_step(value, slope, bend)
    wide = wide + step
    slope = seen(wide)[1]
    doubt = doubt + WIDE * (np.abs(target) + size @ (1.0 + 2.0 * np.pi * h))
    doubt += left_over(value, step, bend)
    return turned_back(wide, h), lateness(slope, bend, doubt) + 4.0 * EPS
