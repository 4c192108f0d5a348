"""The columns of the tables of a result: solutions and their contact phases."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats, Integers, along
from vibroimpact_solvers.periodic_motions.columns import multiplier_columns
from vibroimpact_solvers.periodic_motions.existence import Verdicts
from vibroimpact_solvers.periodic_motions.problem import Problem
from vibroimpact_solvers.periodic_motions.stops.existence import verdicts
from vibroimpact_solvers.periodic_motions.stops.linear import Linear
from vibroimpact_solvers.periodic_motions.stops.multipliers import multipliers
from vibroimpact_solvers.periodic_motions.stops.parts import Part, parts
from vibroimpact_solvers.periodic_motions.stops.phases import Phases, Stop
from vibroimpact_solvers.periodic_motions.stops.prescribed import Cells
from vibroimpact_solvers.periodic_motions.stops.scenes import Scenes
from vibroimpact_solvers.periodic_motions.stops.solutions import Solutions
from vibroimpact_solvers.periodic_motions.stops.sums import Sums, forms_of, sums
from vibroimpact_solvers.results.impact_modes import Reason
from vibroimpact_solvers.results.periodic_motions import Result

Columns = dict[str, Any]
_CONTACT = (
    "phase", "time", "duration", "impulse", "peak_force", "velocity", "indentation",
    "start_indentation", "energy_lost",
)  # fmt: skip
_TINY = float(np.finfo(float).tiny)


def of_linear(problem: Problem, response: Linear) -> Columns:
    """Return the columns of motions in which no stop switches."""
    phases, cells = response.phases, response.cells
    count = cells.Omega.size
    held = response.held
    contact = (0, phases.stop) if held else None
    columns = begun(problem, np.arange(count), contacts=held)
    if "exists" in problem.outputs:
        columns |= of_verdicts(response.verdicts())
    if {"stability", "multipliers"} & problem.outputs:
        columns |= multiplier_columns(problem, *response.multipliers())
    totals: list[Sums | None] = []
    for f in range(count):
        bounded = not response.unbounded[f]
        one = (response.part(f),) if bounded else ()
        totals.append(sums(problem, phases, one, contact) if bounded else None)
    rows = [
        held_row(phases.stop, float(cells.length[f]), phases.scale, totals[f])
        for f in range(count if held else 0)
    ]
    columns |= along_columns(problem, cells.length, totals, mirrored=False)
    if "energy" in problem.outputs:
        for f, total in enumerate(totals):
            if total is not None:
                set_energy(columns, f, phases, response.part(f))
                if held:
                    add_contact_loss(columns, f, rows[f])
    if "waveform" in problem.outputs:
        set_waveforms(problem, columns, [
            (0.0, (response.part(f),)) if totals[f] is not None else None for f in range(count)
        ], mirrored=False)  # fmt: skip
    columns |= of_contacts(rows, np.arange(len(rows)))
    return columns


def of(problem: Problem, phases: Phases, cells: Cells, solved: Solutions) -> Columns:
    """Return the columns of motions with one contact phase per cell."""
    count = solved.index.size
    columns = begun(problem, solved.index, contacts=True)
    twice = problem.symmetric
    if twice:
        columns["solution_contacts"] *= 2
    if "exists" in problem.outputs:
        columns |= of_verdicts(verdicts(problem, phases, cells, solved))
    if {"stability", "multipliers"} & problem.outputs:
        columns |= multiplier_columns(problem, *multipliers(phases, cells, solved))
    every = [parts(phases, cells, solved, k) for k in range(count)]
    totals: list[Sums | None] = [sums(problem, phases, one, (0, phases.stop)) for one in every]
    rows = [
        _contact(problem, phases, cells, solved, k, every[k], total)
        for k, total in enumerate(totals)
        if total is not None
    ]
    if problem.tolerance is not None:
        within = [row["error_impulse"] <= problem.tolerance * row["impulse"] for row in rows]
        columns["solution_within_tolerance"] = np.array(within, dtype=bool)
    columns |= along_columns(problem, cells.length[solved.index], totals, mirrored=twice)
    if "energy" in problem.outputs:
        for k in range(count):
            set_energy(columns, k, phases, Part.at_entry(phases, cells, solved, k))
            add_contact_loss(columns, k, rows[k], 2.0 if twice else 1.0)
    if "waveform" in problem.outputs:
        starts = solved.phase / cells.Omega[solved.index]
        set_waveforms(
            problem, columns, list(zip(starts.tolist(), every, strict=True)), mirrored=twice
        )
    owner = np.arange(count)
    if twice:
        rows = [row for each in rows for row in (each, _mirrored(problem, phases, cells, each))]
        owner = np.repeat(owner, 2)
    columns |= of_contacts(rows, owner)
    return columns


def no_impacts() -> Columns:
    """Return the empty table of impacts."""
    return {
        name: np.zeros(0, np.int64 if name in _WHOLE else np.float64)
        for name in along(Result, "impact")
    }


_WHOLE = ("impact_solution", "impact_constraint", "impact_side")


# -- solutions --


def begun(problem: Problem, index: Integers, *, contacts: bool) -> Columns:
    """Return the first columns of solutions at frequencies of these indices."""
    count = index.size
    columns: Columns = {
        "solution_frequency_index": index,
        "solution_Omega": problem.Omega[index],
        "solution_impacts": np.zeros(count, dtype=np.int64),
        "solution_contacts": np.full(count, int(contacts), dtype=np.int64),
    }
    if problem.tolerance is not None:
        columns["solution_within_tolerance"] = np.ones(count, dtype=bool)
    return columns


def of_verdicts(decided: Verdicts) -> Columns:
    """Return the columns of which solutions are motions."""
    return {
        "solution_exists": decided.reason == Reason.OK,
        "solution_reason": decided.reason,
        "solution_witness": decided.witness,
        "solution_witness_constraint": decided.constraint,
        "solution_certified": decided.certified,
    }


def along_columns(
    problem: Problem, lengths: Floats, totals: list[Sums | None], *, mirrored: bool
) -> Columns:
    """Return the columns of what is summed up along solutions."""
    count, dofs = len(totals), problem.output_dofs.size
    columns: Columns = {}
    if "extremes" in problem.outputs:
        for name in ("x_max", "x_min", "rms"):
            columns[f"solution_{name}"] = np.full((count, dofs), np.nan)
            columns[f"error_{name}"] = np.full((count, dofs), np.inf)
    if "energy" in problem.outputs:
        for name in ("work", "energy_lost", "energy"):
            columns[f"solution_{name}"] = np.full(count, np.nan)
            columns[f"error_{name}"] = np.full(count, np.inf)
    both = 2.0 if mirrored else 1.0
    for k, total in enumerate(totals):
        if total is None:
            continue
        if "extremes" in problem.outputs:
            high, low = total.highest, total.lowest
            if mirrored:
                high = np.maximum(high, -low)
                low = -high
            columns["solution_x_max"][k], columns["solution_x_min"][k] = high, low
            columns["solution_rms"][k] = np.sqrt(total.squares / lengths[k])
            rms, lost = columns["solution_rms"][k], total.rms_error / lengths[k]
            for name in ("x_max", "x_min"):
                columns[f"error_{name}"][k] = total.x_error
            columns["error_rms"][k] = total.x_error + lost / np.maximum(rms, np.sqrt(lost) + _TINY)
        if "energy" in problem.outputs:
            columns["solution_work"][k] = both * total.work
            columns["solution_energy_lost"][k] = both * total.dissipated
            columns["error_work"][k] = both * (total.work_error + 16.0 * EPS * total.flow)
            columns["error_energy_lost"][k] = both * (
                total.loss_error + 16.0 * EPS * total.dissipated
            )
    return columns


def set_energy(columns: Columns, k: int, phases: Phases | Scenes, part: Part) -> None:
    """Enter the energy at the beginning of a part, from the open structure's equilibrium."""
    side, scale = part.side, phases.scale
    free = phases.open.basis
    q, rate = side.coordinates_of(part.states(np.zeros(1)))
    u = side.vectors @ (q[0] + side.basis.still) + side.origin - free.still
    v = scale * (side.vectors @ rate[0])
    modes = free.modes
    roots = modes.roots * (1.0 + modes.rests)
    stiffness = roots * np.abs(roots)
    n = u.size
    off = part.error_of(side.basis.displacement(side.vectors).reshape(n, -1))
    fast = scale * part.error_of(side.basis.velocity(side.vectors).reshape(n, -1))
    if part.frame is not None:
        shift = phases.stopped.modal(part.frame.shift)
        speeds, now = 1j * scale * part.rates[:, np.newaxis] * shift, np.zeros(1)
        u, v = u + part.carried(now, shift)[0], v + part.carried(now, speeds)[0]
        off, fast = off + part.carried_error(shift), fast + part.carried_error(speeds)
    columns["solution_energy"][k] = 0.5 * float(u**2 @ stiffness + v @ v)
    error = np.abs(u * stiffness) @ off + np.abs(v) @ fast + 0.5 * u**2 @ modes.errors
    sizes = 0.5 * float(u**2 @ np.abs(stiffness) + v @ v)
    columns["error_energy"][k] = float(error) + 16.0 * EPS * sizes


