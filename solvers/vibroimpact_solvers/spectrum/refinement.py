"""Natural modes to twice the working precision, with proved errors.

Modes X from an eigensolver err by roundings of the largest eigenvalue, which is much where
stiffnesses are graded. With the small matrices ``S = X^T K X`` and ``G = X^T M X``, computed in
twice the precision, ``X (I + E)`` is better by as many digits as X has (Ogita and Aishima 2018):

    lambda_j = s_jj / g_jj ,    e_ij = (s_ij - lambda_j g_ij)/(lambda_j - lambda_i) ,
    e_jj = (1 - g_jj)/2 ,       e_ij = -g_ij/2  inside a cluster.

A cluster, whose eigenvalues are closer than E can separate, is diagonalized by itself first.

What is left, all of second order in E, is bounded column by column (Cauchy and Schwarz); it is
the residual ``rho_j >= |K e_j - lambda_j M e_j|`` in the norm of ``M^-1``. By Krylov's and
Weinstein's theorem an eigenvalue lies within ``rho_j`` of ``lambda_j``, and by Davis' and Kahan's
the mode is closer to its true direction than ``rho_j / gap_j`` in the norm of M, with the distance
``gap_j`` to the other eigenvalues. Inside a cluster modes are not unique, and no function of the
structure depends on their choice by more than a change of its eigenvalues by ``rho_j``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.sparse.csgraph

from vibroimpact_solvers.arrays import EPS, Booleans, Floats, Integers
from vibroimpact_solvers.kernels import doubled

LARGEST: Final = 256
"""Degrees of freedom up to which modes are kept as sums of two doubles (else `rounded_modes`)."""

_UNIT = 0.5 * EPS
_ROUNDS = 6
_SEPARATES = 0.01  # residual over distance of two eigenvalues, above which they are close
_FINE = 1e-20  # relative error of eigenvalues, and angle, that are good enough
_SAFETY = 1.01  # covers terms of third order and the roundings of the bounds themselves
_NONE = np.zeros((0, 0))


@dataclass(frozen=True, eq=False, slots=True)
class RefinedModes:
    """Modes as sums of two doubles, and their errors."""

    eigenvalues: Floats  # (mode,)
    eigenvalues_low: Floats  # what rounding took from them
    modes: Floats  # (dof, mode)
    modes_low: Floats
    errors: Floats  # of the eigenvalues, (mode,)
    angles: Floats  # errors of the modes in the norm of M, (mode,)


@dataclass(frozen=True, eq=False, slots=True)
class _Couplings:
    """The matrices S and G of some modes, and what follows from them."""

    values: Floats  # (mode,)
    values_low: Floats
    stiffness: Floats  # S without its diagonal
    mass: Floats  # G - I
    coupling: Floats  # ``s_ij - lambda_j g_ij``, 0 on the diagonal
    apart: Floats  # ``lambda_j - lambda_i``
    clusters: Integers | None  # numbers of the clusters, (mode,), where there are any
    rounding: Floats  # errors of the columns of ``S - lambda G``, (mode,)
    weights: Floats  # bounds of the norms of the modes' magnitudes, (mode,)

    @property
    def separate(self) -> Booleans:
        """Which modes are in different clusters, (mode, mode)."""
        if self.clusters is None:
            return ~np.eye(self.values.size, dtype=np.bool_)
        return np.asarray(self.clusters[:, np.newaxis] != self.clusters)


@dataclass(frozen=True, eq=False, slots=True)
class Stiffness:
    """A stiffness matrix that may itself have been computed to twice the working precision."""

    high: Floats  # (n, n)
    low: Floats = field(default_factory=lambda: _NONE)  # what rounding took from it
    error: Floats | None = None  # bounds of what both leave out, (n, n)


def refine(M: Floats, K: Stiffness, modes: Floats) -> RefinedModes:
    """Refine all modes of a structure, ``E^T M E = I`` up to rounding.

    M is full or, (n,), diagonal.
    """
    X, low, before = np.ascontiguousarray(modes), _NONE, np.inf
    for left in reversed(range(_ROUNDS)):
        now = _couplings(M, K, X, low)
        E = _correction(now)
        errors, angles = _errors(now, E)
        X, low = _moved(X, low, E)
        fine = errors <= np.maximum(_FINE * np.abs(now.values), 8.0 * now.rounding)
        # Errors that fall no more are those of twice the working precision.
        furthest = float(angles.max())
        if left == 0 or (fine.all() and (furthest <= _FINE or furthest > 0.25 * before)):
            break
        before = furthest
        if now.clusters is not None:
            X, low = _turned(now, X, low)
    return RefinedModes(now.values, now.values_low, X, low, errors, angles)


def _couplings(M: Floats, K: Stiffness, X: Floats, low: Floats) -> _Couplings:
    n = X.shape[1]
    S, S_low = _form(K.high, K.low, X, low)
    G, G_low = _form(M, _NONE, X, low)
    diagonal = np.arange(n)
    mass = (G - np.eye(n)) + G_low
    # lambda = s/(1 + m) with a small m.
    s, m = S[diagonal, diagonal], mass[diagonal, diagonal]
    below = S_low[diagonal, diagonal] - s * m / (1.0 + m)
    values = s + below
    values_low = below - (values - s)
    stiffness = S + S_low
    stiffness[diagonal, diagonal] = 0.0
    coupling = stiffness - mass * values
    coupling[diagonal, diagonal] = 0.0
    apart = (values - values[:, np.newaxis]) + (values_low - values_low[:, np.newaxis])
    size_K, size_M = _sizes(K.high, X), _sizes(M, X)
    factor = 4.0 * doubled.roundings(n)
    rounding = factor * (size_K + np.abs(values) * size_M) + EPS * EPS * np.abs(values)
    if K.error is not None:
        magnitudes = np.abs(X)
        unknown = np.linalg.norm(magnitudes.T @ (K.error @ magnitudes), axis=0)
        rounding += _SAFETY * np.asarray(unknown)
    clusters = _clusters(coupling, apart)
    return _Couplings(
        values, values_low, stiffness, mass, coupling, apart, clusters, rounding, np.sqrt(size_M)
    )


def _form(A: Floats, A_low: Floats, X: Floats, low: Floats) -> tuple[Floats, Floats]:
    """Return ``X^T A X`` in two parts."""
    full = np.array(np.diag(A) if A.ndim == 1 else A)  # writable: one signature of the kernel
    Y, Y_low = doubled.product(full, A_low, X, low, False)
    return doubled.product(X.T, low.T, Y, Y_low, True)


def _sizes(A: Floats, X: Floats) -> Floats:
    """Return bounds of the norms of the columns of ``|X|^T |A| |X|``, (mode,)."""
    magnitudes = np.abs(X)
    total = magnitudes.sum(axis=1)
    rows = np.abs(A) * total if A.ndim == 1 else np.abs(A) @ total
    return np.asarray(rows @ magnitudes)


def _clusters(coupling: Floats, apart: Floats) -> Integers | None:
    """Return the numbers of clusters, or None where every mode is alone."""
    blur = np.linalg.norm(coupling, axis=0)
    close = blur + blur[:, np.newaxis] >= _SEPARATES * np.abs(apart)
    np.fill_diagonal(close, False)
    if not close.any():
        return None
    _, numbers = scipy.sparse.csgraph.connected_components(close.astype(np.float64), False)
    return np.asarray(numbers, dtype=np.int64)


def _correction(now: _Couplings) -> Floats:
    """Return E."""
    separate = now.separate
    E = -0.5 * now.mass
    E[separate] = now.coupling[separate] / now.apart[separate]
    return E


def _moved(X: Floats, low: Floats, E: Floats) -> tuple[Floats, Floats]:
    """Return ``X (I + E)`` in two parts."""
    change = X @ E + low if low.size else X @ E
    moved = X + change
    return moved, change - (moved - X)


def _turned(now: _Couplings, X: Floats, low: Floats) -> tuple[Floats, Floats]:
    """Diagonalize the clusters."""
    assert now.clusters is not None
    X, low = X.copy(), low.copy()
    for number in np.flatnonzero(np.bincount(now.clusters) > 1):
        some = np.flatnonzero(now.clusters == number)
        block = np.ix_(some, some)
        part = 0.5 * (now.coupling[block] + now.coupling[block].T)
        # The eigenvalues differ by little: the first is taken from all.
        np.fill_diagonal(part, now.apart[some[0], some])
        _, turn = scipy.linalg.eigh(part)
        X[:, some], low[:, some] = doubled.product(X[:, some], low[:, some], turn, _NONE, False)
    return X, low


def _errors(now: _Couplings, E: Floats) -> tuple[Floats, Floats]:
    """Return the errors of the eigenvalues and of the modes ``X (I + E)``, each (mode,)."""

    def norms(columns: Floats) -> Floats:
        return np.asarray(np.sqrt(np.square(columns).sum(axis=0)))

    size = np.abs(now.values)
    e, m, s = norms(E), norms(now.mass), norms(now.stiffness)
    weighted = norms(np.sqrt(size)[:, np.newaxis] * E)
    steep = norms(size[:, np.newaxis] * E)
    all_e, all_m, all_s, all_w = (float(np.linalg.norm(x)) for x in (e, m, s, weighted))
    largest, n = float(size.max()), size.size
    second = all_w * weighted + all_e * s + all_s * e
    second += size * (all_e * e + all_e * m + all_m * e)
    # Of E itself, and of the product with X.
    rounded = 8.0 * _UNIT * (s + size * (m + e) + steep)
    lost = (n + 2) * _UNIT * (now.weights @ np.abs(E))
    inside = norms(np.where(now.separate, 0.0, now.coupling))
    residual = _SAFETY * (second + rounded + now.rounding + 2.0 * largest * lost) + inside
    mass_error = all_e * (e + m) + all_m * e + doubled.roundings(n) * now.weights**2 + lost
    if now.clusters is not None:
        together = np.zeros(now.clusters.max() + 1)
        np.add.at(together, now.clusters, residual**2)
        residual = np.sqrt(together)[now.clusters]
    gap = np.where(now.separate, np.abs(now.apart), np.inf).min(axis=0)
    free = gap - residual - residual.max()
    with np.errstate(divide="ignore"):
        angles = np.where(free > 0.0, 2.0 * residual / free, np.inf) + mass_error
    sound = all_e < 0.1 and all_m < 0.1
    return (residual, angles) if sound else (residual, np.full(n, np.inf))
