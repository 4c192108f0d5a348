"""Flexibilities of a model with its kept degrees of freedom held and without, by one factor."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vibroimpact.models import cholesky
from vibroimpact.models.flexibility import Flexibility, Solver, anchors
from vibroimpact.models.model import Model
from vibroimpact.tables import Array


def flexibility(model: Model, R: Array) -> Flexibility:
    """Return the flexibility of a model with motions R of rigid bodies, shape (dof, rigid)."""
    factors, none = None, np.zeros(0, dtype=np.int64)
    if model.n >= cholesky.LARGE:
        factors = _factors(model, none, R, np.arange(model.n), R)
    return Flexibility(model.K, model.M, R, _solver(factors, none, None, model.n))


def flexibilities(
    model: Model,
    kept: Array,
    R: Array,
    bodies: Array,
    factors: cholesky.Factors | None = None,
    *,
    definite: bool = True,
) -> tuple[Flexibility, Flexibility | None]:
    """Return the flexibility of a model, and that with some degrees of freedom held.

    Parameters
    ----------
    model : Model
    kept : array of int
        The degrees of freedom that are held.
    R : array, shape (dof, rigid)
        Motions of rigid bodies.
    bodies : array, shape (other, rigid)
        Those of them that leave the kept ones at rest, of all others.
    factors : Factors, optional
        Of K; default: large models get theirs here.
    definite : bool
        Whether K is positive semidefinite, to be tried if it is not known.

    Returns
    -------
    Flexibility
    Flexibility or None
        None where no other degree of freedom is left.

    Raises
    ------
    MasslessMotion
        If a rigid body has no mass; of the others alone, its motion has their size.
    """
    others = np.setdiff1d(np.arange(model.n), kept)
    if factors is None and model.n >= cholesky.LARGE and definite:
        factors = _factors(model, kept, R, others, bodies)
    whole = Flexibility(model.K, model.M, R, _solver(factors, kept, None, model.n))
    if not others.size:
        return whole, None
    K, M = (part[others][:, others] for part in (model.K, model.M))
    return whole, Flexibility(K, M, bodies, _solver(factors, kept, others, model.n))


def _factors(
    model: Model, kept: Array, R: Array, others: Array, bodies: Array
) -> cholesky.Factors | None:
    """Return factors of K that serve with the kept degrees of freedom held and without."""
    inner = model.K[others][:, others]
    held = [kept, anchors(model.K, R), others[anchors(inner, bodies)]]
    try:
        return cholesky.Factors(model.K, np.unique(np.concatenate(held)), model.places)
    except cholesky.NotDefinite:
        return None  # some motion is held by rounding alone, which the others say


def _solver(
    factors: cholesky.Factors | None, kept: Array, others: Array | None, n: int
) -> Solver | None:
    """Return the solver of all degrees of freedom, or of the others with the kept ones held."""
    if factors is None:
        return None

    def solver(held: Array) -> Callable[[Array], Array]:
        if others is None:
            return lambda f: factors.solve(f, held)
        zero = np.concatenate([kept, others[held]])

        def solve(f: Array) -> Array:
            whole = np.zeros((n, *f.shape[1:]))
            whole[others] = f
            x: Array = factors.solve(whole, zero)[others]
            return x

        return solve

    return solver