def add_contact_loss(columns: Columns, k: int, row: Columns, times: float = 1.0) -> None:
    """Add the wall's work and what the contact loses; each sum tells how far the other is off."""
    columns["solution_energy_lost"][k] += times * row["energy_lost"]
    columns["solution_work"][k] += times * row["wall_work"]
    columns["error_work"][k] += times * row["error_wall_work"]
    lost_error = columns["error_energy_lost"][k] + times * row["error_energy_lost"]
    work_error = columns["error_work"][k]
    apart = abs(columns["solution_work"][k] - columns["solution_energy_lost"][k])
    columns["error_energy_lost"][k] = min(lost_error, apart + work_error)
    columns["error_work"][k] = min(work_error, apart + lost_error)


def set_waveforms(
    problem: Problem, columns: Columns, motions: list[tuple[float, tuple[Part, ...]] | None], *,
    mirrored: bool,
) -> None:  # fmt: skip
    """Enter displacements at parts of the period from phase 0."""
    assert problem.tau is not None
    tau, dofs = problem.tau, problem.output_dofs
    columns["waveform"] = np.full((len(motions), tau.size, dofs.size), np.nan)
    columns["error_waveform"] = np.full((len(motions), 1, dofs.size), np.inf)
    for k, motion in enumerate(motions):
        if motion is None:
            continue
        start, every = motion
        cell = sum(part.length for part in every)
        whole = cell * (2.0 if mirrored else 1.0)
        since = np.mod(tau * whole - start, whole)
        late = since >= cell if mirrored else np.zeros(since.shape, dtype=bool)
        since = np.where(late, since - cell, since)
        begin, error = 0.0, np.zeros(dofs.size)
        for place, part in enumerate(every):
            last = place == len(every) - 1
            here = (since >= begin) & (np.full(since.shape, last) | (since < begin + part.length))
            form, still = forms_of(part.side, dofs)
            x = part.states(since[here] - begin) @ form.T + still
            off = part.error_of(form) + 4.0 * EPS * np.abs(still)
            if part.frame is not None:
                shift = part.frame.shift[:, dofs]
                x += part.carried(since[here] - begin, shift)
                off += part.carried_error(shift)
            columns["waveform"][k, here] = np.where(late[here], -1.0, 1.0)[:, np.newaxis] * x
            error = np.maximum(error, off)
            begin += part.length
        columns["error_waveform"][k, 0] = error


