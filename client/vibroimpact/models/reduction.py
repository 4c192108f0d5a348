"""Smaller models: static condensation, Guyan's and Craig and Bampton's reduction.

All are ``x = T q`` with reduced matrices ``T' M T`` and ``T' K T``. The degrees of freedom that are
kept, those with limiters above all, remain degrees of freedom of the reduced model. With s the
kept ones and i the others,

    x_i = -K_ii^-1 K_is x_s                   Guyan: exact at rest
    x_i = -K_ii^-1 K_is x_s + Phi q           Craig-Bampton: and the lowest modes with s fixed

"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sparse
import scipy.sparse.linalg

from vibroimpact.models.model import Label, Model
from vibroimpact.tables import Array


@dataclass(frozen=True, eq=False)
class Reduction:
    """A reduced model and what it leaves out.

    Parameters
    ----------
    model : Model
        The reduced model; kept degrees of freedom keep their labels, modes are ``(j, "mode")``.
    T : array, shape (dof, reduced dof)
        Displacements of the whole model by those of the reduced one.
    Omega : array, shape (mode,)
        Natural frequencies of the reduced model that were compared.
    error : array, shape (mode,)
        Upper bounds of their distances from the nearest natural frequency of the whole model,
        relative to that one: ``|Omega^2/lambda - 1| <= |K x - Omega^2 M x| / |x|``, the first
        norm that of K^-1, the second that of K; roundings are left out. nan if K is singular.
    """

    model: Model
    T: Array
    Omega: Array
    error: Array

    def expand(self, q: Array) -> Array:
        """Return displacements of the whole model, shape (..., dof)."""
        return np.asarray(q) @ self.T.T


def condense(model: Model) -> Reduction:
    """Return the model without the degrees of freedom that have no mass.

    They follow the others statically, ``x_0 = -K_00^-1 K_0s x_s``, which is exact for a model
    without damping.

    Raises
    ------
    ValueError
        If a part without mass is not held by springs.
    """
    rows = np.asarray(abs(model.M).sum(axis=1)).ravel()
    massless = rows <= 1e-14 * rows.max(initial=0.0)
    return _reduced(model, np.flatnonzero(~massless), 0, 0)


def reduce(
    model: Model, keep: Iterable[Label], modes: int = 0, compare: int | None = None
) -> Reduction:
    """Return a smaller model that keeps some degrees of freedom.

    Parameters
    ----------
    model : Model
        The whole model.
    keep : iterable of (int, str)
        Labels of the degrees of freedom to keep: those with limiters and loads.
    modes : int
        How many of the lowest modes with these held fixed are added (Craig and Bampton); 0 is
        Guyan's reduction.
    compare : int, optional
        How many of the lowest natural frequencies get an error; default: half of all.

    Raises
    ------
    ValueError
        If a label does not exist, or there are fewer modes.
    """
    kept = np.array(sorted(model.dof(*label) for label in keep), dtype=np.int64)
    if kept.size + modes > model.n:
        raise ValueError(f"{kept.size} kept and {modes} modes are more than {model.n}")
    size = kept.size + modes
    return _reduced(model, kept, modes, max(1, size // 2) if compare is None else compare)


def _reduced(model: Model, kept: Array, modes: int, compare: int) -> Reduction:
    others = np.setdiff1d(np.arange(model.n), kept)
    T = np.zeros((model.n, kept.size + modes))
    T[kept, np.arange(kept.size)] = 1.0
    if others.size:
        inner = sparse.csc_array(model.K[others][:, others])
        try:
            solve = scipy.sparse.linalg.splu(inner).solve
        except RuntimeError:
            raise ValueError("the degrees of freedom left out are not held by springs") from None
        T[others, : kept.size] = -solve(model.K[others][:, kept].toarray())
        if modes:
            T[others, kept.size :] = _lowest(inner, model.M[others][:, others], modes)
    M, K = (T.T @ (part @ T) for part in (model.M, model.K))
    C = None if model.C is None else T.T @ (model.C @ T)
    labels: Sequence[Label] = [
        *(model.labels[row] for row in kept), *((mode, "mode") for mode in range(modes))
    ]  # fmt: skip
    small = Model(M, K, C, labels, model.coordinates, model.units)
    Omega, error = _errors(model, T, M, K, compare)
    return Reduction(small, T, Omega, error)


def _lowest(K: Any, M: Any, count: int) -> Array:
    """Return the lowest modes, orthonormal in M, shape (dof, mode)."""
    if count < K.shape[0] - 1 and K.shape[0] > 200:
        start = np.random.default_rng(0).normal(size=K.shape[0])
        _, shapes = scipy.sparse.linalg.eigsh(K, count, M, sigma=0.0, v0=start)
    else:
        _, shapes = scipy.linalg.eigh(K.toarray(), M.toarray(), subset_by_index=[0, count - 1])
    return np.asarray(shapes)


def _errors(model: Model, T: Array, M: Array, K: Array, count: int) -> tuple[Array, Array]:
    """Return the lowest natural frequencies of the reduced model, and bounds of their errors."""
    if count == 0:
        return np.zeros(0), np.zeros(0)
    squares, shapes = scipy.linalg.eigh(K, M, subset_by_index=[0, min(count, len(K)) - 1])
    x = T @ shapes
    Omega = np.sqrt(np.maximum(squares, 0.0))
    residual, size = model.K @ x - (model.M @ x) * squares, np.sum(x * (model.K @ x), axis=0)
    try:
        solve = scipy.sparse.linalg.splu(sparse.csc_array(model.K)).solve
    except RuntimeError:
        return Omega, np.full(Omega.size, np.nan)
    apart = np.sqrt(np.maximum(np.sum(residual * solve(residual), axis=0), 0.0) / size)
    # |Omega/Omega_j - 1| <= 1 - sqrt(1 - d) where |Omega^2/lambda_j - 1| <= d < 1
    return Omega, np.where(apart < 1.0, 1.0 - np.sqrt(1.0 - np.minimum(apart, 1.0)), apart)
