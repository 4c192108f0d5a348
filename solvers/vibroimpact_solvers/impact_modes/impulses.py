"""Impulses of members, and how far they can be trusted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibroimpact_solvers.arrays import Booleans, Floats


@dataclass(frozen=True, eq=False, slots=True)
class Impulses:
    """Impulses of the members at some frequencies.

    Parameters
    ----------
    plus, minus : array, shape (frequency, constraint)
        p+ and p-; 0 where singular.
    error : array, shape (frequency,)
        Relative error of the largest of them, infinite where singular.
    """

    plus: Floats
    minus: Floats
    error: Floats

    @property
    def singular(self) -> Booleans:
        """Where there is no impulse, or none of which even the sign is known."""
        return np.asarray(self.error >= 1.0)
