"""Displacements that move with walls: what periodic motions with moving walls are relative to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibroimpact_solvers.arrays import Booleans, Floats
from vibroimpact_solvers.periodic_motions.pairs import Complexes


@dataclass(frozen=True, eq=False, slots=True)
class Frame:
    """Displacements that move with the walls, at one frequency of the drive.

    All amplitudes are those at the drive's phase 0, of which real parts count.

    Parameters
    ----------
    harmonics : array, shape (harmonic,)
    shift : array, shape (harmonic, dof), complex
        The displacements.
    walls : array, shape (harmonic, constraint), complex
        Displacements of the walls.
    forces : array, shape (harmonic, dof), complex
        The load of the structure itself.
    """

    harmonics: Floats
    shift: Complexes
    walls: Complexes
    forces: Complexes

    @property
    def some(self) -> Booleans:
        """Harmonics of which something is not zero, (harmonic,)."""
        return np.asarray(self.shift.any(axis=1) | self.forces.any(axis=1))

    def part(self, some: Booleans) -> Frame:
        """Return some of the harmonics."""
        return Frame(self.harmonics[some], self.shift[some], self.walls[some], self.forces[some])

    def at(self, turned: Complexes) -> Frame:
        """Return it from a later phase of the drive on, by which its harmonics have turned."""
        by = turned[:, np.newaxis]
        return Frame(self.harmonics, by * self.shift, by * self.walls, by * self.forces)
