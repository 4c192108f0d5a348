"""Durations of all contact phases: boxes over the period, cut until each shows its roots."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Booleans, Floats, Integers
from vibroimpact_solvers.kernels import durations
from vibroimpact_solvers.kernels.durations import (
    CUT,
    EMPTY,
    FEW_TERMS,
    FULL,
    RADIUS,
    TERMS,
    UNRESOLVED,
)
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.stops import prescribed
from vibroimpact_solvers.periodic_motions.stops.phases import Phases, Side
from vibroimpact_solvers.periodic_motions.stops.prescribed import Cells, Prescribed

_FIRST: Final = 8  # boxes of a period
_LEFT_OUT: Final = 1e-6
"""Part of a polynomial's size that its terms leave out on the disc, above which a box is cut
without a look at matrices."""
_FEW_LEAVE_OUT: Final = 1e-5
"""The same for polynomials of few terms, with which a box is examined first."""
_AGAIN: Final = 4  # times the number of boxes, that are examined in the end at most
_FEW: Final = 2000  # boxes of a frequency that are examined anyway
_CUBES: Final = 7e3
"""Cube of the number of modes in motion with which a box takes twice the time of one with few."""
_FINEST: Final = 1e-8  # of the period
_DOUBTFUL: Final = 1e-6  # of the period: boxes in which roots stay unresolved are not smaller
_ROOM: Final = 64  # roots of a box


@dataclass(frozen=True, eq=False, slots=True)
class Start:
    """The form that is zero where a phase begins, of states of the open structure.

    Parameters
    ----------
    regained : bool
        Whether it is the force, under compression, and not the indentation.
    form : array, shape (2 pair,)
    level : float
        Its value at the zero of states.
    """

    regained: bool
    form: Floats
    level: float


@dataclass(frozen=True, eq=False, slots=True)
class Durations:
    """Where durations may be.

    Parameters
    ----------
    index : array of int, shape (root,)
        The frequency.
    d, half : array, shape (root,)
        Middle and half width of the interval.
    sure : array of bool, shape (root,)
        Whether there is exactly one in it.
    unresolved : array, shape (frequency,)
        Part of the period of which nothing is proved.
    """

    index: Integers
    d: Floats
    half: Floats
    sure: Booleans
    unresolved: Floats


def starts(phases: Phases) -> tuple[Start, ...]:
    """Return how phases of a stop may begin."""
    a, side = phases.impact.constraint, phases.impact.side
    level = side * float(phases.open.level[a]) - phases.wall
    at_wall = Start(False, side * phases.open.position[a], level)
    if phases.damping == 0.0:
        return (at_wall,)
    return at_wall, Start(True, phases.open.force, phases.open.force_level)


@dataclass(frozen=True, eq=False, slots=True)
class Boxes:
    """Boxes over the period in which polynomials tell what moves.

    Parameters
    ----------
    index : array of int, shape (box,)
        The frequency.
    d, half : array, shape (box,)
        Middle and half width.
    left : array, shape (frequency,)
        Length of what is not in a box.
    work : array, shape (frequency,)
        About how much work they are, in boxes of few modes.
    """

    index: Integers
    d: Floats
    half: Floats
    left: Floats
    work: Floats

    @classmethod
    def of(cls, phases: Phases, cells: Cells, most: Integers) -> Boxes:
        """Cut periods; of more boxes than a number (frequency,), take the shorter durations."""
        count = cells.Omega.size
        left, examined = np.zeros(count), np.zeros(count, dtype=np.int64)
        index, d, half = _whole(cells)
        parts: list[tuple[Integers, Floats, Floats]] = []
        while index.size:
            look()
            over = _beyond(index, d, most - examined) | (half < _FINEST * cells.length[index])
            np.add.at(left, index[over], 2.0 * half[over])
            index, d, half = index[~over], d[~over], half[~over]
            long = _leaves_out(phases, cells, index, d, half)
            parts.append((index[~long], d[~long], half[~long]))
            np.add.at(examined, index[~long], 1)
            index, d, half = _halves(index[long], d[long], half[long])
        index, d, half = (np.concatenate(each) for each in zip(*parts, strict=True))
        work = np.zeros(count)
        np.add.at(work, index, 1.0 + prescribed.live_counts(phases, cells, index, d) ** 3 / _CUBES)
        return cls(index, d, half, left, work)

    def at(self, which: Booleans) -> Boxes:
        """Return those of some frequencies."""
        some = which[self.index]
        return Boxes(self.index[some], self.d[some], self.half[some], self.left * which, self.work)


def isolated(phases: Phases, cells: Cells, start: Start, boxes: Boxes) -> Durations:
    """Return the intervals of durations of phases that begin in one way, in some boxes."""
    count = cells.Omega.size
    most = _AGAIN * np.bincount(boxes.index, minlength=count) + _FEW
    used, lost = np.zeros(count, dtype=np.int64), boxes.left.copy()
    roots_of_all: list[tuple[Integers, Floats, Floats, Integers]] = []
    index, d, half = boxes.index, boxes.d, boxes.half
    while index.size:
        look()
        over = _beyond(index, d, most - used) | (half < _FINEST * cells.length[index])
        np.add.at(lost, index[over], 2.0 * half[over])
        index, d, half = index[~over], d[~over], half[~over]
        np.add.at(used, index, 1)
        again = []
        for some in prescribed.pieces(phases, cells, index, d):
            one = prescribed.motions(phases, cells, index[some], d[some])
            states, roots = _roots(phases, cells, start, one, half[some])
            roots_of_all.append(roots)
            cut = some[(states == CUT) | (states == FULL)]
            again.append(_halves(index[cut], d[cut], half[cut]))
        if not again:
            break
        index, d, half = (np.concatenate(parts) for parts in zip(*again, strict=True))
    if not roots_of_all:
        none = np.zeros(0)
        return Durations(none.astype(np.int64), none, none, none.astype(bool), lost)
    index, d, half, kinds = (np.concatenate(parts) for parts in zip(*roots_of_all, strict=True))
    open_end = kinds == UNRESOLVED
    np.add.at(lost, index[open_end], 2.0 * half[open_end])
    return Durations(index, d, half, ~open_end, lost / cells.length)


def _whole(cells: Cells) -> tuple[Integers, Floats, Floats]:
    """Return the first boxes of frequencies: their frequencies, middles and half widths."""
    index = np.repeat(np.arange(cells.Omega.size), _FIRST)
    half = cells.length[index] / (2.0 * _FIRST)
    return index, np.tile(2.0 * np.arange(_FIRST) + 1.0, cells.Omega.size) * half, half


def _beyond(index: Integers, d: Floats, room: Integers) -> Booleans:
    """Return which boxes are too many for the room of their frequencies, from the shortest on."""
    order = np.lexsort((d, index))
    sizes = np.bincount(index, minlength=room.size)
    place = np.empty(index.size, dtype=np.int64)
    place[order] = np.arange(index.size) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    return np.asarray(place >= room[index])


def _halves(index: Integers, d: Floats, half: Floats) -> tuple[Integers, Floats, Floats]:
    """Return boxes cut in halves."""
    w = 0.5 * half
    both = np.concatenate([index, index]), np.concatenate([d - w, d + w])
    return *both, np.concatenate([w, w])


def _tails(x: Floats, terms: int = TERMS) -> Floats:
    """Return bounds of what the first terms of an exponential series leave out."""
    return _grown(terms * np.log(np.maximum(x, 1e-300)) - math.lgamma(terms + 1.0) + x)


def _grown(x: Floats) -> Floats:
    """Return exponentials whose products and squares are still numbers."""
    return np.asarray(np.exp(np.minimum(x, _STEEP)))


_STEEP: Final = 150.0  # exponent beyond which boxes are cut anyway


def _sizes(side: Side, times: Floats, form: Floats) -> Floats:
    """Return the sizes of a form or a state by pairs after a flow, (motion, pair)."""
    n, grows = side.size, _grown(np.maximum(side.growth * times[:, np.newaxis], -_STEEP))
    pairs = side.pairs
    lengths = np.hypot(form[:n], form[n:])
    grows[:, pairs.parabolas] *= 1.0 + times[:, np.newaxis]
    alive = side.growth * times[:, np.newaxis] > -prescribed.GONE
    return np.asarray(np.sqrt(2.0) * lengths * grows * alive)


def _leaves_out(phases: Phases, cells: Cells, index: Integers, d: Floats, half: Floats) -> Booleans:
    """Return which boxes are too long for polynomials of what moves in them."""
    a = phases.impact.constraint
    reach = RADIUS * half[:, np.newaxis]
    bad: Booleans = half * cells.Omega[index] * phases.harmonics.max(initial=1.0) > 1.0
    for side, times, form in (
        (phases.open, cells.length[index] - d, phases.open.kick[a]),
        (phases.loaded, d, phases.loaded.force),
    ):
        sizes, x = _sizes(side, times, form), side.rate * reach
        whole = np.sqrt((sizes**2).sum(axis=1))
        bad |= ~(np.sqrt(((sizes * _tails(x)) ** 2).sum(axis=1)) <= _LEFT_OUT * whole)
    return np.asarray(bad)


def _series(
    side: Side, live: Integers, first: Floats, half: Floats, *, forward: bool, count: int
) -> Floats:
    """Return the Taylor coefficients of ``e^(+-A x half) z`` or of forms, (motion, count, …)."""
    terms = np.empty((len(first), count, first.shape[1]))
    terms[:, 0] = first
    signed = half if forward else -half
    for k in range(1, count):
        rate = prescribed.drift(side, live, terms[:, k - 1], form=forward)
        terms[:, k] = rate * (signed / k)[:, np.newaxis]
    return terms


def _roots(
    phases: Phases, cells: Cells, start: Start, motions: Prescribed, half: Floats
) -> tuple[Integers, tuple[Integers, Floats, Floats, Integers]]:
    """Return what became of boxes, and the intervals of roots in them."""
    states = np.full(half.size, FULL)
    smooth = np.flatnonzero(_tails(_turns(phases, motions, half), FEW_TERMS) <= _FEW_LEAVE_OUT)
    if smooth.size:
        few = _boxes(phases, cells, start, motions.at(smooth), half[smooth], FEW_TERMS)
        states[smooth], _ = _isolated(few, 0)
    left = np.flatnonzero(states == FULL)
    motions, half = motions.at(left), half[left]
    boxes = _boxes(phases, cells, start, motions, half, TERMS)
    own, (of, middles, halves, kinds) = _isolated(boxes, _ROOM * left.size)
    # Smaller boxes tell more, until rounding is all that is left.
    large = half > _DOUBTFUL * cells.length[motions.index]
    doubtful = of[kinds == UNRESOLVED]
    own[doubtful[large[doubtful]]] = CUT
    states[left] = own
    good = (own == EMPTY)[of]
    of = of[good]
    d = motions.d[of] + half[of] * middles[good]
    return states, (motions.index[of], d, half[of] * halves[good], kinds[good])


def _turns(phases: Phases, motions: Prescribed, half: Floats) -> Floats:
    """Return how far what moves fastest turns on the disc, (motion,)."""
    n, m = motions.live.size // 2, motions.live_loaded.size // 2
    fastest = max(
        phases.open.rate[motions.live[:n]].max(initial=0.0),
        phases.loaded.rate[motions.live_loaded[:m]].max(initial=0.0),
    )
    return np.asarray(RADIUS * half * fastest)


def _isolated(
    boxes: durations.Boxes, room: int
) -> tuple[Integers, tuple[Integers, Floats, Floats, Integers]]:
    """Return what became of boxes, and their intervals of roots if there is room for them."""
    which, kinds = np.empty((2, room), dtype=np.int64)
    middles, halves = np.empty((2, room))
    states = np.empty(boxes.g.size, dtype=np.int64)
    count = durations.isolate(boxes, which, middles, halves, kinds, states)
    return states, (which[:count], middles[:count], halves[:count], kinds[:count])


def _boxes(
    phases: Phases,
    cells: Cells,
    start: Start,
    motions: Prescribed,
    half: Floats,
    terms: int,
) -> durations.Boxes:
    """Return what the kernel has to know of boxes around durations, by so many terms."""
    index, d, live, loaded = motions.index, motions.d, motions.live, motions.live_loaded
    to = phases.to_loaded[np.ix_(loaded, live)]
    U = _series(phases.open, live, motions.u, half, forward=False, count=terms)
    V = _series(phases.loaded, loaded, motions.v, half, forward=True, count=terms)
    Y = U @ motions.inverse.transpose(0, 2, 1)  # (motion, term, live)
    own = V @ to  # forms of states at the beginning
    S = own @ Y.transpose(0, 2, 1) * half[:, np.newaxis, np.newaxis]
    beta = Y @ start.form[live] * half[:, np.newaxis]
    jump = cells.jump[index, 0][:, loaded]
    rate = cells.Omega[index] * phases.harmonics[0] * half
    powers = np.ones((index.size, terms), dtype=np.complex128)
    for k in range(1, terms):
        powers[:, k] = powers[:, k - 1] * 1j * rate / k
    push = cells.loaded[:, 0] @ phases.loaded.force
    turned = np.exp(1j * cells.Omega[index] * phases.harmonics[0] * d)
    powers *= (push[index] * turned)[:, np.newaxis]
    at_entry = motions.a[:, 1] @ to.T + jump
    alpha = np.einsum("mki,mi->mk", V, at_entry) + powers
    still_entry = motions.a[:, 0].real @ to.T + phases.offset[loaded]
    still = np.einsum("mki,mi->mk", V, still_entry)
    still[:, 0] += phases.loaded.force_level
    Q = motions.a[:, 1] @ start.form[live] + cells.opened[index, 0] @ start.form
    g = motions.a[:, 0].real @ start.form[live] + start.level
    end = np.zeros(index.size, dtype=np.int64)
    if start.regained or phases.damping == 0.0:
        end[d - half <= 1e-9 * cells.length[index]] = -1
        if cells.sign > 0.0:
            end[d + half >= (1.0 - 1e-9) * cells.length[index]] = 1
    given = at_entry, still_entry, rate, push
    size = _remainders(phases, start, motions, half, given, terms)
    return durations.Boxes(
        S, beta, np.ascontiguousarray(alpha), still, np.ascontiguousarray(Q), g, size, end
    )


def _remainders(
    phases: Phases,
    start: Start,
    motions: Prescribed,
    half: Floats,
    given: tuple[Complexes, Floats, Floats, Complexes],
    terms: int,
) -> Floats:
    """Return bounds of what polynomials leave out on the disc, (motion, 3)."""
    at_entry, still_entry, rate, push = given
    reach, live, loaded = RADIUS * half[:, np.newaxis], motions.live, motions.live_loaded
    n, m = live.size // 2, loaded.size // 2
    x0, x1 = phases.open.rate[live[:n]] * reach, phases.loaded.rate[loaded[:m]] * reach

    def norm(sizes: Floats) -> Floats:
        return np.asarray(np.sqrt((sizes**2).sum(axis=1)))

    u = np.sqrt(2.0) * np.hypot(motions.u[:, :n], motions.u[:, n:])
    v = np.sqrt(2.0) * np.hypot(motions.v[:, :m], motions.v[:, m:])
    u_all, v_all = norm(u * _grown(x0)), norm(v * _grown(x1))
    u_tail, v_tail = norm(u * _tails(x0, terms)), norm(v * _tails(x1, terms))
    inverse = np.linalg.norm(motions.inverse, axis=(1, 2)) if n else np.zeros(half.size)
    S = phases.carried * inverse * half * (v_tail * u_all + v_all * u_tail)
    beta = float(np.linalg.norm(start.form[live])) * inverse * half * u_tail
    entered = np.maximum(norm(np.abs(at_entry)), norm(still_entry))
    alpha = v_tail * entered + np.abs(push[motions.index]) * _tails(RADIUS * rate, terms)
    return np.asarray(np.nan_to_num(np.stack([S, beta, alpha], axis=1), nan=np.inf))
