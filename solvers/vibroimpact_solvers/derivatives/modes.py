"""How natural modes change with a parameter, to first order.

With ``K e_j = lambda_j M e_j`` and ``e_i^T M e_j = delta_ij``, ``A = E^T dK E`` and
``B = E^T dM E``,

    d lambda_j = A_jj - lambda_j B_jj ,
    d e_j = sum_i e_i G_ij ,   G_ij = (A_ij - lambda_j B_ij)/(lambda_j - lambda_i) ,
                               G_jj = -B_jj/2 .

Of two modes whose eigenvalues are close, equal ones among them, the quotient is not taken: both
span a plane that turns as a whole, ``G_ij = -B_ij/2``, and the eigenvalues get the off-diagonal
rate ``L_ij = A_ij - (lambda_i + lambda_j) B_ij/2``. A function f of the structure then changes by
``e_i f[lambda_i, lambda_j] L_ij e_j^T`` with the divided difference of f, which has no pole. Where
degrees of freedom have no mass, they also follow by ``-K_ss^(-1) (dK e_j)_s``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers import condensation
from vibroimpact_solvers.arrays import EPS, Booleans, Floats, Integers
from vibroimpact_solvers.derivatives.parameter import MatrixRate, Parameter
from vibroimpact_solvers.matrices import Form, SymmetricMatrix
from vibroimpact_solvers.model import System
from vibroimpact_solvers.spectrum import Spectrum

_CLOSE: Final = 1e-4
"""Distance of two eigenvalues, over the larger, up to which their modes turn as one."""


@dataclass(frozen=True, eq=False, slots=True)
class ModeRates:
    """Rates of change of the natural modes with one parameter."""

    values: Floats  # of the eigenvalues, (mode,)
    turns: Floats  # G, (mode, mode)
    # Pairs of close modes in both orders, and their off-diagonal rates, each (pair,)
    first: Integers
    second: Integers
    mixed: Floats
    # Errors of all that
    value_errors: Floats  # (mode,)
    turn_errors: Floats  # (mode, mode)
    mixed_errors: Floats  # (pair,)
    static: Floats | None  # rates of degrees of freedom without mass besides, (dof, mode)

    def rows(self, rows: Floats) -> Floats:
        """Return the rates of rows of the modal matrix, shape (…, mode), of the modes alone."""
        return np.asarray(rows @ self.turns)

    def row_errors(self, rows: Floats) -> Floats:
        """Return the errors of these rates, shape (…, mode)."""
        size = np.abs(rows)
        return np.asarray(size @ self.turn_errors + 4.0 * EPS * (size @ np.abs(self.turns)))


@dataclass(frozen=True, eq=False, slots=True)
class _Neighbours:
    """The eigenvalues of a structure and their distances from one another."""

    values: Floats  # (mode,)
    modes: Floats  # (dof, mode)
    angles: Floats
    errors: Floats  # of the values
    both: Floats  # sums of the errors of two values, (mode, mode)
    larger: Floats  # the larger magnitude of two values
    over: Floats  # one over the distance, 0 of close modes
    close: Booleans


def _neighbours(natural: Spectrum) -> _Neighbours:
    values = natural.eigenvalues
    size = np.abs(values)
    errors = EPS * size + (0.0 if natural.errors is None else natural.errors)
    gaps = values - values[:, np.newaxis]
    larger = np.maximum(size, size[:, np.newaxis])
    close = np.abs(gaps) <= _CLOSE * larger
    over = np.divide(1.0, gaps, out=np.zeros_like(gaps), where=~close)
    angles = np.zeros(values.size) if natural.angles is None else natural.angles
    both = errors + errors[:, np.newaxis]
    return _Neighbours(values, natural.modes, angles, errors, both, larger, over, close)


def mode_rates(
    system: System, natural: Spectrum, parameters: Sequence[Parameter]
) -> list[ModeRates]:
    """Return the rates of all natural modes of a structure with some parameters."""
    if not any(parameter.structural for parameter in parameters):
        return [_still(natural.roots.size)] * len(parameters)
    beside = _neighbours(natural)
    return [
        _rates(system, beside, each) if each.structural else _still(natural.roots.size)
        for each in parameters
    ]


def _still(count: int) -> ModeRates:
    """Return the rates of modes that stay."""
    none, square, no_pair = np.zeros(count), np.zeros((count, count)), np.zeros(0, dtype=np.int64)
    empty = np.zeros(0)
    return ModeRates(none, square, no_pair, no_pair, empty, none, square, empty, None)


def _rates(system: System, beside: _Neighbours, parameter: Parameter) -> ModeRates:
    values, close, over = beside.values, beside.close, np.abs(beside.over)
    A, wrong_A = _projected(parameter.K, beside, np.diag(values))
    L, wrong_L = A, wrong_A
    turns = A * beside.over
    wrong = wrong_A * over
    if parameter.M:
        B, wrong_B = _projected(parameter.M, beside, np.eye(values.size))
        L = A - 0.5 * (values + values[:, np.newaxis]) * B
        wrong_L = wrong_A + beside.larger * wrong_B + np.abs(B) * beside.both
        turns = turns - np.where(close, 0.5 * B, B * values * beside.over)
        wrong = wrong + (wrong_B * np.abs(values) + np.abs(B) * beside.errors) * over
        wrong = np.where(close, 0.5 * wrong_B, wrong)
    wrong = wrong + np.abs(turns) * beside.both * over
    first, second = np.nonzero(close & ((L != 0.0) | (wrong_L != 0.0)))
    apart = first != second
    first, second = first[apart], second[apart]
    return ModeRates(
        np.diagonal(L).copy(),
        turns,
        first,
        second,
        L[first, second],
        np.diagonal(wrong_L) + 2.0 * EPS * np.abs(np.diagonal(A)),
        wrong,
        wrong_L[first, second],
        _static(system, parameter, beside.modes),
    )


def _projected(rate: MatrixRate, beside: _Neighbours, own: Floats) -> tuple[Floats, Floats]:
    """Return ``E^T dA E`` and its errors, (mode, mode); `own` is ``E^T A E``."""
    value = rate.factor * own
    error = 2.0 * EPS * np.abs(value)
    if rate.entries is None:
        return value, error
    places, block = touched(rate.entries)
    some, angles = beside.modes[places], beside.angles
    product = some.T @ (block @ some)
    size = np.abs(block).sum(axis=1)
    lengths = np.sqrt(size @ np.square(some))  # by which all products of two modes are bounded
    reach = float(np.sqrt((size @ np.square(some)).sum()))
    error = error + (2.0 + np.sqrt(places.size)) * EPS * np.outer(lengths, lengths)
    if angles.any():
        turned = np.outer(angles * reach, lengths)
        error += turned + turned.T
    return value + 0.5 * (product + product.T), error


def touched(entries: SymmetricMatrix) -> tuple[Integers, Floats]:
    """Return the rows of a matrix that are not zero, and the block of these rows."""
    if entries.form is Form.DIAGONAL:
        places = np.flatnonzero(entries.data[0])
        return places, np.diag(entries.data[0, places])
    sparse = entries.to_sparse()
    sparse.eliminate_zeros()
    places = np.flatnonzero(np.diff(sparse.indptr))
    return places, sparse[places][:, places].toarray()


def _static(system: System, parameter: Parameter, modes: Floats) -> Floats | None:
    """Return how degrees of freedom without mass follow besides, shape (dof, mode)."""
    if not system.massless.size or parameter.K.entries is None:
        return None
    condensed = condensation.of(system)
    pulled = (parameter.K.entries @ modes)[condensed.massless]
    rates = np.zeros_like(modes)
    rates[condensed.massless] = -condensed.solve_static(np.ascontiguousarray(pulled))
    return rates
