"""A solution along its period: extremes, mean squares, energies and the waveform.

Each free motion is divided into panels with the nodes of Gauss' quadrature, so short that the
fastest vibration turns by a radian or two in each: integrals over the period are then exact to
rounding. What has decayed since the impact counts no longer. However many panels there are, a few
of them are in memory at a time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.problem import Problem
from vibroimpact_solvers.periodic_motions.solutions import Cells, Solutions
from vibroimpact_solvers.time_history import modal_damping

_NODES: Final = 12  # in a panel
_PLACES: Final = 0.5 * (np.polynomial.legendre.leggauss(_NODES)[0] + 1.0)
_WEIGHTS: Final = 0.5 * np.polynomial.legendre.leggauss(_NODES)[1]
_PAIRS: Final = ((1, 2), (1, 2))
_TURN = 1.5  # radians in a panel
_LEAST = 4  # panels of a free motion
_PIECE = 256  # panels that are there at once
_DECAYED = 45.0  # exponent after which nothing is left of a vibration
_REFINEMENTS = 4  # steps of Newton's method for an extreme


@dataclass(frozen=True, eq=False, slots=True)
class Outputs:
    """Forms of what is evaluated along the period.

    Parameters
    ----------
    x, v, a : array, shape (dof, 2, pair)
        Displacements, velocities, and accelerations apart from the load, of the requested degrees
        of freedom.
    still : array, shape (dof,)
        Displacements under the constant load.
    coordinates, rates : array, shape (mode, 2, pair)
        Coordinates of the modes from the equilibrium, and their velocities.
    stiffness, stiffness_error : array, shape (mode,)
        Eigenvalues, and their errors.
    damping, damping_error : array, shape (mode, mode), optional
        And what rounding took from it.
    power : array, shape (harmonic, 2, pair), complex
        Velocities along the amplitudes of the load.
    """

    x: Floats
    v: Floats
    a: Floats
    still: Floats
    coordinates: Floats
    rates: Floats
    stiffness: Floats
    stiffness_error: Floats
    damping: Floats | None
    damping_error: Floats
    power: Complexes

    @classmethod
    def of(cls, problem: Problem, driven: Driven) -> Outputs:
        """Return the forms for the requested outputs."""
        basis, modes = driven.basis, driven.basis.modes
        shapes = modes.shapes[problem.output_dofs]
        level = (modes.base + modes.shapes @ basis.still)[problem.output_dofs]
        power = basis.velocity(driven.forces.real @ modes.shapes) + 1j * basis.velocity(
            driven.forces.imag @ modes.shapes
        )
        each = np.eye(modes.roots.size)
        x, v = basis.displacement(shapes), basis.velocity(shapes)
        roots = modes.roots * (1.0 + modes.rests)
        error, system = np.zeros((0, 0)), problem.system
        if system.C is not None and "energy" in problem.outputs:
            exact = driven.structure.natural.proved
            damped = modal_damping.of_modes(system, modes.shapes, modes.roots, exact=exact)
            error = damped.left_out + np.diag(damped.errors)
        return cls(
            x, v, basis.rates_of(v), level, basis.displacement(each), basis.velocity(each),
            roots * np.abs(roots), modes.errors, modes.damping, error, power,
        )  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class Extremes:
    """Largest, smallest and root-mean-square displacements, and their error, each (dof,)."""

    largest: Floats
    smallest: Floats
    rms: Floats
    error: Floats


class Energies(NamedTuple):
    """Work of the load and energy lost in a period, energy at its beginning, and their errors."""

    work: float
    lost: float
    energy: float
    work_error: float
    lost_error: float
    energy_error: float


class Piece(NamedTuple):
    """Some panels of a free motion."""

    leg: int
    times: Floats  # of the nodes, since the impact, (node,)
    weights: Floats  # (node,)
    ends: tuple[float, float]  # the nodes before and after, or ends of the free motion
    states: Floats  # (node, 2, pair)
    turned: Complexes  # factors of the load's amplitudes, (node, harmonic)


@dataclass(eq=False, slots=True)
class _Sums:
    """What is found along a cell."""

    squares: Floats  # integral of the squares of the displacements, (dof,)
    peaks: Floats  # highest and minus lowest displacements from the equilibrium, (2, dof)
    work: float  # of the load
    flow: float  # integral of the modulus of its power
    dissipated: float  # by damping
    rates: Floats  # integral of the moduli of modal velocities, (mode,)
    nodes: int


class Orbit:
    """One solution along its period, in the basis' units.

    Parameters
    ----------
    problem : Problem
    driven : Driven
    outputs : Outputs
    cells : Cells
    solved : Solutions
    row : int
        Its place among the solutions.
    """

    def __init__(
        self,
        problem: Problem,
        driven: Driven,
        outputs: Outputs,
        cells: Cells,
        solved: Solutions,
        row: int,
    ) -> None:
        self.problem, self.driven, self.outputs = problem, driven, outputs
        index = int(solved.index[row])
        self.Omega, self.steady = float(cells.Omega[index]), cells.steady[index]
        self.steady_error = cells.steady_error[index]
        self.starts = solved.phase[row] if solved.phase.shape[1] else np.zeros(1)
        self.lengths, self.states = solved.length[row], solved.state[row]
        self.state_error = solved.whole_error[row]
        self.absolute = cells.steady_floor[index], solved.state_floor[row]
        self.phase_errors, self.impulse_errors = solved.phase_error[row], solved.impulse_error[row]
        self.impulses, self.velocities = solved.impulse[row], solved.velocity[row]
        self.velocity_errors = solved.velocity_error[row]
        self.mirrored = problem.symmetric and solved.phase.shape[1] > 0

    def _pieces(self) -> Iterator[Piece]:
        """Yield all panels, a few at a time."""
        for leg, length in enumerate(self.lengths.tolist()):
            before = 0.0
            for begin, width, panels in self._panels(length):
                for first in range(0, panels, _PIECE):
                    count = np.arange(first, min(first + _PIECE, panels))
                    times = (begin + (count[:, np.newaxis] + _PLACES) * width).ravel()
                    after = min(begin + (count[-1] + 1 + _PLACES[0]) * width, length)
                    weights = np.tile(width * _WEIGHTS, count.size)
                    states, turned = self.state(leg, times), self._turned(leg, times)
                    yield Piece(leg, times, weights, (before, after), states, turned)
                    before = float(times[-1])

    def _panels(self, length: float) -> list[tuple[float, float, int]]:
        """Return beginning, width and number of panels of a width each, of a free motion."""
        if length <= 0.0:  # between impacts that coincide
            return []
        load = self.Omega * float(self.driven.harmonics.max(initial=0.0))
        decays, speeds = self.driven.pairs.rates
        lasts = np.minimum(_DECAYED / np.maximum(decays, _DECAYED / length), length)
        begin, panels = 0.0, []
        for end in np.unique(np.append(lasts, length)).tolist():
            fastest = max(float(speeds[lasts > begin].max(initial=0.0)), load)
            count = math.ceil(max(fastest * (end - begin) / _TURN, _LEAST * (end - begin) / length))
            panels.append((begin, (end - begin) / count, count))
            begin = end
        return panels

    def state(self, leg: int, times: Floats) -> Floats:
        """Return states at times since an impact, shape (time, 2, pair)."""
        look()
        moved = self.driven.pairs.move(
            self.driven.pairs.propagators(np.ascontiguousarray(times)), self.states[leg]
        )
        turned = self._turned(leg, times)
        z = np.asarray(moved + np.einsum("th,hsj->tsj", turned, self.steady).real)
        self.driven.balance.carry(z, times)
        self.driven.balance.creep(z)
        return z

    def _load(self, turned: Complexes) -> Floats:
        """Return changes of state per unit of time by the loads, shape (time, 2, pair)."""
        driven = self.driven
        return np.asarray(np.tensordot(turned, driven.load, 1).real + driven.balance.kick)

    def _turned(self, leg: int, times: Floats) -> Complexes:
        """Return the factors of the load's amplitudes, shape (time, harmonic)."""
        return self._turned_at(self.starts[leg] + self.Omega * times)

    def _turned_at(self, phases: Floats) -> Complexes:
        """Return the factors of the load's amplitudes at phases, shape (phase, harmonic)."""
        return np.asarray(np.exp(1j * phases[:, np.newaxis] * self.driven.harmonics))

    @cached_property
    def _sums(self) -> _Sums:
        """All sums and peaks along the cell that the outputs need."""
        out, outputs = self.outputs, self.problem.outputs
        dofs, modes = out.still.size, out.stiffness.size
        peaks = np.full((2, dofs), -np.inf)
        squares, work, flow, dissipated, rates = [], [], [], [], []
        nodes = 0
        for piece in self._pieces():
            nodes += piece.times.size
            if "extremes" in outputs:
                path = np.tensordot(piece.states, out.x, _PAIRS)
                squares.append(piece.weights @ (path + out.still) ** 2)
                for best, sign in zip(peaks, (1.0, -1.0), strict=True):
                    self._raise_peaks(best, piece, path, sign)
            if "energy" in outputs:
                along = np.tensordot(piece.states, out.power, _PAIRS)
                power = (piece.turned * along).real.sum(axis=1)
                work.append(piece.weights @ power)
                flow.append(piece.weights @ np.abs(power))
            if "energy" in outputs and out.damping is not None:
                v = np.tensordot(piece.states, out.rates, _PAIRS)
                dissipated.append(piece.weights @ ((v @ out.damping) * v).sum(axis=1))
                rates.append(piece.weights @ np.abs(v))
        return _Sums(
            _total(squares, dofs), peaks, math.fsum(work), math.fsum(flow), math.fsum(dissipated),
            _total(rates, modes), nodes,
        )  # fmt: skip

    def extremes(self) -> Extremes:
        """Return extremes and mean squares of the displacements."""
        still, sums = self.outputs.still, self._sums
        rms = np.sqrt(sums.squares / self.lengths.sum())
        largest, smallest = sums.peaks[0], -sums.peaks[1]
        if self.mirrored:
            largest = np.maximum(largest, -smallest)
            smallest = -largest
        return Extremes(largest + still, smallest + still, rms, self.error())

    def _raise_peaks(self, best: Floats, piece: Piece, path: Floats, sign: float) -> None:
        """Raise the largest of each displacement times sign, (dof,), by those in a piece."""
        out = self.outputs
        ends = np.tensordot(self.state(piece.leg, np.array(piece.ends)), out.x, _PAIRS)
        np.maximum(best, np.maximum((sign * ends).max(axis=0), (sign * path).max(axis=0)), out=best)
        top, dof = self._tops(best, piece, path, sign)
        x, v, a = out.x[dof], out.v[dof], out.a[dof]
        low = np.append(piece.ends[0], piece.times)[top]
        high = np.append(piece.times, piece.ends[1])[top + 1]
        near = piece.times[top]
        for _ in range(_REFINEMENTS):
            z = self.state(piece.leg, near)
            load = self._load(self._turned(piece.leg, near))
            slope = np.einsum("tsj,tsj->t", z, v)
            bend = np.einsum("tsj,tsj->t", z, a) + np.einsum("tsj,tsj->t", load, v)
            with np.errstate(divide="ignore", invalid="ignore"):
                step = np.where(sign * bend < 0.0, -slope / bend, 0.0)
            near = np.clip(near + step, low, high)
        peaks = sign * np.einsum("tsj,tsj->t", self.state(piece.leg, near), x)
        np.maximum.at(best, dof, peaks)

    def _tops(
        self, best: Floats, piece: Piece, path: Floats, sign: float
    ) -> tuple[Integers, Integers]:
        """Return nodes, and displacements whose highest peak may be beside them, each (top,).

        A displacement rises from a node to the next one by less than twice what its parabola
        does, as nodes are a fraction of a radian of the fastest vibration apart.
        """
        out, states = self.outputs, piece.states
        load = self._load(piece.turned)
        slope = sign * np.tensordot(states, out.v, _PAIRS)
        bend = sign * (np.tensordot(states, out.a, _PAIRS) + np.tensordot(load, out.v, _PAIRS))
        ends = np.concatenate([piece.ends[:1], piece.times, piece.ends[1:]])
        before, after = np.diff(ends)[:-1, np.newaxis], np.diff(ends)[1:, np.newaxis]
        with np.errstate(divide="ignore", invalid="ignore"):
            d = np.clip(np.where(bend < 0.0, -slope / bend, 0.0), -before, after)
        highest = sign * path + 2.0 * (slope + 0.5 * bend * d) * d
        top, dof = np.nonzero(highest >= best)
        return top, dof

    def error(self) -> Floats:
        """Return the error of the displacements, shape (dof,)."""
        return self._error_of(self.outputs.x) + 4.0 * EPS * np.abs(self.outputs.still)

    def _error_of(self, forms: Floats) -> Floats:
        """Return the errors of forms anywhere along the motion, shape (form,)."""
        out, shape, pairs = np.abs(forms), 2.0 * self.driven.shape_error, self.driven.pairs
        length, harmonics = float(self.lengths.max()), self.driven.harmonics
        # Until a vibration has decayed its phase is off by that of its rate and of the time.
        reach = np.minimum(length, 1.0 / np.maximum(-pairs.growth, 1.0 / length))
        late = (2.0 * pairs.drift + EPS * pairs.speed) * reach
        inexact = self.state_error + shape + 4.0 * EPS + late
        error = np.einsum("dsj,fsj,j->fd", out, self.driven.pairs.size(self.states), inexact).max(
            axis=0
        )
        steady = np.abs(self.steady)
        error += np.einsum("dsj,hsj,hj->d", out, steady, self.steady_error + shape + 4.0 * EPS)
        if driven_by := self.driven.mixing:
            doubts, (floor, own) = driven_by.of_forms(forms), self.absolute
            states = np.abs(self.states).sum(axis=1).max(axis=0) if own.size else 0.0
            error += doubts @ (steady.sum(axis=(0, 1)) + states)
            error += out.sum(axis=1) @ (floor.sum(axis=0) + (own if own.size else 0.0))
        moves = np.einsum("dsj,hsj,h->d", out, steady, harmonics)
        rounded = EPS * (float(np.abs(self.starts).max()) + self.Omega * length)
        return np.asarray(error + moves * (self.phase_errors.max(initial=0.0) + rounded))

    def _steady_error_of(self, forms: Floats) -> Floats:
        """Return the errors of forms of the steady response, shape (harmonic, form)."""
        driven, moduli, sizes = self.driven, np.abs(self.steady), np.abs(forms)
        inexact = self.steady_error + 2.0 * driven.shape_error + 4.0 * EPS
        error = np.einsum("hsj,msj,hj->hm", moduli, sizes, inexact)
        if driven.mixing:
            error += moduli.sum(axis=1) @ driven.mixing.of_forms(forms).T
            error += self.absolute[0] @ sizes.sum(axis=1).T
        return np.asarray(error)

    def energies(self) -> Energies:
        """Return the work of the load, and the energy lost by damping and impacts.

        The work is computed in two ways, of which the one with fewer roundings counts. Whatever
        it is in truth, it is what is lost, so that each tells how far the other may be off.
        """
        both = 2.0 if self.mirrored else 1.0
        lost, lost_error = self._losses()
        work, work_error = self._work_of_parts()
        along, rounding = self._work_along()
        if rounding < work_error:
            work, work_error = along, math.inf
        apart = abs(work - lost)
        errors = min(work_error, apart + lost_error), min(lost_error, apart + work_error)
        energy, energy_error = self._energy()
        return Energies(
            both * work, both * lost, energy, both * errors[0], both * errors[1], energy_error
        )

    def _energy(self) -> tuple[float, float]:
        """Return the energy just after the first impact, from the equilibrium, and its error."""
        out, scale = self.outputs, self.driven.scale
        start = self.state(0, np.zeros(1))[0]
        q = np.tensordot(out.coordinates, start, 2)
        v = scale * np.tensordot(out.rates, start, 2)
        stored = 0.5 * out.stiffness * q**2
        error = np.abs(out.stiffness * q) @ self._error_of(out.coordinates)
        error += scale * np.abs(v) @ self._error_of(out.rates)
        error += 0.5 * out.stiffness_error @ q**2
        sizes = float(np.abs(stored).sum() + 0.5 * (v @ v))
        return float(stored.sum() + 0.5 * (v @ v)), float(error) + 16.0 * EPS * sizes

    def _work_along(self) -> tuple[float, float]:
        """Return the work of the load in a cell by its power, and the rounding of this integral."""
        sums, highest = self._sums, float(self.driven.harmonics.max(initial=0.0))
        phase = float(np.abs(self.starts).max()) + self.Omega * float(self.lengths.max())
        # Roundings of the phases at all nodes, of random sign.
        rounded = highest * phase / math.sqrt(sums.nodes)
        return sums.work, (16.0 + rounded) * EPS * sums.flow

    def _work_of_parts(self) -> tuple[float, float]:
        """Return the work of the load in a cell, and its error to first order.

        Much of the power of the load may flow back within the period, and its integral then
        loses digits. The response to the load alone takes as much as damping dissipates in it.
        The impulses' responses x_p take, M, C and K being symmetric, with the steady response y
        to the load where damping has the other sign,

            integral F . x_p' = -integral F' . x_p = -sum_j p_j w_j . y'(t_j).
        """
        out, scale, driven = self.outputs, self.driven.scale, self.driven
        work = error = 0.0
        if out.damping is not None:
            v = np.einsum("hsj,msj->hm", self.steady, out.rates)
            v_error = self._steady_error_of(out.rates)
            length = scale * float(self.lengths.sum())
            work += 0.5 * length * float(np.einsum("hm,mk,hk->", v.conj(), out.damping, v).real)
            damping = np.abs(out.damping)
            error += length * float(np.einsum("hm,mk,hk->", np.abs(v), damping, v_error))
            both = np.abs(v) + v_error
            error += 0.5 * length * float(np.einsum("hm,mk,hk->", both, out.damping_error, both))
            error += 0.5 * length * float(np.einsum("hm,mk,hk->", v_error, damping, v_error))
        if self.impulses.size == 0 or driven.harmonics.size == 0:
            return work, error
        struck = [impact.constraint for impact in self.problem.impacts]
        rates = self.Omega * driven.harmonics
        form, shape = driven.position[struck], 2.0 * driven.shape_error + 4.0 * EPS
        back, inexact = driven.pairs.steady_response(rates[np.newaxis], driven.load.conj())
        y = np.einsum("hsj,isj->hi", back[0], form).conj()
        doubt = inexact[0] + shape
        y_error = np.einsum("hsj,isj,hj->hi", np.abs(back[0]), np.abs(form), doubt)
        turned = self._turned_at(self.starts).T
        along = rates @ (1j * y * turned).real
        work -= scale**2 * float(self.impulses @ along)
        sizes = np.abs(self.impulses), rates @ np.abs(y)
        moved = rates @ y_error + (rates * driven.harmonics) @ np.abs(y) * self.phase_errors
        error += scale**2 * float(self.impulse_errors @ np.abs(along) + sizes[0] @ moved)
        error += 4.0 * EPS * scale**2 * float(sizes[0] @ sizes[1])
        return work, error

    def _losses(self) -> tuple[float, float]:
        """Return the energy lost in a cell, and its error to first order."""
        out, scale = self.outputs, self.driven.scale
        lost = error = 0.0
        if out.damping is not None:
            lost += scale * self._sums.dissipated
            doubt, length = self._error_of(out.rates), float(self.lengths.sum())
            moved = np.abs(out.damping) @ doubt
            error += scale * float(2.0 * self._sums.rates @ moved + length * (doubt @ moved))
            largest = np.einsum("msj,sj->m", np.abs(out.rates), np.abs(self.steady).sum(axis=0))
            largest += np.einsum("msj,sj->m", np.abs(out.rates), np.abs(self.states).max(axis=0))
            error += scale * float(largest @ out.damping_error @ self._sums.rates)
        for impact, v, doubt in zip(
            self.problem.impacts, self.velocities, self.velocity_errors, strict=False
        ):
            k = self.problem.system.constraints[impact.constraint].restitution
            mu = self.driven.mobility[impact.constraint, impact.constraint]
            factor = (1.0 - k * k) / mu * scale**2
            lost += 0.5 * factor * float(v) ** 2
            error += factor * abs(float(v)) * float(doubt)
        return lost, error + 16.0 * EPS * lost

    def waveform(self, tau: Floats) -> Floats:
        """Return displacements at parts of the period from the drive's phase 0, (tau, dof)."""
        whole = float(self.lengths.sum()) * (2.0 if self.mirrored else 1.0)
        since = np.mod(tau * whole - self.starts[0] / self.Omega, whole)
        sign = np.ones(tau.size)
        if self.mirrored:
            late = since >= 0.5 * whole
            sign[late], since = -1.0, np.where(late, since - 0.5 * whole, since)
        begins = np.concatenate([[0.0], np.cumsum(self.lengths)[:-1]])
        leg = np.maximum(np.searchsorted(begins, since, side="right") - 1, 0)
        x = np.empty((tau.size, self.outputs.still.size))
        for number in range(self.lengths.size):
            here = leg == number
            z = self.state(number, since[here] - begins[number])
            x[here] = np.einsum("tsj,dsj->td", z, self.outputs.x)
        return np.asarray(sign[:, np.newaxis] * x + self.outputs.still)


def _total(parts: list[Floats], size: int) -> Floats:
    """Return the sums of the parts, (size,), rounded like sums of few."""
    return np.array([math.fsum(column) for column in zip(*parts, strict=True)] or np.zeros(size))
