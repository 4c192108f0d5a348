"""Impact modes without modes: boundary conditions, functions of matrices and balls.

A solution of a family moves as ``x(t)``, ``-1/omega <= t <= 1/omega`` (tau = omega t), and back the
same way. Its state at t = 0 and the impulses follow from linear equations: the coordinates are at
their walls at both ends, and what turns the velocities there comes from the walls. Everything
follows from the state at t = 0 by the equation ``x'' = g - B x`` with ``B = M^-1 K``, whose
propagators are ``C = cos(t sqrt B)``, ``S = sin(t sqrt B)/sqrt B``, ``G = (1 - cos(t sqrt B))/B``:
power series at a short time, doubled by ``C -> 2 C^2 - 1``, ``S -> 2 S C``, ``G -> 2 S^2``.
All numbers are enclosures; the precision is raised until they are narrow.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import flint
import numpy as np
from flint import acb_mat, arb, arb_mat

from tests.reference.balls import (
    DEGREE,
    Flow,
    Structure,
    UndecidedError,
    clearly_positive,
    column,
    doubles,
    matrix,
    mobility_times,
    radius,
    sign,
)

_NARROW_MAP = 1e-40  # error of the map over the period, times its largest entry
_SPARE = 192  # bits of the first precision, beside those that doublings cost
_HIGHEST = 4096  # bits
_SHORT = 6  # doublings from a norm of one on
_NARROW = 2.0**-90  # relative width of enclosures from which on they are taken
_MOST_STEPS = 2**15


@dataclass(frozen=True, slots=True)
class Limiter:
    """``-lower <= row x <= upper``; None: no wall."""

    row: Any
    lower: float | None
    upper: float | None


class Propagator(NamedTuple):
    """How the motions move on within a time: C, S and G, see the module."""

    C: Any
    S: Any
    G: Any

    def doubled(self) -> Propagator:
        """Return that of twice the time."""
        C = self.C * self.C * 2
        for i in range(C.nrows()):
            C[i, i] -= 1
        return Propagator(C, self.S * self.C * 2, self.S * self.S * 2)


@dataclass
class Family:
    """A structure, its limiters, and those that are struck."""

    structure: Structure
    limiters: tuple[Limiter, ...]
    active: tuple[int, ...]
    _known: dict[int, tuple[Any, Any, Any]] = field(default_factory=dict)

    def matrices(self) -> tuple[Any, Any, Any]:
        """Return ``M^-1 K``, ``M^-1 f`` and ``M^-1 W^T`` at the precision in force."""
        if flint.ctx.prec not in self._known:
            s, M = self.structure, matrix(self.structure.M)
            pull = column(np.zeros(s.n) if s.force is None else s.force)
            known = M.solve(matrix(s.K)), M.solve(pull), mobility_times(s.M, self.rows)
            self._known[flint.ctx.prec] = known
        return self._known[flint.ctx.prec]

    @cached_property
    def rows(self) -> Any:
        """Directions of the limiters."""
        return np.array([limiter.row for limiter in self.limiters], dtype=np.float64)

    @cached_property
    def rate(self) -> float:
        """A bound of the natural frequencies: the root of a norm of ``M^-1 K``."""
        flint.ctx.prec = _SPARE
        return math.sqrt(np.abs(doubles(self.matrices()[0])).sum(axis=1).max() * (1.0 + 1e-12))

    @cached_property
    def longest(self) -> float:
        """A time within which Taylor polynomials converge."""
        return self.flow.H

    @cached_property
    def flow(self) -> Flow:
        """The motions of the first-order equations."""
        flint.ctx.prec = _SPARE
        return Flow(self.structure.generator())


@dataclass
class Solution:
    """One solution of a family, at the precision in force when it was made."""

    family: Family
    Omega: float

    def __post_init__(self) -> None:
        self.precision = flint.ctx.prec
        self.structure, self.limiters = self.family.structure, self.family.limiters
        self.active, self.rows = self.family.active, self.family.rows
        n = self.structure.n
        self.upper = [a for a in self.active if self.limiters[a].upper is not None]
        self.lower = [a for a in self.active if self.limiters[a].lower is not None]
        self.h = arb.pi() / (2 * arb(self.Omega))  # 1/omega
        self.B, self.pull, self.mobility = self.family.matrices()
        whole = self.propagators[0]
        lift, reach, fall = self.B * whole.S, whole.S * self.pull, whole.G * self.pull
        ups, downs = len(self.upper), len(self.lower)
        size = 2 * n + ups + downs
        L, right = arb_mat(size, size), arb_mat(size, 1)
        ends = ((1, self.upper, 0, 2 * n), (-1, self.lower, n, 2 * n + ups))
        for way, struck, first, place in ends:
            for i in range(n):
                for j in range(n):
                    L[first + i, j] = -way * lift[i, j]
                    L[first + i, n + j] = whole.C[i, j]
                for k, a in enumerate(struck):
                    L[first + i, place + k] = -self.mobility[i, a] * self.h
                right[first + i, 0] = -way * reach[i, 0]
            for k, a in enumerate(struck):
                limiter, row = self.limiters[a], matrix(self.rows[a])
                by_place, by_speed = row * whole.C, row * whole.S
                for j in range(n):
                    L[place + k, j] = by_place[0, j]
                    L[place + k, n + j] = way * by_speed[0, j]
                wall = limiter.upper if way > 0 else -float(limiter.lower or 0.0)
                right[place + k, 0] = arb(wall) - (row * fall)[0, 0]
        try:
            u = L.solve(right).tolist()
        except ZeroDivisionError as error:
            raise UndecidedError("the equations of the solution are singular") from error
        self.middle = arb_mat(u[:n]), arb_mat(u[n : 2 * n])
        self.impulse = {a: u[2 * n + k][0] for k, a in enumerate(self.upper)}
        self.impulse_lower = {a: u[2 * n + ups + k][0] for k, a in enumerate(self.lower)}

    @cached_property
    def _halvings(self) -> int:
        """How often 1/omega is halved for the power series, and at least for the steps."""
        h = float(self.h.mid())
        short = math.ceil(math.log2(max(self.family.rate * h, 1e-300))) + _SHORT
        return max(short, self._step_halvings, 1)

    @cached_property
    def _step_halvings(self) -> int:
        """How often 1/omega is halved for steps along the path, -1 for one step of twice that."""
        return max(-1, math.ceil(math.log2(float(self.h.mid()) / self.family.longest)))

    @cached_property
    def propagators(self) -> dict[int, Propagator]:
        """The propagators of 1/omega divided by the powers of two of the keys."""
        k = self._halvings
        result = {k: self._series(self.h / (arb(2) ** k))}
        while k > -1:
            result[k - 1] = result[k].doubled()
            k -= 1
        return result

    def _series(self, time: Any) -> Propagator:
        n = self.structure.n
        square, X = time * time, -(self.B * (time * time))
        norm = float(max(sum((abs(x) for x in row), arb(0)) for row in X.tolist()).abs_upper())
        assert norm < 1.0
        power = arb_mat([[int(i == j) for j in range(n)] for i in range(n)])
        C, S, G = arb_mat(n, n), arb_mat(n, n), arb_mat(n, n)
        factor, bits, k = arb(1), 0.0, 0
        # Of the rest of the series, no term is half as large as the one before it.
        while bits > -flint.ctx.prec:
            C += power * factor
            S += power * (factor / (2 * k + 1))
            G += power * (factor / ((2 * k + 1) * (2 * k + 2)))
            k += 1
            power = power * X
            factor = factor / ((2 * k - 1) * 2 * k)
            bits += math.log2(max(norm, 1e-300) / ((2 * k - 1) * 2 * k))
        rest = arb(0, 1) * arb(2) ** (2 + math.floor(bits))
        C, S, G = (
            arb_mat([[x + rest for x in row] for row in part.tolist()]) for part in (C, S, G)
        )
        return Propagator(C, S * time, G * square)

    def _moved(self, k: int, way: int, state: tuple[Any, Any]) -> tuple[Any, Any]:
        """Return states, in columns, 1/omega divided by 2^k later (way 1) or before (-1)."""
        P, (x, v) = self.propagators[k], state
        pull = arb_mat([list(row) * x.ncols() for row in self.pull.tolist()])
        force = pull - self.B * x
        return x + P.G * force + P.S * v * way, P.C * v + P.S * force * way

    def state(self, tau: float) -> tuple[Any, Any]:
        """Return x and x' at a time in [-1, 1], on the way from the lower to the upper walls."""
        left, state, way = abs(tau), self.middle, 1 if tau > 0.0 else -1
        for k in range(self._halvings + 1):
            if left >= 2.0**-k:
                state, left = self._moved(k, way, state), left - 2.0**-k
        if left > 0.0:
            P = self._series(self.h * arb(left))
            (x, v), force = state, self.pull - self.B * state[0]
            state = x + P.G * force + P.S * v * way, P.C * v + P.S * force * way
        return state

    def displacement(self, tau: float) -> list[Any]:
        """Return x, enclosures."""
        return list(self.state(tau)[0].entries())

    @cached_property
    def ends(self) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
        """The states at tau = -1 (after its impacts) and tau = 1 (before its impacts)."""
        return self._moved(0, -1, self.middle), self._moved(0, 1, self.middle)

    def narrow(self) -> bool:
        """Tell whether the enclosures are narrow, relative to the largest of their kind."""
        states = (*self.ends, self.middle)
        kinds = [[x for state in states for x in state[k].entries()] for k in (0, 1)]
        kinds.append([*self.impulse.values(), *self.impulse_lower.values()])
        for balls in kinds:
            size = max(float(abs(x.mid())) for x in balls)
            if not max(float(x.rad()) for x in balls) <= _NARROW * max(size, 1e-250):
                return False
        return True

    @cached_property
    def energy(self) -> Any:
        """``x' M x'/2 + x K x/2 - f x``."""
        s, (x, v) = self.structure, self.middle
        total = (v.transpose() * matrix(s.M) * v + x.transpose() * matrix(s.K) * x)[0, 0] / 2
        return total if s.force is None else total - (x.transpose() * column(s.force))[0, 0]

    def harmonic(self, order: int) -> list[Any]:
        """Return Fourier amplitudes of sin(order Omega t) or, even orders, cos(order Omega t)."""
        n = self.structure.n
        kappa, zero = arb(self.Omega) * order, arb(0)
        angle = kappa * self.h  # a multiple of pi/2
        S, C = angle.sin(), angle.cos()
        (x0, v0), (x1, v1) = self.ends
        if order % 2:
            share, terms = zero, (v1 * S - x1 * (kappa * C)) + (v0 * S + x0 * (kappa * C))
        else:
            share = 2 * self.h if order == 0 else 2 * S / kappa
            terms = (v1 * C + x1 * (kappa * S)) - (v0 * C - x0 * (kappa * S))
        stiffness = arb_mat(self.B.tolist())
        for i in range(n):
            stiffness[i, i] -= kappa**2
        try:
            integral = stiffness.solve(self.pull * share - terms)
        except ZeroDivisionError as error:
            raise UndecidedError("a harmonic is at a natural frequency") from error
        factor = 1 / (2 * self.h) if order == 0 else 1 / self.h
        return [x * factor for x in integral.entries()]

    # Existence

    @cached_property
    def pushes(self) -> list[Any]:
        """Impulses and approach velocities: all positive in motions of the structure."""
        values = []
        for (_, v), struck, p in (
            (self.ends[1], self.upper, self.impulse),
            (self.ends[0], self.lower, self.impulse_lower),
        ):
            for a in struck:
                values += [p[a], (matrix(self.rows[a]) * v)[0, 0]]
        return values

    def exists(self, allowance: float = 0.0) -> bool | None:
        """Tell whether the solution is a motion of the structure; None: undecided.

        Limits may be passed by `allowance` times the distance of the walls.
        """
        if any(x < 0 for x in self.pushes):
            return False
        certain = all(x > 0 for x in self.pushes)
        kept = [self._kept(a, side, allowance) for a, side in self._walls()]
        if any(k is False for k in kept):
            return False
        return True if certain and all(kept) else None

    def _walls(self) -> Iterator[tuple[int, int]]:
        for a, limiter in enumerate(self.limiters):
            if limiter.upper is not None:
                yield a, 1
            if limiter.lower is not None:
                yield a, -1

    @cached_property
    def _states(self) -> tuple[Any, Any]:
        """States at the ends of steps of equal lengths, from tau = -1 to 1, in columns."""
        k = self._step_halvings
        if 2 ** (k + 1) > _MOST_STEPS:
            raise UndecidedError(f"2^{k + 1} steps")
        x, v = self.ends[0]
        while k >= 0:
            x, v = (_beside(*pair) for pair in zip((x, v), self._moved(k, 1, (x, v)), strict=True))
            k -= 1
        return _beside(x, self.ends[1][0]), _beside(v, self.ends[1][1])

    @cached_property
    def _rounded_states(self) -> tuple[Any, Any]:
        return doubles(self._states[0]), doubles(self._states[1])

    def _kept(self, a: int, side: int, allowance: float) -> bool | None:
        """Tell whether ``side y_a`` stays at or below its wall.

        Upper walls are looked at from tau = 1 backwards, lower ones from tau = -1 on, so that a
        wall that is struck is at the beginning, where it is left.
        """
        limiter = self.limiters[a]
        wall = limiter.upper if side > 0 else limiter.lower
        assert wall is not None
        struck = a in (self.upper if side > 0 else self.lower)
        if limiter.upper is not None and limiter.lower is not None:
            wall_room = abs(limiter.upper + limiter.lower)
        else:
            wall_room = abs(wall)
        (x, v), (X, V) = self._states, self._rounded_states
        count = x.ncols() - 1
        order = np.arange(count) if side < 0 else np.arange(count, 0, -1)
        X, V = X[:, order], V[:, order]
        table = self._taylor(a, side)
        even, odd, still = doubles(table.even), doubles(table.odd), doubles(table.still)
        c, sizes = np.empty((2, count, 2 * len(even)))
        c[:, ::2], c[:, 1::2] = -(even @ X + still).T, -(odd @ V).T
        sizes[:, ::2] = (np.abs(even) @ np.abs(X) + np.abs(still)).T
        sizes[:, 1::2] = (np.abs(odd) @ np.abs(V)).T
        c[:, 0] += wall + allowance * wall_room
        row = np.zeros(self.structure.size)
        row[: self.structure.n] = self.rows[a]
        off = 2.0 * self.family.flow.remainder(row, np.vstack([X, V, np.ones((1, count))]))
        rounding = (self.structure.n + 8) * 2.0**-52
        sizes[:, 0] += abs(wall) + allowance * wall_room
        clear = clearly_positive(c, off + rounding * sizes.sum(axis=1))
        undecided = False
        for k in np.flatnonzero(~clear):
            place = int(order[k])
            state = (arb_mat([[r[place]] for r in part.tolist()]) for part in (x, v))
            exact = table.margin(*state)
            exact[0] = exact[0] + arb(wall) + arb(allowance * wall_room)
            if struck and allowance == 0.0 and k == 0:
                exact = exact[1:]  # at the wall: the rest of the way divided by its length
            verdict = sign(exact, off)
            if verdict is False:
                return False
            undecided |= verdict is None
        return None if undecided else True

    def _taylor(self, a: int, side: int) -> _Taylor:
        """Return the Taylor coefficients of ``side y_a`` for a step away from tau = side."""
        time = self.h / arb(2) ** self._step_halvings
        X, row = self.B * (time * time), matrix(self.rows[a] * side)
        even, odd, still, factor = [], [], [arb(0)], arb(1)
        for j in range(DEGREE // 2 + 1):
            even.append((row * factor).entries())
            odd.append((row * (-side * factor * time / (2 * j + 1))).entries())
            factor = factor / ((2 * j + 1) * (2 * j + 2))
            still.append((row * self.pull)[0, 0] * factor * (time * time))
            row = row * -X
        return _Taylor(arb_mat(even), arb_mat(odd), arb_mat([[x] for x in still[:-1]]))

    # Stability

    def period(self) -> Any:
        """Return the linearised map over the period."""
        n, P = self.structure.n, self.propagators[-1]
        rows = _beside(P.C, P.S).tolist() + _beside(-(self.B * P.S), P.C).tolist()
        Phi = arb_mat(rows)
        low, high = self.ends
        total = Phi
        ends = ((high, self.upper, 1), (low, self.lower, -1))
        for place, ((x, v), struck, facing) in enumerate(ends):
            acceleration = self.pull - self.B * x
            # before the impacts: at the lower walls the velocity after them, reversed
            v = v * facing
            for a in struck:
                total = self._saltation(a, v, acceleration) * total
                gain = (matrix(self.rows[a]) * v)[0, 0] * 2 / self._mass(a)
                m = arb_mat([[self.mobility[i, a]] for i in range(n)])
                v = v - m * gain
            if place == 0:
                total = Phi * total
        return total

    def narrow_radius(self) -> bool:
        """Whether `radius` is known far better than by any double.

        Multipliers that coincide are off by the root of what their matrix is off.
        """
        total = self.period()
        size = max(abs(float(x.mid())) for x in total.entries())
        return radius(total) * size < _NARROW_MAP

    def radius(self) -> float:
        """Return the spectral radius of the map over half a period, from that over the period."""
        total = self.period()
        flint.ctx.prec = _SPARE  # the errors of the solvers are not nearly as small
        values = acb_mat(total.mid()).eig(algorithm="approx")
        largest = max(float(abs(v).mid()) for v in values)
        return float(max(1.0, largest**0.5))

    def _mass(self, a: int) -> Any:
        return sum(
            (arb(float(w)) * self.mobility[i, a] for i, w in enumerate(self.rows[a])), arb(0)
        )

    def _saltation(self, a: int, v: Any, acceleration: Any) -> Any:
        """Return ``R + (F+ - R F-) n^T/(n F-)`` of one impact of restitution 1."""
        n = self.structure.n
        w, m = matrix(self.rows[a]), arb_mat([[self.mobility[i, a]] for i in range(n)])
        mass, approach, pull = self._mass(a), (w * v)[0, 0], (w * acceleration)[0, 0]
        S = arb_mat(2 * n, 2 * n)
        for i in range(n):
            S[i, i] = S[n + i, n + i] = arb(1)
            for j in range(n):
                turn = 2 * m[i, 0] * w[0, j] / mass
                S[i, j] -= turn
                S[n + i, n + j] -= turn
                # F+ - R F-: the acceleration after the impact minus the reflected one before it
                S[n + i, j] += 2 * m[i, 0] * pull / (mass * approach) * w[0, j]
        return S


class _Taylor(NamedTuple):
    """Taylor coefficients of a coordinate over a step, by powers of its part from 0 to 1.

    Even powers go with the place and the static pull, odd ones with the velocity.
    """

    even: Any
    odd: Any
    still: Any

    def margin(self, x: Any, v: Any) -> list[Any]:
        """Return the coefficients of minus the coordinate."""
        pairs = zip((self.even * x + self.still).entries(), (self.odd * v).entries(), strict=True)
        return [-value for pair in pairs for value in pair]


def _beside(one: Any, two: Any) -> Any:
    """Return two matrices side by side."""
    return arb_mat([a + b for a, b in zip(one.tolist(), two.tolist(), strict=True)])


def solved(
    family: Family, Omega: float, enough: Callable[[Solution], bool] | None = None
) -> Solution:
    """Return a solution at the first precision at which its enclosures are narrow (and enough)."""
    doublings = math.log2(max(family.rate / Omega, 1.0))
    if doublings > _HIGHEST:
        raise UndecidedError("a time of too many oscillations")
    precision = _SPARE + 4 * int(doublings)
    while precision <= _HIGHEST:
        flint.ctx.prec = precision
        try:
            solution = Solution(family, Omega)
        except UndecidedError:
            solution = None
        if solution is not None and solution.narrow() and (enough is None or enough(solution)):
            return solution
        precision *= 2
    raise UndecidedError("no precision is enough")
