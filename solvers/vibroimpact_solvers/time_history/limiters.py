"""The law of soft limiters: restoring forces that grow with a power."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.model import System


@dataclass(frozen=True, slots=True)
class Power:
    """Soft limiters with the force ``-stiffness (y / (scale gap))^exponent`` each.

    The validation model of the chapter's figures, where the exponent is 2n - 1 = 17.

    Parameters
    ----------
    exponent : float
        At least 1; y is taken with its sign.
    stiffness : float
        Force at the distance scale * gap (mass length / time^2), positive.
    scale : float
        Factor of the gaps, positive.
    """

    exponent: float
    stiffness: float
    scale: float = 1.0

    def sizes(self, system: System) -> Floats:
        """Return scale times the gaps, lower and upper, shape (2, constraint)."""
        walls = [(c.lower, c.upper) for c in system.constraints]
        return self.scale * np.array(
            [[np.inf if w[side] is None else w[side] for w in walls] for side in (0, 1)],
            dtype=np.float64,
        ).reshape(2, len(walls))

    def forces(self, y: Floats, sizes: Floats) -> Floats:
        """Return the forces on coordinates, shape (…, constraint)."""
        strength = np.where(y > 0.0, y / sizes[1], -y / sizes[0]) ** self.exponent
        return np.asarray(-self.stiffness * np.sign(y) * strength)

    def potential(self, y: Floats, sizes: Floats) -> Floats:
        """Return the energy stored in all limiters, shape (…,)."""
        size = np.where(y > 0.0, sizes[1], sizes[0])
        finite = np.isfinite(size)
        power = (np.abs(y) / size) ** (self.exponent + 1.0)
        each = np.where(finite, self.stiffness * np.where(finite, size, 0.0) * power, 0.0)
        return np.asarray(each.sum(axis=-1) / (self.exponent + 1.0))
