r"""Motions with several impacts per period, by Newton's method on phases and impulses.

The coordinate at the i-th impact and the law of Newton are

    level + y_F(t_i) + sum_j p_j g_ij(t_i - t_j) = wall_i,
    mu_i p_i / (1 + k_i) + y_F'(t_i) + sum_j p_j g_ij'(t_i - t_j) = 0,

g_ij being the response at i to one unit impulse per period at j, before the impact where i = j.
However many modes there are, these are 2 m equations for m times and m impulses. Without load
the motion may begin at any time: the first impact is at 0, and least squares take the equation
that is then left over by conservation of energy.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibroimpact_solvers.arrays import EPS, Booleans, Floats, Integers
from vibroimpact_solvers.kernels.impact_equations import Cells as Cycles
from vibroimpact_solvers.kernels.impact_equations import Equations, Impacts, Room, set_equations
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.periodic_motions.balance import Folded, add_offset
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.problem import Impact, Problem
from vibroimpact_solvers.periodic_motions.solutions import (
    COINCIDENT,
    Cells,
    Solutions,
    time_between,
)

_STARTS = 48  # random sequences of phases at each frequency
_STEPS = 40
_CLOSE = 1e-13  # residual, relative to its terms, of a solution
_SAME = 1e-6  # difference of phases of equal solutions or coincident impacts, rad
_DIGITS = 6  # to which phases and impulses decide about an order
_LONGEST = 0.5  # of the period: largest change of a time in one step


def solutions(driven: Driven, cells: Cells, problem: Problem) -> Solutions:
    """Return the solutions that are reached from the starts, shape (solution, impact) each."""
    laws = Laws.of(driven, problem)
    parts, before = [], np.empty((0, laws.impacts.wall.size))
    for k in range(cells.Omega.size):
        search = Search(laws, cells, np.array([k]))
        part = search.solutions(np.concatenate([search.starts(), before / search.Omega]))
        before = part.phase
        parts.append(part)
    names = Solutions.__dataclass_fields__
    return Solutions(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def turns(impacts: tuple[Impact, ...]) -> list[int]:
    """Return the impacts of a sequence at which it may begin as well."""
    return [s for s in range(len(impacts)) if impacts[s:] + impacts[:s] == impacts]


def same_begin(problem: Problem, apart: Floats) -> Floats:
    """Return differences of phases, (…, impact), of two rows of impacts.

    Those of one motion are zero, whichever period of the load is the first in both rows, and
    whichever period of the motion an impact is told of.
    """
    turn, whole = problem.turn, 2.0 * np.pi * problem.periods
    apart = apart - turn * np.round(apart[..., :1] / turn)
    return np.asarray(apart - whole * np.round(apart / whole))


@dataclass(frozen=True, eq=False, slots=True)
class Laws:
    """The impacts of a cell, whatever the frequency is.

    Parameters
    ----------
    driven : Driven
    problem : Problem
    impacts : Impacts
    kicks : array, shape (impact, 2, pair)
    others : tuple of two arrays of int, shape (pair of impacts,)
        All pairs of different impacts.
    """

    driven: Driven
    problem: Problem
    impacts: Impacts
    kicks: Floats
    others: tuple[Integers, Integers]

    @classmethod
    def of(cls, driven: Driven, problem: Problem) -> Laws:
        """Return those of a problem; one impact may be that of a symmetric motion."""
        struck = np.array([impact.constraint for impact in problem.impacts])
        upper = np.array([int(impact.side > 0) for impact in problem.impacts])
        constraints = driven.structure.system.constraints
        k = np.array([constraints[a].restitution for a in struck])
        velocity = driven.velocity[struck]
        impacts = Impacts(
            driven.position[struck], velocity, driven.rates_of(velocity),
            driven.walls[upper, struck] - driven.level[struck],
            driven.mobility[struck, struck] / (1.0 + k),
        )  # fmt: skip
        i, j = np.nonzero(~np.eye(struck.size, dtype=bool))
        return cls(driven, problem, impacts, driven.kick[struck], (i, j))


class Search:
    """The equations in some cells, and the search in one.

    Parameters
    ----------
    laws : Laws
    cells : Cells
    chosen : array of int, shape (cell,)
        Times and impulses, shape (row, impact), are those of all chosen cells one after the other,
        or of any number of motions in the only one.
    """

    def __init__(self, laws: Laws, cells: Cells, chosen: Integers) -> None:
        self.laws, self.driven, self.problem = laws, laws.driven, laws.problem
        self.index, self.cells = chosen, cells.at(chosen)
        self.m = laws.impacts.wall.size
        driven, cells = self.driven, self.cells
        self.Omega, self.length = cells.Omega[:, np.newaxis], cells.length[:, np.newaxis]
        self.response = driven.impulse_response(cells.length, cells.rest, cells.sign, laws.kicks)
        struck = [impact.constraint for impact in self.problem.impacts]
        free = cells.sign > 0.0 and driven.free[struck].any()
        self.possible = not free or driven.balance.balances(self.problem)
        self.folded = Folded(driven.balance, struck) if free and self.possible else None
        self.seen = Cycles(
            cells.length, self.Omega * driven.harmonics, cells.steady,
            self.response.after, self.response.before,
        )  # fmt: skip
        self.autonomous = driven.harmonics.size == 0

    def starts(self) -> Floats:
        """Return times of impacts to begin with, those of the request or random ones."""
        if self.problem.phases is not None:
            return np.asarray(self.problem.phases) / self.Omega
        rng = np.random.default_rng(self.m)
        times = np.sort(rng.random((_STARTS, self.m)), axis=1) * self.length
        return times - times[:, :1] if self.autonomous else times

    def solutions(self, times: Floats) -> Solutions:
        """Return the different solutions that Newton's method reaches."""
        impulses = np.zeros(times.shape)
        good = self.possible and np.isfinite(self.response.after).all()
        if not good or times.shape[0] == 0:
            return self.collected(times[:0], impulses[:0])
        impulses = self._first_impulses(times)
        for _ in range(_STEPS):
            residual, jacobian, _ = self.equations(times, impulses)
            if self.autonomous:
                jacobian = np.delete(jacobian, self.m, axis=2)
                step = -np.einsum("sij,sj->si", np.linalg.pinv(jacobian), residual)
                step = np.insert(step, self.m, 0.0, axis=1)
            else:
                singular = ~np.isfinite(jacobian).all(axis=(1, 2))
                jacobian[singular] = np.eye(2 * self.m)
                step = -np.einsum("sij,sj->si", np.linalg.pinv(jacobian), residual)
            longest = np.abs(step[:, self.m :]).max(axis=1, keepdims=True)
            step /= np.maximum(1.0, longest / (_LONGEST * self.length / self.m))
            impulses, times = impulses + step[:, : self.m], times + step[:, self.m :]
        residual, _, size = self.equations(times, impulses)
        solved = (np.abs(residual) <= _CLOSE * size).all(axis=1)
        solved &= impulses.any(axis=1)  # at gap 0, without load: rest
        return self.collected(*self._different(times[solved], impulses[solved]))

    def _first_impulses(self, times: Floats) -> Floats:
        """Return the impulses that Newton's law gives for these times."""
        residual, jacobian, _ = self.equations(times, np.zeros(times.shape))
        if self.autonomous:
            laws, value = jacobian[:, : self.m, : self.m], residual[:, : self.m]
        else:
            laws, value = jacobian[:, self.m :, : self.m], residual[:, self.m :]
        return np.asarray(-np.einsum("sij,sj->si", np.linalg.pinv(laws), value))

    def equations(self, times: Floats, p: Floats) -> Equations:
        """Return residuals, derivatives by impulses and times, and the sizes of their terms.

        Where impacts move rigid-body modes, balances of their impulses take the place of some
        equations about places, see `balance.Folded`.
        """
        equations = self._with_places(times, p)
        if self.folded is not None:
            self.folded.fold(p, self.length, equations)
        return equations

    def _with_places(self, times: Floats, p: Floats) -> Equations:
        """Return the equations about all places, without the mean positions of free bodies."""
        look()
        count, size = times.shape[0], 2 * self.m
        shapes = (count, size), (count, size, size), (count, size)
        equations = Equations(*map(np.empty, shapes))
        room = Room(*np.empty((2, *self.laws.kicks.shape[1:])))
        flow, impacts = self.driven.pairs.flow, self.laws.impacts
        times, p = np.ascontiguousarray(times), np.ascontiguousarray(p)
        set_equations(flow, impacts, self.seen, times, p, equations, room)
        if self.folded is not None:
            self.folded.add_trends(times, p, self.length, equations)
        return equations

    def _moved(self, times: Floats) -> Floats:
        """Return the responses at impacts to all others, shape (row, pair of impacts, 2, pair)."""
        i, j = self.laws.others
        apart = time_between(times[:, i], times[:, j], i > j, self.length)
        flows = self.driven.pairs.propagators(np.ascontiguousarray(apart.ravel()))
        flows = flows.reshape(*apart.shape, *flows.shape[1:])
        moved = self.driven.pairs.move(flows, self.response.after[:, j])
        if self.folded is not None:
            balance, mean = self.driven.balance, -self.folded.moved[j]
            moved[..., balance.pairs] += balance.moved_by(
                mean / self.length[..., np.newaxis], apart
            )
        return moved

    def _different(self, times: Floats, impulses: Floats) -> tuple[Floats, Floats]:
        """Return each solution once, impacts in order, the first in the load's first period.

        Impacts of several constraints may coincide unless one changes the velocity of the other,
        in either order, as roundings decide. Two of one constraint at one time, with opposite
        impulses, solve the equations, too.
        """
        drive = self.problem.turn / self.Omega
        times = times - np.floor(times[:, :1] / drive) * drive
        late = COINCIDENT * self.length
        apart = np.mod(times - times[:, :1], self.length)
        apart -= np.where(apart >= self.length - late, self.length, 0.0)
        highest = np.maximum.accumulate(apart, axis=1)[:, :-1]
        ends = (apart[:, 1:] <= late) & (apart[:, 1:] < highest - late)  # with the first one again
        apart[:, 1:] += np.where(ends, self.length, 0.0)
        after = times[:, :1] + np.maximum.accumulate(apart, axis=1)
        ordered = (np.diff(apart, axis=1) > -late).all(axis=1) & ~self._doubled(apart)
        times, impulses = self._begun_alike(after[ordered], impulses[ordered])
        first, kept = turns(self.problem.impacts), list[int]()
        for row, t in enumerate(times):
            alike = np.array([self._begun_at(t, s) for s in first])
            apart = (times[kept] - alike[:, np.newaxis]) * self.Omega
            if not (np.abs(same_begin(self.problem, apart)) < _SAME).all(axis=-1).any():
                kept.append(row)
        places = np.lexsort(np.round(times[kept] * self.Omega, _DIGITS).T[::-1])
        order = [kept[place] for place in places]
        return times[order], impulses[order]

    def _doubled(self, times: Floats) -> Booleans:
        """Return whether impacts coincide of which each changes the other, shape (row,)."""
        constraint = np.array([impact.constraint for impact in self.problem.impacts])
        i, j = self.laws.others
        a, b, mobility = constraint[i], constraint[j], self.driven.mobility
        coupled = np.abs(mobility[a, b]) > 16.0 * EPS * np.sqrt(mobility[a, a] * mobility[b, b])
        limit = np.where(coupled, COINCIDENT * self.length, -1.0)
        limit = np.where(a == b, _SAME / self.Omega, limit)
        apart = np.abs(times[:, i] - times[:, j])
        return np.asarray((np.minimum(apart, self.length - apart) <= limit).any(axis=1))

    def _begun_alike(self, times: Floats, impulses: Floats) -> tuple[Floats, Floats]:
        """Return motions with that impact first which is, of those that could be, the largest.

        A sequence that repeats itself may begin at several of its impacts: a motion that is late
        by a period of the drive, or without load by any time, is no other motion. Of equal impulses
        that is first whose next one is the largest, and so on; of all equal ones that with the
        longest time to the next impact, or that which pushes.
        """
        times, impulses = times.copy(), impulses.copy()
        first = turns(self.problem.impacts)
        sides = np.array([impact.side for impact in self.problem.impacts])
        for row, (t, p) in enumerate(zip(times, impulses, strict=True)):
            sizes = np.abs(p) / np.abs(p).max()
            waits = np.append(t[1:], t[0] + self.length[0, 0]) - t
            push = -sides * p / np.abs(p).max()
            all_of = np.round([sizes, waits / self.length[0, 0], push], _DIGITS)
            orders = {tuple(np.roll(all_of, -s, axis=1).ravel()): s for s in reversed(first)}
            begin = orders[max(orders)]
            if begin:
                times[row], impulses[row] = self._begun_at(t, begin), np.roll(p, -begin)
        return times, impulses

    def _begun_at(self, times: Floats, first: int) -> Floats:
        """Return times of one motion, (impact,), with another of its impacts first."""
        later = np.append(times[first:], times[:first] + self.length[0, 0])
        load = self.problem.turn / self.Omega[0, 0]
        shift = later[0] if self.autonomous else np.floor(later[0] / load) * load
        return np.asarray(later - shift)

    def collected(self, times: Floats, p: Floats) -> Solutions:
        """Return the solutions with their states, and errors to first order."""
        count, m = times.shape
        times = times.copy()
        for one, other in zip(times.T[:-1], times.T[1:], strict=True):
            late = (one > other) & (one - other <= COINCIDENT * self.length[:, 0])
            other[late] = one[late]
        residual, jacobian, size = self.equations(times, p)
        if self.autonomous:
            jacobian[:, :, m] = 0.0
        inexact = self.response.error.max(axis=1) + 2.0 * self.driven.shape_error
        relative = inexact.max(axis=1, initial=0.0)[:, np.newaxis] + 16.0 * EPS
        doubt = np.abs(residual) + size * relative
        floor = self._mixed(p, doubt)
        errors = np.einsum("nij,nj->ni", np.abs(np.linalg.pinv(jacobian)), doubt)
        lengths = np.diff(np.concatenate([times, times[:, :1] + self.length], axis=1), axis=1)
        state = self.response.after * p[..., np.newaxis, np.newaxis]
        there = self._moved(times)
        for k, (i, j) in enumerate(zip(*self.laws.others, strict=True)):
            state[:, i] += there[:, k] * p[:, j, np.newaxis, np.newaxis]
        velocity = -self.laws.impacts.inertia * p
        placed = self._placed(times, p, state, relative, errors)
        with np.errstate(divide="ignore", invalid="ignore"):
            moved = (errors[:, :m] / np.abs(p)).max(axis=1, initial=0.0)
        speeds = self.driven.pairs.speed
        late = errors[:, m:].max(axis=1, initial=0.0)[:, np.newaxis] * speeds
        return Solutions(
            np.broadcast_to(self.index, count), times * self.Omega, p, velocity, state, lengths,
            errors[:, m:] * self.Omega, errors[:, :m],
            errors[:, :m] * self.laws.impacts.inertia,
            inexact + moved[:, np.newaxis] + late + placed, np.zeros(count), floor,
        )  # fmt: skip

    def _placed(
        self, times: Floats, p: Floats, state: Floats, relative: Floats, errors: Floats
    ) -> Floats:
        """Shift states to where their impacts are at the walls; return what that adds to errors.

        Relative to the pairs of the state, shape (solution, pair).
        """
        added = np.zeros((len(p), state.shape[-1]))
        if self.folded is not None:
            residual, jacobian, size = self._with_places(times, p)
            placing, balance = self.folded.placing, self.driven.balance
            balance.place(state, (residual[:, : self.m] @ placing.T)[:, np.newaxis])
            doubt = size[:, : self.m] * relative
            doubt += np.einsum("nij,nj->ni", np.abs(jacobian[:, : self.m]), errors)
            offset = doubt @ np.abs(placing.T)
            add_offset(added, state, balance, offset)
        return added

    def _mixed(self, p: Floats, doubt: Floats) -> Floats:
        """Add what errors of the load's response, and mixed modes, do to the equations.

        Returns
        -------
        array, shape (solution, pair)
            Absolute errors of the states.
        """
        driven, cells, m = self.driven, self.cells, self.m
        struck = [impact.constraint for impact in self.problem.impacts]
        laws, doubts = self.laws.impacts, driven.doubts[:, struck]
        if not self.autonomous:
            Y = cells.seen_error(driven, laws.position, doubts[0], 2.0 * driven.shape_error)
            doubt[:, :m] += Y.sum(axis=1)
            doubt[:, m:] += np.einsum("fhi,fh->fi", Y, self.Omega * driven.harmonics)
        if not driven.mixing:
            return np.zeros((len(p), 0))
        kicks, after, sizes = self.laws.kicks, self.response.after, np.abs(p)
        absolute = driven.mixing.of_response(cells.length, cells.sign, kicks, after)
        floor = np.einsum(
            "nij,ni->nj", np.broadcast_to(absolute, (len(p), *absolute.shape[1:])), sizes
        )
        state = np.abs(after).sum(axis=2)
        for of, forms in enumerate((laws.position, laws.velocity)):
            seen = np.einsum("ij,fkj->fik", doubts[of], state)
            seen += np.einsum("isj,fkj->fik", np.abs(forms), absolute)
            doubt[:, of * m : (of + 1) * m] += (seen @ sizes[..., np.newaxis])[..., 0]
        return np.asarray(floor)
