"""Floquet multipliers: the linearised motion over one period, with the jumps at its impacts.

Between impacts deviations move like the structure without load. At an impact, with the reset
``R = 1 - f kick (x) slope``, ``f = (1 + k)/mu``, of the state and the rates F- and F+ of the motion
before and after it, a deviation jumps by the saltation matrix

    S = R + (F+ - R F-) (x) form / v-,    v- = form . F-,

form being the struck coordinate: the deviating motion arrives earlier or later. As the impact
changes the state by a multiple of its kick alone, with the acceleration a- before it,

    S = 1 - f kick (x) slope + f (a-/v- kick - A kick) (x) form,

A kick being the rate of the kick. The multipliers are the eigenvalues of the product over one
period, or the squares of those over half of it (`kernels.floquet`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import EPS, Booleans, Floats, Integers
from vibroimpact_solvers.kernels.floquet import A_PART, B_PART, Room, refine, zeros
from vibroimpact_solvers.kernels.floquet import Cells as Cycles
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.periodic_motions import monodromy
from vibroimpact_solvers.periodic_motions.completeness import (
    complete,
    nearly_equal,
    product_of_jumps,
)
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.problem import Problem
from vibroimpact_solvers.periodic_motions.solutions import Cells, Solutions, time_between

_ROUNDINGS = 2.0 * EPS  # of a propagator, or of a product of complex numbers
_CLOSE = 1e-6  # relative distance within which approximate multipliers are refined
_LARGEST = 4  # approximations of the largest multiplier that are refined
_GONE = 184.0
"""Exponent of its decay, beside the slowest one, after which a mode is no part of multipliers.

