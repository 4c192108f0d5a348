"""What is evaluated along the period: displacements, modal coordinates, and their damping."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.problem import Problem


@dataclass(frozen=True, eq=False, slots=True)
class Outputs:
    """Forms of what is evaluated along the period.

    Parameters
    ----------
    x : array, shape (dof, 2, pair)
        Displacements of the requested degrees of freedom.
    still : array, shape (dof,)
        Displacements under the constant load.
    coordinates, rates : array, shape (mode, 2, pair)
        Coordinates of the modes from the equilibrium, and their velocities.
    stiffness, stiffness_error : array, shape (mode,)
        Eigenvalues, and their errors.
    damping, damping_error : array, shape (mode, mode), optional
        And what rounding took from it.
    load : array, shape (2 harmonic, mode)
        Modal forces, factors of the cosine and the sine of each harmonic in turn.
    """

    x: Floats
    still: Floats
    coordinates: Floats
    rates: Floats
    stiffness: Floats
    stiffness_error: Floats
    damping: Floats | None
    damping_error: Floats
    load: Floats

    @classmethod
    def of(cls, problem: Problem, driven: Driven) -> Outputs:
        """Return the forms for the requested outputs."""
        basis, modes = driven.basis, driven.basis.modes
        shapes = modes.shapes[problem.output_dofs]
        level = (modes.base + modes.shapes @ basis.still)[problem.output_dofs]
        forces = driven.forces @ modes.shapes
        each = np.eye(modes.roots.size)
        roots = modes.roots * (1.0 + modes.rests)
        error, system = np.zeros((0, 0)), problem.system
        if system.C is not None and "energy" in problem.outputs:
            error = modes.left_out + np.diag(modes.damping_errors)
        return cls(
            basis.displacement(shapes), level, basis.displacement(each), basis.velocity(each),
            roots * np.abs(roots), modes.errors, modes.damping, error,
            np.stack([forces.real, -forces.imag], axis=1).reshape(-1, forces.shape[1]),
        )  # fmt: skip
