r"""Rigid-body modes between impacts: how impulses balance a constant load.

A rigid-body mode r has no stiffness: in a motion that repeats itself after T the impulses along it
give back what the constant load F_r takes, ``sum_j p_j (w_j . r) + F_r T = 0``. Damping changes
nothing of that, as the mode is where it was. One impulse per period, together with the constant
load ``-kappa / T`` that balances it, has a periodic response,

    q'' + c q' = kappa (sum_n delta(t - n T) - 1 / T),

and where the impulses balance the loads, the sum of these responses is the motion, about a mean
position that is one more unknown. In the pairs of `kernels.flow` the number that the flow leaves
as it is (z2 of a mode without damping, z1 + z2 of one with it) falls from kappa/2 to -kappa/2 in
a period; what it moves by the constant load, besides the flow, is called the trend.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Booleans, Floats, Integers
from vibroimpact_solvers.errors import PlanError
from vibroimpact_solvers.kernels.periodic import ROUNDINGS, Response
from vibroimpact_solvers.periodic_motions.pairs import Pairs
from vibroimpact_solvers.periodic_motions.problem import Problem
from vibroimpact_solvers.time_history.basis import Basis, Modes

_RANK: Final = 1e-9
"""Parts of a direction, or of a load, that are rounding."""


def unloaded(basis: Basis) -> Basis:
    """Return the basis without constant loads on rigid-body modes, each mode by itself."""
    modes = basis.modes
    rigid = modes.roots == 0.0
    if not modes.load[rigid].any():
        return basis.without_chains()
    without: Modes = replace(modes, load=np.where(rigid, 0.0, modes.load))
    return Basis(without, basis.exponent, chains=False)


@dataclass(frozen=True, eq=False, slots=True)
class Balance:
    """The rigid-body modes that damping does not couple to others, in the basis' units.

    Parameters
    ----------
    pairs : array of int, shape (rigid,)
    decay : array, shape (rigid,)
        Their damping c; 0 for those without.
    moved : array, shape (constraint, rigid)
        Participations of the limited coordinates.
    push : array, shape (rigid,)
        Constant loads.
    kick : array, shape (2, pair)
        Change of state per unit of time by all constant loads on rigid-body modes.
    coupled : bool
        Whether there are others, which damping couples.
    """

    pairs: Integers
    decay: Floats
    moved: Floats
    push: Floats
    kick: Floats
    coupled: bool

    @classmethod
    def of(cls, basis: Basis, load: Floats, pairs: Pairs, kicks: Floats) -> Balance:
        """Return those of a basis.

        load is the change of state per unit of time by constant loads, (2, pair), and kicks are
        those of unit impulses on the constraints, (constraint, 2, pair).
        """
        modes, moving = basis.modes, pairs.moving
        rigid = modes.roots == 0.0
        count = int(rigid.sum())
        still: Booleans = np.zeros(pairs.alpha.size, dtype=bool)
        still[pairs.hyperbolas] = (pairs.alpha + pairs.nu == 0.0)[pairs.hyperbolas]
        still[pairs.parabolas] = pairs.alpha[pairs.parabolas] == 0.0
        damping = modes.damping
        if damping is not None and damping.size:
            apart = damping[rigid].copy()
            apart[np.arange(count), np.flatnonzero(rigid)] = 0.0
            count -= int(apart.any(axis=1).sum())
        places = moving[still[moving]]
        coupled = count < int(rigid.sum())
        if places.size != count:
            places, coupled = places[:0], True
        decay = -2.0 * pairs.alpha[places]
        # A unit impulse changes z2 alone.
        return cls(places, decay, kicks[:, 1, places], load[1, places], load, coupled)

    @property
    def loaded(self) -> bool:
        """Whether a constant load drives a rigid-body mode: no motion is without impacts."""
        return bool(self.kick.any())

    def check(self, problem: Problem) -> None:
        """Refuse constant loads that the impacts of a problem cannot balance.

        Raises
        ------
        PlanError
        """
        if not self.loaded:
            return
        if self.coupled:
            message = (
                "a constant load drives a rigid-body mode that damping couples to other modes: "
                "motions in which impulses balance it are computed where it does not"
            )
            raise PlanError(message, ("system", "C"))
        struck = [impact.constraint for impact in problem.impacts]
        along = directions(self.moved[struck])
        left = self.push - along @ (along.T @ self.push)
        if np.linalg.norm(left) > _RANK * np.linalg.norm(self.push):
            message = (
                "a constant load drives a rigid-body mode that no impact of the sequence pushes "
                "back: no motion is periodic"
            )
            raise PlanError(message, ("system", "force"))

    def balances(self, problem: Problem) -> bool:
        """Whether the impacts of a problem may have impulses that balance the loads."""
        moved = self.moved[[impact.constraint for impact in problem.impacts]]
        if self.coupled or not moved.any():
            return False
        return self.loaded or not one_way(problem, moved)

    def complete(self, response: Response, cells: Floats, kicks: Floats, drift: Floats) -> None:
        """Fill in the periodic responses of rigid-body modes to one impulse and the mean of it.

        Shape (cell, kick, …) each; kicks (kick, 2, pair).
        """
        T = cells[:, np.newaxis]
        for j, c in zip(self.pairs.tolist(), self.decay.tolist(), strict=True):
            kick = kicks[:, 1, j]
            half, still = 0.5 * kick, kick == 0.0
            after, before = response.after[..., j], response.before[..., j]
            if c == 0.0:
                after[:, :, 0] = before[:, :, 0] = -kick * T / 12.0
                after[:, :, 1], before[:, :, 1] = half, -half
            else:
                decayed = -kick / -np.expm1(-c * T)
                for z, own, other in ((after, half, decayed), (before, -half, decayed + kick)):
                    z[:, :, 0], z[:, :, 1] = 0.5 * (own + other), 0.5 * (own - other)
            moved = ROUNDINGS + (2.0 * drift[j] + EPS * c) * T
            response.error[..., j] = np.where(still, 0.0, ROUNDINGS + 2.0 * moved)

    def trend(self) -> Floats:
        """Return velocities and accelerations of the coordinates by the loads, (2, constraint)."""
        return self.trend_of(self.moved, self.push)

    def trend_of(self, moved: Floats, push: Floats) -> Floats:
        """Return velocities and accelerations of coordinates, shape (2, …), by constant loads.

        moved (…, rigid) are participations, push (rigid,) or (…, rigid).
        """
        slides = self.decay != 0.0
        slow = np.where(slides, 1.0 / np.where(slides, self.decay, 1.0), 0.0)
        each = moved * push
        return np.stack([each @ slow, each @ np.where(slides, 0.0, 1.0)])

    def along(self, forms: Floats) -> Floats:
        """Return what constant loads add to forms along a free motion, besides the flow.

        Factors of 1, t and t^2/2, shape (3, form); forms have shape (form, 2, pair).
        """
        slides, push = self.decay != 0.0, self.push if self.loaded else 0.0 * self.push
        creep = np.where(slides, push / np.where(slides, self.decay, 1.0), 0.0)
        first, second = forms[:, 0, self.pairs], forms[:, 1, self.pairs]
        both = first @ np.where(slides, 0.5 * push, 0.0) + second @ np.where(
            slides, 0.5 * push, push
        )
        return np.stack([second @ creep, both, first @ np.where(slides, 0.0, push)])

    def moved_by(self, push: Floats, times: Floats) -> Floats:
        """Return what constant loads add to the pairs after times, shape (…, 2, rigid).

        push has shape (…, rigid), times (…).
        """
        t, slides = times[..., np.newaxis], self.decay != 0.0
        first = np.where(slides, 0.5 * push * t, 0.5 * push * t * t)
        return np.stack([first, np.where(slides, 0.5, 1.0) * push * t], axis=-2)

    def carry(self, z: Floats, times: Floats) -> None:
        """Add the trend of the constant loads to states (time, 2, pair) after times."""
        if not self.loaded:
            return
        z[..., self.pairs] += self.moved_by(
            np.broadcast_to(self.push, (*times.shape, self.push.size)), times
        )

    def creep(self, z: Floats, sign: float = 1.0) -> None:
        """Add the steady velocities under constant loads to states, which flow and trend lack."""
        if not self.loaded:
            return
        slides = self.decay != 0.0
        z[..., 1, self.pairs[slides]] += sign * self.push[slides] / self.decay[slides]

    def place(self, state: Floats, offset: Floats) -> None:
        """Shift states (…, 2, pair) by positions of the rigid-body modes, (…, rigid)."""
        slides = self.decay != 0.0
        state[..., 0, self.pairs] += np.where(slides, 0.5 * self.decay, 1.0) * offset
        state[..., 1, self.pairs] += np.where(slides, 0.5 * self.decay, 0.0) * offset


def directions(moved: Floats) -> Floats:
    """Return an orthonormal basis of the rigid motions that impacts (impact, rigid) push."""
    sizes, rows = np.linalg.svd(moved, full_matrices=False)[1:]
    kept = sizes > _RANK * sizes.max(initial=0.0)
    return np.ascontiguousarray(rows[kept].T)


def add_offset(error: Floats, states: Floats, balance: Balance, offset: Floats) -> None:
    """Add errors of positions (solution, rigid) to relative errors (solution, pair) of states.

    states have shape (solution, free motion, 2, pair).
    """
    size = np.abs(states[:, :, 0, balance.pairs]).min(axis=1, initial=np.inf)
    moved = np.where(balance.decay != 0.0, 0.5 * balance.decay, 1.0) * offset
    known = (size > 0.0) & (size < np.inf)
    error[:, balance.pairs] += np.where(known, moved / np.where(known, size, 1.0), 0.0)


def one_way(problem: Problem, moved: Floats) -> bool:
    """Whether impacts that move rigid-body modes, (impact, mode), push one of them one way only."""
    pushes = moved * np.array([i.side for i in problem.impacts])[:, np.newaxis]
    pushes = pushes[:, pushes.any(axis=0)]
    alike = (pushes >= 0.0).all(axis=0) | (pushes <= 0.0).all(axis=0)
    return bool(alike.any())


class Folded:
    """The equations of places of several impacts without the mean positions of rigid modes.

    The ``m`` equations ``y_i + (P beta)_i = wall_i`` become ``m - r`` without the r unknowns beta,
    by the orthogonal complement of the columns of P; the r balances of impulses take their place.

    Parameters
    ----------
    balance : Balance
    struck : list of int
        Constraints of the impacts.
    """

    def __init__(self, balance: Balance, struck: list[int]) -> None:
        self.balance, self.moved = balance, balance.moved[struck]
        self.along = directions(self.moved)
        self.pushed = self.moved @ self.along
        self.load = self.along.T @ balance.push
        count = self.along.shape[1]
        Q, R = np.linalg.qr(self.pushed, mode="complete")
        self.across = Q[:, count:].T
        self.placing = -self.along @ np.linalg.solve(R[:count], Q[:, :count].T)
        """Takes what is left of the places, (impact,), to positions of the modes, (rigid,)."""

    def add_trends(
        self, times: Floats, p: Floats, length: Floats, e: tuple[Floats, Floats, Floats]
    ) -> None:
        """Add what the means of the impulses do to residuals, derivatives and sizes of equations.

        times and p have shape (row, impact), length is that of the cells, (row or 1, 1).
        """
        residual, jacobian, size = e
        m = times.shape[1]
        rates, bends = self.balance.trend_of(self.moved[:, np.newaxis], self.moved)
        T = length[:, :, np.newaxis]
        apart = np.mod(times[:, :, np.newaxis] - times[:, np.newaxis], T)
        own = np.arange(m)
        apart[:, own, own] = 0.0
        place, slope = -(rates + 0.5 * bends * apart) * apart / T, -(rates + bends * apart) / T
        bend = np.broadcast_to(-bends / T, slope.shape).copy()
        slope[:, own, own] = -rates[own, own] / T[:, 0]
        bend[:, own, own] = 0.0
        residual[:, :m] += (place @ p[..., np.newaxis])[..., 0]
        residual[:, m:] += (slope @ p[..., np.newaxis])[..., 0]
        size[:, :m] += (np.abs(place) @ np.abs(p)[..., np.newaxis])[..., 0]
        size[:, m:] += (np.abs(slope) @ np.abs(p)[..., np.newaxis])[..., 0]
        jacobian[:, :m, :m] += place
        jacobian[:, m:, :m] += slope
        slope = slope.copy()
        slope[:, own, own] = 0.0
        for rows, by in ((slice(0, m), slope), (slice(m, None), bend)):
            by_times = by * p[:, np.newaxis]
            jacobian[:, rows, m:] -= by_times
            jacobian[:, rows, m:][:, own, own] += by_times.sum(axis=2)

    def fold(self, p: Floats, length: Floats, e: tuple[Floats, Floats, Floats]) -> None:
        """Put balances of impulses, and places without mean positions, for the places."""
        residual, jacobian, size = e
        m, count = p.shape[1], self.load.size
        places = residual[:, :m].copy(), jacobian[:, :m].copy(), size[:, :m].copy()
        residual[:, :count] = p @ self.pushed + self.load * length
        size[:, :count] = np.abs(p) @ np.abs(self.pushed) + np.abs(self.load) * length
        jacobian[:, :count] = 0.0
        jacobian[:, :count, :m] = self.pushed.T
        residual[:, count:m] = places[0] @ self.across.T
        jacobian[:, count:m] = self.across @ places[1]
        size[:, count:m] = places[2] @ np.abs(self.across.T)
