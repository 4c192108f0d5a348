"""A block of solid finite elements."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse

import vibroimpact as vi


def solid(nx: int, ny: int, nz: int) -> vi.Model:
    """Return a free block of trilinear elements, with coordinates: steel, in m, kg and s."""
    counts, size = (nx, ny, nz), np.array([1.0, 0.6, 0.4])
    h = size / (np.array(counts) - 1)
    lam, mu = 1.2115e11, 8.0769e10
    D = np.diag([2 * mu] * 3 + [mu] * 3)
    D[:3, :3] += lam
    corner = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=float)
    Ke, Me = np.zeros((24, 24)), np.zeros((24, 24))
    for p in corner / np.sqrt(3.0):
        terms = 1.0 + corner * p
        N = terms.prod(axis=1) / 8
        dN = [corner[:, i] * np.delete(terms, i, 1).prod(axis=1) / 4 / h[i] for i in range(3)]
        B = np.zeros((6, 24))
        for i in range(3):
            B[i, i::3] = dN[i]
        for row, (i, j) in enumerate(((0, 1), (1, 2), (2, 0)), 3):
            B[row, i::3], B[row, j::3] = dN[j], dN[i]
        shapes = np.kron(N, np.eye(3))
        Ke += B.T @ D @ B * h.prod() / 8
        Me += 7850.0 * shapes.T @ shapes * h.prod() / 8
    index = np.arange(nx * ny * nz).reshape(nz, ny, nx)
    ends = np.stack([index[a : nz - 1 + a, b : ny - 1 + b, c : nx - 1 + c].ravel()
                     for a in (0, 1) for b in (0, 1) for c in (0, 1)], axis=1)  # fmt: skip
    dofs = (3 * ends[:, :, np.newaxis] + np.arange(3)).reshape(len(ends), 24)
    places = np.repeat(dofs, 24, axis=1).ravel(), np.tile(dofs, (1, 24)).ravel()
    n = 3 * nx * ny * nz
    M, K = (
        sparse.csr_array(sparse.coo_array((np.tile(each.ravel(), len(ends)), places), shape=(n, n)))
        for each in (Me, Ke)
    )
    points = np.array([[x, y, z] for z in range(nz) for y in range(ny) for x in range(nx)]) * h
    labels = [(node, each) for node in range(n // 3) for each in "xyz"]
    return vi.Model(M, K, labels=labels, coordinates=dict(enumerate(points.tolist())))
