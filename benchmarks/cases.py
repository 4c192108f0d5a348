"""Structures that the benchmarks share, and their impact modes."""

from __future__ import annotations

from typing import Final

import numpy as np
import scipy.sparse

from vibroimpact_solvers import impact_modes, presets
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

GAP = 0.2
IMPULSE: Final = frozenset({"impulse"})


def chain(n: int, constraints: int = 1) -> System:
    """Return the chain of eq. 10.60; of 13 masses the one of Fig. 10.13, struck at mass 6.

    With more constraints the masses beside it are struck, too.
    """
    return presets.chain(n, [Constraint.at(struck(n) + i, GAP) for i in range(constraints)])


def struck(n: int) -> int:
    """Return the degree of freedom that is struck."""
    return 5 if n == 13 else int(0.37 * n)


def random_structure(n: int, seed: int) -> System:
    """Return a structure with full M and K and natural frequencies from 0.3 to 3."""
    random = np.random.default_rng(seed)
    frequencies = np.sort(random.uniform(0.3, 3.0, n))
    E = random.standard_normal((n, n)) / np.sqrt(n) + 2.0 * np.eye(n)
    M, K = E @ E.T, (E * frequencies**2) @ E.T
    return System(
        SymmetricMatrix.dense(0.5 * (M + M.T)),
        SymmetricMatrix.dense(0.5 * (K + K.T)),
        (Constraint.at(n // 3, GAP),),
    )


def uneven_chain(n: int, seed: int) -> System:
    """Return a chain of unequal masses and springs: K is tridiagonal, M diagonal."""
    random = np.random.default_rng(seed)
    springs = random.uniform(0.5, 1.5, n + 1)
    K = {0: springs[:-1] + springs[1:], 1: -springs[1:-1]}
    masses = SymmetricMatrix.diagonal(random.uniform(0.5, 1.5, n))
    return System(masses, SymmetricMatrix.bands(K), (Constraint.at(struck(n), GAP),))


def net(side: int) -> System:
    """Return a square net of unequal masses and equal springs: K is sparse, M diagonal."""
    one = scipy.sparse.identity(side)
    line = scipy.sparse.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(side, side))
    K = (scipy.sparse.kron(line, one) + scipy.sparse.kron(one, line)).tocoo()
    n = side * side
    masses = SymmetricMatrix.diagonal(np.random.default_rng(0).uniform(0.5, 1.5, n))
    stiffness = SymmetricMatrix.sparse((n, n), K.row, K.col, K.data)
    return System(masses, stiffness, (Constraint.at(n // 3 + side // 5, GAP),))


def grid(start: float, stop: float, num: int) -> Floats:
    """Return frequencies that hit no pole: a uniform grid, stretched by a hair."""
    return np.asarray(np.linspace(start, stop, num) * (1.0 + 1.4142135623e-7))


def solve(system: System, Omega: Floats, outputs: frozenset[str] = IMPULSE) -> impact_modes.Result:
    """Plan and solve for impact modes, as the service does."""
    problem = impact_modes.Problem(system, Omega * (2.0 / np.pi), outputs=outputs, Omega=Omega)
    return impact_modes.solve(problem, impact_modes.plan(problem))
