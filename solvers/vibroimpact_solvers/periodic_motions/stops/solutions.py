"""Motions with one contact phase per cell: their phases, durations and states, with errors."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Booleans, Floats, Integers
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.stops import prescribed
from vibroimpact_solvers.periodic_motions.stops.isolation import Durations, Start
from vibroimpact_solvers.periodic_motions.stops.phases import Phases, Side
from vibroimpact_solvers.periodic_motions.stops.prescribed import Cells, Prescribed

_STEPS: Final = 12  # of Newton's method
_DONE: Final = 8.0 * EPS  # of the period, steps of the last one
_SAME: Final = 1e-9  # of the period, between two times of one solution
_NEAR: Final = 1e-6  # of 1, how far e^(i theta) of a root may be off
_SAMPLED: Final = 4.0  # errors over the root of the sum of squares of independent ones
_ROUNDED: Final = 4.0  # roundings of a product with a matrix


@dataclass(frozen=True, eq=False, slots=True)
class Solutions:
    """Motions with one contact phase per cell, in the basis' units.

    States are flat deviations from steady responses.

    Parameters
    ----------
    index : array of int, shape (solution,)
        The frequency.
    regained : array of bool, shape (solution,)
        Whether the phase begins with the force, under compression.
    phase : array, shape (solution,)
        The drive's at the beginning of the contact phase.
    d, rest : array, shape (solution,)
        Lengths of the contact phase and of what follows.
    entry, left : array, shape (solution, 2 pair)
        States of the open structure at the beginning and at the end of the contact phase.
    loaded, last : array, shape (solution, 2 pair)
        Those of the loaded structure.
    phase_error, d_error : array, shape (solution,)
    loaded_error, left_error : array, shape (solution, pair)
        Of both numbers of pairs at the beginnings of the phases.
    """

    index: Integers
    regained: Booleans
    phase: Floats
    d: Floats
    rest: Floats
    entry: Floats
    left: Floats
    loaded: Floats
    last: Floats
    phase_error: Floats
    d_error: Floats
    loaded_error: Floats
    left_error: Floats

    def at(self, chosen: Integers) -> Solutions:
        """Return some of the solutions."""
        return Solutions(*(getattr(self, field.name)[chosen] for field in fields(self)))


@dataclass(frozen=True, eq=False, slots=True)
class _Values:
    """What Newton's method takes of motions of given durations and phases, each (motion,)."""

    motions: Prescribed
    start: Floats  # the form at the beginning
    force: Floats  # at the end
    start_turn: Floats  # derivative by the phase
    force_turn: Floats
    start_slope: Floats  # by the duration
    force_slope: Floats
    a: Floats  # state of the open structure at the beginning, (motion, 2 pair)
    b: Floats  # of the loaded one
    turned: Complexes  # e^(i h theta), (motion, harmonic)


def solutions(
    phases: Phases, cells: Cells, start: Start, intervals: Durations
) -> tuple[Solutions, Integers]:
    """Return the motions of the intervals in which durations are.

    And frequencies at which that of an interval was not reached.
    """
    parts: list[Solutions] = []
    lost: list[Integers] = []
    for some in prescribed.pieces(phases, cells, intervals.index, intervals.d):
        index, d, sure = intervals.index[some], intervals.d[some], intervals.sure[some]
        theta, off = _phases(
            phases, cells, start, prescribed.motions(phases, cells, index, d), sure
        )
        index, d, half = np.repeat(index, 2), np.repeat(d, 2), np.repeat(intervals.half[some], 2)
        theta = theta.ravel()
        there = np.isfinite(theta)
        near = np.repeat(off < _NEAR, 2)
        for each in (near, ~near):
            now = there & each
            part, missed = polished(phases, cells, start, index[now], d[now], theta[now], half[now])
            parts.append(part)
            # An interval in which there is one root at most may have none: E is not zero there.
            lost += [missed] if each is near else []
        lost.append(index[::2][~there[::2]])
    if not parts:
        return polished(
            phases, cells, start, intervals.index[:0], intervals.d, intervals.d, intervals.d
        )
    return apart(cells, joined(parts)), np.unique(np.concatenate(lost))


