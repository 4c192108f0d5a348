"""What is summed up along solutions: extremes, energies, forces, waveforms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.problem import Problem
from vibroimpact_solvers.periodic_motions.stops import prescribed
from vibroimpact_solvers.periodic_motions.stops.parts import ROUNDED, Part
from vibroimpact_solvers.periodic_motions.stops.phases import Phases, Side, Stop
from vibroimpact_solvers.periodic_motions.stops.scenes import Scenes

_PEAKS: Final = 8  # nodes between their neighbours at which a form may be largest
_NEWTON: Final = 6


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


def sums(problem: Problem, phases: Phases, one: tuple[Part, ...], contact: int = 0) -> Sums:
    """Sum up the parts of one solution, of which one is its contact phase; -1: none."""
    dofs = problem.output_dofs
    wanted = dofs if {"extremes", "waveform"} & problem.outputs else dofs[:0]
    total = Sums.nothing(wanted.size)
    for place, part in enumerate(one):
        look()
        if wanted.size:
            add_extremes(part, wanted, total)
        if "energy" in problem.outputs:
            add_energies(phases, part, total)
        if place == contact:
            set_forces(phases.stop, phases.scale, part, total)
    return total


def forms_of(side: Side, dofs: Integers) -> tuple[Floats, Floats]:
    """Return displacements as forms, (dof, 2 pair), and their values at the zero of states."""
    modes = side.basis.modes
    shapes = modes.shapes[dofs]
    still = modes.base[dofs] + shapes @ side.basis.still
    return side.basis.displacement(shapes).reshape(len(shapes), -1), still


def add_extremes(part: Part, dofs: Integers, total: Sums) -> None:
    """Add the extremes and the mean squares of displacements along a part."""
    form, still = forms_of(part.side, dofs)
    nodes = part.nodes(form)
    x = part.states(nodes.times) @ form.T + still
    ripple = part.ripple(form, nodes)
    error = part.error_of(form) + ROUNDED * EPS * np.abs(still)
    shift = np.zeros((part.rates.size, dofs.size), dtype=np.complex128)
    if part.frame is not None:
        shift = part.frame.shift[:, dofs]
        x += part.carried(nodes.times, shift)
        error += part.carried_error(shift)
    total.squares += nodes.weights @ x**2
    for sign, name in ((1.0, "highest"), (-1.0, "lowest")):
        best = sign * peaks(part, sign * form, sign * still, nodes.times, sign * x, sign * shift)
        old = getattr(total, name)
        setattr(total, name, np.maximum(old, best) if sign > 0 else np.minimum(old, best))
        if nodes.left.size:
            error = np.maximum(error, (sign * (x - best) + 2.0 * ripple).max(axis=0))
    total.x_error = np.maximum(total.x_error, error)
    total.rms_error += nodes.weights @ (ripple * (2.0 * np.abs(x) + ripple))


def peaks(
    part: Part, form: Floats, level: Floats, times: Floats, seen: Floats,
    shift: Complexes | None = None,
) -> Floats:  # fmt: skip
    """Return the largest values of forms near times at which they are seen, (form,).

    Amplitudes of a shift, (harmonic, form), are added to the forms.
    """
    seen = np.ascontiguousarray(seen.T)
    best, columns = seen.max(axis=1), np.arange(form.shape[0])
    low = seen.copy()
    low[:, 1:][seen[:, 1:] < seen[:, :-1]] = -np.inf
    low[:, :-1][seen[:, :-1] < seen[:, 1:]] = -np.inf
    few = max(len(times) - _PEAKS, 0)
    row = np.argpartition(low, few, axis=1)[:, few:].T
    slope = prescribed.drift(part.side, np.arange(form.shape[1]), form, form=True)
    # The steady response turns at its own rates: its second derivative is not that of the form.
    rates = 1j * part.rates[:, np.newaxis]
    swing = np.zeros((part.rates.size, form.shape[0])) if shift is None else shift
    more = (rates * (rates * (part.steady @ form.T + swing) - part.steady @ slope.T)).T
    there, moving = swing.T, (rates * swing).T

    def step(at: Floats) -> tuple[Floats, Floats, Floats]:
        """Return values, slopes, and Newton's steps of forms at times (…, form) of their own."""
        state, moved = (z.reshape(*at.shape, -1) for z in part.both(at.ravel()))
        turned = np.exp(1j * at[..., np.newaxis] * part.rates)
        value = (state * form).sum(axis=-1) + level + (turned * there).real.sum(axis=-1)
        rate = (moved * form).sum(axis=-1) + (turned * moving).real.sum(axis=-1)
        bend = (moved * slope).sum(axis=-1) + (turned * more).real.sum(axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            way = np.where(bend < 0.0, -rate / bend, 0.0)
        return value, rate, np.where(np.isfinite(way), way, 0.0)

    value, rate, way = step(times[row])
    gap = np.diff(times).max(initial=0.0)
    # A peak beyond an end of the part is not in it; in a whole period it is at the other end.
    ahead = times[row] + way
    near = (np.abs(way) <= gap) & (ahead >= 0.0) & (ahead <= part.length)
    guess = np.where(near, value + 0.5 * way * rate, value)
    first = guess.argmax(axis=0)
    at = times[row][first, columns] + np.where(near, way, 0.0)[first, columns]
    for _ in range(_NEWTON):
        at = np.clip(at, 0.0, part.length)
        value, _, way = step(at)
        best = np.fmax(best, value)
        if not (np.abs(way) > 1e-9 * np.maximum(np.abs(at), gap)).any():
            break
        at = at + way
    return np.asarray(best)


def add_energies(phases: Phases | Scenes, part: Part, total: Sums) -> None:
    """Add the work of the load and what damping of the structure dissipates."""
    side, stopped = part.side, phases.stopped
    free = stopped.placed(()).basis.modes
    scale, n = phases.scale, free.roots.size
    # modal, of the open structure
    pushed = (phases.forces @ free.shapes) * part.turned[:, np.newaxis]
    if part.frame is not None:
        pushed = part.frame.forces @ free.shapes
    modal = side.basis.velocity(np.eye(n)).reshape(n, -1)
    rate_error = part.error_of(modal)
    nodes = part.nodes(modal)
    weights, flow = nodes.weights / scale, np.exp(1j * nodes.times[:, np.newaxis] * part.rates)
    _, rate = side.coordinates_of(part.states(nodes.times))
    carried_error = np.zeros(n)
    v = scale * (rate @ side.vectors.T)
    if part.frame is not None:
        speeds = 1j * scale * part.rates[:, np.newaxis] * stopped.modal(part.frame.shift)
        v += part.carried(nodes.times, speeds)
        carried_error = part.carried_error(speeds)
    load = (flow @ pushed).real
    total.work += float(weights @ (load * v).sum(axis=1))
    total.flow += float(weights @ (np.abs(load) * np.abs(v)).sum(axis=1))
    off = scale * (rate_error + part.ripple(modal, nodes)) @ np.abs(side.vectors).T
    off += carried_error
    total.work_error += float(weights @ (np.abs(load) * off).sum(axis=1))
    if free.damping is not None and free.damping.size:
        dragged = v @ free.damping
        total.dissipated += float(weights @ (dragged * v).sum(axis=1))
        each = (np.abs(dragged) * off).sum(axis=1) * 2.0 + v**2 @ free.damping_errors
        total.loss_error += float(weights @ each)


def set_forces(stop: Stop, scale: float, part: Part, total: Sums) -> None:
    """Sum up the force of a stop along a part, whose side has the form of this force."""
    side, k = part.side, stop.stiffness
    a = stop.impact.constraint
    sign = float(stop.impact.side)
    dent = (sign * side.position[a])[np.newaxis]
    level = np.array([side.force_level / k if k > 0.0 else 0.0])
    if k == 0.0:
        level = np.array([sign * side.level[a] - stop.wall])
    both = np.concatenate([side.force[np.newaxis], dent])
    levels = np.append(side.force_level, level)
    speed = sign * side.velocity[a]
    rate_error = float(part.error_of(speed[np.newaxis])[0])
    errors = part.error_of(both) + ROUNDED * EPS * np.array([side.force_size, np.abs(level)[0]])
    steady_error = float(errors[0])
    nodes = part.nodes(np.concatenate([both, speed[np.newaxis]]))
    z, weights = part.states(nodes.times), nodes.weights / scale
    seen, ripple = z @ both.T + levels, part.ripple(both, nodes)
    best = peaks(part, both, levels, nodes.times, seen)
    if nodes.left.size:
        errors = np.maximum(errors, (seen - best + 2.0 * ripple).max(axis=0))
    total.peak_force, total.indentation = (float(value) for value in best)
    total.impulse = float(weights @ seen[:, 0])
    if part.frame is not None:
        wall = part.carried(nodes.times, 1j * scale * part.rates * part.frame.walls[:, a])
        power = -sign * seen[:, 0] * wall  # the stop pushes the structure by -sign F
        total.wall_work = float(weights @ power)
        off = (errors[0] + ripple[:, 0]) * np.abs(wall) + 16.0 * EPS * np.abs(power)
        total.wall_work_error = float(weights @ off)
    v, own = scale * (z @ speed), part.ripple(speed[np.newaxis], nodes)[:, 0]
    total.rubbed = float(weights @ v**2)
    off = scale * (rate_error + own)
    total.rubbed_error = float(weights @ ((2.0 * np.abs(v) + off) * off))
    total.force_error, total.indentation_error = (float(e) for e in errors)
    total.impulse_error = steady_error * part.length / scale + float(weights @ ripple[:, 0])
