"""Displacements, velocities and energies at the output times, filled in as the motion goes on."""

from __future__ import annotations

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.time_history.problem import Problem
from vibroimpact_solvers.time_history.structure import Configuration, Structure


class History:
    """Arrays of displacements, velocities and energies at the output times."""

    def __init__(self, problem: Problem, structure: Structure) -> None:
        self.problem, self.structure = problem, structure
        times, outputs = problem.times.size, problem.outputs
        shape = (times, problem.output_dofs.size)
        self.x = np.empty(shape) if "x" in outputs else None
        self.v = np.empty(shape) if "v" in outputs else None
        dofs = problem.output_dofs
        self._all = dofs.size == problem.system.n and bool((dofs == np.arange(dofs.size)).all())
        self.energy = np.empty(times) if "energy" in outputs else None

    def take(self, configuration: Configuration, samples: Floats, first: int) -> None:
        """Fill in the outputs at consecutive times from states, shape (time, 2, pair)."""
        basis, modes = configuration.basis, configuration.basis.modes
        scale, some = self.structure.scale, slice(first, first + samples.shape[0])
        q, rate = basis.coordinates(samples)
        q += basis.still
        rate *= scale
        dofs = self.problem.output_dofs
        shapes, base = modes.shapes, modes.base
        if self.energy is None and not self._all:
            shapes, base = shapes[dofs], base[dofs]
        if (self.x is not None and self.v is not None) or self.energy is not None:
            both = np.concatenate([q, rate]) @ shapes.T  # one pass over a large matrix
            self.fill(both[: q.shape[0]] + base, both[q.shape[0] :], some)
        elif self.x is not None:
            self.x[some] = q @ shapes.T + base
        elif self.v is not None:
            self.v[some] = rate @ shapes.T

    def fill(self, x: Floats, v: Floats, some: slice) -> None:
        """Fill in the outputs from x and v, of all degrees of freedom where energy is an output."""
        dofs = self.problem.output_dofs
        whole = x.shape[1] == self.problem.system.n
        if self.x is not None:
            self.x[some] = x[:, dofs] if whole else x
        if self.v is not None:
            self.v[some] = v[:, dofs] if whole else v
        if self.energy is not None:
            system, law = self.problem.system, self.problem.limiter
            force = self.structure.force
            energy = 0.5 * (v * (system.M @ v.T).T).sum(axis=1)
            energy += (x * (0.5 * (system.K @ x.T).T - force)).sum(axis=1)
            if law is not None:
                energy += law.potential(x @ self.structure.W.T, law.sizes(system))
            self.energy[some] = energy

    @property
    def drift(self) -> float | None:
        """The largest change of the energy relative to it, where it is conserved."""
        if self.energy is None or self.energy.size == 0 or not conserves(self.problem):
            return None
        size = float(np.abs(self.energy).max())
        return float(np.abs(self.energy - self.energy[0]).max()) / size if size > 0.0 else 0.0


def conserves(problem: Problem) -> bool:
    """Whether the motion conserves its energy."""
    system = problem.system
    lossless = system.C is None and not problem.load
    if problem.limiter is None:
        lossless &= all(c.restitution == 1.0 for c in system.constraints)
    return lossless
