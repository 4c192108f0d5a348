"""Smaller models: static condensation, Guyan's and Craig and Bampton's reduction.

All are ``x = T q`` with reduced matrices ``T' M T`` and ``T' K T``. The degrees of freedom that are
kept, those with limiters above all, remain degrees of freedom of the reduced model. With s the
kept ones and i the others,

    x_i = -K_ii^-1 K_is x_s                   Guyan: exact at rest
    x_i = -K_ii^-1 K_is x_s + Phi q           Craig-Bampton: and the lowest modes with s fixed

Where a structure can still move as a rigid body while s is fixed, K_ii has no inverse: these
motions belong to every reduction, as the first of the modes, and the shapes of the kept degrees of
freedom are orthogonal to them in M.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import cast

import numpy as np
import scipy.linalg

from vibroimpact.models import cholesky
from vibroimpact.models.flexibility import (
    INDEPENDENT,
    RIGID,
    Flexibility,
    MasslessMotion,
    no_rigid_body_modes,
    rigid_body_modes,
    unit_stiffness,
)
from vibroimpact.models.model import Model
from vibroimpact.models.reduced import Reduction
from vibroimpact.models.reduced_model import ReducedModel, Whole
from vibroimpact.models.static_solvers import flexibilities
from vibroimpact.models.whole_system import base_displacements
from vibroimpact.tables import Array
from vibroimpact_schema.files.labels import Label


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
    return _reduced(model, np.flatnonzero(~massless), 0, 0, None)


def reduce(
    model: Model,
    keep: Iterable[Label | int],
    modes: int = 0,
    compare: int | None = None,
    rigid: int | None = None,
) -> Reduction:
    """Return a smaller model that keeps some degrees of freedom.

    Motions of rigid bodies that a structure has although these are fixed are always part of it: a
    free beam of which one deflection is kept has one more degree of freedom, and the mass, moment
    of inertia and natural frequencies 0 of the whole beam.

    Parameters
    ----------
    model : Model
        The whole model.
    keep : iterable of (int, str) or of int
        Labels of the degrees of freedom to keep: those with limiters and loads. Of a model without
        nodes their numbers, counted from 0.
    modes : int
        How many of the lowest elastic modes with these held fixed are added (Craig and Bampton);
        0 is Guyan's reduction.
    compare : int, optional
        How many of the lowest natural frequencies get an error; default: half of all. For
        responses at the stops see `Reduction.compare`.
    rigid : int, optional
        Number of rigid-body modes of the whole structure, 6 for a free one in space; default: as
        K tells. To be given where K was rounded, as in files with few digits, or where springs are
        so soft that a warning asks.

    Raises
    ------
    ValueError
        If a label does not exist, there are fewer modes, or some degrees of freedom can move
        without mass and stiffness.

    Warns
    -----
    UserWarning
        If K nearly has more rigid-body modes than it has to rounding.
    """
    kept = np.array(sorted({_row(model, label) for label in keep}), dtype=np.int64)
    if kept.size + modes > model.n:
        raise ValueError(f"{kept.size} kept and {modes} modes are more than {model.n}")
    return _reduced(model, kept, modes, compare, rigid)


def _row(model: Model, label: Label | int) -> int:
    """Return the row of a degree of freedom that is to be kept."""
    if model.numbered and isinstance(label, int | np.integer):
        return model.dof(int(label))
    if isinstance(label, str) or np.shape(label) != (2,):
        raise TypeError(f'keep must be pairs such as (17, "z"), node and direction, not {label!r}')
    node, direction = cast("Label", label)
    return model.dof(node, direction)


def _reduced(
    model: Model, kept: Array, modes: int, compare: int | None, rigid: int | None
) -> Reduction:
    R, definite, factors = _rigid(model, kept, rigid)
    moved = R[kept] / unit_stiffness(model.K)[kept, np.newaxis]
    held, turned = _held(moved, model.n)
    others = np.setdiff1d(np.arange(model.n), kept)
    T = np.zeros((model.n, kept.size + held + modes))
    T[kept, np.arange(kept.size)] = 1.0
    first = kept.size + held
    try:
        whole, flexible = flexibilities(
            model, kept, R, R[others] @ turned[:, :held], factors, definite=definite
        )
        if flexible is not None:
            T[others, : kept.size] = flexible.solve(-model.K[others][:, kept].toarray())
            T[others, kept.size : first] = flexible.R
            T[others, first:] = _modes(flexible, modes)
    except MasslessMotion as massless:
        motion = massless.motion
        if motion.size < model.n:
            motion = np.zeros(model.n)
            motion[others] = massless.motion
        raise _massless(model, motion) from None
    bodies = T[:, kept.size : first]
    T[:, : kept.size] -= bodies @ (bodies.T @ (model.M @ T[:, : kept.size]))
    M = _mean(T.T @ (model.M @ T))
    C = None if model.C is None else _mean(T.T @ (model.C @ T))
    K = _stiffness(model, T, kept, first, moved @ turned[:, held:])
    labels: Sequence[Label] = [
        *(model.labels[row] for row in kept), *((mode, "mode") for mode in range(held + modes))
    ]  # fmt: skip
    base = {
        each: base_displacements(M, T.T @ (model.M @ moved))
        for each, moved in _influences(model).items()
    }
    motions = np.concatenate([R[kept], bodies.T @ (model.M @ R), np.zeros((modes, R.shape[1]))])
    small = ReducedModel(
        M, K, C, labels, model.coordinates, model.units,
        base=base, T=T, whole=Whole(model, R), motions=motions,
    )  # fmt: skip
    count = max(1, small.n // 2) if compare is None else min(compare, small.n)
    Omega, error = _errors(whole, small, T, motions, definite, count)
    return Reduction(small, T, Omega, error, kept.size, held, model, motions)


def _rigid(
    model: Model, kept: Array, rigid: int | None
) -> tuple[Array, bool, cholesky.Factors | None]:
    """Return rigid-body modes, whether K is semidefinite, and factors of K where it is definite.

    These factors serve all that follows, so that a large supported structure has one set of them.
    """
    if model.n < cholesky.LARGE or rigid:
        return *rigid_body_modes(model.K, rigid, model.places), None
    try:
        factors = cholesky.Factors(model.K, kept, model.places)
        if rigid == 0 or no_rigid_body_modes(model.K, factors):
            return np.zeros((model.n, 0)), True, factors
    except cholesky.NotDefinite:
        pass  # as of a structure that is free, to rounding
    return *rigid_body_modes(model.K, rigid, model.places), None


def _modes(flexible: Flexibility, count: int) -> Array:
    """Return the lowest modes of the part that is not kept."""
    if count == 0:
        return np.zeros((flexible.K.shape[0], 0))
    _, shapes = flexible.modes(count)
    if shapes.shape[1] < count:
        raise ValueError(f"{count} modes are more than the {shapes.shape[1]} that have mass")
    return shapes


def _held(moved: Array, n: int) -> tuple[int, Array]:
    """Return how many combinations of rigid-body modes leave the kept ones at rest, and all.

    Parameters
    ----------
    moved : array, shape (kept, rigid)
        Displacements of the kept degrees of freedom by rigid-body modes of unit size.
    n : int
        All degrees of freedom.

    Returns
    -------
    int
        How many.
    array, shape (rigid, rigid)
        Combinations of rigid-body modes, these first.
    """
    rigid = moved.shape[1]
    if not moved.size:
        return rigid, np.eye(rigid)
    _, sizes, turned = scipy.linalg.svd(moved, full_matrices=True)
    rank = int((sizes > INDEPENDENT / np.sqrt(n)).sum())
    return rigid - rank, turned[::-1].T


def _influences(model: Model) -> dict[str, Array]:
    """Return the displacements by a unit displacement of the base in each direction of a model."""
    directions = model.base or dict.fromkeys(each for _, each in model.labels)
    return {each: model.influence(each) for each in directions}


def _mean(matrix: Array) -> Array:
    """Return a matrix that is symmetric but for rounding as one that is symmetric."""
    return 0.5 * (matrix + matrix.T)


def _stiffness(model: Model, T: Array, kept: Array, first: int, moving: Array) -> Array:
    """Return T' K T, with the zeros that it has without rounding.

    Static shapes and modes are orthogonal in K, and motions of rigid bodies have no energy.

    Parameters
    ----------
    model : Model
        The whole model.
    T : array, shape (dof, reduced dof)
        Static shapes, motions of rigid bodies with the kept ones at rest, and from `first` on
        elastic modes.
    kept : array of int
        The kept degrees of freedom.
    first : int
        As said.
    moving : array, shape (kept, independent)
        Their displacements by the other motions of rigid bodies, in units of equal stiffness.
    """
    static, elastic = T[:, : kept.size], T[:, first:]
    K = np.zeros((T.shape[1], T.shape[1]))
    K[first:, first:] = _mean(elastic.T @ (model.K @ elastic))
    S = _mean(static.T @ (model.K @ static))
    if moving.size:
        unit = np.outer(*[unit_stiffness(model.K)[kept]] * 2)
        axes, _, _ = scipy.linalg.svd(moving, full_matrices=False)
        elastic_part = np.eye(kept.size) - axes @ axes.T
        S = _mean(elastic_part @ (S * unit) @ elastic_part) / unit
        terms = np.sum(np.abs(static) * (abs(model.K) @ np.abs(static)), axis=0)
        without_energy = (moving.shape[1] == kept.size) | (np.diagonal(S) <= RIGID * terms)
        S[without_energy] = S[:, without_energy] = 0.0
    K[: kept.size, : kept.size] = S
    return K


def _errors(
    whole: Flexibility | None, small: Model, T: Array, bodies: Array, definite: bool, count: int
) -> tuple[Array, Array]:
    """Return the lowest natural frequencies of the reduced model, and bounds of their errors.

    Parameters
    ----------
    whole : Flexibility
        Of the whole model; None: nothing is compared.
    small : Model
        The reduced model.
    T : array, shape (dof, reduced dof)
        Displacements of the whole model.
    bodies : array, shape (reduced dof, rigid)
        Motions of rigid bodies of the reduced model.
    definite : bool
        Whether the stiffness of the whole model is positive semidefinite.
    count : int
        How many frequencies.
    """
    if whole is None or count == 0:
        return np.zeros(0), np.zeros(0)
    rigid = min(count, bodies.shape[1])
    squares, shapes = Flexibility(small.K, small.M, bodies).modes(count - rigid)
    x = T @ shapes
    Omega = np.concatenate([np.zeros(rigid), np.sqrt(np.maximum(squares, 0.0))])
    if not definite:
        return Omega, np.full(Omega.size, np.nan)
    residual, size = whole.K @ x - (whole.M @ x) * squares, np.sum(x * (whole.K @ x), axis=0)
    products = np.sum(residual * whole.elastic(residual), axis=0)
    apart = np.sqrt(np.maximum(products, 0.0) / size)
    # |Omega/Omega_j - 1| <= 1 - sqrt(1 - d) where |Omega^2/lambda_j - 1| <= d < 1
    error = np.where(apart < 1.0, 1.0 - np.sqrt(1.0 - np.minimum(apart, 1.0)), apart)
    return Omega, np.concatenate([np.zeros(rigid), error])


def _massless(model: Model, motion: Array) -> ValueError:
    """Return the error that names what can move without mass and stiffness."""
    share = np.abs(motion / unit_stiffness(model.K))
    rows = np.argsort(-share, kind="stable")[:3]
    moving = [f"node {model.labels[row][0]} {model.labels[row][1]}" for row in rows
              if share[row] > 0.1 * share[rows[0]]]  # fmt: skip
    return ValueError(
        f"{', '.join(moving)} can move without mass and without stiffness: fix it with "
        "Model.fixed, or give it one of them"
    )
