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
from vibroimpact_solvers.periodic_motions.stops.phases import Phases, Side, Stop
from vibroimpact_solvers.periodic_motions.stops.prescribed import Cells
from vibroimpact_solvers.periodic_motions.stops.scenes import Scenes
from vibroimpact_solvers.periodic_motions.stops.solutions import Solutions

_NODES: Final = 12
_PLACES: Final = 0.5 * (np.polynomial.legendre.leggauss(_NODES)[0] + 1.0)
_WEIGHTS: Final = 0.5 * np.polynomial.legendre.leggauss(_NODES)[1]
_TURN: Final = 2.0  # radians of what turns fastest in a panel
_SILENT: Final = 1e-15  # of a form, what needs no nodes
_NUMBERS: Final = 2**16  # nodes times pairs, at most
_LEAST: Final = 500  # nodes that are always allowed
_LONG: Final = 300.0  # exponents whose exponentials are numbers
_PEAKS: Final = 8  # nodes between their neighbours at which a form may be largest
_NEWTON: Final = 6
_ROUNDED: Final = 8.0


@dataclass(frozen=True, eq=False, slots=True)
class Nodes:
    """A quadrature over a part of a motion.

    Parameters
    ----------
    times, weights : array, shape (time,)
    left : array of int
        Pairs that are too fast for the nodes.
    """

    times: Floats
    weights: Floats
    left: Integers


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
        moved = prescribed.apply(flow, np.broadcast_to(self.state, (times.size, self.state.size)))
        return np.asarray(
            moved + (np.exp(1j * times[:, np.newaxis] * self.rates) @ self.steady).real
        )

    def both(self, times: Floats) -> tuple[Floats, Floats]:
        """Return whole states and their rates, (time, 2 pair)."""
        flow = self.side.propagators(times)
        moved = prescribed.apply(flow, np.broadcast_to(self.state, (times.size, self.state.size)))
        rates = prescribed.drift(self.side, np.arange(self.state.size), moved, form=False)
        turned = np.exp(1j * times[:, np.newaxis] * self.rates)
        return (
            np.asarray(moved + (turned @ self.steady).real),
            np.asarray(rates + ((turned * (1j * self.rates)) @ self.steady).real),
        )

    def nodes(self, form: Floats) -> Nodes:
        """Return times and weights of a quadrature that is exact for forms (form, 2 pair).

        So it is but for what is fast and of little weight, if all is too much.
        """
        n, growth, rate = self.side.size, self.side.growth, self.side.rate
        sizes = self._lengths(form) * np.hypot(self.state[:n], self.state[n:])
        grown = sizes * np.exp(np.clip(growth * self.length, 0.0, _LONG))
        steady = np.abs(self.steady).sum(axis=0)
        whole = grown.sum(axis=1) + self._lengths(form) @ np.hypot(steady[:n], steady[n:])
        share = (grown / np.maximum(whole, 1e-300)[:, np.newaxis]).max(axis=0)
        # Pairs by descending rate; what of them, and for how long, is more than rounding.
        order = np.argsort(-rate, kind="stable")
        seen = np.log(np.maximum(share[order], 1e-300) * n / _SILENT)
        own, fades = growth[order], np.where(growth[order] < 0.0, -growth[order], 0.0)
        lasts = np.where(fades > 0.0, seen / np.maximum(fades, 1e-300), np.inf)
        lasts = np.clip(np.where((seen <= 0.0) & (own <= 0.0), 0.0, lasts), 0.0, self.length)
        most = max(_LEAST, _NUMBERS // max(n, 1))
        low, high = 0, n
        while low < high:
            first = (low + high) // 2
            if self._panels(rate[order[first:]], lasts[first:])[1].sum() * _NODES <= most:
                high = first
            else:
                low = first + 1
        left = np.zeros(n, dtype=bool)
        left[order[:low]] = lasts[:low] > 0.0
        ends, counts = self._panels(rate[order[low:]], lasts[low:])
        starts = np.concatenate([[0.0], ends[:-1]])
        inner = [
            begin + (end - begin) * np.arange(count) / count
            for begin, end, count in zip(starts, ends, counts.tolist(), strict=True)
        ]
        edges = np.concatenate([*inner, [self.length]])
        widths = np.diff(edges)[:, np.newaxis]
        times, weights = edges[:-1, np.newaxis] + widths * _PLACES, widths * _WEIGHTS
        # Both ends are nodes of no weight: peaks are often there.
        times = np.concatenate([edges[:1], times.ravel(), edges[-1:]])
        return Nodes(times, np.concatenate([[0.0], weights.ravel(), [0.0]]), np.flatnonzero(left))

    def _panels(self, rates: Floats, lasts: Floats) -> tuple[Floats, Integers]:
        """Return ends of stretches and their numbers of panels, for pairs by descending rate."""
        load = float(self.rates.max(initial=0.0))
        until = np.append(np.maximum.accumulate(lasts) if lasts.size else lasts, self.length)
        width = np.diff(until, prepend=0.0)
        fastest = np.maximum(np.append(rates, 0.0), load)
        some = width > 1e-12 * self.length
        some[-1] |= not some.any()
        ends = until[some]
        ends[-1] = self.length
        counts = np.ceil(np.diff(ends, prepend=0.0) * fastest[some] / _TURN)
        return ends, np.maximum(np.minimum(counts, 1e9), 1.0).astype(np.int64)

    def _lengths(self, form: Floats) -> Floats:
        n = self.side.size
        return np.asarray(np.hypot(form[:, :n], form[:, n:]))

    def ripple(self, form: Floats, nodes: Nodes) -> Floats:
        """Return the sizes of what the nodes leave out of forms, (time, form)."""
        left, n = nodes.left, self.side.size
        sizes = np.hypot(self.state[left], self.state[left + n])
        decay = np.exp(np.clip(nodes.times[:, np.newaxis] * self.side.growth[left], -_LONG, _LONG))
        return np.asarray((decay * sizes) @ self._lengths(form)[:, left].T)

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
    total.squares += nodes.weights @ x**2
    error = part.error_of(form) + _ROUNDED * EPS * np.abs(still)
    for sign, name in ((1.0, "highest"), (-1.0, "lowest")):
        best = sign * peaks(part, sign * form, sign * still, nodes.times, sign * x)
        old = getattr(total, name)
        setattr(total, name, np.maximum(old, best) if sign > 0 else np.minimum(old, best))
        if nodes.left.size:
            error = np.maximum(error, (sign * (x - best) + 2.0 * ripple).max(axis=0))
    total.x_error = np.maximum(total.x_error, error)
    total.rms_error += nodes.weights @ (ripple * (2.0 * np.abs(x) + ripple))


def peaks(part: Part, form: Floats, level: Floats, times: Floats, seen: Floats) -> Floats:
    """Return the largest values of forms near times at which they are seen, (form,)."""
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
    more = (rates * (rates * (part.steady @ form.T) - part.steady @ slope.T)).T

    def step(at: Floats) -> tuple[Floats, Floats, Floats]:
        """Return values, slopes, and Newton's steps of forms at times (…, form) of their own."""
        state, moved = (z.reshape(*at.shape, -1) for z in part.both(at.ravel()))
        value = (state * form).sum(axis=-1) + level
        rate = (moved * form).sum(axis=-1)
        turned = np.exp(1j * at[..., np.newaxis] * part.rates)
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
    forces = phases.forces @ free.shapes  # modal, of the open structure
    pushed, scale, n = forces * part.turned[:, np.newaxis], phases.scale, free.roots.size
    modal = side.basis.velocity(np.eye(n)).reshape(n, -1)
    rate_error = part.error_of(modal)
    nodes = part.nodes(modal)
    weights, flow = nodes.weights / scale, np.exp(1j * nodes.times[:, np.newaxis] * part.rates)
    _, rate = side.coordinates_of(part.states(nodes.times))
    v = scale * (rate @ side.vectors.T)
    load = (flow @ pushed).real
    total.work += float(weights @ (load * v).sum(axis=1))
    total.flow += float(weights @ (np.abs(load) * np.abs(v)).sum(axis=1))
    off = scale * (rate_error + part.ripple(modal, nodes)) @ np.abs(side.vectors).T
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
    errors = part.error_of(both) + _ROUNDED * EPS * np.array([side.force_size, np.abs(level)[0]])
    steady_error = float(errors[0])
    nodes = part.nodes(np.concatenate([both, speed[np.newaxis]]))
    z, weights = part.states(nodes.times), nodes.weights / scale
    seen, ripple = z @ both.T + levels, part.ripple(both, nodes)
    best = peaks(part, both, levels, nodes.times, seen)
    if nodes.left.size:
        errors = np.maximum(errors, (seen - best + 2.0 * ripple).max(axis=0))
    total.peak_force, total.indentation = (float(value) for value in best)
    total.impulse = float(weights @ seen[:, 0])
    v, own = scale * (z @ speed), part.ripple(speed[np.newaxis], nodes)[:, 0]
    total.rubbed = float(weights @ v**2)
    off = scale * (rate_error + own)
    total.rubbed_error = float(weights @ ((2.0 * np.abs(v) + off) * off))
    total.force_error, total.indentation_error = (float(e) for e in errors)
    total.impulse_error = steady_error * part.length / scale + float(weights @ ripple[:, 0])
