"""Central differences of impact modes in ball arithmetic, of data that are themselves balls.

As in `impact_modes`, a solution is found from its state at t = 0 and the propagator of the
first-order equations over ``1/omega``; no natural modes, no formula of the solvers. Data change
by ``2^-STEP``, so that the differences are right to some ``2^-(2 STEP)``, relative to their third
derivatives.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import flint
import numpy as np
from flint import arb, arb_mat

from tests.reference.balls import UndecidedError, doubles

BITS = 900
STEP = 160


def balls(values: Any) -> Any:
    """Return a matrix of doubles, without error."""
    return arb_mat(np.atleast_2d(np.asarray(values, dtype=np.float64)).tolist())


@dataclass
class Data:
    """A family of impact modes: limiters by rows w, and walls (lower, upper), None: no wall."""

    M: Any
    K: Any
    force: Any
    rows: Any
    walls: list[tuple[Any, Any]]
    Omega: Any

    @classmethod
    def of(cls, M: Any, K: Any, force: Any, rows: Any, walls: Any, Omega: float) -> Data:
        """Return the data of doubles."""
        n = len(M)
        pull = np.zeros(n) if force is None else np.asarray(force)
        exact = [tuple(None if wall is None else arb(wall) for wall in pair) for pair in walls]
        return cls(balls(M), balls(K), balls(pull.reshape(-1, 1)), balls(rows), exact, arb(Omega))


@dataclass
class Change:
    """Rates of the data with a parameter, of doubles; None: it stays."""

    M: Any = None
    K: Any = None
    force: Any = None
    rows: Any = None
    walls: dict[int, tuple[float, float]] = field(default_factory=dict)
    Omega: float = 0.0

    def apply(self, data: Data, step: Any) -> Data:
        """Return the data some steps away."""

        def moved(value: Any, rate: Any) -> Any:
            if rate is None:
                return value
            rate = np.asarray(rate, dtype=np.float64)
            return value + balls(rate.reshape(-1, 1) if rate.ndim == 1 else rate) * step

        walls = list(data.walls)
        for place, rates in self.walls.items():
            walls[place] = tuple(
                None if wall is None else wall + step * arb(rate)
                for wall, rate in zip(walls[place], rates, strict=True)
            )
        return Data(
            moved(data.M, self.M),
            moved(data.K, self.K),
            moved(data.force, self.force),
            moved(data.rows, self.rows),
            walls,
            data.Omega + step * arb(self.Omega),
        )


def solution(data: Data, tau: tuple[float, ...]) -> dict[str, Any]:
    """Return upper and lower impulses, displacements at tau = 1 and at others, and the energy.

    Lists of balls. Raises `UndecidedError` where the equations are singular.
    """
    n, count = data.M.nrows(), data.rows.nrows()
    B, pull = data.M.solve(data.K), data.M.solve(data.force)
    h = arb.pi() / (2 * data.Omega)
    A = arb_mat(2 * n + 1, 2 * n + 1)
    for i in range(n):
        A[i, n + i] = arb(1)
        A[n + i, 2 * n] = pull[i, 0]
        for j in range(n):
            A[n + i, j] = -B[i, j]
    pushes = data.M.solve(data.rows.transpose())  # M^-1 W^T
    ends = [(1, [a for a in range(count) if data.walls[a][1] is not None])]
    ends.append((-1, [a for a in range(count) if data.walls[a][0] is not None]))
    size = 2 * n + len(ends[0][1]) + len(ends[1][1])
    L, right, place = arb_mat(size, size), arb_mat(size, 1), 2 * n
    equation = 0
    for way, struck in ends:
        flow = (A * (h * way)).exp()
        # At the wall the velocity is what the impulse turns: x' = M^-1 W^T p/omega.
        for i in range(n):
            for j in range(2 * n):
                L[equation, j] = flow[n + i, j]
            for k, a in enumerate(struck):
                L[equation, place + k] = -pushes[i, a] * h
            right[equation, 0] = -flow[n + i, 2 * n]
            equation += 1
        for a in struck:
            for j in range(2 * n):
                L[equation, j] = sum((data.rows[a, i] * flow[i, j] for i in range(n)), arb(0))
            static = sum((data.rows[a, i] * flow[i, 2 * n] for i in range(n)), arb(0))
            wall = data.walls[a][1] if way > 0 else -data.walls[a][0]
            right[equation, 0] = wall - static
            equation += 1
        place += len(struck)
    try:
        u = L.solve(right)
    except ZeroDivisionError as error:
        raise UndecidedError("the equations of the solution are singular") from error
    plus, minus = [arb(0)] * count, [arb(0)] * count
    for k, a in enumerate(ends[0][1]):
        plus[a] = u[2 * n + k, 0]
    for k, a in enumerate(ends[1][1]):
        minus[a] = u[2 * n + len(ends[0][1]) + k, 0]
    state = arb_mat([[u[i, 0]] for i in range(2 * n)] + [[arb(1)]])
    at = [(A * (h * arb(t))).exp() * state for t in (1.0, *tau)]
    x = arb_mat([[u[i, 0]] for i in range(n)])
    v = arb_mat([[u[n + i, 0]] for i in range(n)])
    energy = (v.transpose() * data.M * v + x.transpose() * data.K * x)[0, 0] / 2
    energy -= (data.force.transpose() * x)[0, 0]
    return {
        "impulse": plus,
        "impulse_lower": minus,
        "momentum": [2 * p * h for p in plus],
        "momentum_lower": [2 * p * h for p in minus],
        "shape": [at[0][i, 0] for i in range(n)],
        "waveform": [each[i, 0] for each in at[1:] for i in range(n)],
        "energy": [energy],
    }


def derivative(data: Data, change: Change, tau: tuple[float, ...]) -> dict[str, Any]:
    """Return the derivatives of a solution as doubles, by name, flat."""
    before, flint.ctx.prec = flint.ctx.prec, BITS
    try:
        step = arb(2) ** -STEP
        ahead = solution(change.apply(data, step), tau)
        back = solution(change.apply(data, -step), tau)
        found = {}
        for name, values in ahead.items():
            parts = [(a - b) / (2 * step) for a, b in zip(values, back[name], strict=True)]
            if any(float(each.rad()) > 1e-18 * (1e-30 + abs(float(each.mid()))) for each in parts):
                raise UndecidedError(f"the difference of {name} is not narrow")
            found[name] = doubles(arb_mat([[each] for each in parts]))[:, 0]
        return found
    finally:
        flint.ctx.prec = before
