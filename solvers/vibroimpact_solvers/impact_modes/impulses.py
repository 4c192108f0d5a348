"""Impulses of impact modes and their errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibroimpact_solvers.arrays import Booleans, Floats

_LARGE = 1e3  # times the usual magnitude


@dataclass(frozen=True, eq=False, slots=True)
class Impulses:
    """Impulses of a family at some frequencies."""

    # p+ and p-; 0 where singular, (frequency, constraint)
    plus: Floats
    minus: Floats
    error: Floats  # relative error of the largest of them, infinite where singular, (frequency,)

    def singular(self, usual: Floats) -> Booleans:
        """Return where no impulse brings the structure to its walls.

        There the impulses grow without bound until they are rounding errors. Near their zeros,
        at natural frequencies, they are as uncertain but small. `usual` is the order of magnitude
        of impulses, (frequency,).
        """
        largest = np.maximum(np.abs(self.plus).max(axis=1), np.abs(self.minus).max(axis=1))
        lost = (self.error >= 1.0) & (largest > _LARGE * usual)
        return np.asarray(lost | ~np.isfinite(self.error))
