"""Rates of the data of a family with some parameters, which come first in all arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vibroimpact_solvers.arrays import EPS, Booleans, Floats, Integers
from vibroimpact_solvers.derivatives import ModeRates, Parameter, mode_rates
from vibroimpact_solvers.impact_modes.modal import modal_load
from vibroimpact_solvers.impact_modes.problem import Problem
from vibroimpact_solvers.spectrum import Spectrum


@dataclass(frozen=True, eq=False, slots=True)
class Rates:
    """Rates of the modes, their participations, loads and shapes, and of the walls."""

    values: Floats  # of the eigenvalues, (parameter, 1, mode)
    value_errors: Floats
    # Pairs of close modes, their off-diagonal rates and errors, (parameter, 1, pair)
    first: Integers
    second: Integers
    mixed: Floats
    mixed_errors: Floats
    rows: Floats  # of the participations, (parameter, constraint, mode)
    row_errors: Floats
    load: Floats  # of the static loads, (parameter, 1, mode)
    shapes: Floats  # of rows of the modal matrix, (parameter, dof, mode)
    shape_errors: Floats
    lower: Floats  # of the distances of the walls, (parameter, constraint)
    upper: Floats

    @property
    def turning(self) -> Booleans:
        """Whether parameters let the two halves of a period differ, (parameter,)."""
        moved = (self.upper != self.lower).any(axis=1)
        return np.asarray(moved | self.load.any(axis=(1, 2)))


def rates_of(problem: Problem, natural: Spectrum, rows: Floats, shapes: Floats) -> Rates:
    """Return the rates of a problem's data with its parameters.

    Parameters
    ----------
    problem : Problem
    natural : Spectrum
    rows : array, (constraint, mode)
        Participations of the modes at the active constraints.
    shapes : array, (dof, mode)
        Rows of the modal matrix for the outputs.
    """
    parameters, load = problem.parameters, modal_load(problem, natural)[0]
    modes = mode_rates(problem.system, natural, parameters)
    along = [_rows(problem, natural, *each, rows) for each in zip(parameters, modes, strict=True)]
    loads = [each.rows(load[np.newaxis]) for each in modes]
    for place, parameter in enumerate(parameters):
        if parameter.force is not None:
            loads[place] = loads[place] + parameter.force @ natural.modes
    dofs = problem.output_dofs[: len(shapes)]
    turned = [_shapes(each, shapes, dofs) for each in modes]
    walls = [parameter.walls(problem.active) for parameter in parameters]
    return Rates(
        np.stack([each.values for each in modes])[:, np.newaxis],
        np.stack([each.value_errors for each in modes])[:, np.newaxis],
        *_pairs(modes),
        np.stack([each[0] for each in along]),
        np.stack([each[1] for each in along]),
        np.stack(loads),
        np.stack([each[0] for each in turned]),
        np.stack([each[1] for each in turned]),
        np.stack([each[0] for each in walls]),
        np.stack([each[1] for each in walls]),
    )


def _pairs(modes: Sequence[ModeRates]) -> tuple[Integers, Integers, Floats, Floats]:
    """Return the close pairs of all parameters, their rates and errors."""
    count = modes[0].values.size
    codes = [each.first * count + each.second for each in modes]
    every = np.unique(np.concatenate(codes))
    mixed, errors = np.zeros((2, len(modes), 1, every.size))
    for place, (each, code) in enumerate(zip(modes, codes, strict=True)):
        at = np.searchsorted(every, code)
        mixed[place, 0, at], errors[place, 0, at] = each.mixed, each.mixed_errors
    return every // count, every % count, mixed, errors


def _rows(
    problem: Problem, natural: Spectrum, parameter: Parameter, modes: ModeRates, rows: Floats
) -> tuple[Floats, Floats]:
    """Return the rates of the participations and their errors, each (constraint, mode)."""
    change, error = modes.rows(rows), modes.row_errors(rows)
    turned = parameter.directions(problem.system.n, problem.active)
    if not turned.any():
        return change, error
    touched = np.flatnonzero(turned.any(axis=0))
    entries = natural.rows(touched)
    error = error + 4.0 * EPS * (np.abs(turned[:, touched]) @ np.abs(entries))
    return change + turned[:, touched] @ entries, error


def _shapes(modes: ModeRates, shapes: Floats, dofs: Integers) -> tuple[Floats, Floats]:
    """Return the rates of rows of the modal matrix and their errors, each (dof, mode)."""
    change, error = modes.rows(shapes), modes.row_errors(shapes)
    if modes.static is None or not dofs.size:
        return change, error
    return change + modes.static[dofs], error + 8.0 * EPS * np.abs(modes.static[dofs])
