"""Solutions of families in extended precision, straight from eq. 10.47-10.59 and their relatives.

Nothing is shared with the solvers: natural modes by mpmath's own eigensolver, one linear
system for the impulses at all walls that are struck.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mpmath
import numpy as np

from vibroimpact_solvers.model import System

Number = Any


@dataclass(frozen=True)
class Modes:
    """Eigenvalues, and the modes as seen by all constraints: ``seen[a][j]``; static loads."""

    eigenvalues: list[Number]
    seen: list[list[Number]]
    load: list[Number]


@dataclass(frozen=True)
class Solution:
    """One solution: impulses at both walls and the motion of its modes."""

    plus: list[Number]
    minus: list[Number]
    modes: Modes
    omega: Number
    places: list[Number]

    def coordinate(self, constraint: int, tau: Number) -> Number:
        """Return a constrained coordinate at a triangle-wave time."""
        return sum(
            row * self._modal(j, tau) for j, row in enumerate(self.modes.seen[constraint]) if row
        )

    def velocity_into(self, constraint: int, tau: int) -> Number:
        """Return the speed towards the wall at tau = 1 or -1, by the triangle-wave time."""
        step = mpmath.mpf(10) ** (-mpmath.mp.dps // 3)
        inner = tau * (1 - step)
        change = self.coordinate(constraint, mpmath.mpf(tau)) - self.coordinate(constraint, inner)
        return tau * change / step

    def _modal(self, j: int, tau: Number) -> Number:
        rate, sine, cosine, constant = self._terms[j]
        if rate is None:
            return sine * tau + cosine * tau**2 + constant
        cos, sin = mpmath.cos_sin(rate * tau)
        return mpmath.re(sine * sin + cosine * cos + constant)

    @cached_property
    def _terms(self) -> list[tuple[Number, Number, Number, Number]]:
        """For each mode its rate in tau and the factors of sine and cosine, or of tau and tau^2."""
        scale = 2 * self.omega**2
        terms = []
        for j, eigenvalue in enumerate(self.modes.eigenvalues):
            a = [row[j] for row in self.modes.seen]
            total = sum(x * (p + m) for x, p, m in zip(a, self.plus, self.minus, strict=True))
            apart = sum(x * (p - m) for x, p, m in zip(a, self.plus, self.minus, strict=True))
            mu = eigenvalue / self.omega**2
            if mu == 0:
                terms.append((None, total / scale, apart / (2 * scale), self.places[j]))
                continue
            g = mpmath.sqrt(mu)
            cos, sin = mpmath.cos_sin(g)
            still = self.modes.load[j] / eigenvalue
            terms.append((g, total / (scale * g * cos), -apart / (scale * g * sin), still))
        return terms


def modes(system: System) -> Modes:
    """Return the natural modes of a small system, with the digits that are set."""
    M, K = mpmath.matrix(system.M.to_dense().tolist()), mpmath.matrix(system.K.to_dense().tolist())
    L = mpmath.cholesky(M)
    inverse = L**-1
    eigenvalues, Q = mpmath.eigsy(inverse * K * inverse.T)
    E = inverse.T * Q
    n = system.n
    scale = max(abs(value) for value in eigenvalues)
    floor = scale * mpmath.mpf(10) ** (-mpmath.mp.dps * 2 // 3)
    values = [mpmath.mpf(0) if abs(v) < floor else v for v in eigenvalues]
    rows = system.directions(range(len(system.constraints)))
    seen = [[sum(row[i] * E[i, j] for i in range(n) if row[i]) for j in range(n)] for row in rows]
    size = max(abs(E[i, j]) for i in range(n) for j in range(n))
    none = size * mpmath.mpf(10) ** (-mpmath.mp.dps // 2)
    seen = [[value if abs(value) > none else mpmath.mpf(0) for value in row] for row in seen]
    force = np.zeros(n) if system.force is None else system.force
    load = [sum(force[i] * E[i, j] for i in range(n)) for j in range(n)]
    return Modes(values, seen, load)


def chain_modes(system: System) -> Modes:
    """Return the natural modes of a uniform chain, eq. 10.63."""
    assert system.chain is not None
    n, size = system.n, mpmath.mpf(system.n + 1)
    mass, stiffness = mpmath.mpf(system.chain.mass), mpmath.mpf(system.chain.stiffness)
    values = [
        4 * stiffness / mass * mpmath.sin(j * mpmath.pi / (2 * size)) ** 2 for j in range(1, n + 1)
    ]
    factor = mpmath.sqrt(2 / (size * mass))
    seen = []
    for constraint in system.constraints:
        ((dof, weight),) = constraint.coordinate
        row = [
            weight * factor * mpmath.sin((dof + 1) * j * mpmath.pi / size) for j in range(1, n + 1)
        ]
        seen.append(row)
    return Modes(values, seen, [mpmath.mpf(0)] * n)


def omega_of(Omega: float) -> Number:
    """Return the triangle-wave frequency.

    It is off by far less than what is compared and by far more than what is computed, as odd
    and even responses have poles at simple numbers. Next to a pole phases are compared to the
    square of a double's rounding, 1e-32.
    """
    offset = mpmath.mpf(10) ** (-2 * mpmath.mp.dps // 3)
    return 2 * mpmath.mpf(float(Omega)) / mpmath.pi * (1 + offset)


def solution(system: System, natural: Modes, omega: Number, active: Sequence[int]) -> Solution:
    """Return the solution with impacts at every wall of the active constraints."""
    count = len(system.constraints)
    walls = [(a, +1) for a in active if system.constraints[a].upper is not None]
    walls += [(a, -1) for a in active if system.constraints[a].lower is not None]
    rigid = [j for j, value in enumerate(natural.eigenvalues) if value == 0]
    size = len(walls) + len(rigid)
    A, b = mpmath.zeros(size, size), mpmath.zeros(size, 1)
    for i, (a, side) in enumerate(walls):
        constraint = system.constraints[a]
        b[i] = mpmath.mpf(constraint.upper) if side > 0 else -mpmath.mpf(constraint.lower)
        for j, value in enumerate(natural.eigenvalues):
            row = natural.seen[a][j]
            if value == 0:
                A[i, len(walls) + rigid.index(j)] = row
            else:
                b[i] -= row * natural.load[j] / value
            for k, (other, from_side) in enumerate(walls):
                strength = row * natural.seen[other][j] / (2 * omega**2)
                A[i, k] += strength * _response(value / omega**2, side, from_side)
    for r, j in enumerate(rigid):
        for k, (other, from_side) in enumerate(walls):
            A[len(walls) + r, k] = from_side * natural.seen[other][j] / 2
        b[len(walls) + r] = natural.load[j]
    # A rigid-body mode that the unknown impulses do not move: its place is free.
    for place in range(len(walls), size):
        if all(A[place, k] == 0 for k in range(size)):
            A[place, place] = 1
    unknowns = mpmath.lu_solve(A, b)
    plus, minus = [mpmath.mpf(0)] * count, [mpmath.mpf(0)] * count
    for k, (a, side) in enumerate(walls):
        (plus if side > 0 else minus)[a] = unknowns[k]
    places = [mpmath.mpf(0)] * len(natural.eigenvalues)
    for r, j in enumerate(rigid):
        places[j] = unknowns[len(walls) + r]
    return Solution(plus, minus, natural, omega, places)


def _response(mu: Number, side: int, from_side: int) -> Number:
    """Motion at one turn caused by an impulse at one turn."""
    if mu == 0:
        return side + mpmath.mpf(from_side) / 2
    g = mpmath.sqrt(mu)
    return mpmath.re(side * mpmath.tan(g) / g - from_side * mpmath.cot(g) / g)
