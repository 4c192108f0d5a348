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
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import EPS, Booleans, Floats, Integers
from vibroimpact_solvers.kernels.circle import circle_roots
from vibroimpact_solvers.kernels.periodic import Response
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.problem import Impact
from vibroimpact_solvers.periodic_motions.solutions import PI, Cells, Solutions

_ROUNDINGS = 2.0 * EPS  # of a few real operations, or of a complex product
_ZERO = 16.0 * EPS  # more than `circle_roots` takes for zero, relative to the terms
_ROOM = 4096  # roots that are found at once
WIDE = 4.0 * float(np.finfo(np.longdouble).eps)  # of an angle and a sum in the wider type

Wide = NDArray[np.longdouble]


def solutions(driven: Driven, cells: Cells, impact: Impact) -> tuple[Solutions, Booleans]:
    """Return all solutions with one impact per cell, shape (solution, 1) each.

    Also whether none can be missing at a frequency, shape (frequency,): there may be more where
    what an impact takes is not known to its sign, or where two solutions are about to meet.
    """
    a, side = impact.constraint, impact.side
    k = driven.structure.system.constraints[a].restitution
    form, slope = driven.position[a], driven.velocity[a]
    kicks = driven.kick[a : a + 1]
    each = driven.pairs.impulse_response(cells.length, cells.rest, cells.sign, kicks)
    response = Response(*(part[:, 0] for part in each))
    more = 2.0 * driven.shape_error + driven.summed
    g, g_error, rate, rate_error = driven.pairs.seen(form, slope, response, more)
    floor = np.zeros((cells.length.size, 0))
    if driven.mixing:
        floor = driven.mixing.of_response(cells.length, cells.sign, kicks, each.after)[:, 0]
        for of, (error, seen_by) in enumerate(((g_error, form), (rate_error, slope))):
            sizes = np.linalg.norm((response.after, response.before)[of], axis=1)
            bounded = np.where(np.isfinite(sizes), sizes, 0.0)  # else there is no solution
            error += bounded @ driven.doubts[of, a] + floor @ np.linalg.norm(seen_by, axis=0)
    mu = driven.mobility[a, a]
    level = driven.level[a]
    wall = driven.walls[1 if side > 0 else 0, a] - level
    wall_error = driven.level_error[a] + EPS * abs(wall)
    denominator = mu + (1.0 + k) * rate
    doubt = (1.0 + k) * rate_error + _ROUNDINGS * (mu + (1.0 + k) * np.abs(rate))
    with np.errstate(divide="ignore", invalid="ignore"):
        c = -(1.0 + k) / denominator
    held = cells.sign < 0.0 or not driven.free[a]  # else see `falling`
    if driven.harmonics.size == 0:
        moving = held & np.isfinite(g) & (g != 0.0) & (wall != 0.0)  # at gap 0 only rest
        index = np.flatnonzero(moving & (np.abs(denominator) <= doubt))
        phase = np.zeros(index.size)
        p = wall / g[index]
        p_error = np.abs(p) * (g_error / np.abs(g) + _ROUNDINGS)[index]
        p_error += wall_error / np.abs(g[index])
        phase_error = np.zeros(index.size)
        complete = np.ones(g.size, dtype=bool)
    else:
        Y = np.einsum("sj,fhsj->fh", form, cells.steady)
        Y_error = cells.seen_error(
            driven,
            form[np.newaxis],
            driven.doubts[0, a : a + 1],
            2.0 * driven.shape_error + driven.summed,
        )[..., 0]
        turning = cells.Omega[:, np.newaxis] * driven.harmonics
        with np.errstate(invalid="ignore"):
            Q = Y * (1.0 + 1j * turning * (c * g)[:, np.newaxis])
        clear = held & np.isfinite(Q).all(axis=1) & (np.abs(denominator) > doubt)
        law = _Law(
            cells.Omega, driven.harmonics, Y, Y_error, g, g_error, c, doubt / (1.0 + k),
            wall, wall_error,
        )  # fmt: skip
        walls = np.full(g.size, wall)
        index, rough = roots(Q, walls, driven.harmonics, clear)
        complete = clear & (np.abs(denominator) > 2.0 * doubt)
        complete &= ~about_to_meet(Q, walls, driven.harmonics, law.largest_doubt(), complete)
        complete |= not held  # one impact a period moves a free body on
        law = law.at(index)
        phase, p, phase_error, p_error = law.solved(rough)
    velocity = -p * mu / (1.0 + k)
    state = response.after[index]
    state *= p[:, np.newaxis, np.newaxis]
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(p == 0.0, 0.0, p_error / np.abs(p))
    velocity_error = p_error * mu / (1.0 + k) + np.abs(velocity) * (2.0 * driven.shape_error + EPS)
    one = np.newaxis  # impact, or free motion
    return Solutions(
        index, phase[:, one], p[:, one], velocity[:, one], state[:, one],
        cells.length[index, one], phase_error[:, one], p_error[:, one], velocity_error[:, one],
        response.error[index] + more, relative, floor[index] * np.abs(p)[:, np.newaxis],
    ), complete  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class _Law:
    """The two equations of impacts, ``y + g p = wall`` and ``p / c = y'``, with their errors.

    Parameters
    ----------
    Omega : array, shape (row,)
        Rows are frequencies, or the solutions at them.
    harmonics : array, shape (harmonic,)
    Y, Y_error : array, shape (row, harmonic)
    g, g_error, c, inertia_error : array, shape (row,)
        The error is that of 1 / c.
    wall, wall_error : float
    """

    Omega: Floats
    harmonics: Floats
    Y: Complexes
    Y_error: Floats
    g: Floats
    g_error: Floats
    c: Floats
    inertia_error: Floats
    wall: float
    wall_error: float

    def at(self, index: Integers) -> _Law:
        """Return some of the rows, each as often as it is listed."""
        fields = ("Omega", "Y", "Y_error", "g", "g_error", "c", "inertia_error")
        return replace(self, **{name: getattr(self, name)[index] for name in fields})

    def doubts(self, impulses: Floats) -> tuple[Floats, Floats]:
        """Return the errors of both equations where impulses are of these magnitudes, (row,)."""
        turning = self.Omega[:, np.newaxis] * self.harmonics
        at_wall = self.Y_error.sum(axis=1) + impulses * self.g_error + self.wall_error
        return at_wall, (turning * self.Y_error).sum(axis=1) + impulses * self.inertia_error

    def largest_doubt(self) -> Floats:
        """Return the error of the equation of phases, whatever the phase is, shape (row,).

        It holds where c is half of the true one, too.
        """
        with np.errstate(invalid="ignore"):
            turning = self.Omega[:, np.newaxis] * self.harmonics
            at_wall, of_law = self.doubts(np.abs(self.c) * (turning * np.abs(self.Y)).sum(axis=1))
            return np.asarray(2.0 * (at_wall + np.abs(self.c * self.g) * of_law))

    def along(self, phases: Wide) -> tuple[Wide, Wide, Wide]:
        """Return y, y' and the derivative of y' by the phase, without rounding of angles."""
        angles = phases[:, np.newaxis] * self.harmonics
        terms = self.Y * (np.cos(angles) + 1j * np.sin(angles))
        turning = self.Omega[:, np.newaxis] * self.harmonics
        y, v = terms.real.sum(axis=1), -(turning * terms.imag).sum(axis=1)
        return y, v, -(turning * self.harmonics * terms.real).sum(axis=1)

    def solved(self, rough: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return phases and impulses near approximate phases, and their errors.

        One step of Newton's method. The phase's error is told by the bound of the second
        derivative, as two solutions may be about to meet; that of the impulse by the linear
        equations of both errors elsewhere, as phases that are late need not be wrong impulses.
        """
        h, Omega, c, g = self.harmonics, self.Omega, self.c, self.g
        turning, size = Omega[:, np.newaxis] * h, np.abs(self.Y)
        wide = rough.astype(np.longdouble)
        near = self.along(wide)
        value = (near[0] + g * c * near[1] - self.wall).astype(np.float64)
        slope = (near[1] / Omega + c * g * near[2]).astype(np.float64)
        terms = size * np.hypot(1.0, turning * (c * g)[:, np.newaxis])
        bend = terms @ h**2
        step = newton_step(value, slope, bend)
        wide = wide + step
        v, a = (part.astype(np.float64) for part in self.along(wide)[1:])
        p = c * v
        at_wall, of_law = self.doubts(np.abs(p))
        at_wall += WIDE * (abs(self.wall) + terms @ (1.0 + 2.0 * np.pi * h))
        at_wall += left_over(value, step, bend)
        doubt = at_wall + np.abs(c * g) * of_law
        late = lateness(slope, bend, doubt)
        with np.errstate(divide="ignore", invalid="ignore"):
            turned = np.abs(a) + (size * turning) @ h**2 * late
            error = np.abs(c) * (of_law + turned * late)
            linear = np.abs(c) * (turned * at_wall + np.abs(v / Omega) * of_law) / np.abs(slope)
        clear = slope**2 > 16.0 * bend * doubt  # the slope stays what it is to an eighth
        error = np.where(clear, np.minimum(error, 1.25 * linear), error)
        return turned_back(wide, h), p, late + 4.0 * EPS, error + EPS * np.abs(p)


def newton_step(value: Floats, slope: Floats, bend: Floats) -> Floats:
    """Return the step of Newton's method for a root; 0 near a double one, where it may be wide.

    value and slope are those of the function, `bend` bounds its second derivative.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(slope**2 > 4.0 * bend * np.abs(value), -value / slope, 0.0)


def left_over(value: Floats, step: Floats, bend: Floats) -> Floats:
    """Return a bound of the function's value after `newton_step`."""
    return np.where(step == 0.0, np.abs(value), 0.5 * bend * step**2)


def lateness(slope: Floats, bend: Floats, doubt: Floats) -> Floats:
    """Return how far a root may be away, where the function is not known better than `doubt`.

    Near a double root that follows from the bound of the second derivative.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        square = slope**2 - 2.0 * bend * doubt
        return np.where(
            square > 0.0,
            2.0 * doubt / (np.abs(slope) + np.sqrt(np.maximum(square, 0.0))),
            2.0 * np.sqrt(2.0 * doubt / bend) + np.abs(slope) / bend,
        )


def turned_back(phases: Wide, harmonics: Floats) -> Floats:
    """Return phases within the period in which all harmonics repeat themselves."""
    period = 2 * PI / math.gcd(*harmonics.astype(np.int64).tolist())
    return np.mod(phases, period).astype(np.float64)


def roots(
    Q: Complexes, wall: Floats, harmonics: Floats, clear: Booleans
) -> tuple[Integers, Floats]:
    """Return the frequencies and about the phases of all roots of ``Re sum Q_h e^(ih) = wall``.

    Each root once: where all harmonics are multiples of a number, the load repeats itself within
    the period of the drive, and so do the roots.
    """
    common = math.gcd(*harmonics.astype(np.int64).tolist())
    orders = harmonics / common
    if orders.size == 1:
        index, phase = _two(Q[:, 0], wall, clear)
    else:
        index, phase = _many(Q, wall, orders.astype(np.int64), clear)
    return index, phase / common


def about_to_meet(
    Q: Complexes, wall: Floats, harmonics: Floats, doubt: Floats, clear: Booleans
) -> Booleans:
    """Return where ``Re sum Q_h e^(ih)`` has an extreme within the doubt of the wall, (frequency,).

    Two roots are there, or none. Only frequencies that are `clear` are looked at.
    """
    size = np.abs(Q).sum(axis=1)
    doubt = doubt + _ZERO * (np.abs(wall) + np.abs(Q) @ (1.0 + 2.0 * np.pi * harmonics))
    if harmonics.size == 1:
        return np.asarray(clear & (np.abs(size - np.abs(wall)) <= doubt))
    near = np.abs(wall) <= doubt + size
    near &= clear
    index, phase = roots(1j * harmonics * Q, np.zeros(wall.size), harmonics, near)
    turned = np.exp(1j * phase[:, np.newaxis] * harmonics)
    extreme = (Q[index] * turned).real.sum(axis=1)
    meeting = near & (size <= doubt)
    meeting[index[np.abs(extreme - wall[index]) <= doubt[index]]] = True
    return np.asarray(meeting)


def _two(Q: Complexes, wall: Floats, clear: Booleans) -> tuple[Integers, Floats]:
    """Return the frequencies and the phases of the roots of ``|Q| cos(arg Q + phase) = wall``."""
    size = np.abs(Q)
    reached = np.flatnonzero(clear & (size >= np.abs(wall)) & (size > 0.0))
    half = np.arccos(wall[reached] / size[reached])
    turn = -np.angle(Q[reached])
    return np.repeat(reached, 2), np.stack([turn - half, turn + half], axis=1).ravel()


def _many(Q: Complexes, wall: Floats, orders: Integers, clear: Booleans) -> tuple[Integers, Floats]:
    """Return the frequencies and phases of the roots, ascending at each, of several orders."""
    size = np.abs(Q).sum(axis=1)
    at = np.flatnonzero(clear & (size >= np.abs(wall)) & (size > 0.0))
    each, walls = Q[at] / size[at, np.newaxis], wall[at] / size[at]
    room = max(2 * int(orders[-1]), _ROOM)
    index, phases = np.empty(room, np.int64), np.empty(room)
    parts, begin = [(np.empty(0, np.int64), np.empty(0))], 0
    while begin < at.size:
        begin, count = circle_roots(each, orders, walls, begin, index, phases)
        parts.append((at[index[:count]], phases[:count].copy()))
    indices, roots = (np.concatenate(part) for part in zip(*parts, strict=True))
    roots = np.mod(roots, 2.0 * np.pi)
    order = np.lexsort((roots, indices))
    return indices[order], roots[order]
