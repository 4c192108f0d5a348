"""What is summed up along solutions: extremes, energies, forces, waveforms."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.problem import Problem
from vibroimpact_solvers.periodic_motions.stops import relaxed
from vibroimpact_solvers.periodic_motions.stops.phases import Phases, Side
from vibroimpact_solvers.periodic_motions.stops.relaxed import Cells
from vibroimpact_solvers.periodic_motions.stops.solutions import Solutions

_NODES: Final = 12
_PLACES: Final = 0.5 * (np.polynomial.legendre.leggauss(_NODES)[0] + 1.0)
_WEIGHTS: Final = 0.5 * np.polynomial.legendre.leggauss(_NODES)[1]
_TURN: Final = 2.0  # radians of what turns fastest in a panel
_SILENT: Final = 1e-18  # of the largest number of a state
_NUMBERS: Final = 2**20  # that are there at once
_PANELS: Final = 200_000  # of a part of a motion
_NEWTON: Final = 6
_ROUNDED: Final = 8.0


@dataclass(frozen=True, eq=False, slots=True)
class Part:
    """A part of one solution, in which one structure moves.

    Parameters
    ----------
    side : Side
    state : array, shape (2 pair,)
    steady : array, shape (harmonic, 2 pair), complex
        With the drive's phase at the beginning.
    rates, turned : array, shape (harmonic,)
        Rates of the load, and what its amplitudes are multiplied by at the beginning.
    length : float
    error : array, shape (pair,)
        Of the state.
    """

    side: Side
    state: Floats
    steady: Complexes
    rates: Floats
    turned: Complexes
    length: float
    error: Floats

    def states(self, times: Floats) -> Floats:
        """Return whole states, with the steady response, at times, (time, 2 pair)."""
        flow = self.side.propagators(times)
        moved = relaxed.apply(flow, np.broadcast_to(self.state, (times.size, self.state.size)))
        return np.asarray(
            moved + (np.exp(1j * times[:, np.newaxis] * self.rates) @ self.steady).real
        )

    def drift(self, times: Floats) -> Floats:
        """Return the rates of whole states, (time, 2 pair)."""
        flow = self.side.propagators(times)
        moved = relaxed.apply(flow, np.broadcast_to(self.state, (times.size, self.state.size)))
        every = np.arange(self.state.size)
        moved = relaxed.drift(self.side, every, moved, form=False)
        turned = np.exp(1j * times[:, np.newaxis] * self.rates) * (1j * self.rates)
        return np.asarray(moved + (turned @ self.steady).real)

    def nodes(self) -> Iterator[tuple[Floats, Floats]]:
        """Yield times and weights of a quadrature, some panels at once."""
        pairs = self.side.size
        sizes = np.hypot(self.state[:pairs], self.state[pairs:])
        some = sizes > _SILENT * sizes.max(initial=0.0)
        growth, rate = self.side.growth[some], self.side.rate[some]
        lasts = np.where(growth < 0.0, relaxed.GONE / np.maximum(-growth, 1e-300), np.inf)
        load = float(self.rates.max(initial=0.0))
        least = max(1, math.ceil(_NUMBERS / (_NODES * 2 * pairs)))
        begin, ends = 0.0, [0.0]
        while begin < self.length:
            fastest = max(load, float(rate[lasts > begin].max(initial=0.0)), 1e-300)
            width = min(_TURN / fastest, max(self.length - begin, self.length / _PANELS))
            begin = min(begin + width, self.length)
            if self.length - begin < 1e-12 * self.length:
                begin = self.length
            ends.append(begin)
            if len(ends) > least:
                yield _panels(ends)
                ends = [begin]
        if len(ends) > 1:
            yield _panels(ends)

    def error_of(self, form: Floats) -> Floats:
        """Return errors of forms (form, 2 pair) along the part, (form,)."""
        n = self.side.size
        growth = np.maximum(self.side.growth * self.length, 0.0)
        error = self.error * np.exp(np.minimum(growth, 700.0))
        sizes = np.abs(self.state) + np.abs(self.steady).sum(axis=0)
        lengths = np.hypot(form[:, :n], form[:, n:])
        rounded = self.side.shape_error + _ROUNDED * EPS
        late = (
            2.0 * EPS * self.length * (np.abs(form) @ (np.abs(self.steady).T * self.rates).sum(1))
        )
        return np.asarray(np.sqrt(lengths**2 @ error**2) + rounded * np.abs(form) @ sizes + late)

    @classmethod
    def at_entry(cls, phases: Phases, cells: Cells, solved: Solutions, k: int) -> Part:
        """Return the state of the open structure where a contact phase begins."""
        f = int(solved.index[k])
        turned = np.exp(1j * solved.phase[k] * phases.harmonics)
        return cls(
            phases.open, solved.entry[k], cells.opened[f] * turned[:, np.newaxis],
            cells.Omega[f] * phases.harmonics, turned, 0.0, solved.left_error[k],
        )  # fmt: skip


def _panels(ends: list[float]) -> tuple[Floats, Floats]:
    edges = np.array(ends)
    widths = np.diff(edges)[:, np.newaxis]
    times, weights = edges[:-1, np.newaxis] + widths * _PLACES, widths * _WEIGHTS
    # Both ends are nodes of no weight: peaks are often there.
    times = np.concatenate([edges[:1], times.ravel(), edges[-1:]])
    return times, np.concatenate([[0.0], weights.ravel(), [0.0]])


def parts(phases: Phases, cells: Cells, solved: Solutions, k: int) -> tuple[Part, Part]:
    """Return the contact phase of a solution, and what follows."""
    f = int(solved.index[k])
    rates = cells.Omega[f] * phases.harmonics

    def part(side: Side, steady: Complexes, since: float, state: Floats, length: float,
             error: Floats) -> Part:  # fmt: skip
        turned = np.exp(1j * (solved.phase[k] * phases.harmonics + rates * since))
        own = steady[f] * turned[:, np.newaxis]
        return Part(side, state, own, rates, turned * cells.factor[f], length, error)

    d, rest = float(solved.d[k]), float(solved.rest[k])
    return (
        part(phases.loaded, cells.loaded, 0.0, solved.loaded[k], d, solved.loaded_error[k]),
        part(phases.open, cells.opened, d, solved.left[k], rest, solved.left_error[k]),
    )


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
    x_error : array, shape (dof,)
    energy_error, force_error, indentation_error, impulse_error, rubbed_error : float
    """

    highest: Floats
    lowest: Floats
    squares: Floats
    x_error: Floats
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


