"""Derivatives of natural frequencies, mode shapes and what follows from them.

    dOmega_j = d lambda_j/(2 |Omega_j|) ,      dW e_j = W de_j + dW e_j ,

with the rates of `derivatives.modes`. Modes whose frequencies cannot be told apart have no shapes
of their own: their frequencies move by the eigenvalues of the rates projected on them, ascending
for a parameter that grows and descending for one that falls.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Booleans, Floats
from vibroimpact_solvers.derivatives import MatrixRate, ModeRates, Parameter, mode_rates
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.matrices import SymmetricMatrix
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.natural_frequencies.problem import Problem
from vibroimpact_solvers.spectrum import Spectrum

_TOGETHER: Final = 100.0
"""Distance of eigenvalues over their errors below which they are not told apart."""
_ALIKE: Final = 1e-8
"""Difference of the rates of a group, over them, up to which all of it moves alike."""


class Reason(IntEnum):
    """Whether there is a derivative, and why not."""

    OK = 0
    REPEATED = 1
    RIGID = 2


def moving_rates(problem: Problem, place: int) -> Parameter:
    """Return a parameter's rates of the structure whose modes are computed."""
    parameter = problem.parameters[place]
    held = problem.held
    if held is None:
        return parameter
    if parameter.directions(problem.system.n, problem.fixed).any():
        message = "it turns a coordinate that is held: there is no derivative by it"
        raise ModelError(("derivatives", place), message, code="held_direction")
    Z = held.basis

    def part(rate: MatrixRate) -> MatrixRate:
        if rate.entries is None:
            return rate
        entries = SymmetricMatrix.leanest((Z.T @ rate.entries.to_sparse() @ Z).tocsr())
        return replace(rate, entries=entries)

    return replace(parameter, M=part(parameter.M), K=part(parameter.K))


@dataclass(frozen=True, eq=False, slots=True)
class _Modes:
    """The natural modes and their rates with one parameter."""

    natural: Spectrum
    rates: ModeRates
    values: Floats  # rates of the eigenvalues, those of groups projected, (mode,)
    turns: Floats  # of the modes, close ones that are told apart included, (mode, mode)
    turn_errors: Floats
    apart: Booleans  # whether two modes are told apart, (mode, mode)
    alone: Booleans  # whether a mode is told apart from all others, or moves like them, (mode,)


def outputs(
    problem: Problem,
    natural: Spectrum,
    count: int,
    shapes: Floats | None,
    participations: Floats | None,
    signs: Floats | None,
) -> dict[str, Any]:
    """Return the derivatives of the first modes by the names of their fields.

    Parameters
    ----------
    problem : Problem
    natural : Spectrum
        All modes, or the lowest ones where only frequencies are asked for.
    count : int
        Modes in the result.
    shapes : array, shape (dof, mode), optional
        The first modes, without their signs.
    participations : array, shape (constraint, mode), optional
        Of all modes.
    signs : array, shape (mode,), optional
    """
    columns: dict[str, list[Floats]] = {}
    moving = [moving_rates(problem, place) for place in range(len(problem.parameters))]
    values = natural.eigenvalues
    wrong = EPS * np.abs(values) + (0.0 if natural.errors is None else natural.errors)
    gaps = values - values[:, np.newaxis]
    apart = np.abs(gaps) > _TOGETHER * (wrong + wrong[:, np.newaxis])
    for place, rates in enumerate(mode_rates(problem.moving, natural, moving)):
        look()
        modes = _modes(natural, rates, apart, gaps, wrong)
        one = _frequencies(modes, count)
        if shapes is not None and signs is not None:
            one |= _shapes(problem, modes, place, shapes, signs)
        if participations is not None and signs is not None:
            one |= _participations(problem, modes, place, participations, signs)
        if participations is not None and "residual_flexibility" in problem.outputs:
            one |= _flexibility(problem, modes, place, participations, count)
        for name, value in one.items():
            columns.setdefault(name, []).append(value)
    whole = {name: np.stack(values, axis=-1) for name, values in columns.items()}
    whole["derivative_reason"] = whole["derivative_reason"].astype(np.int64)
    return whole


