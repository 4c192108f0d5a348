"""Free linear motion of one or two masses after their last impact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.model import System


@dataclass(frozen=True, eq=False, slots=True)
class FreeMotion:
    """Solutions of ``M x'' + C x' + K x = 0`` by complex modes."""

    rates: NDArray[np.complex128]  # eigenvalues of the first-order system in (x, v), (2 n,)
    modes: NDArray[np.complex128]  # its eigenvectors, by columns, (2 n, 2 n)

    @classmethod
    def of(cls, system: System) -> FreeMotion:
        """Return the motions of a structure; of oscillatory ones all modes are simple."""
        n = system.n
        M, K = system.M.to_dense(), system.K.to_dense()
        C = np.zeros((n, n)) if system.C is None else system.C.to_dense()
        first = np.zeros((2 * n, 2 * n))
        first[:n, n:] = np.eye(n)
        first[n:, :n] = -np.linalg.solve(M, K)
        first[n:, n:] = -np.linalg.solve(M, C)
        rates, modes = np.linalg.eig(first)
        return cls(rates.astype(np.complex128), modes.astype(np.complex128))

    def at(self, state: Floats, t: Floats) -> Floats:
        """Return (x, v) at times after a state, shape (time, 2 n).

        state has shape (2 n,), or (time, 2 n) where each time has its own.
        """
        weights: NDArray[Any] = np.linalg.solve(self.modes, state.T.astype(np.complex128)).T
        states: Floats = ((np.exp(np.outer(t, self.rates)) * weights) @ self.modes.T).real
        return states
