"""Eigenvalues of the monodromy matrix itself, where modes' own multipliers nearly coincide.

The matrix of the linearised motion over one cell, begun just after the first impact, is the
product of the flows of all free motions and of the saltation matrices of the impacts between them
(`multipliers`). LAPACK finds as many eigenvalues as there are, however close they are. With the
eigenvectors V, and ``V^-1 M V = rho + R`` computed factor by factor, the diagonal of R improves
them; what is off the diagonal matters to second order,

    sum_j min(2 |R_ij R_ji| / |rho_i - rho_j|, sqrt |R_ij R_ji|),

which bounds what two values do to one another however close they are, and errors of flows and jumps
to first order, between left and right eigenvectors that have been carried to where they act.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.periodic_motions.pairs import Complexes, Pairs

LARGEST: Final = 1200
"""Rows of matrices whose eigenvalues are computed: some seconds each."""


@dataclass(frozen=True, eq=False, slots=True)
class Factors:
    """The factors of the linearised motion over a cell with m impacts.

    Parameters
    ----------
    flows : array, shape (m, 2, 2, mode)
        Of the free motions after each impact; each mode moves by itself.
    flow_errors : array, shape (m, mode)
        Bounds of their errors in the Euclidean norm.
    forms, kicks : array, shape (m, 2, 2, mode)
        Velocity and position of the struck coordinates; kicks and their rates.
    jumps : array, shape (m, 2, 2)
        ``S = 1 + sum_cb kick_c jump_cb form_b``.
    jump_errors : array, shape (m, 2, 2)
    relative : float
        Error of products of forms and kicks, relative to their terms.
    """

    flows: Floats
    flow_errors: Floats
    forms: Floats
    kicks: Floats
    jumps: Floats
    jump_errors: Floats
    relative: float

    def flow(self, leg: int, z: Any) -> Any:
        """Return states (2, mode, …) after a free motion."""
        return np.einsum("stj,tj...->sj...", self.flows[leg], z)

    def flow_back(self, leg: int, y: Any) -> Any:
        """Return what forms (2, mode, …) of the end of a free motion are at its beginning."""
        return np.einsum("stj,sj...->tj...", self.flows[leg], y)

    def jump(self, impact: int, z: Any) -> Any:
        """Return states after an impact."""
        seen = np.einsum("bsj,sj...->b...", self.forms[impact], z)
        return z + np.tensordot(self.kicks[impact], _product(self.jumps[impact], seen), (0, 0))

    def jump_back(self, impact: int, y: Any) -> Any:
        """Return what forms of the state after an impact are before it."""
        seen = np.einsum("csj,sj...->c...", self.kicks[impact], y)
        return y + np.tensordot(self.forms[impact], _product(self.jumps[impact].T, seen), (0, 0))

    def whole(self, z: Any) -> Any:
        """Return states after the whole cell."""
        for leg in range(len(self.flows)):
            z = self.jump((leg + 1) % len(self.flows), self.flow(leg, z))
        return z

    def doubt(self, right: Complexes, left: Complexes) -> Floats:
        """Return the first-order effect of all errors on eigenvalues, shape (value,).

        right and left, (2, mode, value) each, are eigenvectors whose products are one.
        """
        count = len(self.flows)
        x, steps = right, []
        for leg in range(count):
            moved = self.flow(leg, x)
            steps.append((x, moved))
            x = self.jump((leg + 1) % count, moved)
        y, doubt = left, np.zeros(right.shape[-1])
        for leg in reversed(range(count)):
            impact = (leg + 1) % count
            start, moved = steps[leg]
            forms, kicks = np.abs(self.forms[impact]), np.abs(self.kicks[impact])
            seen = np.einsum("bsj,sjv->bv", self.forms[impact], moved)
            pushed = np.einsum("csj,sjv->cv", self.kicks[impact], y)
            errors = self.jump_errors[impact]
            doubt += np.einsum("cv,cb,bv->v", np.abs(pushed), errors, np.abs(seen))
            seen_size = np.einsum("bsj,sjv->bv", forms, np.abs(moved))
            pushed_size = np.einsum("csj,sjv->cv", kicks, np.abs(y))
            sizes = np.abs(self.jumps[impact])
            doubt += self.relative * np.einsum("cv,cb,bv->v", pushed_size, sizes, np.abs(seen))
            doubt += self.relative * np.einsum("cv,cb,bv->v", np.abs(pushed), sizes, seen_size)
            y = self.jump_back(impact, y)
            lengths = np.linalg.norm(y, axis=0) * np.linalg.norm(start, axis=0)
            doubt += self.flow_errors[leg] @ lengths
            y = self.flow_back(leg, y)
        return doubt


def _product(matrix: Floats, seen: Any) -> Any:
    return np.tensordot(matrix, seen, 1)


def flows(pairs: Pairs, modes: Integers, propagators: Floats) -> Floats:
    """Return propagators (…, 2, pair) of some modes as matrices, shape (…, 2, 2, mode)."""
    even, odd = propagators[..., 0, modes], propagators[..., 1, modes]
    back = odd * np.select(
        [modes < pairs.rotations.stop, modes < pairs.hyperbolas.stop], [-1.0, 1.0], 0.0
    )
    return np.stack([np.stack([even, odd], axis=-2), np.stack([back, even], axis=-2)], axis=-3)


def eigenvalues(factors: Factors) -> tuple[Complexes, Floats]:
    """Return all multipliers, shape (2 mode,), by descending modulus, and their errors.

    They are nan where there is no basis of eigenvectors.
    """
    modes = factors.forms.shape[-1]
    size = 2 * modes
    matrix = factors.whole(np.eye(size).reshape(2, modes, size)).reshape(size, size)
    none = np.full(size, np.nan, dtype=np.complex128), np.full(size, np.inf)
    if not np.isfinite(matrix).all():
        return none
    try:
        rough, vectors = np.linalg.eig(matrix)
        inverse = np.linalg.inv(vectors)
    except np.linalg.LinAlgError:
        return none
    values, right = rough.astype(np.complex128), vectors.astype(np.complex128)
    moved = factors.whole(right.reshape(2, modes, size)).reshape(size, size)
    R = inverse @ (moved - right * values)
    values = values + np.where(values.imag == 0.0, R.diagonal().real, R.diagonal())
    np.fill_diagonal(R, 0.0)
    apart = np.abs(values[:, np.newaxis] - values)
    np.fill_diagonal(apart, np.inf)
    sizes = np.abs(R)
    with np.errstate(divide="ignore", invalid="ignore"):
        both = np.where(sizes * sizes.T == 0.0, 0.0, 2.0 * sizes * sizes.T / apart)
    errors = np.minimum(np.sqrt(sizes * sizes.T), both).sum(axis=1)
    left = inverse.T.astype(np.complex128).reshape(2, modes, size)
    # Eigenvectors of what has decayed may be almost parallel, and products of their inverse without
    # bound: then nothing is known of these multipliers.
    with np.errstate(over="ignore", invalid="ignore"):
        errors += factors.doubt(right.reshape(2, modes, size), left) + 4.0 * EPS * np.abs(values)
    errors = np.where(np.isnan(errors), np.inf, errors)
    order = np.argsort(-np.abs(values), kind="stable")
    return values[order], errors[order]