It is e^-184 = 1e-80 of them then, and takes as much of a multiplier of `_TINY` as rounding does.
"""
_TINY = 1e-60  # of the largest multiplier: bound of those of such modes
_FADED = 60.0
"""The same exponent for the dense matrix, the eigenvectors of which would be almost parallel."""
_FAINT = 1e-20  # of the largest multiplier: bound of those of modes that fade
_POOR = 1e-7  # error of a multiplier, of the largest one, from which the dense matrix may do better
_AT_A_TIME = 64  # solutions between two looks at the meter
_MEMORY = 2**26  # bytes of the couplings that are there at once


def multipliers(
    problem: Problem, driven: Driven, cells: Cells, solved: Solutions
) -> tuple[Complexes, Floats]:
    """Return the multipliers by descending modulus and their errors, (solution, multiplier).

    Those of one modulus, as conjugate ones, by their argument: from zero to pi, then negative ones.
    The largest one alone, where the others are not requested. They are nan, and their errors
    infinite, where a motion grazes, or where they cannot be told.
    """
    every = "multipliers" in problem.outputs
    values, errors = _of_modes(driven, cells.at(solved.index))
    if solved.phase.size:
        struck = np.array([impact.constraint for impact in problem.impacts])
        walls = _Walls.of(driven, struck)
        coupled = walls.size.any(axis=(0, 1))
        alone = np.tile(~coupled, 2)
        own, doubt = _coupled(driven, walls, np.flatnonzero(coupled), cells, solved, every)
        values = np.concatenate([own, values[:, alone]], axis=1)
        errors = np.concatenate([doubt, errors[:, alone]], axis=1)
        unknown = np.isnan(own).any(axis=1)
        values[unknown], errors[unknown] = np.nan, np.inf
        if problem.symmetric:
            errors = errors * (2.0 * np.abs(values) + errors)
            values = values**2
    order = _order(values, errors)
    values, errors = np.take_along_axis(values, order, 1), np.take_along_axis(errors, order, 1)
    if every:
        return values, errors
    return values[:, :1], error_of_largest(values, errors)[:, np.newaxis]


def error_of_largest(values: Complexes, errors: Floats) -> Floats:
    """Return the error of the largest modulus, (solution,), as that of the first multiplier.

    Of several that may be the largest, the first is by its argument, not by its error.
    """
    moduli = np.abs(values)
    highest = np.max(moduli + errors, axis=1, initial=0.0) - moduli[:, 0]
    return np.asarray(np.where(np.isnan(highest), errors[:, 0], np.maximum(highest, errors[:, 0])))


def _order(values: Complexes, errors: Floats) -> Integers:
    """Return the order that `multipliers` tells, which no rounding changes."""
    moduli = np.abs(values)
    order = np.argsort(-moduli, axis=1, kind="stable")
    moduli, doubt = (np.take_along_axis(each, order, axis=1) for each in (moduli, errors))
    same = np.minimum(doubt[:, :-1] + doubt[:, 1:], _CLOSE * moduli[:, :-1])
    circle = np.zeros(order.shape, dtype=np.int64)
    np.cumsum(moduli[:, :-1] - moduli[:, 1:] > same, axis=1, out=circle[:, 1:])
    angle = np.angle(np.take_along_axis(values, order, axis=1))
    inner = np.lexsort((np.abs(angle), angle < 0.0, circle), axis=1)
    return np.asarray(np.take_along_axis(order, inner, axis=1))


def determinants(
    problem: Problem, driven: Driven, cells: Cells, solved: Solutions
) -> tuple[Floats, Floats]:
    """Return numbers with the signs of ``det(1 + Z)`` and ``det(1 - Z)``, each (solution,).

    Z is the linearised motion over the period; over half of it, mirrored, where that mirrors the
    rest. The structure by itself is damped: its part of the determinants is positive. Rigid bodies
    have a multiplier 1 by themselves, which impacts change: there all multipliers are multiplied.
    """
    look()
    struck = np.array([impact.constraint for impact in problem.impacts])
    walls = _Walls.of(driven, struck)
    coupled = np.flatnonzero(walls.size.any(axis=(0, 1)))
    jumps, late = _jumps(driven, walls, cells, solved)
    cycles = _cycles(driven, walls, coupled, cells, solved, jumps, late)
    n = 2 * struck.size
    later = np.arange(n)[:, np.newaxis] // 2 > np.arange(n) // 2
    values = []
    for rho in (-cells.sign, cells.sign):
        if rho > 0.0 and (cycles.trace == 1.0 + cycles.determinant).any():
            each = _coupled(driven, walls, coupled, cells, solved, every=True)[0]
            values.append(np.prod(1.0 - each, axis=1).real)
            continue
        inverse = 1.0 / (1.0 - rho * cycles.trace + cycles.determinant)
        sums = np.einsum("nijxp,np->xnij", cycles.terms, inverse)
        F = np.eye(n) - np.where(later, rho, 1.0) * (rho * sums[A_PART] + sums[B_PART])
        values.append(np.linalg.det(F))
    return values[0], values[1]


def _coupled(
    driven: Driven, walls: _Walls, coupled: Integers, cells: Cells, solved: Solutions, every: bool
) -> tuple[Complexes, Floats]:
    """Return multipliers of the modes that impacts couple, or the largest ones, and errors."""
    jumps, late = _jumps(driven, walls, cells, solved)
    clear: Booleans = np.asarray(np.isfinite(jumps).all(axis=(1, 2, 3)))
    count, size = solved.index.size, 2 * coupled.size
    width = size if every else min(size, _LARGEST)
    values = np.full((count, width), np.nan, dtype=np.complex128)
    errors = np.full((count, width), np.inf)
    left = np.flatnonzero(clear)
    constraints = driven.structure.system.constraints
    restitution = np.array([constraints[a].restitution for a in walls.struck.tolist()])
    each_takes = 400 * max(1, coupled.size) * walls.struck.size**2
    block = max(1, min(_AT_A_TIME, _MEMORY // each_takes))
    for start in range(0, left.size, block):
        look()
        at = left[start : start + block]
        kept = _lasting(driven, coupled, solved.at(at), _GONE)
        room = _room(kept.size, 2 * walls.struck.size)
        cycles = _cycles(driven, walls, kept, cells, solved.at(at), jumps[at], late[at])
        size, few = 2 * kept.size, min(width, 2 * kept.size)
        rough, near = np.empty((at.size, size), dtype=np.complex128), np.empty((at.size, few))
        together = nearly_equal(cycles)
        if size > monodromy.LARGEST:
            together[:] = False
        zeros(cycles, rough, room)
        every_mode = kept.size == coupled.size
        product = product_of_jumps(restitution, walls.same, jumps[at], None if every_mode else kept)
        missed = ~complete(cycles, product, rough)
        order = np.argsort(-np.abs(rough), axis=1, kind="stable")[:, :few]
        rough = np.take_along_axis(rough, order, axis=1)
        refine(cycles, _CLOSE, rough, near, room)
        near = np.where(near < np.inf, near, np.abs(rough))
        rough[missed], near[missed] = np.nan, np.inf
        poor = (near > _POOR * np.abs(rough).max(axis=1, initial=0.0, keepdims=True)).any(axis=1)
        for row in np.flatnonzero(together | missed | poor) if size <= monodromy.LARGEST else ():
            look()
            one = at[row : row + 1]
            dense = _lasting(driven, kept, solved.at(one), _FADED)
            factors = _factors(driven, walls, dense, cells, solved.at(one), jumps[one], late[one])
            each, doubt = _padded(*monodromy.eigenvalues(factors), few, _FAINT)
            if together[row] or missed[row] or doubt.max() < near[row].max():
                rough[row], near[row] = each, doubt
        for place, each, doubt in zip(at.tolist(), rough, near, strict=True):
            values[place], errors[place] = _padded(each, doubt, width, _TINY)
    return values, errors


def _lasting(driven: Driven, modes: Integers, solved: Solutions, exponent: float) -> Integers:
    """Return those of some modes of which something is left after each free motion.

    Of the others nothing is left of a deviation between two impacts: they are driven by the rest
    and drive nothing, and their multipliers vanish.
    """
    growth = driven.pairs.growth[driven.pairs.moving[modes]]
    decay = growth.max(initial=-np.inf) - growth
    return np.asarray(modes[decay * solved.length.min() < exponent])


def _padded(
    values: Complexes, errors: Floats, width: int, least: float
) -> tuple[Complexes, Floats]:
    """Return so many multipliers and errors, (width,); others are below `least` of the largest."""
    more = max(0, width - values.size)
    unknown = np.isnan(values).any()
    value, error = (np.nan, np.inf) if unknown else (0.0, least * np.abs(values).max(initial=0.0))
    values = np.concatenate([values[:width], np.full(more, value, dtype=np.complex128)])
    return values, np.concatenate([errors[:width], np.full(more, error)])


def _factors(
    driven: Driven,
    walls: _Walls,
    coupled: Integers,
    cells: Cells,
    solved: Solutions,
    jumps: Floats,
    late: Floats,
) -> monodromy.Factors:
    """Return the factors of the linearised motion of one solution."""
    pairs, modes, m = driven.pairs, driven.pairs.moving[coupled], walls.struck.size
    legs, rest = solved.length[0], np.zeros(m)
    late_by: Floats = solved.phase_error[0] / cells.Omega[solved.index]
    if m == 1:  # the period is exact
        legs, rest, late_by = cells.length[solved.index], cells.rest[solved.index], np.zeros(1)
    between = (late_by + np.roll(late_by, -1))[:, np.newaxis] * pairs.speed[modes]
    propagators = pairs.propagators(np.ascontiguousarray(legs), np.ascontiguousarray(rest))
    flows = monodromy.flows(pairs, modes, propagators)
    there = np.abs(flows[:, 0]).sum(axis=1)  # of even and odd numbers
    inexact = _inexact(driven, modes, legs) + between
    jump_errors = 2.0 * EPS * np.abs(jumps[0])
    jump_errors[:, 0, 1] += np.abs(jumps[0, :, 0, 0]) * late[0]
    shape = m, 2, 2, modes.size
    return monodromy.Factors(
        flows, there * inexact, walls.forms[..., modes].reshape(shape),
        walls.kicks[..., modes].reshape(shape), jumps[0], jump_errors,
        2.0 * (driven.shape_error + driven.vector_error) + _ROUNDINGS + driven.summed,
    )  # fmt: skip


def _room(modes: int, n: int) -> Room:
    """Return room for n rows of the determinant."""
    sums, square = np.empty((4, modes)), np.empty((3, n, n), dtype=np.complex128)
    real, imaginary, real_rate, imaginary_rate = sums
    F, slope, minor = square
    spread, (x, y) = np.empty((n, n)), np.empty((2, 2 * modes))
    return Room(real, imaginary, real_rate, imaginary_rate, F, slope, minor, spread, x, y)


def _of_modes(driven: Driven, cells: Cells) -> tuple[Complexes, Floats]:
    """Return the multipliers of the structure by itself, (cell, 2 mode)."""
    pairs, moving = driven.pairs, driven.pairs.moving
    propagators = pairs.propagators(cells.length, cells.rest)
    even, odd = propagators[:, 0].astype(np.complex128), propagators[:, 1].astype(np.complex128)
    odd[:, pairs.rotations] *= 1j
    odd[:, pairs.parabolas] = 0.0
    values = np.concatenate([(even + odd)[:, moving], (even - odd)[:, moving]], axis=1)
    return values, np.abs(values) * np.tile(_inexact(driven, moving, cells.length), 2)


def _inexact(driven: Driven, modes: Integers, period: Floats) -> Floats:
    """Return the relative errors of propagators over exact periods, (solution, mode).

    Rates are off by their drifts, and decays by the rounding of their exponents.
    """
    rates: Floats = 2.0 * driven.pairs.drift + EPS * np.abs(driven.pairs.alpha)
    return np.asarray(_ROUNDINGS + rates[modes] * period[:, np.newaxis])


class _Walls(NamedTuple):
    """What the modes do between the walls of impacts i and j: forms i, kicks j and their rates.

    The forms are those of velocity and position, in this order, and the kicks are followed by
    their rates; products have shape (2 m, 2 m, mode).
    """

    struck: Integers  # (m,)
    forms: Floats  # (2 m, 2, pair)
    kicks: Floats  # (2 m, 2, pair)
    same: Floats  # form . kick
    turned: Floats  # form . J kick, J being the odd part of a propagator
    size: Floats  # sum of the moduli of the terms of both

    @classmethod
    def of(cls, driven: Driven, struck: Integers) -> _Walls:
        """Return those of impacts on constraints, shape (m,)."""
        pairs, moving = driven.pairs, driven.pairs.moving
        kick = driven.kick[struck]
        kicks = np.stack([kick, pairs.rate(kick)], axis=1).reshape(-1, *kick.shape[1:])
        forms = np.stack([driven.velocity[struck], driven.position[struck]], axis=1)
        forms = forms.reshape(kicks.shape)
        odd = np.zeros((2, kick.shape[2]))
        odd[1] = 1.0
        turned = pairs.move(odd, kicks)
        same, other = (np.einsum("isj,ksj->ikj", forms, to)[..., moving] for to in (kicks, turned))
        size = sum(
            np.einsum("isj,ksj->ikj", np.abs(forms), np.abs(to))[..., moving]
            for to in (kicks, turned)
        )
        return cls(struck, forms, kicks, same, other, size)


def _cycles(
    driven: Driven,
    walls: _Walls,
    coupled: Integers,
    cells: Cells,
    solved: Solutions,
    jumps: Floats,
    late: Floats,
) -> Cycles:
    """Return the cells of solutions, of the modes that impacts couple."""
    pairs, modes = driven.pairs, driven.pairs.moving[coupled]
    count, m = solved.phase.shape
    own, period = np.arange(m), cells.length[solved.index]
    starts = np.cumsum(solved.length, axis=1) - solved.length
    order = own[:, np.newaxis] > own
    apart = time_between(
        starts[:, :, np.newaxis], starts[:, np.newaxis], order, period[:, np.newaxis, np.newaxis]
    )
    apart[:, own, own] = period[:, np.newaxis]
    rest = np.zeros(apart.shape)
    rest[:, own, own] = cells.rest[solved.index, np.newaxis]
    there = pairs.propagators(apart.ravel(), rest.ravel())[..., modes]
    there = there.reshape(count, m, m, 2, modes.size)
    decay = np.exp(2.0 * pairs.alpha[modes] * apart[..., np.newaxis])
    back = there.swapaxes(1, 2).copy()  # from i to j is what is left of the period from j to i
    back[:, own, own] = np.array([1.0, 0.0])[:, np.newaxis]
    back *= decay[..., np.newaxis, :]
    even, odd, back_even, back_odd = (
        part[:, :, :, k].repeat(2, axis=1).repeat(2, axis=2)
        for part in (there, back)
        for k in (0, 1)
    )
    same, turned, size = (part[..., coupled] for part in (walls.same, walls.turned, walls.size))
    plain = np.stack([even * same + odd * turned, back_odd * turned - back_even * same], axis=3)
    shape = count, 2 * m, m, 2
    terms = np.einsum("nijcxp,njcb->nijbxp", plain.reshape(*shape, 2, -1), jumps, optimize=True)
    spread = ((np.abs(even) + np.abs(odd)) * size).reshape(*shape, -1)
    doubt = np.einsum("nijcp,njcb->nijbp", spread, np.abs(jumps), optimize=True)
    doubt = doubt.reshape(count, 2 * m, 2 * m, -1)
    inexact = _inexact(driven, modes, period)
    relative = (
        inexact + 4.0 * (driven.shape_error + driven.vector_error) + _ROUNDINGS + driven.summed
    )
    # The period is exact; the times between two impacts are as inexact as their phases.
    between = solved.phase_error[:, :, np.newaxis] + solved.phase_error[:, np.newaxis]
    between /= cells.Omega[solved.index, np.newaxis, np.newaxis]
    between[:, own, own] = 0.0
    between = between.repeat(2, axis=1).repeat(2, axis=2)[..., np.newaxis] * pairs.speed[modes]
    doubt *= relative[:, np.newaxis, np.newaxis] + between
    trace, determinant = 2.0 * there[:, 0, 0, 0], decay[:, 0, 0]
    root = np.sqrt(determinant)
    return Cycles(
        np.ascontiguousarray(trace), np.ascontiguousarray(determinant),
        np.ascontiguousarray(terms.reshape(count, 2 * m, 2 * m, 2, -1)),
        np.ascontiguousarray(doubt), late,
        np.where(np.abs(trace) <= 2.0 * root, root, np.abs(trace)), inexact,
    )  # fmt: skip


def _jumps(driven: Driven, walls: _Walls, cells: Cells, solved: Solutions) -> tuple[Floats, Floats]:
    """Return the numbers of the saltation matrices, and errors of those by the acceleration.

    Returns
    -------
    jumps : array, shape (solution, m, 2, 2)
        ``S = 1 + sum_cb kick_c jump_cb form_b``, of velocity and position; infinite where a motion
        grazes.
    late : array, shape (solution, m)
        Absolute error of the acceleration by the velocity.
    """
    struck = walls.struck
    form, place = driven.rates_of(driven.velocity[struck]), driven.position[struck]
    before = solved.state - solved.impulse[..., np.newaxis, np.newaxis] * driven.kick[struck]
    inexact = solved.state_error + 2.0 * driven.shape_error + driven.summed
    own = np.einsum("isj,nisj->ni", form, before)
    error = np.einsum("isj,nisj,nj->ni", np.abs(form), driven.pairs.size(before), inexact)
    mixing = driven.mixing
    if mixing:  # what they make of the state before an impact is what they make of that after it
        error += np.einsum("nii->ni", solved.seen_error(form, mixing.of_forms(form)))
    fall = driven.balance.trend()[1, struck]
    own += fall
    error += (2.0 * driven.shape_error + _ROUNDINGS) * np.abs(fall)
    by_load = np.zeros_like(own)
    if driven.harmonics.size:
        Y = np.einsum("isj,fhsj->fih", place, cells.steady)
        more = 2.0 * driven.shape_error + driven.summed + _ROUNDINGS
        Y_error = cells.seen_error(driven, place, driven.doubts[0, struck], more).swapaxes(1, 2)
        turning = (cells.Omega[:, np.newaxis] * driven.harmonics)[:, np.newaxis]
        rates, rates_error = turning**2 * Y, turning**2 * Y_error
        turned = np.exp(1j * solved.phase[..., np.newaxis] * driven.harmonics)
        by_load = -(rates[solved.index] * turned).real.sum(axis=-1)
        error += rates_error[solved.index].sum(axis=-1)
        there = rates[solved.index] * driven.harmonics
        moves = np.abs((there * turned).imag.sum(axis=-1))
        moves += (np.abs(there) @ driven.harmonics) * solved.phase_error
        error += moves * solved.phase_error
    v = solved.velocity
    k = np.array([driven.structure.system.constraints[a].restitution for a in struck])
    factor = (1.0 + k) / driven.mobility[struck, struck]
    with np.errstate(divide="ignore", invalid="ignore"):
        bend = (own + by_load) / v
        # An error that the velocity has in common with the state is none of their quotient.
        relative = solved.velocity_error / np.abs(v)
        apart = np.maximum(0.0, relative - solved.common_error[:, np.newaxis])
        late = (error + np.abs(own) * apart + np.abs(by_load) * relative) / np.abs(v)
        late += 4.0 * EPS * np.abs(bend)
    jumps = np.zeros((*v.shape, 2, 2))
    jumps[..., 0, 0], jumps[..., 0, 1], jumps[..., 1, 1] = -factor, factor * bend, -factor
    return jumps, late