# -- contacts --


def _contact(
    problem: Problem, phases: Phases, cells: Cells, solved: Solutions, k: int,
    every: tuple[Part, Part], total: Sums,
) -> Columns:  # fmt: skip
    """Return the row of a contact phase."""
    scale, Omega = phases.scale, float(cells.Omega[solved.index[k]])
    a, side = phases.impact.constraint, phases.impact.side
    entry = Part.at_entry(phases, cells, solved, k)
    z = entry.states(np.zeros(1))[0]
    velocity = float(z @ phases.open.velocity[a]) * scale
    # Errors of the state at the beginning are those of the loaded phase.
    both = every[0].error_of(np.stack([phases.loaded.velocity[a], phases.loaded.position[a]]))
    speed_error, start_error = float(both[0]) * scale, 0.0
    dents = [0.0, 0.0]
    if phases.damping > 0.0:
        end = every[1].states(np.zeros(1))[0]
        for place, state in enumerate((z, end)):
            y = float(state @ phases.open.position[a]) + float(phases.open.level[a])
            dents[place] = side * y - phases.wall
        if solved.regained[k]:
            size = abs(float(phases.loaded.level[a])) + abs(phases.wall)
            start_error = float(both[1]) + 8.0 * EPS * size
        else:
            dents[0] = 0.0
    c = phases.damping / scale
    lost = c * total.rubbed + 0.5 * phases.stiffness * (dents[1] ** 2 - dents[0] ** 2)
    dent_error = total.indentation_error * (abs(dents[1]) + abs(dents[0])) * phases.stiffness
    phase, phase_error = float(solved.phase[k]), float(solved.phase_error[k])
    ends = float(solved.d_error[k] + solved.phase_error[k] / Omega)
    work_error = total.wall_work_error + total.peak_force * ends * every[0].wall_speed(a)
    return {
        "constraint": a, "side": side, "phase": phase, "time": phase / (Omega * scale),
        "duration": float(solved.d[k]) / scale, "impulse": total.impulse,
        "peak_force": total.peak_force, "velocity": velocity, "indentation": total.indentation,
        "start_indentation": dents[0], "energy_lost": lost, "wall_work": total.wall_work,
        "error_wall_work": work_error,
        "error_phase": phase_error + 2.0 * EPS * phase,
        "error_time": (phase_error + 4.0 * EPS * phase) / (Omega * scale),
        "error_duration": (float(solved.d_error[k]) + 4.0 * EPS * float(solved.d[k])) / scale,
        "error_impulse": total.impulse_error + total.peak_force * ends / scale,
        "error_peak_force": total.force_error, "error_velocity": speed_error,
        "error_indentation": total.indentation_error, "error_start_indentation": start_error,
        "error_energy_lost": c * total.rubbed_error + dent_error + 16.0 * EPS * abs(lost),
    }  # fmt: skip


