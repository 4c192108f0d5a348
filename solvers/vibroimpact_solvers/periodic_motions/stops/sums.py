"""What is summed up along solutions: extremes, energies, forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.periodic_motions.problem import Problem
from vibroimpact_solvers.periodic_motions.stops.parts import ROUNDED, Part
from vibroimpact_solvers.periodic_motions.stops.phases import Phases, Side, Stop
from vibroimpact_solvers.periodic_motions.stops.samples import Samples
from vibroimpact_solvers.periodic_motions.stops.scenes import Scenes


@dataclass(eq=False, slots=True)
class Sums:
    """What is summed up along a cell of one solution, in the problem's units but for the time.

    Parameters
    ----------
    highest, lowest, squares : array, shape (dof,)
    work, dissipated, flow : float
        Work of the load, losses by the structure's damping, integral of the power's modulus.
    peak_force, indentation, impulse, rubbed : float
        Of the contact phase; rubbed is the integral of the squared rate of the indentation.
    wall_work : float
        Work of the wall in the contact phase.
    x_error : array, shape (dof,)
    rms_error : array, shape (dof,)
        Integrals of errors of squares.
    energy_error, force_error, indentation_error, impulse_error, rubbed_error : float
    """

    highest: Floats
    lowest: Floats
    squares: Floats
    x_error: Floats
    rms_error: Floats
    work: float = 0.0
    dissipated: float = 0.0
    flow: float = 0.0
    work_error: float = 0.0
    loss_error: float = 0.0
    peak_force: float = 0.0
    indentation: float = 0.0
    impulse: float = 0.0
    rubbed: float = 0.0
    force_error: float = 0.0
    indentation_error: float = 0.0
    impulse_error: float = 0.0
    rubbed_error: float = 0.0
    wall_work: float = 0.0
    wall_work_error: float = 0.0

    @classmethod
    def nothing(cls, dofs: int) -> Sums:
        """Return the sums over no time."""
        none, some = np.full(dofs, np.inf), np.zeros((3, dofs))
        return cls(-none, none, *some)


def sums(
    problem: Problem,
    structure: Phases | Scenes,
    every: Sequence[Part],
    contact: tuple[int, Stop] | None = None,
) -> Sums:
    """Sum up the parts of one solution, one of them the contact phase of a stop if it is given."""
    dofs = problem.output_dofs
    wanted = dofs if {"extremes", "waveform"} & problem.outputs else dofs[:0]
    total = Sums.nothing(wanted.size)
    for place, part in enumerate(every):
        look()
        side = part.side
        stop = contact[1] if contact is not None and contact[0] == place else None
        form, still = forms_of(side, wanted)
        rates = _rates(side) if "energy" in problem.outputs else form[:0]
        force = of_force(stop, side) if stop is not None else form[:0]
        every_form = np.concatenate([form, rates, force])
        if not every_form.size:
            continue
        samples = Samples.of(part, every_form)
        if wanted.size:
            _add_extremes(samples, wanted, form, still, total)
        if rates.size:
            _add_energies(structure, samples, rates, total)
        if stop is not None:
            set_forces(stop, structure.scale, samples, total)
    return total


def forms_of(side: Side, dofs: Integers) -> tuple[Floats, Floats]:
    """Return displacements as forms, (dof, 2 pair), and their values at the zero of states."""
    modes = side.basis.modes
    shapes = modes.shapes[dofs]
    still = modes.base[dofs] + shapes @ side.basis.still
    return side.basis.displacement(shapes).reshape(-1, 2 * side.size), still


def _rates(side: Side) -> Floats:
    """Return the rates of modal coordinates as forms, (mode, 2 pair)."""
    n = side.vectors.shape[1]
    return side.basis.velocity(np.eye(n)).reshape(n, -1)


def of_force(stop: Stop, side: Side) -> Floats:
    """Return the force of a stop, the indentation and its rate as forms, (3, 2 pair)."""
    a, sign = stop.impact.constraint, float(stop.impact.side)
    return np.stack([side.force, sign * side.position[a], sign * side.velocity[a]])


def _add_extremes(
    samples: Samples, dofs: Integers, form: Floats, still: Floats, total: Sums
) -> None:
    """Add the extremes and the mean squares of displacements, see `forms_of`, along a part."""
    part, nodes = samples.part, samples.nodes
    x, ripple = samples.states @ form.T + still, samples.ripple(form)
    error = part.error_of(form) + ROUNDED * EPS * np.abs(still)
    shift = np.zeros((part.rates.size, dofs.size), dtype=np.complex128)
    if part.frame is not None:
        shift = part.frame.shift[:, dofs]
        x += part.carried(nodes.times, shift)
        error += part.carried_error(shift)
    total.squares += nodes.weights @ x**2
    both = samples.peaks(
        np.concatenate([form, -form]),
        np.concatenate([still, -still]),
        np.concatenate([x, -x], axis=1),
        np.concatenate([shift, -shift], axis=1),
    )
    highest, lowest = both[: dofs.size], -both[dofs.size :]
    total.highest = np.maximum(total.highest, highest)
    total.lowest = np.minimum(total.lowest, lowest)
    if nodes.left.size:
        beyond = np.maximum(x - highest, lowest - x) + 2.0 * ripple
        error = np.maximum(error, beyond.max(axis=0))
    total.x_error = np.maximum(total.x_error, error)
    total.rms_error += nodes.weights @ (ripple * (2.0 * np.abs(x) + ripple))


def _add_energies(structure: Phases | Scenes, samples: Samples, rates: Floats, total: Sums) -> None:
    """Add the work of the load and what damping dissipates, by the rates of coordinates."""
    part, nodes = samples.part, samples.nodes
    side, stopped, scale = part.side, structure.stopped, structure.scale
    free = stopped.placed(()).basis.modes
    # modal, of the open structure
    pushed = (structure.forces @ free.shapes) * part.turned[:, np.newaxis]
    weights, flow = nodes.weights / scale, np.exp(1j * nodes.times[:, np.newaxis] * part.rates)
    _, rate = side.coordinates_of(samples.states)
    v = scale * (rate @ side.vectors.T)
    off = scale * (part.error_of(rates) + samples.ripple(rates)) @ np.abs(side.vectors).T
    if part.frame is not None:
        pushed = part.frame.forces @ free.shapes
        speeds = 1j * scale * part.rates[:, np.newaxis] * stopped.modal(part.frame.shift)
        v += part.carried(nodes.times, speeds)
        off += part.carried_error(speeds)
    load = (flow @ pushed).real
    total.work += float(weights @ (load * v).sum(axis=1))
    total.flow += float(weights @ (np.abs(load) * np.abs(v)).sum(axis=1))
    total.work_error += _summed(weights, (np.abs(load) * off).sum(axis=1))
    if free.damping is not None and free.damping.size:
        dragged = v @ free.damping
        total.dissipated += float(weights @ (dragged * v).sum(axis=1))
        each = (np.abs(dragged) * off).sum(axis=1) * 2.0 + v**2 @ free.damping_errors
        total.loss_error += _summed(weights, each)


def _summed(weights: Floats, errors: Floats) -> float:
    """Return a sum of errors, which may be infinite: nodes without weight add nothing to it."""
    some = weights > 0.0
    return float(weights[some] @ errors[some])


def set_forces(stop: Stop, scale: float, samples: Samples, total: Sums) -> None:
    """Sum up the force of a stop along a part, whose side has the form of this force."""
    part, weights = samples.part, samples.nodes.weights / scale
    side, k, a, sign = part.side, stop.stiffness, stop.impact.constraint, stop.impact.side
    forms = of_force(stop, side)
    still = side.force_level / k if k > 0.0 else sign * side.level[a] - stop.wall
    levels = np.array([side.force_level, still, 0.0])
    off, ripple = part.error_of(forms), samples.ripple(forms)
    errors = off[:2] + ROUNDED * EPS * np.array([side.force_size, abs(still)])
    steady_error = float(errors[0])
    values = samples.states @ forms.T + levels
    seen, speed = values[:, :2], values[:, 2]
    best = samples.peaks(forms[:2], levels[:2], seen)
    if samples.nodes.left.size:
        errors = np.maximum(errors, (seen - best + 2.0 * ripple[:, :2]).max(axis=0))
    total.peak_force, total.indentation = (float(value) for value in best)
    total.impulse = float(weights @ seen[:, 0])
    if part.frame is not None:
        times = samples.nodes.times
        wall = part.carried(times, 1j * scale * part.rates * part.frame.walls[:, a])
        power = -sign * seen[:, 0] * wall  # the stop pushes the structure by -sign F
        total.wall_work = float(weights @ power)
        doubt = (errors[0] + ripple[:, 0]) * np.abs(wall) + 16.0 * EPS * np.abs(power)
        total.wall_work_error = _summed(weights, doubt)
    v, fast = scale * speed, scale * (float(off[2]) + ripple[:, 2])
    total.rubbed = float(weights @ v**2)
    total.rubbed_error = _summed(weights, (2.0 * np.abs(v) + fast) * fast)
    total.force_error, total.indentation_error = (float(e) for e in errors)
    total.impulse_error = steady_error * part.length / scale + float(weights @ ripple[:, 0])
