"""Extended precision: ball arithmetic with any number of digits.

A number is a ball of FLINT's Arb: a midpoint and a bound of its distance to the true number, which
every operation rounds outwards. A comparison is true only where it is so for all numbers of its
balls.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Any, Final

import flint
import numpy as np

from vibroimpact_solvers import precision
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import PlanError

Real = Any
"""A ball, `flint.arb`."""
Matrix = Any
"""A matrix of balls, `flint.arb_mat`."""

GUARD: Final = 20
"""Guard digits of the arithmetic."""


def working(digits: int) -> AbstractContextManager[None]:
    """Compute with a number of digits and the guard digits."""
    return precision.working(round((digits + GUARD + 1) * math.log2(10.0)))


def working_digits() -> int:
    """Return the number of digits of the present precision, without the guard digits."""
    return round(flint.ctx.prec / math.log2(10.0)) - GUARD - 1


def undecided(what: str, now: Real) -> PlanError:
    """Return the refusal of what the digits do not tell."""
    known = f"{working_digits()} digits do not tell {what} at t = {float(now.mid())!r}"
    return PlanError(f"{known}: give more digits, or a t_end before it", ("digits",))


def real(value: float) -> Real:
    """Return a number that is exactly a double."""
    return flint.arb(float(value))


def within(value: Real, radius: Real) -> Real:
    """Return the ball of all numbers within a radius of those of a ball."""
    return value + flint.arb(0, radius.upper())


def matrix(rows: Sequence[Sequence[Any]]) -> Matrix:
    """Return a matrix of balls."""
    return flint.arb_mat([list(row) for row in rows])


def column(values: Sequence[Any]) -> Matrix:
    """Return a matrix of one column."""
    return flint.arb_mat([[value] for value in values])


def exact(values: Floats) -> Matrix:
    """Return the matrix whose entries are exactly these doubles."""
    return matrix([[real(value) for value in row] for row in values.tolist()])


def joined(columns: Sequence[Matrix]) -> Matrix:
    """Return the matrix of some columns."""
    return flint.arb_mat([list(row) for row in zip(*(c.entries() for c in columns), strict=True)])


def widened(values: Matrix, radii: Sequence[Real]) -> Matrix:
    """Return a column whose entries are within radii of those of another one."""
    return column([within(v, r) for v, r in zip(values.entries(), radii, strict=True)])


def around(value: Real, every: Real) -> Real:
    """Return a ball about the midpoint of one that contains another one."""
    return within(value.mid(), (every - value.mid()).abs_upper())


def radii(values: Matrix) -> list[Real]:
    """Return the radii of a column."""
    return [value.rad() for value in values.entries()]


def doubles(values: Matrix) -> Floats:
    """Return the doubles nearest to the midpoints."""
    rows = [[float(value.mid()) for value in row] for row in values.tolist()]
    return np.array(rows, dtype=np.float64).reshape(values.nrows(), values.ncols())


def above(value: Real) -> float:
    """Return a double that is not below the magnitude of any number of a ball."""
    return float(np.nextafter(float(value.abs_upper()) * (1.0 + 1e-15), np.inf))


def largest_radius(values: Matrix) -> float:
    """Return a double that is not below the radius of any entry."""
    return max((above(value.rad()) for value in values.entries()), default=0.0)


def norm(values: Floats) -> float:
    """Return an upper bound of the spectral norm of a matrix of doubles."""
    if not values.size:
        return 0.0
    sizes = np.abs(values)
    product = float(sizes.sum(axis=0).max()) * float(sizes.sum(axis=1).max())
    return float(np.sqrt(product)) * (1.0 + 1e-12)
