"""Linear motions in ball arithmetic (Arb), without modes, and the signs of polynomials.

A motion obeys ``z' = A z`` with the state ``z = (x, x', 1, pairs of harmonic loads)``. It is
advanced by the matrix exponential and seen through its Taylor polynomials, whose remainder is
bounded by a norm of A; where a polynomial has a sign is decided by its Bernstein coefficients.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import flint
import numpy as np
from flint import arb, arb_mat

REACH = 4.0  # norm of A times the length of a step
DEGREE = 40  # of the Taylor polynomials over a step
_FEW = 41  # Taylor coefficients looked at in double precision: the rest is below rounding


class UndecidedError(ArithmeticError):
    """The reference cannot tell: precision or patience end first."""


def matrix(rows: Any) -> Any:
    """Return an exact matrix of doubles."""
    return arb_mat(np.atleast_2d(np.asarray(rows, dtype=np.float64)).tolist())


def column(values: Any) -> Any:
    """Return an exact column of doubles."""
    return matrix(np.asarray(values, dtype=np.float64).reshape(-1, 1))


def doubles(balls: Any) -> Any:
    """Return the midpoints of a matrix, rounded."""
    flat = [float(x) for x in balls.entries()]
    return np.array(flat).reshape(balls.nrows(), balls.ncols())


def radius(balls: Any) -> float:
    """Return the largest radius of the entries."""
    return max((float(x.rad()) for x in balls.entries()), default=0.0)


@dataclass(frozen=True, slots=True)
class Structure:
    """``M x'' + C x' + K x = f + sum amplitude cos(frequency t + phase)``, all of doubles."""

    M: Any
    K: Any
    C: Any | None = None
    force: Any | None = None
    load: tuple[tuple[int, float, float, float], ...] = ()  # dof, amplitude, frequency, phase
    # Direction, times and values of loads that are straight lines between samples.
    sampled: tuple[tuple[Any, Any, Any], ...] = ()

    @property
    def n(self) -> int:
        """Number of degrees of freedom."""
        return len(self.M)

    @property
    def size(self) -> int:
        """Length of the state."""
        return 2 * self.n + 1 + 2 * len(self.load) + 2 * len(self.sampled)

    def generator(self) -> Any:
        """Return A at the precision in force."""
        n = self.n
        right = np.zeros((n, self.size))
        right[:, :n] = -np.asarray(self.K)
        if self.C is not None:
            right[:, n : 2 * n] = -np.asarray(self.C)
        if self.force is not None:
            right[:, 2 * n] = self.force
        for place, (dof, amplitude, _, _) in enumerate(self.load):
            right[dof, 2 * n + 1 + 2 * place] += amplitude
        first = 2 * n + 1 + 2 * len(self.load)  # of the values of samples and their slopes
        for place, (direction, _, _) in enumerate(self.sampled):
            right[:, first + 2 * place] = direction
        accelerations = matrix(self.M).solve(matrix(right))
        A = arb_mat(self.size, self.size)
        for i in range(n):
            A[i, n + i] = arb(1)
            for j in range(self.size):
                A[n + i, j] = accelerations[i, j]
        for place, (_, _, frequency, _) in enumerate(self.load):
            c = 2 * n + 1 + 2 * place
            A[c, c + 1], A[c + 1, c] = arb(-frequency), arb(frequency)
        for place in range(len(self.sampled)):
            A[first + 2 * place, first + 2 * place + 1] = arb(1)
        return A

    def breaks(self) -> list[float]:
        """Return the times at which loads bend."""
        return sorted({float(t) for _, times, _ in self.sampled for t in times if t > 0.0})

    def bend(self, z: Any, t: Any) -> None:
        """Let the values of samples and their slopes be those from a time on, in a state."""
        first = 2 * self.n + 1 + 2 * len(self.load)
        for place, (_, times, values) in enumerate(self.sampled):
            k = max(i for i in range(len(times) - 1) if arb(float(times[i])) <= t)
            low, high = arb(float(values[k])), arb(float(values[k + 1]))
            slope = (high - low) / (arb(float(times[k + 1])) - arb(float(times[k])))
            z[first + 2 * place, 0] = (low + slope * (t - arb(float(times[k])))).mid()
            z[first + 2 * place + 1, 0] = slope.mid()

    def state(self, x: Any, v: Any) -> Any:
        """Return the state at t = 0."""
        z = arb_mat(self.size, 1)
        for i in range(self.n):
            z[i, 0], z[self.n + i, 0] = arb(float(x[i])), arb(float(v[i]))
        z[2 * self.n, 0] = arb(1)
        for place, (_, _, _, phase) in enumerate(self.load):
            c = 2 * self.n + 1 + 2 * place
            z[c + 1, 0], z[c, 0] = arb(float(phase)).sin_cos()
        self.bend(z, arb(0))
        return z


def mobility_times(M: Any, rows: Any) -> Any:
    """Return ``M^-1 W^T``."""
    return matrix(M).solve(matrix(rows).transpose())


