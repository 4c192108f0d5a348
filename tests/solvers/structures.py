"""Structures for tests: random ones, and the chain of the book's figures."""

from __future__ import annotations

import numpy as np

from tests.reference import balls, impact_modes
from vibroimpact_solvers import presets
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System


def chain(n: int = 13, dof: int = 5, gap: float = 0.2) -> System:
    """Return the uniform chain with one bilateral limiter."""
    return presets.chain(n, [Constraint.at(dof, gap)])


def symmetric(rng: np.random.Generator, n: int, lowest: float = 0.1) -> np.ndarray:
    """Return a random symmetric matrix with eigenvalues above the lowest."""
    A = rng.normal(size=(n, n))
    return A @ A.T / n + lowest * np.eye(n)


def random_system(seed: int, n: int, constraints: list[Constraint]) -> System:
    """Return a system with full random M and K."""
    rng = np.random.default_rng(seed)
    M, K = symmetric(rng, n, 0.3), symmetric(rng, n)
    return System(SymmetricMatrix.dense(M), SymmetricMatrix.dense(K), tuple(constraints))


def referenced(system: System) -> tuple[balls.Structure, tuple[impact_modes.Limiter, ...]]:
    """Return a system without damping and load as the references take it."""
    rows = system.directions(range(len(system.constraints)))
    limiters = tuple(
        impact_modes.Limiter(row, c.lower, c.upper)
        for row, c in zip(rows, system.constraints, strict=True)
    )
    return balls.Structure(system.M.to_dense(), system.K.to_dense()), limiters