def joined(parts: list[Solutions]) -> Solutions:
    """Return all solutions of some parts."""
    return Solutions(
        *(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Solutions))
    )


def _phases(
    phases: Phases, cells: Cells, start: Start, motions: Prescribed, sure: Booleans
) -> tuple[Floats, Floats]:
    """Return phases at which both forms are zero, two where one is not sure, (motion, 2).

    And how far they are from being zero at once, relative to 1, (motion,).
    """
    Q, g, R, h = forms(phases, cells, start, motions)
    Q, R = Q[:, 0], R[:, 0]
    across = (Q.conj() * R).imag
    with np.errstate(invalid="ignore", divide="ignore"):
        u = 1j * (h * Q.conj() - g * R.conj()) / across
        theta = np.full((Q.size, 2), np.nan)
        theta[:, 0] = np.angle(u)
        turn = np.arccos(np.clip(-g / np.abs(Q), -1.0, 1.0))
        theta[~sure] = (-np.angle(Q)[:, np.newaxis] + turn[:, np.newaxis] * [1.0, -1.0])[~sure]
    return np.asarray(theta / phases.harmonics[0]), np.asarray(np.abs(np.abs(u) - 1.0))


def forms(
    phases: Phases, cells: Cells, start: Start, motions: Prescribed
) -> tuple[Complexes, Floats, Complexes, Floats]:
    """Return amplitudes and constants of the forms at both ends, (motion, harmonic) and (motion,).

    They are Q and g of the beginning, R and h of the end.
    """
    index, live, loaded = motions.index, motions.live, motions.live_loaded
    to = phases.to_loaded[np.ix_(loaded, live)]
    Q = motions.a[:, 1:] @ start.form[live] + cells.opened[index] @ start.form
    g = motions.a[:, 0].real @ start.form[live] + start.level
    turned = np.exp(1j * (cells.Omega[index] * motions.d)[:, np.newaxis] * phases.harmonics)
    at_entry = motions.a[:, 1:] @ to.T + cells.jump[index][..., loaded]
    R = np.einsum("mhi,mi->mh", at_entry, motions.v)
    R = R + cells.loaded[index] @ phases.loaded.force * turned
    still = motions.a[:, 0].real @ to.T + phases.offset[loaded]
    h = (still * motions.v).sum(axis=1) + phases.loaded.force_level
    return Q, g, R, h


def _values(
    phases: Phases, cells: Cells, start: Start, index: Integers, d: Floats, theta: Floats
) -> _Values:
    """Return the forms of motions of prescribed durations, and their derivatives."""
    motions = prescribed.motions(phases, cells, index, d)
    live, loaded = motions.live, motions.live_loaded
    Q, g, R, h = forms(phases, cells, start, motions)
    harmonics = phases.harmonics
    turned = np.exp(1j * theta[:, np.newaxis] * harmonics)
    start_value, force = (Q * turned).real.sum(axis=1) + g, (R * turned).real.sum(axis=1) + h
    start_turn = (1j * harmonics * Q * turned).real.sum(axis=1)
    force_turn = (1j * harmonics * R * turned).real.sum(axis=1)
    a = np.zeros((index.size, 2 * phases.open.size))
    a[:, live] = motions.a[:, 0].real + np.einsum("mhi,mh->mi", motions.a[:, 1:], turned).real
    b = a @ phases.to_loaded.T + phases.offset
    b += np.einsum("mhi,mh->mi", cells.jump[index], turned).real
    y = np.einsum("mij,mj->mi", motions.inverse, motions.u)
    to = phases.to_loaded[np.ix_(loaded, live)]
    slope_form = prescribed.drift(phases.loaded, loaded, motions.v, form=True)
    late = turned * np.exp(1j * (cells.Omega[index] * d)[:, np.newaxis] * harmonics)
    rates = 1j * cells.Omega[index, np.newaxis] * harmonics
    push = cells.loaded[index] @ phases.loaded.force
    slope = (slope_form * b[:, loaded]).sum(axis=1) + (rates * push * late).real.sum(axis=1)
    slope -= ((y @ to.T) * motions.v).sum(axis=1) * force
    return _Values(
        motions, start_value, force, start_turn, force_turn, -(y @ start.form[live]) * force,
        slope, a, b, turned,
    )  # fmt: skip


