"""Histories: displacements, velocities, accelerations and energies at the output times."""

from __future__ import annotations

from typing import Any

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.time_history.problem import MOVED, STATES, Problem
from vibroimpact_solvers.time_history.soft_laws import SoftLaws
from vibroimpact_solvers.time_history.structure import Structure

History = tuple[Floats, Floats, Floats, Floats, Floats]
"""Displacements, velocities and accelerations (motion, time, dof), energies and lengths of the
errors of the states (motion, time), as `kernels.rigid_motion.follow` fills them in; empty where not
requested."""


def new_history(problem: Problem, motions: int) -> History:
    """Return the arrays of the history of some motions."""
    times, outputs = problem.times.size, problem.outputs
    whole = motions, times, problem.output_dofs.size
    x, v, a = (np.empty(whole if name in outputs else (motions, 0, 0)) for name in MOVED)
    stated = problem.estimate and outputs & STATES
    energy, error = (
        np.empty((motions, times if wanted else 0)) for wanted in ("energy" in outputs, stated)
    )
    return x, v, a, energy, error


def some_of(history: History, motions: slice | Integers) -> History:
    """Return the history of some of the motions."""
    x, v, a, energy, error = history
    return x[motions], v[motions], a[motions], energy[motions], error[motions]


def requested(problem: Problem, history: History) -> dict[str, Any]:
    """Return the fields of the result, of all motions, with the drift of their energies."""
    *moved, energy, _ = history
    outputs = problem.outputs
    values = {name: part for name, part in zip(MOVED, moved, strict=True) if name in outputs}
    if "energy" in outputs:
        values["energy"] = energy
        if conserves(problem):
            values["error_energy_drift"] = relative_drift(energy)
    return values


def requested_of_one(
    problem: Problem, structure: Structure, laws: SoftLaws | None, x: Floats, v: Floats
) -> dict[str, Any]:
    """Return the fields of the result from x and v, of all dofs where energy is an output."""
    outputs, system = problem.outputs, problem.system
    dofs, energy = problem.output_dofs, np.empty(0)
    if "energy" in outputs:
        energy = 0.5 * (v * (system.M @ v.T).T).sum(axis=1)
        energy += (x * (0.5 * (system.K @ x.T).T - structure.force)).sum(axis=1)
        if laws is not None:
            energy += laws.potential(x @ structure.W.T)
    if x.shape[1] == system.n:
        x, v = x[:, dofs], v[:, dofs]
    none = np.empty((1, 0))
    history = x[np.newaxis], v[np.newaxis], none, energy[np.newaxis], none
    values = requested(problem, history)
    return {name: value[0] for name, value in values.items()}


def relative_drift(energies: Floats) -> Floats:
    """Return the largest change of each motion's energy, relative to its largest."""
    size = np.abs(energies).max(axis=1, initial=0.0)
    change = np.abs(energies - energies[:, :1]).max(axis=1, initial=0.0)
    return np.asarray(change / np.where(size > 0.0, size, 1.0))


def conserves(problem: Problem) -> bool:
    """Whether the motion conserves its energy."""
    system = problem.system
    lossless = system.C is None and not problem.acting
    if problem.limiter is None:
        lossless &= not any(c.law.lossy for c in system.constraints)
    return lossless
