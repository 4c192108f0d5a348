"""Solution of the differentiated equations of a family, and its errors.

With ``y = share z'/omega^2`` the equations of `equations` read

    p'_j A'_j - r_j . y = b_j ,      sum_j r_ij p_j A'_j = w_i ,

where b and w hold the terms in which amplitudes and impulses stay. Amplitudes of modes away from
their poles are eliminated; those with the smallest p' keep an unknown each, so that the equations
stay well conditioned through the poles, as in `kernels.families`. All parameters have the same
equations, which are inverted once.

b and w err by roundings, by errors of the rates of the modes and of the phases gamma; p' errs by
the phase. A solution errs by the inverse, entry by entry, times the errors of the equations.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import EPS, Booleans, Floats, Integers
from vibroimpact_solvers.impact_modes.derivatives.equations import (
    Component,
    ComponentRates,
    Frequency,
    add_pairs,
    averaged,
    terms,
)
from vibroimpact_solvers.impact_modes.derivatives.rates import Rates
from vibroimpact_solvers.impact_modes.derivatives.sums import over_modes, over_unknowns

_BORDERED: Final = 3  # modes that keep an unknown, beside rigid ones
_ROUNDINGS: Final = 1.0  # of a term and of the sum in which it stands


class Solution(NamedTuple):
    """Rates of the unknowns of one system of equations, and their errors."""

    z: Floats  # (parameter, frequency, unknown)
    z_error: Floats
    A: list[Floats]  # of each component, (parameter, frequency, mode)
    A_error: list[Floats]
    singular: Booleans  # where there are none, (frequency,)


class _Modes(NamedTuple):
    """The equations of the modes of all components, each (frequency, mode) but the rows."""

    rows: Floats  # (unknown, mode)
    wrong: Floats  # errors of the rows, (unknown, mode)
    place: Floats  # p
    speed: Floats  # p'
    speed_error: Floats
    steepness: Floats  # of p' at other phases


class _Inverse(NamedTuple):
    """The equations without eliminated amplitudes, inverted, and how these follow."""

    rho: float  # largest entry of the rows, by which they are divided
    rows: Floats  # (unknown, mode)
    system: Floats  # (frequency, m, m)
    inverse: Floats
    chosen: Integers  # modes that keep an unknown, (frequency, bordered)
    over: Floats  # one over p', 0 of these, (frequency, mode)
    singular: Booleans  # (frequency,)


class Unknowns(NamedTuple):
    """Impulses of a system of equations, their errors, and the rates of the walls."""

    z: Floats  # (frequency, unknown)
    z_error: Floats
    walls: Floats  # (parameter, unknown)
    share: float


def solve(
    components: list[Component],
    own: list[ComponentRates],
    rates: Rates,
    at: Frequency,
    given: Unknowns,
) -> Solution:
    """Return the rates of the impulses and amplitudes of some components that they drive."""
    count, unknowns = given.z.shape
    shape = given.walls.shape[0], count, unknowns
    walls = np.broadcast_to(given.walls[:, np.newaxis], shape).copy()
    wall_errors = EPS * np.abs(walls)
    parts, right = list[_Modes](), list[tuple[Floats, Floats]]()
    for one, each in zip(components, own, strict=True):
        part, sides, moved, wrong = _of_component(one, each, rates, at, given)
        parts.append(part)
        right.append(sides)
        walls -= moved
        wall_errors += wrong
    joined = _Modes(*(np.concatenate(each, axis=1) for each in zip(*parts, strict=True)))
    b, b_error = (np.concatenate(each, axis=2) for each in zip(*right, strict=True))
    rigid = sum(
        int(np.count_nonzero(one.phases.gamma[0] == 0.0))
        for one in components
        if one.phases.symmetric
    )
    inverse = _inverted(joined, min(joined.rows.shape[1], _BORDERED + rigid))
    y, y_error, A, A_error = _solved(joined, inverse, (walls, wall_errors), (b, b_error))
    unit, ends = at.square / given.share, np.cumsum([len(one.load) for one in components])[:-1]
    return Solution(
        y * unit,
        (y_error + 2.0 * EPS * np.abs(y)) * unit,
        list(np.split(A, ends, axis=2)),
        list(np.split(A_error, ends, axis=2)),
        inverse.singular,
    )


def _of_component(
    one: Component, own: ComponentRates, rates: Rates, at: Frequency, given: Unknowns
) -> tuple[_Modes, tuple[Floats, Floats], Floats, Floats]:
    """Return the equations of a component's modes, b, and its part at the walls, with errors."""
    place, speed = one.place, one.speed
    moved, slowed = (terms(one, own, rates, at, each) for each in (place, speed))
    if rates.first.size:
        slopes = averaged(one.phases, rates, 1.0, 0)
        add_pairs(moved, one, rates, at, (slopes[0], slopes[1]))
        add_pairs(slowed, one, rates, at, (slopes[2], slopes[3]))
    here = place.p * one.A + place.s * (one.load / at.square)
    rows, size, row_rates = np.abs(one.rows), np.abs(here), np.abs(own.rows)
    at_walls = over_modes(moved.value, one.rows) + over_modes(here, own.rows)
    wrong = over_modes(moved.size, _ROUNDINGS * EPS * rows + one.wrong)
    lost = np.abs(place.p) * one.A_error + _ROUNDINGS * EPS * size
    wrong += over_modes(moved.error, rows) + over_modes(size, own.row_errors)
    wrong += over_modes(lost, row_rates)
    pushed = (given.share / at.square) * over_unknowns(given.z, own.rows)
    b = pushed - slowed.value
    size = np.abs(pushed) + slowed.size
    if at.rate.any():
        driven = (2.0 * given.share / at.square) * over_unknowns(given.z, one.rows) * at.relative
        b -= driven
        size += np.abs(driven)
    error = over_unknowns(np.abs(given.z), own.row_errors)
    error += over_unknowns(given.z_error, row_rates)
    error *= given.share / at.square
    error += _ROUNDINGS * EPS * size + slowed.error
    steepness = np.maximum(one.phases.gamma, EPS) if one.phases.symmetric else np.ones_like(here)
    speed_error = steepness * (one.uncertainty + 0.5 * EPS)
    part = _Modes(one.rows, one.wrong, place.p, speed.p, speed_error, steepness)
    return part, (b, error), at_walls, wrong