def polished(
    phases: Phases, cells: Cells, start: Start, index: Integers, d: Floats, theta: Floats,
    reach: Floats,
) -> tuple[Solutions, Integers]:  # fmt: skip
    """Return solutions by Newton's method in both phase and duration from good starts.

    Those that leave their start by more than the reach, and some, are left out, and those that
    do not come to rest; the second value has their frequencies.
    """
    every, first, still = index, d, np.ones(d.size, dtype=bool)
    for _ in range(_STEPS):
        if not index.size:
            break
        look()
        v = _values(phases, cells, start, index, d, theta)
        across = v.start_turn * v.force_slope - v.start_slope * v.force_turn
        with np.errstate(invalid="ignore", divide="ignore"):
            turn = (-v.start * v.force_slope + v.force * v.start_slope) / across
            more = (-v.force * v.start_turn + v.start * v.force_turn) / across
        length = cells.length[index]
        good = np.isfinite(turn) & np.isfinite(more)
        good &= np.abs(d + more - first) <= 4.0 * reach + 1e-6 * length
        good &= (d + more > 0.0) & (d + more < length)
        index, d, theta = index[good], (d + more)[good], (theta + turn)[good]
        first, reach = first[good], reach[good]
        small = np.abs(more[good]) <= _DONE * length[good]
        still = (np.abs(more[good]) <= _SAME * length[good]) & (np.abs(turn[good]) <= _SAME)
        if small.all() and (np.abs(turn[good]) <= 64.0 * _DONE).all():
            break
    index, d, theta = index[still], d[still], theta[still]
    count = cells.Omega.size
    lost = np.bincount(every, minlength=count) > np.bincount(index, minlength=count)
    solved = _solved(phases, cells, start, index, d, np.mod(theta, 2.0 * np.pi))
    return solved, np.flatnonzero(lost)


def _solved(
    phases: Phases, cells: Cells, start: Start, index: Integers, d: Floats, theta: Floats
) -> Solutions:
    """Return solutions with their states and errors, which go where they should."""
    v = _values(phases, cells, start, index, d, theta)
    rest = cells.length[index] - d
    last = prescribed.apply(phases.loaded.propagators(d), v.b)
    late = v.turned * np.exp(1j * (cells.Omega[index] * d)[:, np.newaxis] * phases.harmonics)
    back = last - phases.offset
    back = back - np.einsum("mhi,mh->mi", cells.jump[index], late).real
    left = back @ phases.to_open.T
    solved = Solutions(
        index, np.full(index.size, start.regained), theta, d, rest, v.a, left, v.b, last,
        *_errors(phases, cells, start, v, index, d, last, left),
    )  # fmt: skip
    rates = 1j * cells.Omega[index, np.newaxis] * phases.harmonics * v.turned
    slope = prescribed.drift(phases.open, np.arange(2 * phases.open.size), start.form, form=True)
    rises = v.a @ slope + (rates * (cells.opened[index] @ start.form)).real.sum(axis=1)
    good = (rises > 0.0) & (v.force_slope < 0.0)
    if start.regained:
        a, side = phases.impact.constraint, phases.impact.side
        y = v.a @ phases.open.position[a]
        y += (v.turned * (cells.opened[index] @ phases.open.position[a])).real.sum(axis=1)
        good &= side * (y + phases.open.level[a]) > phases.wall
    return solved.at(np.flatnonzero(good))


def apart(cells: Cells, solved: Solutions) -> Solutions:
    """Return solutions, each of them once, by frequency and duration."""
    order = np.lexsort((solved.phase, solved.d, solved.index))
    keep: list[int] = []
    for k in order.tolist():
        length = cells.length[solved.index[k]]
        same = False
        for j in reversed(keep):
            if solved.index[j] != solved.index[k] or solved.d[k] - solved.d[j] > _SAME * length:
                break
            apart = abs(float(solved.phase[k] - solved.phase[j]))
            if min(apart, 2.0 * np.pi - apart) <= _SAME * 2.0 * np.pi:
                same = solved.regained[j] == solved.regained[k]
        if not same:
            keep.append(k)
    return solved.at(np.array(keep, dtype=np.int64))


