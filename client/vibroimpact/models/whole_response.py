"""Harmonic responses of a whole model, to a stated residual, by one factor of its stiffness.

The responses ``x`` at angular frequencies Omega, ``(K + i Omega C - Omega^2 M) x = f``, are sought
in a subspace: that of a reduction, and vectors ``E`` with the kept degrees of freedom at rest. What
the equations lack there, the residuals r, tells what is missing: ``K^-1 r`` joins the subspace, for
all frequencies and forces at once, until

    |r| / |x| <= 1e-8 ,   |r|^2 = r' K^-1 r ,   |x|^2 = x' (K + Omega^2 M) x .

x then solves exactly the equations of a model whose dynamic stiffness differs by that part, in the
norm of K + Omega^2 M: it is an answer of the whole model, however few the vectors are. Each round
multiplies the residuals by some Omega^2/Omega_j^2 of the next mode that is not in the subspace.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.linalg

from vibroimpact.models.flexibility import Flexibility, unit_stiffness
from vibroimpact.models.whole_system import Side
from vibroimpact.tables import Array

CLOSE: Final = 1e-8
"""Relative residual at which the search ends."""
_ROUNDS: Final = 60
_SMALL: Final = 1e-4
"""Below it a round that does not halve the residual is the last: what is left is rounding."""
_AT_ONCE: Final = 40
"""Vectors that join in a round at most."""
_NEGLIGIBLE: Final = 1e-6
"""Part of the largest residual below which a direction waits for the next round."""
_DEPENDENT: Final = 1e-10
"""Energy of a vector of unit energy beside others below which it depends on them."""


@dataclass(frozen=True, eq=False)
class Subspace:
    """A subspace that has the responses of a whole model.

    Parameters
    ----------
    V : array, shape (dof, vector)
        Static shapes and motions of rigid bodies of the reduction, then others.
    M, C, K : array, shape (vector, vector)
        The model in it.
    x : array, shape (frequency, vector, force), complex
        The responses.
    residual : array, shape (frequency,)
        The largest relative one of all forces.
    """

    V: Array
    M: Array
    C: Array
    K: Array
    x: Array
    residual: Array


def responses(M: Array, C: Array, K: Array, F: Array, Omega: Array) -> Array:
    """Return the responses of small matrices to forces, shape (frequency, vector, force).

    Raises
    ------
    ValueError
        Where there is none, as in an undamped resonance.
    """
    x = np.zeros((Omega.size, *F.shape), dtype=np.complex128)
    for place, turning in enumerate(Omega):
        try:
            x[place] = np.linalg.solve(K + 1j * turning * C - turning**2 * M, F)
        except np.linalg.LinAlgError:
            raise ValueError(
                f"frequency: Omega = {float(turning)!r} is a natural frequency without damping"
            ) from None
    return x


def subspace(
    side: Side, flexible: Flexibility | None, first: int, F: Array, Omega: Array
) -> Subspace:
    """Return a subspace with the responses of the whole model.

    Parameters
    ----------
    side : Side
        The whole model and its damping.
    flexible : Flexibility, optional
        Of the degrees of freedom that are not kept; None: there are none.
    first : int
        Columns of T before the elastic modes.
    F : array, shape (dof, force)
        Forces.
    Omega : array, shape (frequency,)
        Angular frequencies, not 0.

    Raises
    ------
    ValueError
        If the stiffness is not positive semidefinite.
    """
    others = np.setdiff1d(np.arange(side.whole.n), side.rows)
    E, last = side.T[others, first:], np.inf
    for _ in range(_ROUNDS):
        if flexible is not None:
            E = _independent(flexible, E)
        V = np.zeros((side.whole.n, first + E.shape[1]))
        V[:, :first], V[others, first:] = side.T[:, :first], E
        products = side.whole.K @ V, side.damped(V), side.whole.M @ V
        K, C, M = (_symmetric(V.T @ each) for each in products)
        space = Subspace(V, M, C, K, responses(M, C, K, V.T @ F, Omega), np.zeros(Omega.size))
        if flexible is None:
            return space
        terms = np.hstack([part[others] for part in (F, *products)])
        X, space.residual[:] = _corrections(flexible, terms, space, Omega)
        largest = space.residual.max(initial=0.0)
        if largest <= CLOSE or 0.5 * last < largest <= _SMALL:
            return space
        E, last = np.hstack([E, X]), largest
    return space


def _corrections(
    flexible: Flexibility, terms: Array, space: Subspace, Omega: Array
) -> tuple[Array, Array]:
    """Return displacements by the residuals, and how large these are at each frequency.

    Parameters
    ----------
    flexible : Flexibility
    terms : array, shape (other, term)
        Forces, and those of K, C and M by the vectors: the residuals are their sums.
    space : Subspace
    Omega : array, shape (frequency,)
    """
    x, turning = space.x, Omega[:, np.newaxis, np.newaxis]
    forces = np.broadcast_to(np.eye(x.shape[2]), (Omega.size, *2 * x.shape[2:]))
    weights = np.concatenate([forces, -x, -1j * turning * x, turning**2 * x], axis=1)
    norm = space.K + turning**2 * space.M
    sizes = np.sqrt(np.maximum(np.sum(x.conj() * (norm @ x), axis=1).real, 0.0))
    weights /= np.where(sizes > 0.0, sizes, np.inf)[:, np.newaxis]
    several = np.moveaxis(weights, 1, 0).reshape(weights.shape[1], -1)
    # In forces that make unit displacements of springs, directions are told apart by their size.
    scale = unit_stiffness(flexible.K)[:, np.newaxis]
    axes, upper = np.linalg.qr(scale * terms)
    U, s, parts = np.linalg.svd(
        upper @ np.hstack([several.real, several.imag]), full_matrices=False
    )
    count = min(_AT_ONCE, int((s > _NEGLIGIBLE * s[0]).sum())) if s[0] > 0.0 else 0
    forces = (axes @ U[:, :count]) / scale
    X = flexible.elastic(forces)
    amounts = s[:count, np.newaxis] * parts[:count]
    squares = np.sum(amounts * ((forces.T @ X) @ amounts), axis=0).reshape(2, *sizes.shape)
    return X, np.sqrt(np.maximum(squares.sum(axis=0), 0.0)).max(axis=1, initial=0.0)


def _independent(flexible: Flexibility, E: Array) -> Array:
    """Return vectors of unit energy that span the same, orthogonal in K and in M."""
    if not E.shape[1]:
        return E
    G = E.T @ (flexible.K @ E)
    energies = np.diagonal(G)
    if energies.min() < -_NEGLIGIBLE * energies.max():
        raise ValueError("the stiffness of the model is not positive semidefinite")
    some = energies > 0.0
    E, size = E[:, some], 1.0 / np.sqrt(energies[some])
    values, turned = scipy.linalg.eigh(_symmetric(G[np.ix_(some, some)] * np.outer(size, size)))
    kept = values > _DEPENDENT
    E = E @ (size[:, np.newaxis] * turned[:, kept] / np.sqrt(values[kept]))
    _, turned = scipy.linalg.eigh(_symmetric(E.T @ (flexible.M @ E)))
    independent: Array = E @ turned[:, ::-1]
    return independent


def _symmetric(matrix: Array) -> Array:
    return 0.5 * (matrix + matrix.T)
