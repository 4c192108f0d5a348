"""The columns of the tables of a result, of motions with any sequence of contacts."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import EPS
from vibroimpact_solvers.periodic_motions.columns import multiplier_columns
from vibroimpact_solvers.periodic_motions.existence import Verdicts
from vibroimpact_solvers.periodic_motions.problem import Problem
from vibroimpact_solvers.periodic_motions.stops import columns as tables
from vibroimpact_solvers.periodic_motions.stops.orbit_errors import Errors, errors, multipliers
from vibroimpact_solvers.periodic_motions.stops.orbit_existence import verdict
from vibroimpact_solvers.periodic_motions.stops.orbits import Kind, Orbit
from vibroimpact_solvers.periodic_motions.stops.parts import Part
from vibroimpact_solvers.periodic_motions.stops.samples import Samples
from vibroimpact_solvers.periodic_motions.stops.scenes import Scenes
from vibroimpact_solvers.periodic_motions.stops.sums import Sums, of_force, set_forces, sums

Columns = dict[str, Any]
_ADDED = (
    "impulse", "rubbed", "wall_work", "impulse_error", "rubbed_error", "wall_work_error",
)  # fmt: skip


class Checked(NamedTuple):
    """An orbit, and its errors."""

    orbit: Orbit
    errors: Errors

    @classmethod
    def of(cls, orbit: Orbit) -> Checked:
        """Return an orbit with its errors."""
        return cls(orbit, errors(orbit))


def of(problem: Problem, scenes: Scenes, motions: list[tuple[int, Checked]]) -> Columns:
    """Return the columns of motions, each with the index of its frequency."""
    index = np.array([f for f, _ in motions], dtype=np.int64)
    columns = tables.begun(problem, index, contacts=False)
    rows = [contact_rows(*one) for _, one in motions]
    columns["solution_contacts"] = np.array([len(each) for each in rows], dtype=np.int64)
    if "exists" in problem.outputs:
        columns |= tables.of_verdicts(_verdicts(motions))
    if {"stability", "multipliers"} & problem.outputs:
        size = 2 * scenes.open.pairs.moving.size
        values, off = np.zeros((len(motions), size), np.complex128), np.zeros((len(motions), size))
        for k, (_, one) in enumerate(motions):
            values[k], off[k] = multipliers(one.orbit, one.errors.times)
        columns |= multiplier_columns(problem, values, off)
    every = [parts(*one) for _, one in motions]
    totals = [sums(problem, scenes, one) for one in every]
    if problem.tolerance is not None:
        columns["solution_within_tolerance"] = np.array([
            all(row["error_impulse"] <= problem.tolerance * row["impulse"] for row in each)
            for each in rows
        ])  # fmt: skip
    lengths = np.array([one.orbit.cell.length for _, one in motions])
    columns |= tables.along_columns(problem, lengths, list(totals), mirrored=False)
    if "energy" in problem.outputs:
        for k in range(len(motions)):
            tables.set_energy(columns, k, scenes, every[k][0])
            loss = {
                name: float(sum(row[name] for row in rows[k]))
                for name in ("energy_lost", "wall_work", "error_energy_lost", "error_wall_work")
            }
            tables.add_contact_loss(columns, k, loss)
    if "waveform" in problem.outputs:
        starts = [float(one.orbit.starts[0]) for _, one in motions]
        tables.set_waveforms(
            problem, columns, list(zip(starts, every, strict=True)), mirrored=False
        )
    owner = np.repeat(np.arange(len(motions)), [len(each) for each in rows])
    return columns | tables.of_contacts([row for each in rows for row in each], owner)


def _verdicts(motions: list[tuple[int, Checked]]) -> Verdicts:
    decided = [verdict(*one) for _, one in motions]
    return Verdicts(
        np.array([each.reason for each in decided], dtype=np.int64),
        np.array([each.witness for each in decided], dtype=np.float64),
        np.array([each.constraint for each in decided], dtype=np.int64),
        np.array([each.certified for each in decided], dtype=bool),
    )  # fmt: skip


def parts(one: Orbit, off: Errors) -> tuple[Part, ...]:
    """Return the parts of a motion in which one structure moves."""
    cell, frame, every = one.cell, one.cell.scenes.frame, list[Part]()
    for k, loaded in enumerate(one.scenes):
        turned = cell.turned(float(one.starts[k]))
        every.append(Part(
            one.side(k), one.states[k], cell.steady(loaded) * turned[:, np.newaxis], cell.rates,
            turned * cell.factor, float(one.lengths[k]), off.states[k],
            None if frame is None else frame.at(turned),
        ))  # fmt: skip
    return tuple(every)


def contact_rows(one: Orbit, off: Errors) -> list[Columns]:
    """Return the rows of all contact phases of a motion, in the order of their beginnings."""
    every, rows = parts(one, off), list[Columns]()
    for k, switching in enumerate(one.switchings):
        if switching.kind is not Kind.LOST:
            rows.append(_row(one, off, every, k))
    switch, scenes = {each.stop for each in one.switchings}, one.cell.scenes
    for stop in (each for each in one.scenes[0] if each not in switch):
        total = _forces(one, every, range(len(every)), *stop)
        rows.append(tables.held_row(scenes.stop(*stop), one.cell.length, scenes.scale, total))
    return rows


def _forces(one: Orbit, every: tuple[Part, ...], which: Iterable[int], a: int, sign: int) -> Sums:
    """Sum up the force of a stop along some parts."""
    scenes, total = one.cell.scenes, Sums.nothing(0)
    stop = scenes.stop(a, sign)
    for k in which:
        watching, own = scenes.watching(one.scenes[k], a, sign), Sums.nothing(0)
        part = replace(every[k], side=watching)
        set_forces(stop, scenes.scale, Samples.of(part, of_force(stop, watching)), own)
        for name in ("peak_force", "indentation", "force_error", "indentation_error"):
            setattr(total, name, max(getattr(total, name), getattr(own, name)))
        for name in _ADDED:
            setattr(total, name, getattr(total, name) + getattr(own, name))
    return total


def _row(one: Orbit, off: Errors, every: tuple[Part, ...], k: int) -> Columns:
    """Return the row of the contact phase that begins with a switching."""
    switching, count, scenes = one.switchings[k], len(one.switchings), one.cell.scenes
    stop, scale, a, sign = scenes.stop(*switching.stop), scenes.scale, *switching.stop
    after = [(k + further) % count for further in range(1, count + 1)]
    end = next(place for place in after if one.switchings[place].stop == switching.stop)
    lasts = [k, *after[: after.index(end)]]
    total = _forces(one, every, lasts, a, sign)
    duration = sum(every[place].length for place in lasts)
    before, time = one.before[k], float(one.times[k])
    begun = every[k - 1]
    z = one.ends[k - 1] + one.cell.at(before, time)[0]
    side = scenes.side(before)
    velocity = float(z @ side.velocity[a]) * scale
    pair = np.stack([side.velocity[a], side.position[a]])
    both = begun.error_of(pair)
    bends = abs(float(one.cell.at(before, time)[1] @ side.velocity[a])) + abs(one.rates[k])
    dents = _dents(one, k, end)
    c = stop.damping / scale
    lost = c * total.rubbed + 0.5 * stop.stiffness * (dents[1] ** 2 - dents[0] ** 2)
    dent_error = total.indentation_error * (abs(dents[1]) + abs(dents[0])) * stop.stiffness
    start_error = 0.0
    if switching.kind is Kind.REGAINED:
        start_error = float(both[1]) + 8.0 * EPS * (abs(float(side.level[a])) + abs(stop.wall))
    late, early = float(off.times[k]), float(off.times[end])
    work_error = total.wall_work_error + total.peak_force * (late + early) * begun.wall_speed(a)
    Omega, length = one.cell.Omega, one.cell.length
    shown = float(np.mod(time, length))
    phase = float(np.mod(Omega * time, 2.0 * np.pi))
    return {
        "constraint": a, "side": sign, "phase": phase, "time": shown / scale,
        "duration": duration / scale, "impulse": total.impulse, "peak_force": total.peak_force,
        "velocity": velocity, "indentation": total.indentation, "start_indentation": dents[0],
        "energy_lost": lost, "wall_work": total.wall_work,
        "error_wall_work": work_error,
        "error_phase": Omega * late + 4.0 * EPS * Omega * length,
        "error_time": (late + 4.0 * EPS * length) / scale,
        "error_duration": (late + early + 4.0 * EPS * length) / scale,
        "error_impulse": total.impulse_error + total.peak_force * (late + early) / scale,
        "error_peak_force": total.force_error,
        "error_velocity": (float(both[0]) + bends * EPS * length) * scale,
        "error_indentation": total.indentation_error, "error_start_indentation": start_error,
        "error_energy_lost": c * total.rubbed_error + dent_error + 16.0 * EPS * abs(lost),
    }  # fmt: skip


def _dents(one: Orbit, begin: int, end: int) -> tuple[float, float]:
    """Return the indentations at both ends of a contact phase, zero at a wall."""
    dents: list[float] = []
    for k in (begin, end):
        switching, scenes, before = one.switchings[k], one.cell.scenes, one.before[k]
        a, sign = switching.stop
        stop = scenes.stop(a, sign)
        if switching.kind is Kind.WALL or stop.damping == 0.0:
            dents.append(0.0)
            continue
        side, z = scenes.side(before), one.ends[k - 1] + one.cell.at(before, one.times[k])[0]
        y = float(z @ side.position[a]) + float(side.level[a])
        dents.append(sign * y - stop.wall)
    return dents[0], dents[1]