def _turned(rows: Floats) -> Floats:
    """Return transposed matrices."""
    return np.swapaxes(rows, -1, -2)


def _inverted(modes: _Modes, bordered: int) -> _Inverse:
    """Eliminate the amplitudes of all modes but some, and invert the equations that are left.

    Rows are divided by the largest of their entries, rho: unknowns are ``rho^2 y`` and ``rho A'``.
    """
    count, unknowns = len(modes.speed), len(modes.rows)
    rho = max(float(np.abs(modes.rows).max(initial=0.0)), 1e-300)
    rows = modes.rows / rho
    near = np.abs(modes.speed) / modes.steepness
    chosen = np.argpartition(near, bordered - 1, axis=1)[:, :bordered]
    outer = modes.speed != 0.0
    np.put_along_axis(outer, chosen, False, axis=1)
    over = np.divide(1.0, modes.speed, out=np.zeros(near.shape), where=outer)
    response = modes.place * over
    system = np.zeros((count, unknowns + bordered, unknowns + bordered))
    for i in range(unknowns):
        system[:, i, :unknowns] = over_modes(response * rows[i], rows)
    at_border = rows.T[chosen]
    places = np.take_along_axis(modes.place, chosen, axis=1)
    system[:, :unknowns, unknowns:] = _turned(at_border * places[..., np.newaxis])
    system[:, unknowns:, :unknowns] = -at_border
    ends = np.arange(unknowns, unknowns + bordered)
    system[:, ends, ends] = np.take_along_axis(modes.speed, chosen, axis=1)
    size = np.abs(system).max(axis=2)
    singular = ~np.isfinite(size).all(axis=1) | (size == 0.0).any(axis=1)
    system[singular], size[singular] = np.eye(system.shape[1]), 1.0
    balanced = system / size[..., np.newaxis]
    singular |= np.linalg.det(balanced) == 0.0
    balanced[singular] = np.eye(system.shape[1])
    inverse = np.linalg.inv(balanced) / size[:, np.newaxis, :]
    return _Inverse(rho, rows, system, inverse, chosen, over, singular)


def _solved(
    modes: _Modes,
    by: _Inverse,
    walls: tuple[Floats, Floats],
    right: tuple[Floats, Floats],
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return y and A' with their errors, for walls w and right-hand sides b with their errors."""
    b, b_error = right[0] * by.rho, right[1] * by.rho
    unknowns, response = len(by.rows), modes.place * by.over
    chosen = np.broadcast_to(by.chosen, (len(b), *by.chosen.shape))

    def some(values: Floats) -> Floats:
        return np.take_along_axis(values, chosen, axis=2)

    whole = np.concatenate([walls[0] - over_modes(response * b, by.rows), some(b)], axis=2)
    rates_of_unknowns = _times(by.inverse, whole)
    rates_of_unknowns += _times(by.inverse, whole - _times(by.system, rates_of_unknowns))
    y = rates_of_unknowns[..., :unknowns]
    driven = over_unknowns(y, by.rows)
    A = (b + driven) * by.over
    np.put_along_axis(A, chosen, rates_of_unknowns[..., unknowns:], axis=2)
    # Errors of the equations, then of the unknowns.
    rows, wrong_rows, size = np.abs(by.rows), modes.wrong / by.rho, np.abs(A)
    lost = b_error + modes.speed_error * size + over_unknowns(np.abs(y), wrong_rows)
    lost += _ROUNDINGS * EPS * (np.abs(b) + np.abs(driven))
    at_walls = walls[1] + over_modes(np.abs(response) * lost, rows)
    at_walls += over_modes(np.abs(modes.place) * size, _ROUNDINGS * EPS * rows + wrong_rows)
    error = _times(np.abs(by.inverse), np.concatenate([at_walls, some(lost)], axis=2))
    A_error = (lost + over_unknowns(error[..., :unknowns], rows)) * np.abs(by.over)
    np.put_along_axis(A_error, chosen, error[..., unknowns:], axis=2)
    y_error = error[..., :unknowns]
    return y / by.rho**2, y_error / by.rho**2, A / by.rho, A_error / by.rho


def _times(matrices: Floats, columns: Floats) -> Floats:
    """Return products of matrices, (frequency, m, m), and vectors, (parameter, frequency, m)."""
    return np.asarray((matrices @ columns[..., np.newaxis])[..., 0])