@dataclass
class Flow:
    """The motions of ``z' = A z``, looked at in steps of a length H with ``|A| H <= REACH``."""

    A: Any
    longest: float = math.inf
    degree: int = DEGREE

    @cached_property
    def weights(self) -> tuple[Any, float]:
        """Weights of the entries of z, and the norm of A that belongs to them."""
        A = np.abs(doubles(self.A))
        scaling = np.ones(len(A))
        before = None
        for _ in range(30):  # balancing, by powers of two
            if before is not None and (before == scaling).all():
                break
            before = scaling.copy()
            for i in range(len(A)):
                row = float((A[i] * scaling).sum() - A[i, i] * scaling[i]) / scaling[i]
                column = float((A[:, i] / scaling).sum() - A[i, i] / scaling[i]) * scaling[i]
                if row > 0.0 and column > 0.0:
                    scaling[i] *= 2.0 ** round(0.5 * math.log2(row / column))
        norm = float((A * scaling / scaling[:, np.newaxis]).sum(axis=1).max())
        return scaling, max(norm * (1.0 + 1e-12), 1e-300)

    @cached_property
    def H(self) -> float:
        """Length of a step, a double."""
        return min(self.longest, REACH / self.weights[1])

    @cached_property
    def E(self) -> Any:
        """``exp(A H)``."""
        return (self.A * arb(self.H)).exp()

    def taylor_rows(self, row: Any, length: Any = None) -> Any:
        """Return the rows ``r (A h)^k / k!`` of a step h, shape (degree + 1, size)."""
        Ah, r, rows = self.A * (arb(self.H) if length is None else length), row, []
        for k in range(self.degree + 1):
            rows.append(r.entries())
            r = (r * Ah) * (arb(1) / (k + 1))
        return arb_mat(rows)

    def remainder(self, row: Any, z: Any) -> float:
        """Bound the part of ``r z`` and of its slope that the Taylor polynomial leaves out."""
        scaling, norm = self.weights
        size = float((np.abs(z).T / scaling).max())
        along = float((np.abs(row) * scaling).sum())
        grown = norm * self.H
        d = self.degree
        return (
            4.0
            * along
            * size
            * math.exp(grown)
            * grown
            * math.exp(d * math.log(max(grown, 1e-300)) - math.lgamma(d + 1))
        )


# Polynomials on [0, 1]


@cache
def power_to_bernstein(degree: int) -> Any:
    """Return the matrix from power to Bernstein coefficients."""
    B = np.zeros((degree + 1, degree + 1))
    for j in range(degree + 1):
        for k in range(j + 1):
            B[j, k] = math.comb(j, k) / math.comb(degree, k)
    return B


@cache
def _exact_bernstein(degree: int, precision: int) -> Any:
    assert precision == flint.ctx.prec
    return arb_mat(
        [
            [arb(math.comb(j, k)) / math.comb(degree, k) if k <= j else arb(0)
             for k in range(degree + 1)]
            for j in range(degree + 1)
        ]
    )  # fmt: skip


def bernstein(c: list[Any]) -> list[Any]:
    """Return the Bernstein coefficients of a polynomial on [0, 1], in balls."""
    B = _exact_bernstein(len(c) - 1, flint.ctx.prec)
    return list((B * arb_mat([[x] for x in c])).entries())


@cache
def _halving(degree: int, precision: int) -> Any:
    """Return the matrix from Bernstein coefficients to those on both halves (de Casteljau)."""
    assert precision == flint.ctx.prec
    left = [
        [arb(math.comb(j, k)) / 2**j if k <= j else arb(0) for k in range(degree + 1)]
        for j in range(degree + 1)
    ]
    return arb_mat(left + [row[::-1] for row in left[::-1]])


def halves(b: list[Any]) -> tuple[list[Any], list[Any]]:
    """Return the Bernstein coefficients on both halves."""
    both = (_halving(len(b) - 1, flint.ctx.prec) * arb_mat([[x] for x in b])).entries()
    return list(both[: len(b)]), list(both[len(b) :])


def clearly_positive(coefficients: Any, pad: Any) -> Any:
    """Tell which polynomials are positive on [0, 1], shape (polynomial, power), in doubles."""
    c = coefficients
    pad = pad + c.shape[1] * 2.0**-51 * np.abs(c).sum(axis=1)
    return (c @ power_to_bernstein(c.shape[1] - 1).T).min(axis=1) > pad


def sign(c: list[Any], pad: float, depth: int = 60) -> bool | None:
    """Tell whether a polynomial stays above -pad on [0, 1] (True), or passes below (False)."""
    beyond = arb(pad)
    stack = [(bernstein(c), depth)]
    undecided, patience = False, 6 * depth
    while stack:
        b, left = stack.pop()
        patience -= 1
        if all(x > beyond for x in b):
            continue
        if b[0] < -beyond or b[-1] < -beyond:
            return False
        if left == 0:
            undecided = True
            continue
        if patience < 0:
            return None
        stack.extend((half, left - 1) for half in halves(b))
    return None if undecided else True


def few(rows: Any) -> Any:
    """Return the Taylor rows that double precision sees."""
    table = rows.tolist()[:_FEW]
    return arb_mat(table)
