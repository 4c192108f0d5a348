"""Certified edges against impact modes in ball arithmetic, from M and K without natural modes."""

from __future__ import annotations

import flint
import numpy as np
import pytest

from tests.reference import impact_modes
from tests.solvers.structures import referenced
from vibroimpact_solvers import existence_bands as bands
from vibroimpact_solvers.existence_bands import Edge, Result
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System


def ill_conditioned(seed: int) -> System:
    """Return a structure whose M has a condition number of up to 1e11."""
    rng = np.random.default_rng(seed)
    n, condition = int(rng.integers(2, 5)), 10.0 ** rng.uniform(3, 11)
    Q = np.linalg.qr(rng.normal(size=(n, n)))[0]
    A = rng.normal(size=(n, n))
    M, K = Q @ np.diag(np.geomspace(1.0, 1.0 / condition, n)) @ Q.T, A @ A.T + 0.1 * np.eye(n)
    stops = [Constraint.at(0, 1.0)]
    if seed % 2:
        stops.append(Constraint.at(n - 1, float(rng.uniform(0.5, 3.0))))
    full = [SymmetricMatrix.dense(0.5 * (m + m.T)) for m in (M, K)]
    return System(full[0], full[1], tuple(stops))


def solved(system: System) -> Result:
    eigenvalues = np.linalg.eigvals(np.linalg.solve(system.M.to_dense(), system.K.to_dense()))
    highest = float(np.sqrt(np.abs(eigenvalues).max()))
    problem = bands.Problem(system, 0.25 * highest, 1.2 * highest, (0,))
    return bands.solve(problem, bands.plan(problem))


def exists(system: System, Omega: float) -> bool:
    """Whether the impact mode is a motion of the structure."""
    before = flint.ctx.prec
    try:
        family = impact_modes.Family(*referenced(system), (0,))
        solution = impact_modes.solved(family, Omega, enough=lambda s: s.exists() is not None)
        return bool(solution.exists())
    finally:
        flint.ctx.prec = before


@pytest.mark.parametrize("seed", range(6))
def test_edges_are_within_their_errors(seed: int) -> None:
    system = ill_conditioned(seed)
    result = solved(system)
    assert result.band_certified.any()
    rng = np.random.default_rng(seed)
    for k in rng.permutation(np.flatnonzero(result.band_certified))[:3]:
        error = 1.0001 * float(result.band_edge_error[k])
        for outwards, edge, reason in (
            (-1.0, result.band_start[k], result.band_start_reason[k]),
            (1.0, result.band_stop[k], result.band_stop_reason[k]),
        ):
            assert error < 1e-9 * edge
            if reason != Edge.RANGE:
                assert exists(system, float(edge - outwards * error))
                assert not exists(system, float(edge + outwards * error))
