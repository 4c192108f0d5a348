"""Upper bounds of the natural frequencies, without computing these."""

from __future__ import annotations

import math

import numpy as np
import scipy.linalg

from vibroimpact_solvers import condensation
from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.body import once_per_body
from vibroimpact_solvers.condensation import Condensation
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.factors import Solve
from vibroimpact_solvers.matrices import Form, SymmetricMatrix
from vibroimpact_solvers.model import System

_STEPS = 24  # of the Lanczos iteration; fewer already come within a few percent


def largest_frequency(system: System) -> float:
    """Return an upper bound of all natural frequencies and growth rates of a system.

    For a diagonal M the bound of Gershgorin for ``M^(-1/2) K M^(-1/2)``. Otherwise an
    estimate by Lanczos' method, raised until a factorization of ``sigma M -+ K`` proves it.
    Where there are degrees of freedom without mass, those of the condensed structure.
    """
    if system.chain is not None:
        # Eq. 10.63 with j = N + 1.
        return 2.0 * math.sqrt(system.chain.stiffness / system.chain.mass)
    return math.sqrt(_square(system))


@once_per_body
def _square(system: System) -> float:
    if not system.massless.size:
        return _bound(system, system.K)
    condensed = condensation.of(system)
    rounded = 8.0 * system.n * EPS * _bound(condensed, condensed.sizes)
    return _bound(condensed, condensed.K) + rounded


def _bound(moving: System | Condensation, K: SymmetricMatrix) -> float:
    M = moving.M
    if M.form is Form.DIAGONAL:
        return _gershgorin(M.data[0], K)
    return _proven(M, K, _lanczos(M, K, moving.solve_M))


def _gershgorin(mass: Floats, K: SymmetricMatrix) -> float:
    root = np.sqrt(mass)
    if K.form in {Form.DENSE, Form.SPARSE}:
        rows = abs(K.to_sparse()) if K.form is Form.SPARSE else np.abs(K.data)
        return float((rows @ (1.0 / root) / root).max())
    sums = np.abs(K.data[0]) / mass
    for k, band in enumerate(K.data[1:], start=1):
        part = np.abs(band[:-k]) / (root[k:] * root[:-k])
        sums[k:] += part
        sums[:-k] += part
    return float(sums.max())


def _lanczos(M: SymmetricMatrix, K: SymmetricMatrix, solve: Solve) -> float:
    """Estimate the largest magnitude of an eigenvalue, from below."""
    v = 1.0 + np.sin(np.arange(1.0, M.n + 1.0))
    w = M @ v
    norm = math.sqrt(v @ w)
    before, coupling = np.zeros(M.n), 0.0
    diagonal, off = [], []
    for _ in range(min(_STEPS, M.n)):
        v, w = v / norm, w / norm
        forward = solve(K @ v)
        along = float(forward @ w)
        forward -= along * v + coupling * before
        diagonal.append(along)
        before, w = v, M @ forward
        coupling = norm = math.sqrt(max(float(forward @ w), 0.0))
        if norm <= 1e-12 * max(abs(value) for value in (along, 1e-300)):
            break
        off.append(norm)
        v = forward
    values = scipy.linalg.eigvalsh_tridiagonal(
        np.array(diagonal), np.array(off[: len(diagonal) - 1])
    )
    return float(np.abs(values).max())


def _proven(M: SymmetricMatrix, K: SymmetricMatrix, estimate: float) -> float:
    """Return a multiple of the estimate that no eigenvalue exceeds in magnitude."""
    for doubling in range(60):
        bound = max(estimate, 1e-300) * (1.0 + 0.05 * 2.0**doubling)
        if all(M.plus(sign / bound, K).is_positive_definite() for sign in (-1.0, 1.0)):
            return bound
    raise ConvergenceError("no bound of the natural frequencies was found")