# -- errors --


def pair_squares(side: Side, squares: Floats) -> Floats:
    """Return squared errors of both numbers of pairs, which turn into each other."""
    both = squares.reshape(*squares.shape[:-1], 2, side.size).max(axis=-2)
    return np.concatenate([both, both], axis=-1)


def squares_after(side: Side, times: Floats, z: Floats, squares: Floats) -> Floats:
    """Return squared errors of states (motion, 2 pair) after a flow, from those before."""
    grows = np.exp(np.clip(side.growth * times[:, np.newaxis], -300.0, 300.0))
    grows[:, side.pairs.parabolas] *= 1.0 + times[:, np.newaxis]
    n = side.size
    size = np.hypot(z[:, :n], z[:, n:])
    own = grows * size * (side.pairs.drift * times[:, np.newaxis] + _ROUNDED * EPS)
    grown = grows**2
    both = np.concatenate([own, own], axis=1) ** 2
    return np.asarray(np.concatenate([grown, grown], axis=1) * pair_squares(side, squares) + both)


def _errors(
    phases: Phases, cells: Cells, start: Start, v: _Values, index: Integers, d: Floats,
    last: Floats, left: Floats,
) -> tuple[Floats, Floats, Floats, Floats]:  # fmt: skip
    """Return errors of phase, duration, and of the states at the beginnings of both phases.

    Errors of single steps count as independent ones; those of the state at the beginning are what
    the equation of the period makes of them.
    """
    opened, loaded = phases.open, phases.loaded
    rest = cells.length[index] - d
    to2, open2 = phases.to_loaded**2, phases.to_open**2
    shapes = (opened.shape_error + loaded.shape_error + _ROUNDED * EPS) ** 2
    jump = np.abs(cells.jump[index]).sum(axis=1)
    steady2 = np.abs(cells.opened[index]).sum(axis=1) ** 2 @ to2.T
    steady2 += np.abs(cells.loaded[index]).sum(axis=1) ** 2
    entered = shapes * (v.a**2 @ to2.T + phases.offset**2 + jump**2 + steady2)
    ended = squares_after(loaded, d, v.b, entered) + shapes * (last**2 + jump**2 + steady2)
    back = (ended + shapes * (last**2 + phases.offset**2 + jump**2)) @ open2.T
    back += shapes * left**2
    again = squares_after(opened, rest, left, back)
    live = v.motions.live
    a2 = np.zeros_like(again)
    a2[:, live] = np.einsum("mij,mj->mi", v.motions.inverse**2, again[:, live])
    a2 += shapes * v.a**2
    steady = np.abs(cells.opened[index] @ start.form).sum(axis=1)
    still = abs(start.level) + abs(phases.wall) * float(np.abs(start.form).max() > 0.0)
    start2 = a2 @ start.form**2 + shapes * (steady**2 + v.a**2 @ start.form**2)
    start2 += (4.0 * EPS * (still + abs(start.level))) ** 2
    b2 = a2 @ to2.T + entered
    ended = squares_after(loaded, d, v.b, b2)
    push = np.abs(cells.loaded[index] @ loaded.force).sum(axis=1)
    force2 = ended @ loaded.force**2 + shapes * (push**2 + last**2 @ loaded.force**2)
    force2 += (4.0 * EPS * loaded.force_size) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        phase = np.sqrt(start2) / np.abs(v.start_turn)
        duration = (np.sqrt(force2) + np.abs(v.force_turn) * phase) / np.abs(v.force_slope)
    turning = np.einsum("mhi,mh->mi", v.motions.a[:, 1:], 1j * phases.harmonics * v.turned).real
    a2[:, live] += (turning * phase[:, np.newaxis]) ** 2
    b2 = a2 @ to2.T + entered
    back = (squares_after(loaded, d, v.b, b2) + shapes * last**2) @ open2.T + shapes * left**2
    n = opened.size

    def of(squares: Floats, side: Side) -> Floats:
        return np.asarray(_SAMPLED * np.sqrt(pair_squares(side, squares)[:, : side.size]))

    assert n == opened.size
    return _SAMPLED * phase, _SAMPLED * duration, of(b2, loaded), of(back, opened)
