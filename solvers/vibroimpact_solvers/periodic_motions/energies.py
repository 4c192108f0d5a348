"""Energies of solutions: work of the load, losses by damping and impacts, energy at an impact."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.periodic_motions.along import Along
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.outputs import Outputs
from vibroimpact_solvers.periodic_motions.path_errors import along_paths, steady_errors
from vibroimpact_solvers.periodic_motions.problem import Problem
from vibroimpact_solvers.periodic_motions.solutions import Cells, Solutions


class Energies(NamedTuple):
    """Work of the load and energy lost in a period, energy at its beginning, and their errors.

    Each has shape (solution,).
    """

    work: Floats
    lost: Floats
    energy: Floats
    work_error: Floats
    lost_error: Floats
    energy_error: Floats


class _Motion(NamedTuple):
    """Solutions, and what is known along them."""

    problem: Problem
    driven: Driven
    outputs: Outputs
    cells: Cells
    solved: Solutions
    along: Along
    rates_error: Floats  # of modal velocities anywhere along them, (solution, mode)


def energies(
    problem: Problem,
    driven: Driven,
    outputs: Outputs,
    cells: Cells,
    solved: Solutions,
    along: Along,
) -> Energies:
    """Return the work of the load, and the energy lost by damping and impacts.

    The work is computed in two ways, of which the one with fewer roundings counts. Whatever
    it is in truth, it is what is lost, so that each tells how far the other may be off.
    """
    rates_error = along_paths(driven, cells, solved, outputs.rates)
    motion = _Motion(problem, driven, outputs, cells, solved, along, rates_error)
    both = 2.0 if problem.symmetric and solved.phase.shape[1] else 1.0
    lost, lost_error = _losses(motion)
    work, work_error = _work_of_parts(motion)
    rounding = _rounding(motion)
    better = rounding < work_error
    work, work_error = np.where(better, along.work, work), np.where(better, np.inf, work_error)
    apart = np.abs(work - lost)
    energy, energy_error = _energy(motion)
    return Energies(
        both * work, both * lost, energy, both * np.minimum(work_error, apart + lost_error),
        both * np.minimum(lost_error, apart + work_error), energy_error,
    )  # fmt: skip


def _energy(motion: _Motion) -> tuple[Floats, Floats]:
    """Return the energies just after the first impact, from the equilibrium, and their errors."""
    out, driven, cells, solved = motion.outputs, motion.driven, motion.cells, motion.solved
    starts = solved.phase[:, :1] if solved.phase.size else np.zeros((solved.index.size, 1))
    start = solved.state[:, 0] + cells.at(solved.index).load_state(driven, starts)[:, 0]
    driven.balance.creep(start)
    q = np.tensordot(start, out.coordinates, ((1, 2), (1, 2)))
    v = driven.scale * np.tensordot(start, out.rates, ((1, 2), (1, 2)))
    stored, moving = 0.5 * q**2 @ out.stiffness, 0.5 * (v**2).sum(axis=1)
    q_error = along_paths(driven, cells, solved, out.coordinates)
    error = (np.abs(q * out.stiffness) * q_error).sum(axis=1)
    error += driven.scale * (np.abs(v) * motion.rates_error).sum(axis=1)
    error += 0.5 * q**2 @ out.stiffness_error
    sizes = 0.5 * q**2 @ np.abs(out.stiffness) + moving
    return stored + moving, error + 16.0 * EPS * sizes


def _rounding(motion: _Motion) -> Floats:
    """Return the rounding of the work of the load as the integral of its power."""
    solved, along = motion.solved, motion.along
    highest = float(motion.driven.harmonics.max(initial=0.0))
    phase = np.abs(solved.phase).max(axis=1, initial=0.0)
    phase = phase + motion.cells.Omega[solved.index] * solved.length.max(axis=1)
    # Roundings of the phases at all nodes, of random sign.
    rounded = highest * phase / np.sqrt(along.nodes)
    return np.asarray((16.0 + rounded) * EPS * along.flow)


def _work_of_parts(motion: _Motion) -> tuple[Floats, Floats]:
    """Return the work of the load in a cell, and its error to first order.

    Much of the power of the load may flow back within the period, and its integral then
    loses digits. The response to the load alone takes as much as damping dissipates in it.
    The impulses' responses x_p take, M, C and K being symmetric, with the steady response y
    to the load where damping has the other sign,

        integral F . x_p' = -integral F' . x_p = -sum_j p_j w_j . y'(t_j).
    """
    out, driven, solved, cells = motion.outputs, motion.driven, motion.solved, motion.cells
    scale, index = driven.scale, solved.index
    work, error = np.zeros((2, index.size))
    if out.damping is not None:
        v = np.tensordot(cells.steady, out.rates, ((2, 3), (1, 2)))
        v_error = steady_errors(driven, cells, out.rates)
        damping, size = np.abs(out.damping), np.abs(v)
        length = scale * solved.length.sum(axis=1)
        work += 0.5 * length * (v.conj() * (v @ out.damping)).real.sum(axis=(1, 2))[index]
        each = size * (v_error @ damping) + 0.5 * v_error * (v_error @ damping)
        each += 0.5 * (size + v_error) * ((size + v_error) @ out.damping_error)
        error += length * each.sum(axis=(1, 2))[index]
    if solved.phase.size == 0 or driven.harmonics.size == 0:
        return work, error
    struck = [impact.constraint for impact in motion.problem.impacts]
    rates = cells.Omega[:, np.newaxis] * driven.harmonics
    form, shape = driven.position[struck], 2.0 * driven.shape_error + 4.0 * EPS
    back, inexact = driven.pairs.steady_response(rates, driven.load.conj())
    back *= cells.amplification[:, :, np.newaxis, np.newaxis]
    y = np.einsum("fhsj,isj->fih", back, form).conj()
    moduli = np.abs(back) * (inexact + shape)[:, :, np.newaxis]
    y_error = np.einsum("fhsj,isj->fih", moduli, np.abs(form))[index]
    turned = np.exp(1j * solved.phase[..., np.newaxis] * driven.harmonics)
    rates = rates[index, np.newaxis]
    along = (rates * (1j * y[index] * turned).real).sum(axis=-1)
    work -= scale**2 * (solved.impulse * along).sum(axis=1)
    size, swing = np.abs(solved.impulse), rates * np.abs(y[index])
    moved = (rates * y_error).sum(axis=-1) + (swing @ driven.harmonics) * solved.phase_error
    each = solved.impulse_error * np.abs(along) + size * moved + 4.0 * EPS * size * swing.sum(-1)
    return work, error + scale**2 * each.sum(axis=1)


def _losses(motion: _Motion) -> tuple[Floats, Floats]:
    """Return the energy lost in a cell, and its error to first order."""
    out, driven, solved, cells = motion.outputs, motion.driven, motion.solved, motion.cells
    scale, along, doubt = driven.scale, motion.along, motion.rates_error
    lost, error = np.zeros((2, solved.index.size))
    if out.damping is not None:
        lost += scale * along.dissipated
        moved = doubt @ np.abs(out.damping)
        length = solved.length.sum(axis=1)
        error += scale * (2.0 * along.speeds * moved).sum(axis=1)
        error += scale * length * (doubt * moved).sum(axis=1)
        sizes = np.abs(cells.steady).sum(axis=1)[solved.index] + np.abs(solved.state).max(axis=1)
        largest = np.tensordot(sizes, np.abs(out.rates), ((1, 2), (1, 2)))
        error += scale * ((largest @ out.damping_error) * along.speeds).sum(axis=1)
    impacts = motion.problem.impacts if solved.phase.size else ()
    for place, impact in enumerate(impacts):
        k = motion.problem.system.constraints[impact.constraint].restitution
        mu = driven.mobility[impact.constraint, impact.constraint]
        factor, v = (1.0 - k * k) / mu * scale**2, solved.velocity[:, place]
        lost += 0.5 * factor * v**2
        error += factor * np.abs(v) * solved.velocity_error[:, place]
    return lost, error + 16.0 * EPS * lost
