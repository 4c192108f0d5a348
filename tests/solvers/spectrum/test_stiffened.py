"""Modes of a structure that springs are added to, against eigenvalues with sixty digits."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest

from vibroimpact_solvers.spectrum import stiffened


@pytest.mark.parametrize(
    ("n", "springs", "decades"),
    [(1, 1, 0.0), (6, 1, 0.0), (6, 1, 12.0), (8, 2, 6.0), (8, 3, 12.0), (9, 1, -8.0)],
)
@pytest.mark.parametrize("spread", [1.0, 6.0])
def test_modes_with_springs(n: int, springs: int, decades: float, spread: float) -> None:
    """Eigenvalues, and participations that are tiny at a stiff spring, keep their digits."""
    rng = np.random.default_rng(3)
    values = np.sort(10.0 ** rng.uniform(0.0, spread, n))
    if n > 6:
        values[0], values[2] = 0.0, values[1]  # a rigid body, and two equal modes
    rows, k = rng.normal(size=(springs, n)), 10.0**decades * rng.uniform(0.5, 2.0, springs)
    found = stiffened(values.astype(np.longdouble), rows, k.tolist())
    with mp.workdps(60):
        A = mp.diag([mp.mpf(float(value)) for value in values])
        for row, stiffness in zip(rows, k, strict=True):
            r = mp.matrix([mp.mpf(float(x)) for x in row])
            A += mp.mpf(float(stiffness)) * r * r.T
        exact, vectors = mp.eigsy(A)
        true = np.array([float(x) for x in exact])
        along = mp.matrix(rows.tolist()) * vectors
        sizes = np.array([[abs(float(along[a, j])) for j in range(n)] for a in range(springs)])
    unit = np.maximum(np.abs(true), 1e-9)
    assert (np.abs(found.eigenvalues.astype(float) - true) <= 2e-15 * unit).all()
    assert np.abs(found.vectors.T @ found.vectors - np.eye(n)).max() < 1e-14
    alone = np.abs(np.diff(true, append=np.inf)) > 1e-9 * unit
    alone &= np.abs(np.diff(true, prepend=-np.inf)) > 1e-9 * unit
    allowed = (1e-13 * sizes + 1e-18)[:, alone]
    assert (np.abs(np.abs(found.rows) - sizes)[:, alone] <= allowed).all()
