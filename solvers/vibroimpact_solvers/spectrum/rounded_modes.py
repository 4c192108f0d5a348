"""Natural modes of large structures, rounded to double precision, with proved errors.

`refinement` keeps modes as sums of two doubles and their products in twice the precision, which
takes n^3 slow operations. Here only the residuals are computed so,

    r_j = K x_j - lambda_j M x_j ,    lambda_j = x_j^T K x_j / x_j^T M x_j ;

their couplings, ``c_ij = x_i^T r_j``, are small and can be rounded. As there,
``X (I + E)`` is better by as many digits as X has,

    e_ij = c_ij / (lambda_j - lambda_i) ,    e_jj = (1 - g_jj)/2 ,    G = X^T M X ,

and E is ``-g_ij/2`` inside a cluster. With ``g_ij = (c_ij - c_ji)/(lambda_i - lambda_j)`` the
residual of a column of ``X (I + E)`` is, in the basis X and without any term left out,

    C e_j - (G - I) c_j + e_jj c_j ,

bounded by the norms of its factors. Eigenvalues and directions are as near as this residual tells
(`refinement`). The columns are rounded once afterwards, entry by entry.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.sparse.csgraph

from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.kernels import doubled
from vibroimpact_solvers.matrices import SymmetricMatrix
from vibroimpact_solvers.spectrum import products
from vibroimpact_solvers.spectrum.refinement import RefinedModes

_UNIT: Final = 0.5 * EPS
_ROUNDS: Final = 4
_COLUMNS: Final = 64  # modes at a time
_SEPARATES: Final = 0.01  # entry of E from which two modes are not told apart
_FINE: Final = 1e-15  # relative error of eigenvalues that is good enough
_TURNED: Final = 1e-17  # direction of a mode that another round would not better
_SOUND: Final = 1e-3  # largest E and G - I whose third powers the safety covers
_SAFETY: Final = 1.01  # covers terms of third order and the roundings of the bounds themselves
_NONE: Final = np.zeros((0, 0))


@dataclass(frozen=True, eq=False, slots=True)
class _Residuals:
    """What the residuals of some modes tell."""

    values: Floats  # lambda_j, (mode,)
    low: Floats  # what rounding took from them
    excess: Floats  # ``g_jj - 1``, (mode,)
    couplings: Floats  # c_ij, 0 on the diagonal, (mode, mode)
    rounding: Floats  # bounds of the norms of the errors of its columns, (mode,)

    def apart(self, columns: slice) -> Floats:
        """Return ``lambda_j - lambda_i`` of some j, (mode, column)."""
        values, low = self.values, self.low
        distances: Floats = values[columns] - values[:, np.newaxis]
        distances += low[columns] - low[:, np.newaxis]
        return distances


@dataclass(frozen=True, eq=False, slots=True)
class _Step:
    """The better modes ``X (I + E)``, and their errors."""

    modes: Floats  # (dof, mode)
    errors: Floats  # of the eigenvalues, (mode,)
    angles: Floats  # of the modes in the norm of M, besides the rounding of their entries, (mode,)


def refine(M: SymmetricMatrix, K: SymmetricMatrix, modes: Floats, least: float) -> RefinedModes:
    """Refine all modes of a structure, ``E^T M E = I`` up to rounding.

    least is a lower bound of the eigenvalues of M with its diagonal scaled to ones. Angles are
    infinite where the modes given are too far from the right ones.
    """
    X, before = np.ascontiguousarray(modes), np.inf
    for left in reversed(range(_ROUNDS)):
        now = _residuals(M, K, X, least)
        clusters = _clusters(now)
        step = _step(M, X, now, clusters)
        X, furthest = step.modes, float(step.angles.max(initial=0.0))
        fine = step.errors <= np.maximum(_FINE * np.abs(now.values), 8.0 * now.rounding)
        if left == 0 or (fine.all() and (furthest <= _TURNED or furthest > 0.25 * before)):
            break
        before = furthest
        _turn(X, now, clusters)
    return RefinedModes(now.values, now.low, X, _NONE, step.errors, step.angles)


def _residuals(M: SymmetricMatrix, K: SymmetricMatrix, X: Floats, least: float) -> _Residuals:
    """Return what the residuals of modes tell, each computed to twice the precision."""
    n, count = X.shape
    values, low, excess, rounding = np.zeros((4, count))
    couplings = np.empty((count, count))
    inertia = np.sqrt(M.main_diagonal)[:, np.newaxis]
    for some in _parts(count, _COLUMNS):
        x = X[:, some]
        stiff, stiff_low, stiff_error = products.product(K, x)
        heavy, heavy_low, heavy_error = products.product(M, x)
        s, s_low = products.along(x, stiff, stiff_low)
        g, g_low = products.along(x, heavy, heavy_low)
        m = (g - 1.0) + g_low
        # lambda = s/(1 + m) with a small m.
        below = s_low - s * m / (1.0 + m)
        value = s + below
        rest = below - (value - s)
        size = np.abs(x)
        sums = (size * (stiff_error + np.abs(value) * heavy_error)).sum(axis=0)
        terms = (size * (np.abs(stiff) + np.abs(value * heavy))).sum(axis=0)
        unknown = sums + doubled.roundings(n) * terms + 8.0 * EPS * EPS * np.abs(value)
        scaled = doubled.product(heavy, heavy_low, np.diag(value), np.diag(rest), False)
        r = (stiff - scaled[0]) + (stiff_low - scaled[1])
        error = stiff_error + np.abs(value) * heavy_error + unknown * np.abs(heavy)
        error += doubled.roundings(_COLUMNS) * np.abs(scaled[0])
        # The sum over a column of |X|^T d is below the norm of |X|^T, which is that of a matrix
        # whose columns are at most 1/least long in the scaled M, times that of d.
        exact = np.linalg.norm(error / inertia, axis=0) / np.sqrt(least)
        rounded = (n + 4) * _UNIT * np.linalg.norm(r / inertia, axis=0) * np.sqrt(count / least)
        values[some], low[some], excess[some] = value, rest, m
        rounding[some] = _SAFETY * (exact + rounded) + unknown
        couplings[:, some] = X.T @ r
    np.fill_diagonal(couplings, 0.0)
    return _Residuals(values, low, excess, couplings, rounding)


def _clusters(now: _Residuals) -> Integers:
    """Return the numbers of the clusters of modes that E cannot tell apart, (mode,)."""
    count, pairs = now.values.size, list[Integers]()
    for some in _parts(count, _COLUMNS):
        size = np.abs(now.couplings[:, some])
        size += 2.0 * (now.rounding[some] + now.rounding[:, np.newaxis])
        near = np.argwhere(size >= _SEPARATES * np.abs(now.apart(some)))
        pairs.append(near + np.array([0, some.start]))
    rows, columns = np.concatenate(pairs).T
    close = scipy.sparse.coo_array((np.ones(rows.size), (rows, columns)), shape=(count, count))
    _, numbers = scipy.sparse.csgraph.connected_components(close, directed=False)
    return np.asarray(numbers, dtype=np.int64)


def _groups(clusters: Integers) -> Iterator[Integers]:
    """Return the modes of each cluster of more than one."""
    for number in np.flatnonzero(np.bincount(clusters) > 1):
        yield np.flatnonzero(clusters == number)


def _step(M: SymmetricMatrix, X: Floats, now: _Residuals, clusters: Integers) -> _Step:
    """Return the better modes ``X (I + E)`` and their errors."""
    n, count = X.shape
    better = np.empty_like(X)
    # Norms of the columns of E, of C outside of clusters, of what is left inside, and of G - I.
    e, c, inside, g = np.zeros((4, count))
    blocks = [(some, _mass_block(M, X, some)) for some in _groups(clusters)]
    for some in _parts(count, _COLUMNS):
        apart, c_some = now.apart(some), now.couplings[:, some]
        together = clusters[:, np.newaxis] == clusters[some]
        distance = np.where(together, np.inf, apart)
        E, mass = c_some / distance, (now.couplings[some].T - c_some) / distance
        doubt = (now.rounding[some] + now.rounding[:, np.newaxis]) / np.abs(distance)
        place = np.arange(count)[some]
        mass[place, place - some.start] = now.excess[some]
        for group, block in blocks:
            inner = (group >= some.start) & (group < some.stop)
            mass[np.ix_(group, group[inner] - some.start)] = block[:, inner]
        E = np.where(together, -0.5 * mass, E)
        better[:, some] = X[:, some] + X @ E
        e[some], g[some] = _norms(E), _norms(np.abs(mass) + doubt)
        c[some] = _norms(np.where(together, 0.0, c_some))
        left = np.abs(c_some) + np.abs(apart * E)
        inside[some] = _norms(np.where(together, left, 0.0))
    all_e, all_g = float(np.linalg.norm(e)), float(np.linalg.norm(g))
    all_c = float(np.hypot(np.linalg.norm(c), np.linalg.norm(inside)))
    second = all_c * e + (all_g + 4.0 * _UNIT) * (c + inside) + np.abs(now.excess) * c
    residual = _SAFETY * (second + now.rounding + inside)
    of_clusters = np.zeros(int(clusters.max()) + 1)
    np.add.at(of_clusters, clusters, residual**2)
    residual = np.sqrt(of_clusters)[clusters]
    if not (all_e < _SOUND and all_g < _SOUND):
        return _Step(better, residual, np.full(count, np.inf))
    weights = np.linalg.norm(X, axis=1)
    length = math.sqrt(float(weights @ (_magnitudes(M) @ weights)))
    angles = all_e * (e + g) + all_g * e + (n + 2) * _UNIT * length * e
    for some in _parts(count, _COLUMNS):
        together = clusters[:, np.newaxis] == clusters[some]
        distance = np.where(together, np.inf, np.abs(now.apart(some)))
        free = (distance - residual[:, np.newaxis]).min(axis=0) - residual[some]
        with np.errstate(divide="ignore", invalid="ignore"):
            angles[some] += np.where(free > 0.0, 2.0 * residual[some] / free, np.inf)
    return _Step(better, residual, angles)


def _mass_block(M: SymmetricMatrix, X: Floats, some: Integers) -> Floats:
    """Return ``G - I`` of the modes of a cluster."""
    x = X[:, some]
    heavy, heavy_low, _ = products.product(M, x)
    high, low = doubled.product(x.T, _NONE, heavy, heavy_low, False)
    return np.asarray((high - np.eye(some.size)) + low)


def _turn(X: Floats, now: _Residuals, clusters: Integers) -> None:
    """Turn the modes of every cluster into its own directions, in place."""
    for some in _groups(clusters):
        block = now.couplings[np.ix_(some, some)]
        part = 0.5 * (block + block.T)
        # The eigenvalues differ by little: the first is taken from all.
        first = int(some[0])
        np.fill_diagonal(part, -now.apart(slice(first, first + 1))[some, 0])
        _, turn = scipy.linalg.eigh(part)
        X[:, some] = doubled.product(X[:, some], _NONE, turn, _NONE, False)[0]


def _norms(columns: Floats) -> Floats:
    return np.asarray(np.sqrt(np.square(columns).sum(axis=0)))


def _magnitudes(A: SymmetricMatrix) -> SymmetricMatrix:
    return replace(A, data=np.abs(A.data))


def _parts(count: int, each: int) -> Iterator[slice]:
    for start in range(0, count, each):
        yield slice(start, min(start + each, count))
