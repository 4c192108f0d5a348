"""An antisymmetric family by natural modes, with a power series above the spectrum."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vibroimpact_solvers.arrays import EPS, Booleans, Floats, Integers
from vibroimpact_solvers.impact_modes.direct import (
    ROUNDED,
    DirectFamily,
    Forces,
    largest_displacements,
)
from vibroimpact_solvers.impact_modes.family import Family
from vibroimpact_solvers.impact_modes.modal import Amplitudes, ModalFamily
from vibroimpact_solvers.impact_modes.planning import SeriesRange
from vibroimpact_solvers.impact_modes.problem import Frequencies, Problem
from vibroimpact_solvers.spectrum import Spectrum

_CLOSEST = 1e-3  # relative distance of the lowest frequency of the series from the spectrum


class ModalWithSeriesFamily(ModalFamily):
    """A modal family whose displacements above a frequency come from a power series."""

    def __init__(
        self, problem: Problem, family: Family, spectrum: Spectrum, series: SeriesRange
    ) -> None:
        super().__init__(problem, family, spectrum)
        largest = spectrum.largest_frequency
        self._direct = DirectFamily(problem, largest * (1.0 + 1e-12), factorizes=series.factorizes)
        self._start = largest * series.start * 2.0 / np.pi
        self._factorizes = series.factorizes

    def displacements(self, motion: Amplitudes, tau: Floats, dofs: Integers) -> Floats:
        """Return displacements, shape (frequency, tau, dof)."""
        x = np.empty((motion.omega.size, tau.size, dofs.size))
        high = motion.omega >= self._start
        if high.any():
            x[high] = self._direct.displacements(self._forces(motion, high), tau, dofs)
        if not high.all():
            x[~high] = super().displacements(motion.at(~high), tau, dofs)
        return x

    def harmonics(self, motion: Amplitudes, orders: Integers, dofs: Integers) -> Floats:
        """Return Fourier amplitudes, shape (frequency, order, dof)."""
        b = np.empty((motion.omega.size, orders.size, dofs.size))
        high = (motion.omega >= self._start) & self._factorizes
        if high.any():
            b[high] = self._direct.harmonics(self._forces(motion, high), orders, dofs)
        if not high.all():
            b[~high] = super().harmonics(motion.at(~high), orders, dofs)
        return b

    def motion_errors(self, motion: Amplitudes, x: Floats, dofs: Integers) -> Floats:
        """Return errors of displacements x, (frequency, …, dof), as (frequency, dof)."""
        errors = super().motion_errors(motion, x, dofs)
        high = motion.omega >= self._start
        if not high.any():
            return errors
        size = largest_displacements(x[high])
        apart = 1.0 + _CLOSEST - self._start / motion.omega[high]
        relative = ROUNDED + 4.0 * EPS / apart
        forces = self._forces(motion, high)
        if forces.p.shape[1] > 1:  # what one impulse moves, another one may move back
            alone = [replace(forces, p=forces.p * one) for one in np.eye(forces.p.shape[1])]
            parts = [self._direct.displacements(one, np.ones(1), dofs) for one in alone]
            size = np.sum([largest_displacements(part) for part in parts], axis=0)
            relative += forces.error
        errors[high] = relative[:, np.newaxis] * size
        return errors

    def _forces(self, motion: Amplitudes, chosen: Booleans) -> Forces:
        """Return the impulses by the same sums as the displacements: common errors cancel."""
        omega = motion.omega[chosen]
        return self._direct.solutions(Frequencies(omega, np.zeros(omega.size)))[1]
