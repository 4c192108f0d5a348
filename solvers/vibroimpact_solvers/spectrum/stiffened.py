"""Modes of a structure that springs are added to, one after the other, from its own modes.

In modal coordinates a spring k at a coordinate with the modal row r is a change of rank one,

    (Lambda + k r r^T) v = mu v ,    1 + k sum_j r_j^2 / (lambda_j - mu) = 0 ,

whose roots lie one in each interval between neighbouring lambda_j (secular equation; G. H. Golub,
"Some modified matrix eigenvalue problems", SIAM Review 15, 1973). Each root is found as its
distance to the nearer lambda_j, so that differences keep all digits, however stiff the spring is
and however graded the spectrum. With the row r^ whose roots are exactly those found,
``r^_i^2 = prod_j (mu_j - lambda_i) / (k prod_(j != i) (lambda_j - lambda_i))``, the vectors
``v_i = r^_i / (lambda_i - mu)`` are orthogonal to rounding (M. Gu and S. C. Eisenstat, "A stable
and efficient algorithm for the rank-one modification of the symmetric eigenproblem", SIAM J.
Matrix Anal. Appl. 15, 1994), and ``r^T v = -1 / (k |d|)``, d being v before it has unit length,
keeps its digits where it is small: the mode hardly moves at a stiff spring.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.meter import look

_WIDE: Any = np.longdouble
_EQUAL: Final = 4.0  # roundings within which two eigenvalues are one
_SILENT: Final = 1e-100  # of the largest entry of a row, below which a mode does not feel a spring
_TINY: Final = 2.0**-400  # of an interval: no root is nearer to its end
_GEOMETRIC: Final = 10  # halvings of the exponent of a distance
_ROUNDS: Final = 200  # steps of the search for roots, at most


@dataclass(frozen=True, eq=False, slots=True)
class Stiffened:
    """Modes of a structure with springs, in the modal coordinates of the structure without.

    Parameters
    ----------
    eigenvalues : array of long double, shape (mode,)
        Ascending.
    vectors : array, shape (mode, mode)
        The modes as columns, orthonormal.
    rows : array, shape (row, mode)
        What the modes make of the coordinates, those of the springs first.
    """

    eigenvalues: NDArray[Any]
    vectors: Floats
    rows: Floats


def stiffened(eigenvalues: NDArray[Any], rows: Floats, stiffness: Sequence[float]) -> Stiffened:
    """Return the modes of a structure with springs at its first coordinates.

    Parameters
    ----------
    eigenvalues : array of long double, shape (mode,)
        Without the springs, ascending.
    rows : array, shape (row, mode)
        Modal rows ``w^T E`` of the coordinates.
    stiffness : sequence of float
        Of the spring at each of the first rows, at least 0.
    """
    values = eigenvalues.astype(_WIDE)
    vectors, rows = np.eye(values.size), rows.copy()
    for place, k in enumerate(stiffness):
        if k > 0.0 and rows[place].any():
            values, turned, own = _with_spring(values, rows[place], k)
            vectors, rows = vectors @ turned, rows @ turned
            rows[place] = own
    return Stiffened(values, vectors, rows)


def _with_spring(
    values: NDArray[Any], row: Floats, k: float
) -> tuple[NDArray[Any], Floats, Floats]:
    """Return eigenvalues, vectors as columns and the row of the spring after it is added."""
    n = values.size
    basis, row = _apart(values, row)
    moved = np.flatnonzero(np.abs(row) > _SILENT * np.abs(row).max())
    poles, part = values[moved], row[moved].astype(_WIDE)
    origin, distance = _roots(poles, part, k)
    # poles_i - mu_j, with all its digits
    apart = (poles[:, np.newaxis] - poles[origin]) - distance
    vectors = _weights(poles, part, apart, k)[:, np.newaxis] / apart
    lengths = np.sqrt((vectors * vectors).sum(axis=0))
    new = values.copy()
    new[moved] = poles[origin] + distance
    turned, own = np.eye(n), np.zeros(n)
    turned[np.ix_(moved, moved)] = (vectors / lengths).astype(np.float64)
    own[moved] = (-1.0 / (k * lengths)).astype(np.float64)
    order = np.argsort(new, kind="stable")
    return new[order], (basis @ turned)[:, order], own[order]


def _apart(values: NDArray[Any], row: Floats) -> tuple[Floats, Floats]:
    """Turn equal modes such that one of them feels the spring; return the turn and the row."""
    turned, row = np.eye(values.size), row.copy()
    gaps = np.diff(values)
    equal = gaps <= _EQUAL * EPS * np.maximum(np.abs(values[1:]), np.abs(values[:-1]))
    first = 0
    for place in range(1, values.size + 1):
        if place < values.size and equal[place - 1]:
            continue
        some = first + np.flatnonzero(row[first:place])  # the others feel nothing as they are
        if some.size > 1:
            length = float(np.linalg.norm(row[some]))
            mirror = row[some].copy()
            mirror[-1] += np.copysign(length, mirror[-1])
            mirror /= np.linalg.norm(mirror)
            turned[np.ix_(some, some)] -= 2.0 * np.outer(mirror, mirror)
            row[some[:-1]], row[some[-1]] = 0.0, -np.copysign(length, mirror[-1])
        first = place
    return turned, row


def _roots(
    poles: NDArray[Any], row: NDArray[Any], k: float
) -> tuple[NDArray[np.int64], NDArray[Any]]:
    """Return the pole nearest to each root, and the distance of the root from it."""
    n, squares = poles.size, k * row * row
    origin = np.arange(n)
    # The last root is below the last pole by no more than the trace of the spring.
    widths = np.append(np.diff(poles), squares.sum())
    side = np.ones(n, _WIDE)
    if n > 1:
        above = _secular(poles, squares, origin[:-1], 0.5 * widths[:-1]) < 0.0
        origin[:-1] += above
        side[:-1] = np.where(above, -1.0, 1.0)
        widths[:-1] *= 0.5
    low, high = widths * _WIDE(_TINY), widths.copy()
    for step in range(_ROUNDS):
        look()
        if step < _GEOMETRIC:
            trial = np.sqrt(low) * np.sqrt(high)
        else:
            trial = 0.5 * (low + high)
            trial = np.where(high - low > low, np.sqrt(low) * np.sqrt(high), trial)
        if not ((trial > low) & (trial < high)).any():
            break
        value = side * _secular(poles, squares, origin, side * trial)
        # Towards the pole the function goes to -infinity times the side.
        low, high = np.where(value < 0.0, trial, low), np.where(value < 0.0, high, trial)
    return origin, side * 0.5 * (low + high)


def _secular(
    poles: NDArray[Any],
    squares: NDArray[Any],
    origin: NDArray[np.int64],
    distance: NDArray[Any],
) -> NDArray[Any]:
    """Return ``1 + k sum r_j^2 / (lambda_j - mu)`` for each mu = lambda_origin + distance."""
    apart = (poles[:, np.newaxis] - poles[origin]) - distance
    return np.asarray(1.0 + (squares[:, np.newaxis] / apart).sum(axis=0))


def _weights(poles: NDArray[Any], row: NDArray[Any], apart: NDArray[Any], k: float) -> NDArray[Any]:
    """Return the row whose roots are exactly those found, with the signs of the given one.

    apart is poles_i - mu_j; the roots and the poles interlace, so that ratios are positive.
    """
    n = poles.size
    between = poles[:, np.newaxis] - poles
    np.fill_diagonal(between, 1.0)
    # Of pole i: (mu_j - p_i)/(p_j - p_i) for j < i, the same with j + 1 in the pole for j >= i.
    index = np.arange(n)
    before = index[np.newaxis, :] < index[:, np.newaxis]
    ratios = np.where(before, apart / between, 1.0)
    later = np.ones((n, n), _WIDE)
    later[:, :-1] = apart[:, :-1] / between[:, 1:]
    ratios = np.where(~before & (index < n - 1)[np.newaxis, :], later, ratios)
    last = np.abs(apart[:, -1]) / k
    return np.asarray(np.sign(row) * np.sqrt(np.abs(ratios.prod(axis=1)) * last))