def _modes(
    natural: Spectrum, rates: ModeRates, apart: Booleans, gaps: Floats, wrong: Floats
) -> _Modes:
    """Return the rates of the modes, close ones told apart.

    `gaps` are the distances of the eigenvalues, (mode, mode), `wrong` their errors.
    """
    turns, errors = rates.turns.copy(), rates.turn_errors.copy()
    i, j = rates.first, rates.second
    told = apart[i, j]
    i, j, mixed = i[told], j[told], rates.mixed[told]
    turns[i, j] += mixed / gaps[i, j]
    errors[i, j] += rates.mixed_errors[told] / np.abs(gaps[i, j])
    errors[i, j] += np.abs(mixed) * (wrong[i] + wrong[j]) / gaps[i, j] ** 2
    moved, alone = _projected(rates, apart)
    return _Modes(natural, rates, moved, turns, errors, apart, alone)


def _projected(rates: ModeRates, apart: Booleans) -> tuple[Floats, Booleans]:
    """Return the rates of all eigenvalues, and which modes have rates of their own."""
    moved, alone = rates.values.copy(), np.ones(rates.values.size, dtype=np.bool_)
    start, count = 0, rates.values.size
    for stop in range(1, count + 1):
        if stop < count and not apart[stop - 1, stop]:
            continue
        if stop - start > 1:
            some = np.arange(start, stop)
            block = np.diag(rates.values[some])
            inside = (rates.first >= start) & (rates.first < stop)
            inside &= (rates.second >= start) & (rates.second < stop)
            i, j = rates.first[inside] - start, rates.second[inside] - start
            block[i, j] = rates.mixed[inside]
            slopes = np.linalg.eigvalsh(block)
            size = max(float(np.abs(slopes).max()), float(rates.value_errors[some].max()))
            alone[some] = np.ptp(slopes) <= _ALIKE * size
            moved[some] = slopes
        start = stop
    return moved, alone


def _frequencies(modes: _Modes, count: int) -> dict[str, Floats]:
    """Return rates of the frequencies, reasons, and distances to where there is no derivative."""
    natural, rates = modes.natural, modes.rates
    roots, values = natural.roots[:count], natural.eigenvalues
    moved, wrong = modes.values[:count], rates.value_errors[:count]
    size = np.abs(roots)
    still = (moved == 0.0) & (wrong == 0.0)
    rigid = (size == 0.0) & ~still
    reason = np.where(modes.alone[:count], Reason.OK, Reason.REPEATED)
    reason[rigid] = Reason.RIGID
    safe = np.where(size > 0.0, size, 1.0)
    relative = np.divide(
        natural.errors[:count] if natural.errors is not None else 0.0 * size, np.square(safe)
    )
    rate = np.where(still, 0.0, moved / (2.0 * safe))
    error = wrong / (2.0 * safe) + np.abs(rate) * (relative + 2.0 * EPS)
    rate[rigid], error[rigid] = np.nan, np.inf
    # Where the next mode is met, or the square root of an eigenvalue of 0, to first order.
    all_moved = modes.values
    with np.errstate(divide="ignore", invalid="ignore"):
        meets = np.diff(values) / np.abs(np.diff(all_moved))
        below = np.concatenate([[np.inf], meets])[:count]
        above = np.concatenate([meets, [np.inf]])[:count]
        falls = np.where(moved != 0.0, np.abs(values[:count] / moved), np.inf)
    distance = np.fmin(np.fmin(below, above), falls)
    distance[~np.isfinite(distance)] = np.nan
    distance[reason != Reason.OK] = 0.0
    return {
        "derivative_Omega": rate,
        "derivative_Omega_error": error,
        "derivative_reason": reason,
        "derivative_distance": distance,
    }


def _shapes(
    problem: Problem, modes: _Modes, place: int, shapes: Floats, signs: Floats
) -> dict[str, Floats]:
    """Return rates of mode shapes and effective masses."""
    count = shapes.shape[1]
    natural, rates = modes.natural, modes.rates
    rows, lost = natural.modes, modes.turn_errors[:, :count]
    turned = modes.turns[:, :count]
    change = rows @ turned
    size = np.abs(rows)
    error = size @ lost + 4.0 * EPS * (size @ np.abs(turned))
    if natural.angles is not None:
        error += np.outer(np.sqrt(np.square(rows).sum(axis=1)), natural.angles[:count])
    if rates.static is not None:
        change = change + rates.static[:, :count]
        error += 8.0 * EPS * np.abs(rates.static[:, :count])
    if problem.held is not None:
        Z = problem.held.basis
        change, error = np.asarray(Z @ change), np.asarray(abs(Z) @ error)
    _forget(change, error, modes.alone[:count])
    fields: dict[str, Floats] = {}
    if "shape" in problem.outputs:
        fields["derivative_shape"] = (change * signs).T
        fields["derivative_shape_error"] = error.T
    if "effective_mass" in problem.outputs and problem.directions is not None:
        r, M = problem.directions.T, problem.system.M
        heavy = M @ np.ascontiguousarray(r)
        factors, moved = shapes.T @ heavy, change.T @ heavy
        wrong = error.T @ np.abs(heavy)
        rate = problem.parameters[place].M
        if rate:
            more = rate.whole(M) @ np.ascontiguousarray(r)
            moved = moved + shapes.T @ more
            wrong = wrong + 4.0 * EPS * (np.abs(shapes).T @ np.abs(more))
        wrong = wrong + 4.0 * EPS * (np.abs(change).T @ np.abs(heavy))
        fields["derivative_effective_mass"] = 2.0 * factors * moved
        own = 8.0 * EPS * (np.abs(shapes).T @ np.abs(heavy)) * np.abs(moved)
        fields["derivative_effective_mass_error"] = 2.0 * np.abs(factors) * wrong + 2.0 * own
        bad = np.isnan(fields["derivative_effective_mass"])
        fields["derivative_effective_mass_error"][bad] = np.inf
    return fields


