"""The columns of the two tables of a result, of solutions with equally many impacts each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vibroimpact_solvers.arrays import EPS, Booleans, Floats, Integers, along, nothing
from vibroimpact_solvers.periodic_motions.along import Along
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.energies import energies
from vibroimpact_solvers.periodic_motions.existence import verdicts
from vibroimpact_solvers.periodic_motions.multipliers import error_of_largest, multipliers
from vibroimpact_solvers.periodic_motions.outputs import Outputs
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.path_errors import along_paths
from vibroimpact_solvers.periodic_motions.problem import Impact, Problem
from vibroimpact_solvers.periodic_motions.solutions import Cells, Solutions
from vibroimpact_solvers.periodic_motions.waveform import waveforms
from vibroimpact_solvers.results.impact_modes import Reason
from vibroimpact_solvers.results.periodic_motions import Bifurcation, Result
from vibroimpact_solvers.stability import neutral

Columns = dict[str, Any]


def of(
    problem: Problem,
    driven: Driven,
    cells: Cells,
    solved: Solutions,
    largest: tuple[Complexes, Floats] | None = None,
) -> Columns:
    """Return the columns of some solutions, by the names of the result's fields.

    Their largest multipliers and errors, each (solution, 1), may be known.
    """
    count = solved.index.size
    columns = _impacts(problem, driven, solved)
    size = columns["impact_phase"].size // max(count, 1)
    columns |= {
        "solution_frequency_index": solved.index,
        "solution_Omega": problem.Omega[solved.index],
        "solution_impacts": np.full(count, size),
    }
    if problem.tolerance is not None:
        within = solved.impulse_error <= problem.tolerance * np.abs(solved.impulse)
        columns["solution_within_tolerance"] = within.all(axis=1)
    if "exists" in problem.outputs:
        decided = verdicts(problem, driven, cells, solved)
        columns |= {
            "solution_exists": decided.reason == Reason.OK,
            "solution_reason": decided.reason,
            "solution_witness": decided.witness,
            "solution_witness_constraint": decided.constraint,
            "solution_certified": decided.certified,
        }
    if {"stability", "multipliers"} & problem.outputs:
        if largest is None or "multipliers" in problem.outputs:
            largest = multipliers(problem, driven, cells, solved)
        columns |= multiplier_columns(problem, *largest)
    if {"extremes", "energy", "waveform"} & problem.outputs:
        columns |= _along(problem, driven, cells, solved)
    return columns


def merged(parts: Sequence[Columns], table: str = "impact") -> Columns:
    """Return the columns of all solutions by ascending frequency, those of earlier parts first.

    `table` has the rows that belong to solutions, ``"impact"`` or ``"contact"``.
    """
    owner = f"{table}_solution"
    shift, owners = 0, []
    for part in parts:
        owners.append(part[owner] + shift)
        shift += part["solution_impacts"].size
    whole = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    order = np.argsort(whole["solution_frequency_index"], kind="stable")
    place = np.empty(order.size, dtype=np.int64)
    place[order] = np.arange(order.size)
    moved = place[np.concatenate(owners)]
    row_order = np.argsort(moved, kind="stable")
    rows = set(along(Result, table))
    merged: Columns = {
        name: values[row_order if name in rows else order] for name, values in whole.items()
    }
    merged[owner] = moved[row_order]
    return merged


def result_of(problem: Problem, columns: Columns, complete: Booleans, statement: str) -> Result:
    """Return the result that has these columns."""
    values = nothing(Result) | columns
    values["Omega"], values["complete"] = problem.Omega, complete
    values["error_statement"] = statement
    if {"extremes", "waveform"} & problem.outputs:
        values["dof"] = problem.output_dofs
    if "waveform" in problem.outputs:
        values["tau"] = problem.tau
    return Result(**values)


def _impacts(problem: Problem, driven: Driven, solved: Solutions) -> Columns:
    """Return the table of impacts."""
    count, m = solved.phase.shape
    listed: tuple[Impact, ...] = problem.impacts if m else ()
    phase, velocity, momentum = solved.phase, solved.velocity, solved.impulse
    errors = solved.phase_error, solved.velocity_error, solved.impulse_error
    sides = np.array([impact.side for impact in listed])
    momentum = -sides * momentum
    if problem.symmetric and m:  # the other half mirrors it
        listed = (*listed, Impact(listed[0].constraint, -listed[0].side))
        sides = np.array([impact.side for impact in listed])
        phase = np.concatenate([phase, phase + np.pi * problem.periods], axis=1)
        velocity = np.concatenate([velocity, -velocity], axis=1)
        momentum = np.repeat(momentum, 2, axis=1)
        errors = tuple(np.repeat(error, 2, axis=1) for error in errors)  # type: ignore[assignment]
        m = 2
    phase_error, velocity_error, momentum_error = errors
    scale = driven.scale
    phase_error = phase_error + 2.0 * EPS * np.abs(phase)
    Omega = problem.Omega[solved.index, np.newaxis]
    time = np.mod(phase, 2.0 * np.pi * problem.periods) / Omega
    struck = np.array([impact.constraint for impact in listed], dtype=np.int64)
    return {
        "impact_solution": np.repeat(np.arange(count), m),
        "impact_constraint": np.tile(struck, count),
        "impact_side": np.tile(sides.astype(np.int64), count),
        "impact_phase": np.mod(phase, 2.0 * np.pi).ravel(),
        "impact_time": time.ravel(),
        "impact_momentum": (momentum * scale).ravel(),
        "impact_velocity": (velocity * scale).ravel(),
        "error_phase": phase_error.ravel(),
        "error_time": (phase_error / Omega + 2.0 * EPS * time).ravel(),
        "error_momentum": (momentum_error * scale).ravel(),
        "error_velocity": (velocity_error * scale).ravel(),
    }


def multiplier_columns(problem: Problem, values: Complexes, errors: Floats) -> Columns:
    """Return the columns of the multipliers."""
    largest = values[:, 0]
    error = error_of_largest(values, errors)
    outside = np.abs(largest) > 1.0 + error
    through = np.where(largest.real > 0.0, Bifurcation.FOLD, Bifurcation.FLIP)
    complex_pair = np.abs(largest.imag) > errors[:, 0]
    kind: Integers = np.where(complex_pair, Bifurcation.TORUS, through)
    modulus = np.abs(largest)
    modulus_errors = error + 2.0 * EPS * modulus
    columns: Columns = {
        "solution_stability": modulus,
        "error_stability": modulus_errors,
        "solution_neutral": neutral(modulus, modulus_errors),
        "solution_bifurcation": np.where(outside, kind, Bifurcation.NONE).astype(np.int64),
    }
    if "multipliers" in problem.outputs:
        columns |= {
            "multipliers_real": values.real,
            "multipliers_imaginary": values.imag,
            "error_multipliers_real": errors,
            "error_multipliers_imaginary": errors,
        }
    return columns


def _along(problem: Problem, driven: Driven, cells: Cells, solved: Solutions) -> Columns:
    """Return the columns of what is evaluated along the period."""
    count, dofs = solved.index.size, problem.output_dofs.size
    columns: Columns = {}
    if "extremes" in problem.outputs:
        for name in ("x_max", "x_min", "rms"):
            columns[f"solution_{name}"] = np.full((count, dofs), np.nan)
            columns[f"error_{name}"] = np.full((count, dofs), np.inf)
    if "energy" in problem.outputs:
        for name in ("work", "energy_lost", "energy"):
            columns[f"solution_{name}"] = np.full(count, np.nan)
            columns[f"error_{name}"] = np.full(count, np.inf)
    if "waveform" in problem.outputs:
        assert problem.tau is not None
        columns["waveform"] = np.full((count, problem.tau.size, dofs), np.nan)
        columns["error_waveform"] = np.full((count, 1, dofs), np.inf)
    bounded = np.flatnonzero(~cells.unbounded()[solved.index])
    if bounded.size:
        each = _of_bounded(problem, driven, cells, solved.at(bounded))
        for name, values in each.items():
            columns[name][bounded] = values
    return columns


def _of_bounded(problem: Problem, driven: Driven, cells: Cells, solved: Solutions) -> Columns:
    """Return the columns of what is evaluated along solutions with bounded responses."""
    outputs, columns = Outputs.of(problem, driven), Columns()
    if {"extremes", "waveform"} & problem.outputs:
        error = along_paths(driven, cells, solved, outputs.x)
        error += 4.0 * EPS * np.abs(outputs.still)
    if "waveform" in problem.outputs:
        columns["waveform"] = waveforms(problem, driven, outputs, cells, solved)
        columns["error_waveform"] = error[:, np.newaxis]
    if {"extremes", "energy"} & problem.outputs:
        along = Along.of(problem, driven, outputs, cells, solved)
    if "extremes" in problem.outputs:
        highest, lowest = along.peaks[:, 0], -along.peaks[:, 1]
        if problem.symmetric and solved.phase.shape[1]:
            highest = np.maximum(highest, -lowest)
            lowest = -highest
        rms = np.sqrt(along.squares / solved.length.sum(axis=1)[:, np.newaxis])
        values = {"x_max": highest, "x_min": lowest, "rms": rms}
        columns |= {f"solution_{name}": value for name, value in values.items()}
        columns |= {f"error_{name}": error for name in values}
        # Squares in closed form have roundings relative to what they are sums of.
        columns["error_rms"] = error * np.maximum(1.0, along.sizes / np.where(rms == 0.0, 1.0, rms))
    if "energy" in problem.outputs:
        balance = energies(problem, driven, outputs, cells, solved, along)
        columns |= {
            "solution_work": balance.work,
            "solution_energy_lost": balance.lost,
            "solution_energy": balance.energy,
            "error_work": balance.work_error,
            "error_energy_lost": balance.lost_error,
            "error_energy": balance.energy_error,
        }
    return columns
