"""Displacements of solutions at parts of their period."""

from __future__ import annotations

from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.outputs import Outputs
from vibroimpact_solvers.periodic_motions.problem import Problem
from vibroimpact_solvers.periodic_motions.solutions import Cells, Solutions

_PIECE: Final = 2**20
"""Numbers of states that are there at once."""


def waveforms(
    problem: Problem, driven: Driven, outputs: Outputs, cells: Cells, solved: Solutions
) -> Floats:
    """Return displacements at parts of the period from phase 0, (solution, tau, dof)."""
    assert problem.tau is not None
    tau, mirrored = problem.tau, problem.symmetric and solved.phase.shape[1] > 0
    x = np.empty((solved.index.size, tau.size, len(outputs.x)))
    step = max(1, _PIECE // (tau.size * 2 * driven.pairs.alpha.size))
    parts = max(1, _PIECE // (2 * driven.pairs.alpha.size))
    for first in range(0, solved.index.size, step):
        rows = slice(first, min(first + step, solved.index.size))
        some = solved.at(np.arange(rows.start, rows.stop))
        for begin in range(0, tau.size, parts):
            look()
            here = slice(begin, begin + parts)
            x[rows, here] = _some(driven, outputs, cells, some, tau[here], mirrored)
    return x


def _some(
    driven: Driven, outputs: Outputs, cells: Cells, solved: Solutions, tau: Floats, mirrored: bool
) -> Floats:
    """Return displacements of few solutions at few times, shape (solution, tau, dof)."""
    lengths = solved.length
    whole = lengths.sum(axis=1)[:, np.newaxis] * (2.0 if mirrored else 1.0)
    Omega = cells.Omega[solved.index, np.newaxis]
    starts = solved.phase if solved.phase.size else np.zeros(lengths.shape)
    since = np.mod(tau * whole - starts[:, :1] / Omega, whole)
    late = since >= 0.5 * whole if mirrored else np.zeros(since.shape, dtype=bool)
    since = np.where(late, since - 0.5 * whole, since)
    begins = np.cumsum(lengths, axis=1) - lengths
    leg = (begins[:, np.newaxis] <= since[..., np.newaxis]).sum(axis=2) - 1
    leg = np.maximum(leg, 0)
    row = np.arange(lengths.shape[0])[:, np.newaxis]
    times = since - begins[row, leg]
    x = displacements(driven, outputs, cells, solved, leg, times)
    return np.asarray(np.where(late, -1.0, 1.0)[..., np.newaxis] * x + outputs.still)


def displacements(
    driven: Driven, outputs: Outputs, cells: Cells, solved: Solutions, leg: Integers, times: Floats
) -> Floats:
    """Return displacements of few solutions, from those under the constant load.

    Parameters
    ----------
    leg : array of int, shape (solution, time)
        Free motions.
    times : array, shape (solution, time)
        From their beginnings.

    Returns
    -------
    array, shape (solution, time, dof)
    """
    starts = solved.phase if solved.phase.size else np.zeros(solved.length.shape)
    row = np.arange(solved.index.size)[:, np.newaxis]
    phases = starts[row, leg] + cells.Omega[solved.index, np.newaxis] * times
    propagators = driven.pairs.propagators(np.ascontiguousarray(times.ravel()))
    propagators = propagators.reshape(*times.shape, *propagators.shape[1:])
    z = driven.pairs.move(propagators, solved.state[row, leg])
    z += cells.at(solved.index).load_state(driven, phases)
    driven.balance.carry(z, times)
    driven.balance.creep(z)
    return np.tensordot(z, outputs.x, ((2, 3), (1, 2)))