def held_row(stop: Stop, length: float, scale: float, total: Sums | None) -> Columns:
    """Return the row of a stop that is loaded throughout a period, by the basis' time."""
    T, c = length / scale, stop.damping / scale
    row: Columns = dict.fromkeys(_CONTACT, math.nan)
    row |= {f"error_{name}": math.inf for name in _CONTACT}
    row |= {"constraint": stop.impact.constraint, "side": stop.impact.side}
    row |= {"duration": T, "error_duration": 2.0 * EPS * T, "wall_work": 0.0}
    row |= {"error_wall_work": 0.0}
    row |= {"phase": 0.0, "time": 0.0, "error_phase": 0.0, "error_time": 0.0}
    if total is not None:
        row |= {
            "impulse": total.impulse, "peak_force": total.peak_force,
            "indentation": total.indentation, "energy_lost": c * total.rubbed,
            "wall_work": total.wall_work, "error_wall_work": total.wall_work_error,
            "error_impulse": total.impulse_error, "error_peak_force": total.force_error,
            "error_indentation": total.indentation_error,
            "error_energy_lost": c * total.rubbed_error + 16.0 * EPS * c * total.rubbed,
        }  # fmt: skip
    return row


def _mirrored(problem: Problem, phases: Phases, cells: Cells, row: Columns) -> Columns:
    """Return the row of the contact phase half a period later, at the other wall."""
    half = math.pi * problem.periods
    Omega = row["phase"] / row["time"] if row["time"] > 0.0 else math.inf
    later = row["time"] + half / Omega
    return row | {
        "side": -row["side"], "phase": float(np.mod(row["phase"] + half, 2.0 * math.pi)),
        "time": later, "velocity": -row["velocity"],
    }  # fmt: skip


def of_contacts(rows: list[Columns], owner: Integers) -> Columns:
    """Return the table of contact phases."""
    table: Columns = {"contact_solution": owner.astype(np.int64)}
    for name in ("constraint", "side"):
        table[f"contact_{name}"] = np.array([row[name] for row in rows], dtype=np.int64)
    for name in _CONTACT:
        table[f"contact_{name}"] = np.array([row[name] for row in rows], dtype=np.float64)
        errors = [row[f"error_{name}"] for row in rows]
        table[f"error_contact_{name}"] = np.array(errors, dtype=np.float64)
    return table