def _rows(
    problem: Problem, modes: _Modes, place: int, participations: Floats
) -> tuple[Floats, Floats]:
    """Return rates of the participations of all modes, and errors: (constraint, mode)."""
    change = participations @ modes.turns
    size = np.abs(participations)
    error = size @ modes.turn_errors + 4.0 * EPS * (size @ np.abs(modes.turns))
    if modes.natural.angles is not None:
        reach = np.sqrt(np.square(participations).sum(axis=1))
        error += np.outer(reach, modes.natural.angles)
    listed = range(len(problem.system.constraints))
    turned = problem.parameters[place].directions(problem.system.n, tuple(listed))
    if turned.any():
        rows = modes.natural.modes
        if problem.held is not None:
            rows = np.asarray(problem.held.basis @ rows)
        change = change + turned @ rows
        error = error + 4.0 * EPS * (np.abs(turned) @ np.abs(rows))
    return change, error


def _participations(
    problem: Problem, modes: _Modes, place: int, participations: Floats, signs: Floats
) -> dict[str, Floats]:
    """Return rates of the participations of the first modes."""
    if "participation" not in problem.outputs:
        return {}
    count = signs.size
    change, error = (
        each[:, :count].copy() for each in _rows(problem, modes, place, participations)
    )
    _forget(change, error, modes.alone[:count])
    return {
        "derivative_participation": (change * signs).T,
        "derivative_participation_error": error.T,
    }


def _flexibility(
    problem: Problem, modes: _Modes, place: int, participations: Floats, count: int
) -> dict[str, Floats]:
    """Return rates of the flexibility ``sum_j r_j r_j^T/lambda_j`` of the modes left out."""
    natural, rates = modes.natural, modes.rates
    change, error = _rows(problem, modes, place, participations)
    rest = np.flatnonzero(natural.roots[count:] != 0.0) + count
    values = natural.eigenvalues[rest]
    rows, moved, wrong = participations[:, rest], change[:, rest], error[:, rest]
    one = (moved / values) @ rows.T
    rate = one + one.T - (rows * (rates.values[rest] / values**2)) @ rows.T
    lost = (wrong / np.abs(values)) @ np.abs(rows).T
    sizes = (np.abs(moved) / np.abs(values)) @ np.abs(rows).T
    pulled = (np.abs(rows) * (np.abs(rates.values[rest]) / values**2)) @ np.abs(rows).T
    drift = (np.abs(rows) * (rates.value_errors[rest] / values**2)) @ np.abs(rows).T
    lost = lost + lost.T + drift + 8.0 * EPS * (sizes + sizes.T + pulled)
    inside = ~modes.apart[rates.first, rates.second]
    for i, j, mixed in zip(
        rates.first[inside], rates.second[inside], rates.mixed[inside], strict=True
    ):
        if i in rest and j in rest:
            weight = mixed / (natural.eigenvalues[i] * natural.eigenvalues[j])
            rate = rate - weight * np.outer(participations[:, i], participations[:, j])
    cut = 0 < count < natural.roots.size and not modes.apart[count - 1, count]
    if cut and not modes.alone[count]:
        rate, lost = np.full_like(rate, np.nan), np.full_like(lost, np.inf)
    return {
        "derivative_residual_flexibility": rate,
        "derivative_residual_flexibility_error": lost,
    }


def _forget(change: Floats, error: Floats, alone: Booleans) -> None:
    """Leave out what modes that are not told apart have not: in place, modes in columns."""
    change[:, ~alone], error[:, ~alone] = np.nan, np.inf
