"""Existence of single solutions in ball arithmetic, where double precision leaves it open.

Without natural modes: from the state ``z = (x, x', 1)`` after the impacts at tau = -1 the motion
is ``exp(A t) z``. The displacements there and the impulses solve linear equations, as velocities
at impacts are ``M^-1 W^T p/omega`` and struck coordinates are at their walls. The distance f of a
coordinate from its limit is positive throughout a time of half-length s about its middle if

    f - |f'| s - D s^2/2 > 0 ,      D >= |f''| ,

or, where it leaves its wall at the end of that time with the velocity v, if ``D s < v``; else the
time is halved. Every number is a ball, so that what is decided is proved, roundings included.
"""

from __future__ import annotations

import math
from typing import Any, Final

import flint
import numpy as np
import scipy.linalg

from vibroimpact_solvers import condensation, precision
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.impact_modes.family import Family
from vibroimpact_solvers.impact_modes.problem import Problem
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.results.impact_modes import Reason

LARGEST: Final = 16
"""Degrees of freedom up to which solutions are decided in ball arithmetic."""

_BITS = (256, 512)
_HALVINGS = 100  # of the time between two impacts
_DEEPEST = 60  # of the first intervals within which velocities change by little
MOST: Final = 4000
"""Intervals of time in which one solution is looked at, at most."""


Verdict = tuple[Reason, float]
"""The reason, and a time at which a limit is passed or nan."""


def decided(problem: Problem, place: int) -> Verdict | None:
    """Return what is true of the solution at one frequency, None if it stays open."""
    for bits in _BITS:
        look()
        with precision.working(bits + 2 * _HALVINGS):
            try:
                verdict = _Solution(problem, place).verdict()
            except ZeroDivisionError:  # of equations that are singular to this precision
                continue
        if verdict is not None:
            return verdict
    return None


