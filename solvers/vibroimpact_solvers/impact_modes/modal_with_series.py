"""An antisymmetric family by natural modes, with a power series above the spectrum."""

from __future__ import annotations

import numpy as np

from vibroimpact_solvers.arrays import Booleans, Floats, Integers
from vibroimpact_solvers.impact_modes.direct import DirectFamily, Forces
from vibroimpact_solvers.impact_modes.family import Family
from vibroimpact_solvers.impact_modes.modal import Amplitudes, ModalFamily
from vibroimpact_solvers.impact_modes.planning import SeriesRange
from vibroimpact_solvers.impact_modes.problem import Problem
from vibroimpact_solvers.spectrum import Spectrum


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
            x[high] = self._direct.displacements(_forces(motion, high), tau, dofs)
        if not high.all():
            x[~high] = super().displacements(motion.at(~high), tau, dofs)
        return x

    def harmonics(self, motion: Amplitudes, orders: Integers, dofs: Integers) -> Floats:
        """Return Fourier amplitudes, shape (frequency, order, dof)."""
        b = np.empty((motion.omega.size, orders.size, dofs.size))
        high = (motion.omega >= self._start) & self._factorizes
        if high.any():
            b[high] = self._direct.harmonics(_forces(motion, high), orders, dofs)
        if not high.all():
            b[~high] = super().harmonics(motion.at(~high), orders, dofs)
        return b


def _forces(motion: Amplitudes, chosen: Booleans) -> Forces:
    return Forces(motion.omega[chosen], motion.p[chosen])