def sums(problem: Problem, phases: Phases, one: tuple[Part, ...], contact: int = 0) -> Sums:
    """Sum up the parts of one solution, of which one is its contact phase; -1: none."""
    dofs = problem.output_dofs
    wanted = dofs if {"extremes", "waveform"} & problem.outputs else dofs[:0]
    total = Sums(
        np.full(wanted.size, -np.inf), np.full(wanted.size, np.inf), np.zeros(wanted.size),
        np.zeros(wanted.size),
    )  # fmt: skip
    for place, part in enumerate(one):
        look()
        if wanted.size:
            _extremes(part, wanted, total)
        if "energy" in problem.outputs:
            _energies(phases, part, total)
        if place == contact:
            _forces(phases, part, total)
    return total


def forms_of(side: Side, dofs: Integers) -> tuple[Floats, Floats]:
    """Return displacements as forms, (dof, 2 pair), and their values at the zero of states."""
    modes = side.basis.modes
    shapes = modes.shapes[dofs]
    still = modes.base[dofs] + shapes @ side.basis.still
    return side.basis.displacement(shapes).reshape(len(shapes), -1), still


def _extremes(part: Part, dofs: Integers, total: Sums) -> None:
    form, still = forms_of(part.side, dofs)
    for times, weights in part.nodes():
        x = part.states(times) @ form.T + still
        total.squares += weights @ x**2
        for sign, name in ((1.0, "highest"), (-1.0, "lowest")):
            best = sign * peaks(part, sign * form, sign * still, times, sign * x)
            old = getattr(total, name)
            setattr(total, name, np.maximum(old, best) if sign > 0 else np.minimum(old, best))
    error = part.error_of(form) + _ROUNDED * EPS * np.abs(still)
    total.x_error = np.maximum(total.x_error, error)


