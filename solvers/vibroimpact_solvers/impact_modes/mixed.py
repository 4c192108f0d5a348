"""An odd family by natural modes, its displacements above the spectrum without them."""

from __future__ import annotations

import numpy as np

from vibroimpact_solvers.arrays import Booleans, Floats, Integers
from vibroimpact_solvers.impact_modes.direct import DirectFamily, Forces
from vibroimpact_solvers.impact_modes.impulses import Impulses
from vibroimpact_solvers.impact_modes.modal import Amplitudes, ModalFamily
from vibroimpact_solvers.impact_modes.problem import Frequencies, Problem
from vibroimpact_solvers.stability import Orbits


class MixedFamily:
    """Natural modes below, power series above a frequency.

    Parameters
    ----------
    modal : ModalFamily
        Serves below, and for impulses, energies and limits everywhere.
    direct : DirectFamily
        Serves above.
    from_omega : float
        Triangle-wave frequency from which on.
    """

    def __init__(self, modal: ModalFamily, direct: DirectFamily, from_omega: float) -> None:
        self.modal, self.direct, self.from_omega = modal, direct, from_omega

    @property
    def mobility(self) -> Floats:
        """``W M^(-1) W^T``, shape (constraint, constraint)."""
        return self.modal.mobility

    def members(self, at: Frequencies, *, with_motion: bool = True) -> tuple[Impulses, Amplitudes]:
        """Return impulses and motion of the members at some frequencies."""
        return self.modal.members(at, with_motion=with_motion)

    def energy(self, motion: Amplitudes) -> Floats:
        """Return the total energies, shape (frequency,)."""
        return self.modal.energy(motion)

    def orbits(self, motion: Amplitudes, error: Floats) -> Orbits:
        """Return the motion as far as its stability depends on it.

        The error is the relative one of the motion, shape (frequency,).
        """
        return self.modal.orbits(motion, error)

    def check(
        self, motion: Amplitudes, error: Floats, problem: Problem, excess: float
    ) -> tuple[Floats, Booleans]:
        """Return a time at which a limit is passed or nan, and whether that is certain.

        The error is the relative one of the motion, shape (frequency,).
        """
        return self.modal.check(motion, error, problem, excess)

    def displacements(self, motion: Amplitudes, tau: Floats, dofs: Integers) -> Floats:
        """Return displacements, shape (frequency, tau, dof)."""
        x = np.empty((motion.omega.size, tau.size, dofs.size))
        high = motion.omega >= self.from_omega
        if high.any():
            x[high] = self.direct.displacements(_forces(motion, high), tau, dofs)
        if not high.all():
            x[~high] = self.modal.displacements(motion.at(~high), tau, dofs)
        return x

    def harmonics(self, motion: Amplitudes, orders: Integers, dofs: Integers) -> Floats:
        """Return Fourier amplitudes, shape (frequency, order, dof)."""
        b = np.empty((motion.omega.size, orders.size, dofs.size))
        high = (motion.omega >= self.from_omega) & self.direct.factorizes
        if high.any():
            b[high] = self.direct.harmonics(_forces(motion, high), orders, dofs)
        if not high.all():
            b[~high] = self.modal.harmonics(motion.at(~high), orders, dofs)
        return b


def _forces(motion: Amplitudes, chosen: Booleans) -> Forces:
    return Forces(motion.omega[chosen], motion.p[chosen])
