"""Impact modes without modes: boundary conditions, matrix exponentials and balls.

A solution of a family moves as ``x(t)``, ``-1/omega <= t <= 1/omega`` (tau = omega t), and back the
same way. Its state at t = 0 and the impulses follow from linear equations: the coordinates are at
their walls at both ends, and what turns the velocities there comes from the walls. Everything
follows from the state at t = 0 by the matrix exponential of the first-order equations.
All numbers are enclosures; the precision is raised until they are narrow.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import flint
import numpy as np
from flint import acb_mat, arb, arb_mat

from tests.reference.balls import (
    Flow,
    Structure,
    UndecidedError,
    clearly_positive,
    column,
    doubles,
    few,
    matrix,
    mobility_times,
    radius,
    sign,
)

PRECISIONS = (192, 384, 768, 1536, 3072)
_NARROW = 2.0**-90  # relative width of enclosures from which on they are taken
_MOST_STEPS = 30_000


@dataclass(frozen=True, slots=True)
class Limiter:
    """``-lower <= row x <= upper``; None: no wall."""

    row: Any
    lower: float | None
    upper: float | None


@dataclass
class Solution:
    """One solution of a family, at the precision in force when it was made."""

    structure: Structure
    limiters: tuple[Limiter, ...]
    active: tuple[int, ...]
    Omega: float

    def __post_init__(self) -> None:
        self.precision = flint.ctx.prec
        n, s = self.structure.n, self.structure
        self.upper = [a for a in self.active if self.limiters[a].upper is not None]
        self.lower = [a for a in self.active if self.limiters[a].lower is not None]
        self.h = arb.pi() / (2 * arb(self.Omega))  # 1/omega
        self.A = s.generator()
        self.forward, self.backward = (self.A * self.h).exp(), (self.A * -self.h).exp()
        rows = np.array([limiter.row for limiter in self.limiters], dtype=np.float64)
        self.rows, self.mobility = rows, mobility_times(s.M, rows)
        ups, downs = len(self.upper), len(self.lower)
        size = 2 * n + ups + downs
        L, right = arb_mat(size, size), arb_mat(size, 1)
        ends = ((self.forward, self.upper, 0, 2 * n), (self.backward, self.lower, n, 2 * n + ups))
        for end, struck, first, place in ends:
            for i in range(n):
                for j in range(2 * n):
                    L[first + i, j] = end[n + i, j]
                for k, a in enumerate(struck):
                    L[first + i, place + k] = -self.mobility[i, a] * self.h
                right[first + i, 0] = -end[n + i, 2 * n]
            reach = matrix(rows[struck]) * _some_rows(end, n) if struck else None
            for k, a in enumerate(struck):
                limiter = self.limiters[a]
                wall = limiter.upper if end is self.forward else -float(limiter.lower or 0.0)
                for j in range(2 * n):
                    L[place + k, j] = reach[k, j]
                right[place + k, 0] = arb(wall) - reach[k, 2 * n]
        try:
            u = L.solve(right)
        except ZeroDivisionError as error:
            raise UndecidedError("the equations of the solution are singular") from error
        self.middle = arb_mat(2 * n + 1, 1)
        for i in range(2 * n):
            self.middle[i, 0] = u[i, 0]
        self.middle[2 * n, 0] = arb(1)
        self.impulse = {a: u[2 * n + k, 0] for k, a in enumerate(self.upper)}
        self.impulse_lower = {a: u[2 * n + ups + k, 0] for k, a in enumerate(self.lower)}

    def state(self, tau: float) -> Any:
        """Return (x, x', 1) at a time in [-1, 1], on the way from the lower to the upper walls."""
        return (self.A * (self.h * arb(float(tau)))).exp() * self.middle

    def displacement(self, tau: float) -> list[Any]:
        """Return x, enclosures."""
        return list(self.state(tau).entries()[: self.structure.n])

    @cached_property
    def ends(self) -> tuple[Any, Any]:
        """The states at tau = -1 (after its impacts) and tau = 1 (before its impacts)."""
        return self.backward * self.middle, self.forward * self.middle

    def narrow(self) -> bool:
        """Tell whether the enclosures are narrow, relative to the largest of their kind."""
        n = self.structure.n
        for z in (*self.ends, self.middle):
            balls = z.entries()
            for part in (balls[:n], balls[n : 2 * n]):
                size = max(float(abs(x.mid())) for x in part)
                if max(float(x.rad()) for x in part) > _NARROW * max(size, 1e-250):
                    return False
        impulses = [*self.impulse.values(), *self.impulse_lower.values()]
        size = max(float(abs(p.mid())) for p in impulses)
        return max(float(p.rad()) for p in impulses) <= _NARROW * max(size, 1e-250)

    @cached_property
    def energy(self) -> Any:
        """``x' M x'/2 + x K x/2 - f x``."""
        n, s, z = self.structure.n, self.structure, self.middle.tolist()
        x, v = arb_mat(z[:n]), arb_mat(z[n : 2 * n])
        total = (v.transpose() * matrix(s.M) * v + x.transpose() * matrix(s.K) * x)[0, 0] / 2
        return total if s.force is None else total - (x.transpose() * column(s.force))[0, 0]

    def harmonic(self, order: int) -> list[Any]:
        """Return Fourier amplitudes of sin(order Omega t) or, even orders, cos(order Omega t)."""
        n, s = self.structure.n, self.structure
        kappa, zero = arb(self.Omega) * order, arb(0)
        angle = kappa * self.h  # a multiple of pi/2
        S, C = angle.sin(), angle.cos()
        low, high = (z.tolist() for z in self.ends)
        x0, v0, x1, v1 = (arb_mat(z[i : i + n]) for z in (low, high) for i in (0, n))
        pull = matrix(s.M).solve(column(np.zeros(n) if s.force is None else s.force))
        stiffness = matrix(s.M).solve(matrix(s.K))
        if order % 2:
            share, terms = zero, (v1 * S - x1 * (kappa * C)) + (v0 * S + x0 * (kappa * C))
        else:
            share = 2 * self.h if order == 0 else 2 * S / kappa
            terms = (v1 * C + x1 * (kappa * S)) - (v0 * C - x0 * (kappa * S))
        for i in range(n):
            stiffness[i, i] -= kappa**2
        try:
            integral = stiffness.solve(pull * share - terms)
        except ZeroDivisionError as error:
            raise UndecidedError("a harmonic is at a natural frequency") from error
        factor = 1 / (2 * self.h) if order == 0 else 1 / self.h
        return [x * factor for x in integral.entries()]

    # Existence

    @cached_property
    def pushes(self) -> list[Any]:
        """Impulses and approach velocities: all positive in motions of the structure."""
        n = self.structure.n
        values = []
        for z, struck, p in (
            (self.ends[1], self.upper, self.impulse),
            (self.ends[0], self.lower, self.impulse_lower),
        ):
            v = arb_mat(z.tolist()[n : 2 * n])
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
    def _steps(self) -> tuple[Flow, int]:
        """The flow, and the number of its steps from one end to the other."""
        flow = Flow(self.A)
        count = max(1, int(np.ceil(2.0 * float(self.h.mid()) / flow.H)))
        if count > _MOST_STEPS:
            raise UndecidedError(f"{count} steps")
        return flow, count

    @cached_property
    def _states(self) -> dict[int, Any]:
        """States at the starts of the steps, in columns: from tau = -1 on (1), and back (-1)."""
        _, count = self._steps
        states = {}
        for direction, end in ((1, self.ends[0]), (-1, self.ends[1])):
            step, Z = (self.A * (self.h * 2 * direction / count)).exp(), end
            while Z.ncols() < count:
                more = step * Z
                Z = arb_mat([a + b for a, b in zip(Z.tolist(), more.tolist(), strict=True)])
                step = step * step
            states[direction] = arb_mat([row[:count] for row in Z.tolist()])
        return states

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
        direction = -side
        flow, count = self._steps
        Z, length = self._states[direction], self.h * 2 * direction / count
        row = matrix(self.rows[a] * side).tolist()[0] + [0] * (self.structure.n + 1)
        rows = flow.taylor_rows(arb_mat([row]), length)
        Y = few(rows) * Z
        off = 2.0 * flow.remainder(doubles(arb_mat([row])), doubles(Z))
        c = -doubles(Y).T
        c[:, 0] = [float(arb(wall) - y) for y in Y.tolist()[0]]
        c[:, 0] += allowance * wall_room
        pad = radius(Y) * Y.nrows() + off
        clear = clearly_positive(c, pad)
        touching = struck and allowance == 0.0
        undecided = False
        for k in np.flatnonzero(~clear):
            first = touching and k == 0
            exact = [-y for y in (Y.tolist()[i][k] for i in range(Y.nrows()))]
            exact[0] = exact[0] + arb(wall) + arb(allowance * wall_room)
            if first:  # at the wall: the rest of the way divided by its length
                exact = exact[1:]
            verdict = sign(exact, off)
            if verdict is False:
                return False
            undecided |= verdict is None
        return None if undecided else True

    # Stability

    def radius(self) -> float:
        """Return the spectral radius of the map over half a period, from that over the period."""
        n = self.structure.n
        size = 2 * n
        motion = (self.A * (2 * self.h)).exp()
        Phi = arb_mat([r[:size] for r in motion.tolist()[:size]])
        low, high = self.ends
        total = Phi
        for place, (z, struck, facing) in enumerate(((high, self.upper, 1), (low, self.lower, -1))):
            rate = (self.A * z).tolist()
            acceleration = arb_mat(rate[n : 2 * n])
            # before the impacts: at the lower walls the velocity after them, reversed
            v = arb_mat(z.tolist()[n : 2 * n]) * facing
            for a in struck:
                total = self._saltation(a, v, acceleration) * total
                gain = (matrix(self.rows[a]) * v)[0, 0] * 2 / self._mass(a)
                m = arb_mat([[self.mobility[i, a]] for i in range(n)])
                v = v - m * gain
            if place == 0:
                total = Phi * total
        values = acb_mat(total.mid()).eig(algorithm="approx")
        largest = max(float(abs(v).mid()) for v in values)
        return max(1.0, largest**0.5)

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


def _some_rows(end: Any, n: int) -> Any:
    return arb_mat(end.tolist()[:n])


def solved(
    structure: Structure,
    limiters: tuple[Limiter, ...],
    active: tuple[int, ...],
    Omega: float,
    enough: Callable[[Solution], bool] | None = None,
) -> Solution:
    """Return a solution at the first precision at which its enclosures are narrow (and enough)."""
    for precision in PRECISIONS:
        flint.ctx.prec = precision
        try:
            solution = Solution(structure, limiters, active, Omega)
        except UndecidedError:
            continue
        if solution.narrow() and (enough is None or enough(solution)):
            return solution
    raise UndecidedError("no precision is enough")