def peaks(part: Part, form: Floats, level: Floats, times: Floats, seen: Floats) -> Floats:
    """Return the largest values of forms near times at which they are seen, (form,)."""
    rates = part.drift(times) @ form.T
    slope = relaxed.drift(part.side, np.arange(form.shape[1]), form, form=True)
    bends = part.drift(times) @ slope.T
    # The steady response turns at its own rates: its second derivative is not that of the form.
    turned = np.exp(1j * times[:, np.newaxis] * part.rates)
    bends += _correction(part, form, slope, turned)
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.where(bends < 0.0, -rates / bends, 0.0)
        apart = np.diff(times).max(initial=0.0)
        guess = np.where(np.abs(off) <= apart, seen + 0.5 * off * rates, seen)
    row, column = guess.argmax(axis=0), np.arange(form.shape[0])
    best = seen.max(axis=0)
    at = times[row] + np.where(np.abs(off) <= apart, off, 0.0)[row, column]
    low, high = times[0], times[-1]
    for _ in range(_NEWTON):
        at = np.clip(at, low, high)
        value = (part.states(at) * form).sum(axis=1) + level
        best = np.fmax(best, value)
        moved = part.drift(at)
        rate = (moved * form).sum(axis=1)
        turned = np.exp(1j * at[:, np.newaxis] * part.rates)
        bend = (moved * slope).sum(axis=1) + _correction_rows(part, form, slope, turned)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.where(bend < 0.0, -rate / bend, 0.0)
        if not (np.abs(step) > 1e-9 * np.maximum(np.abs(at), apart)).any():
            break
        at = at + np.where(np.isfinite(step), step, 0.0)
    return np.asarray(best)


def _correction(part: Part, form: Floats, slope: Floats, turned: Complexes) -> Floats:
    """Return what to add to ``slope . z'`` for the second derivatives of forms, (time, form)."""
    rates = 1j * part.rates[:, np.newaxis]
    more = rates * (rates * (part.steady @ form.T) - part.steady @ slope.T)
    return np.asarray((turned @ more).real)


def _correction_rows(part: Part, form: Floats, slope: Floats, turned: Complexes) -> Floats:
    """Return the same of each form at a time of its own, (form,)."""
    rates = 1j * part.rates[:, np.newaxis]
    more = rates * (rates * (part.steady @ form.T) - part.steady @ slope.T)
    return np.asarray((turned * more.T).sum(axis=1).real)


def _energies(phases: Phases, part: Part, total: Sums) -> None:
    """Add the work of the load and what damping of the structure dissipates."""
    side, stopped = part.side, phases.stopped
    free = stopped.placed(()).basis.modes
    forces = phases.forces @ free.shapes  # modal, of the open structure
    pushed, scale, n = forces * part.turned[:, np.newaxis], phases.scale, free.roots.size
    modal = side.basis.velocity(np.eye(n)).reshape(n, -1)
    rate_error = part.error_of(modal)
    for times, weights in part.nodes():
        _, rate = side.coordinates_of(part.states(times))
        v = scale * (rate @ side.vectors.T)
        load = (np.exp(1j * times[:, np.newaxis] * part.rates) @ pushed).real
        power = (load * v).sum(axis=1)
        total.work += float(weights @ power) / scale
        sizes = np.abs(load) * np.abs(v)
        total.flow += float(weights @ sizes.sum(axis=1)) / scale
        off = scale * (np.abs(side.vectors) @ rate_error)
        total.work_error += float(weights @ (np.abs(load) @ off)) / scale
        if free.damping is not None and free.damping.size:
            dragged = v @ free.damping
            total.dissipated += float(weights @ (dragged * v).sum(axis=1)) / scale
            each = 2.0 * np.abs(dragged) @ off + np.abs(v) ** 2 @ free.damping_errors
            total.loss_error += float(weights @ each) / scale


def _forces(phases: Phases, part: Part, total: Sums) -> None:
    """Sum up the contact phase."""
    side, k = part.side, phases.stiffness
    a = phases.impact.constraint
    sign = float(phases.impact.side)
    dent = (sign * side.position[a])[np.newaxis]
    level = np.array([side.force_level / k if k > 0.0 else 0.0])
    if k == 0.0:
        level = np.array([sign * side.level[a] - phases.wall])
    both = np.concatenate([side.force[np.newaxis], dent])
    levels = np.append(side.force_level, level)
    speed = sign * side.velocity[a]
    rate_error = float(part.error_of(speed[np.newaxis])[0])
    errors = part.error_of(both) + _ROUNDED * EPS * np.array([side.force_size, np.abs(level)[0]])
    for times, weights in part.nodes():
        z = part.states(times)
        seen = z @ both.T + levels
        force, deep = peaks(part, both, levels, times, seen)
        total.peak_force = max(total.peak_force, float(force))
        total.indentation = max(total.indentation, float(deep))
        total.impulse += float(weights @ seen[:, 0]) / phases.scale
        v = phases.scale * (z @ speed)
        total.rubbed += float(weights @ v**2) / phases.scale
        total.rubbed_error += float(weights @ np.abs(v)) * 2.0 * rate_error
    total.force_error, total.indentation_error = (float(e) for e in errors)
    total.impulse_error = float(errors[0]) * part.length / phases.scale