class _Solution:
    def __init__(self, problem: Problem, place: int) -> None:
        system, family = problem.system, Family.of(problem)
        condensed = condensation.in_balls(system)
        M, K, massive = condensed.M, condensed.K, condensed.massive
        self.n = n = massive.size
        self.constraints = system.constraints
        self.upper = [problem.active[i] for i in family.upper]
        self.lower = [problem.active[i] for i in family.lower]
        self.rows = _exact(system.directions(range(len(self.constraints)))[:, massive])
        force = np.zeros(n) if system.force is None else system.force[massive]
        self.B, pull = M.solve(K), M.solve(_exact(force[:, np.newaxis]))
        self.mobility = M.solve(self.rows.transpose())
        self.A = flint.arb_mat(2 * n + 1, 2 * n + 1)
        for i in range(n):
            self.A[i, n + i], self.A[n + i, 2 * n] = flint.arb(1), pull[i, 0]
            for j in range(n):
                self.A[n + i, j] = -self.B[i, j]
        at = problem.frequencies
        omega = flint.arb(float(at.omega[place]))
        # What rounding took from omega is a double, known to a rounding of itself.
        rest = float(at.rounding[place])
        self.h = 1 / (omega * (1 + flint.arb(rest, abs(rest) * 2.0**-50)))
        self._propagators = self._all_propagators()
        self._solve()

    def _all_propagators(self) -> list[Any]:
        """Return ``exp(A t)``, number k for t = 2^(1 - k)/omega."""
        last = (self.A * (self.h / flint.arb(2) ** _HALVINGS)).exp()
        propagators = [last]
        for _ in range(_HALVINGS + 1):
            look()
            propagators.append(propagators[-1] * propagators[-1])
        return propagators[::-1]

    def _solve(self) -> None:
        n, whole = self.n, self._propagators[0].tolist()
        struck = [*((a, 1) for a in self.upper), *((a, -1) for a in self.lower)]
        size = n + len(struck)
        L, right = flint.arb_mat(size, size), flint.arb_mat(size, 1)
        # Columns of the state at the end: displacements at the beginning, impulses, constant.
        start = [[flint.arb(int(i == j)) for j in range(n)] for i in range(2 * n + 1)]
        for i, row in enumerate(start):
            for a, side in struck:
                moved = n <= i < 2 * n and side < 0
                row.append(self.mobility[i - n, a] * self.h if moved else flint.arb(0))
            row.append(flint.arb(int(i == 2 * n)))
        end = flint.arb_mat(whole) * flint.arb_mat(start)
        for i in range(n):
            for j in range(n + len(struck)):
                L[i, j] = end[n + i, j]
            for k, (a, side) in enumerate(struck):
                if side > 0:
                    L[i, n + k] -= self.mobility[i, a] * self.h
            right[i, 0] = -end[n + i, n + len(struck)]
        for k, (a, side) in enumerate(struck):
            look()
            line = flint.arb_mat([self.rows.tolist()[a]])
            places = line * flint.arb_mat((end if side > 0 else flint.arb_mat(start)).tolist()[:n])
            for j in range(n + len(struck)):
                L[n + k, j] = places[0, j]
            wall = self.constraints[a].upper if side > 0 else -(self.constraints[a].lower or 0.0)
            right[n + k, 0] = flint.arb(wall) - places[0, n + len(struck)]
        u = L.solve(right)
        self.impulses = [u[n + k, 0] for k in range(len(struck))]
        whole_u = flint.arb_mat([*u.tolist(), [flint.arb(1)]])
        self.start = flint.arb_mat(start) * whole_u
        self.end = end * whole_u

    def verdict(self) -> Verdict | None:
        """Return the verdict, None if it stays open."""
        if any(p < 0 for p in self.impulses):
            return Reason.NEGATIVE_IMPULSE, math.nan
        if not all(p > 0 for p in self.impulses):
            return None
        pairs = [(a, self.end) for a in self.upper] + [(a, self.start) for a in self.lower]
        speeds = [self._speed(a, state) for a, state in pairs]
        if any(v < 0 for v in speeds):
            return Reason.WRONG_VELOCITY, math.nan
        return self._path() if all(v > 0 for v in speeds) else None

    def _speed(self, a: int, state: Any) -> Any:
        row = flint.arb_mat([self.rows.tolist()[a]])
        return (row * flint.arb_mat(state.tolist()[self.n : 2 * self.n]))[0, 0]

    def _path(self) -> Verdict | None:
        """Halve times until each is decided."""
        n, watches = self.n, list[tuple[int, int]]()
        rows, none = self.rows.tolist(), [flint.arb(0)] * self.n
        margins = []
        for a, constraint in enumerate(self.constraints):
            for side, wall in ((1, constraint.upper), (-1, constraint.lower)):
                if wall is not None:
                    watches.append((a, side))
                    margins.append([*(-side * w for w in rows[a]), *none, flint.arb(wall)])
        R = flint.arb_mat(margins)
        rates = R * self.A
        self._bends = _above(rates * self.A)
        A = _above(self.A)
        fastest = math.sqrt(float(np.abs(np.linalg.eigvals(A[n : 2 * n, :n])).max(initial=0.0)))
        h = float(self.h.mid())
        first = max(0, math.ceil(math.log2(max(2.0 * fastest * h, 1e-9))))
        self._growth = dict[int, Any]()
        for k in range(first, first + _DEEPEST):
            look()
            self._growth[k] = scipy.linalg.expm(A * (h * 2.0**-k)) * (1.0 + 1e-9)
        stack = [(0, 0, self._moved(1, self.start, 1), list(range(len(watches))))]
        for _ in range(MOST):
            look()
            if not stack:
                return Reason.OK, math.nan
            k, index, z, left = stack.pop()
            if k >= first + _DEEPEST:
                return None
            if k >= first:
                verdict = self._interval(k, index, z, left, (R, rates, watches))
                if verdict is not None:
                    return verdict
            if left:
                for way in (-1, 1):
                    child = self._moved(k + 2, z, way)
                    stack.append((k + 1, 2 * index + (way + 1) // 2, child, list(left)))
        return None

    def _interval(
        self, k: int, index: int, z: Any, left: list[int], margins: tuple[Any, Any, Any]
    ) -> Verdict | None:
        """Take the limits that are kept throughout an interval from those left to be decided."""
        R, rates, watches = margins
        f, rise = (R * z).entries(), (rates * z).entries()
        s, last = self.h / flint.arb(2) ** k, 2**k - 1
        bends = self._bends @ (self._growth[k] @ _above(z)[:, 0]) * (1.0 + 1e-9)
        for place in list(left):
            a, side = watches[place]
            if f[place] < 0:
                return Reason.PENETRATION, -1.0 + (2 * index + 1) / 2.0**k
            bend = flint.arb(float(bends[place]))
            kept = f[place] - abs(rise[place]) * s - bend * s * s / 2 > 0
            if side > 0 and a in self.upper and index == last:
                kept = bend * s < self._speed(a, self.end)
            elif side < 0 and a in self.lower and index == 0:
                kept = bend * s < self._speed(a, self.start)
            if kept:
                left.remove(place)
        return None

    def _moved(self, number: int, z: Any, way: int) -> Any:
        """Return a state later or, way -1, before: motions can be driven backwards."""
        if way > 0:
            return self._propagators[number] * z
        return self._reversed(self._propagators[number] * self._reversed(z))

    def _reversed(self, z: Any) -> Any:
        values = [-v if self.n <= i < 2 * self.n else v for i, v in enumerate(z.entries())]
        return flint.arb_mat([[v] for v in values])


def _exact(rows: Floats) -> Any:
    return flint.arb_mat(np.asarray(rows, dtype=np.float64).tolist())


def _above(matrix: Any) -> Floats:
    """Return bounds of the magnitudes of the entries."""
    rows = [[float(x.abs_upper()) for x in row] for row in matrix.tolist()]
    return np.array(rows) * (1.0 + 1e-15) + 1e-300
