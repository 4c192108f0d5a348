"""Motions of rigid bodies, and the elastic modes beside them, of supported and free structures.

Rigid-body modes R are the null space of K, which is positive semidefinite. Where there are some, K
has no inverse, but K x = f has solutions for every f that is in equilibrium, R' f = 0: one of them
has as many displacements held at zero as there are rigid-body modes, and no force there. With M
orthonormal R and P = 1 - R R' M, the flexibility P K^- P' is that of the structure without rigid
bodies' motions, whichever displacements were held; its eigenvalues in M are 1/Omega_j^2.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import scipy.linalg
import scipy.sparse as sparse
import scipy.sparse.linalg

from vibroimpact.models import cholesky
from vibroimpact.tables import Array

_DENSE: Final = 200
"""Size up to which all modes are computed at once."""
_SHIFT: Final = 1e-12
"""Added to the diagonal of the scaled K: above rounding, below elastic modes."""
RIGID: Final = 1e-14
"""Energy of a rigid-body mode relative to the sum of its terms: some roundings of the entries."""
_NEARLY: Final = 1e-7
"""The same of modes that are rigid if K was rounded to seven digits."""
_SUSPECT: Final = 10.0 * _NEARLY
"""Above this energy no motion is suspected of being rigid."""
_SURE: Final = 1e-11
"""Energies above it, of solutions with factors of K, are no roundings."""
_TRIED: Final = 8
"""Modes that are looked at."""
_ROUNDED: Final = 1e-5
"""Up to this, a negative energy is the rounding of a rigid-body mode."""
_GAP: Final = 1e3
"""So much lies between such modes and the next one: ratio of their energies."""
INDEPENDENT: Final = 1e-6
"""Singular values below this, relative to the largest, are taken for zero: in vectors of unit
size with errors of at most some 1e-8."""
_MASSLESS: Final = 1e-12
"""Share of the diagonal of R' M R below which a combination of R has no mass."""


Solver = Callable[[Any], Callable[[Array], Array]]
"""Rows that are held at zero -> function that returns the displacements of forces."""


def rigid_body_modes(
    K: Any, count: int | None = None, places: Array | None = None
) -> tuple[Array, bool]:
    """Return the motions without elastic energy, and whether K is positive semidefinite.

    Parameters
    ----------
    K : sparse matrix, shape (n, n)
        Stiffness.
    count : int, optional
        How many there are; default: as K tells, to rounding.
    places : array, shape (n, dimension), optional
        Where degrees of freedom lie, which saves time with large models.

    Returns
    -------
    array, shape (n, count)
        Orthonormal where displacements are scaled to unit stiffness.
    bool
        Whether no displacement has negative energy, rigid-body modes left out.
    """
    scale = unit_stiffness(K)
    scaled = sparse.csc_array(sparse.diags_array(scale) @ K @ sparse.diags_array(scale))
    n = scaled.shape[0]
    shifted = sparse.csc_array(scaled + _SHIFT * sparse.eye_array(n))
    solve, negative = _shifted(shifted, places)
    definite = negative == 0
    tried = _TRIED if count is None else count + 1
    while True:
        values, shapes = _nearest_to_zero(scaled, solve, min(tried, n))
        terms = _terms(scaled, shapes)
        energies = np.divide(np.abs(values), terms, out=np.zeros_like(values), where=terms > 0.0)
        rigid = int((energies <= RIGID).sum()) if count is None else min(count, n)
        if rigid < len(values) or len(values) == n:
            break
        tried *= 2
    if count is None:
        _warn_of_rounding(np.sign(values) * energies, rigid)
    elif not definite:  # roundings of rigid-body modes have either sign
        definite = int((values[:rigid] < 0.0).sum()) >= negative
    return scale[:, np.newaxis] * shapes[:, :rigid], definite


def _shifted(A: Any, places: Array | None) -> tuple[Callable[[Array], Array], float]:
    """Return a function that solves, and how many eigenvalues of A are negative.

    nan where pivots are not on the diagonal, so that they do not tell.
    """
    if A.shape[0] >= cholesky.LARGE:
        try:
            return cholesky.Factors(A, (), places).solve, 0
        except cholesky.NotDefinite:
            pass  # which the others do not need
    factors = scipy.sparse.linalg.splu(
        A, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    if not (factors.perm_r == factors.perm_c).all():
        return factors.solve, float("nan")
    # Pivots on the diagonal have the signs of the eigenvalues (Sylvester).
    return factors.solve, int((factors.U.diagonal() <= 0.0).sum())


def no_rigid_body_modes(K: Any, factors: cholesky.Factors) -> bool:
    """Return whether all motions have energy, far beyond rounding, and none stands apart.

    Parameters
    ----------
    K : sparse matrix, shape (n, n)
        Stiffness.
    factors : Factors
        Of K.
    """
    scale = unit_stiffness(K)
    scaled = sparse.csc_array(sparse.diags_array(scale) @ K @ sparse.diags_array(scale))
    n = K.shape[0]

    def inverse(f: Array) -> Array:
        solution: Array = factors.solve(f.ravel() / scale) / scale
        return solution

    def energies(count: int, tolerance: float, vectors: int) -> Array:
        _, shapes = scipy.sparse.linalg.eigsh(
            scaled, count, sigma=0.0, OPinv=operator, v0=start, ncv=vectors, tol=tolerance
        )
        own = np.sum(shapes * (scaled @ shapes), axis=0)
        return np.sort(own / _terms(scaled, shapes))

    start = np.random.default_rng(0).normal(size=n)
    operator = scipy.sparse.linalg.LinearOperator((n, n), matvec=inverse, dtype=np.float64)
    (lowest,) = energies(1, 1e-2, 8)  # it tells of all
    if lowest > _SUSPECT:
        return True
    if lowest <= _SURE:
        return False
    # A fine mesh of a slender structure: the next ones tell whether the first stand apart.
    return _nearly_rigid(energies(_TRIED, 1e-3, 20), 0) == 0


def _terms(scaled: Any, shapes: Array) -> Array:
    """Return the sums of the sizes of all terms of the energies of shapes."""
    sums: Array = np.sum(np.abs(shapes) * (abs(scaled) @ np.abs(shapes)), axis=0)
    return sums


def unit_stiffness(K: Any) -> Array:
    """Return what displacements are divided by so that K has ones on its diagonal."""
    diagonal = np.asarray(K.diagonal())
    return 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))


def _nearest_to_zero(scaled: Any, solve: Any, count: int) -> tuple[Array, Array]:
    """Return the eigenvalues of least size and their vectors, sorted by size."""
    n = scaled.shape[0]
    if n <= _DENSE or count >= n - 1:
        values, shapes = scipy.linalg.eigh(scaled.toarray())
    else:
        inverse = scipy.sparse.linalg.LinearOperator((n, n), matvec=solve, dtype=np.float64)
        start = np.random.default_rng(0).normal(size=n)
        values, shapes = scipy.sparse.linalg.eigsh(
            scaled, count, sigma=-_SHIFT, OPinv=inverse, v0=start
        )
    order = np.argsort(np.abs(values), kind="stable")[:count]
    return values[order], shapes[:, order]


def _nearly_rigid(energies: Array, rigid: int) -> int:
    """Return how many modes are nearly rigid, and far from the next mode."""
    small = energies[rigid:]
    sizes = np.abs(small)
    for nearly in range(int((sizes <= _ROUNDED).sum()), 0, -1):
        apart = nearly < len(small) and sizes[nearly] >= _GAP * sizes[nearly - 1]
        if apart and (sizes[nearly - 1] <= _NEARLY or small[:nearly].min() < 0.0):
            return nearly
    return 0


def _warn_of_rounding(energies: Array, rigid: int) -> None:
    """Warn of modes that are nearly rigid, and far from the next mode."""
    nearly = _nearly_rigid(energies, rigid)
    if nearly:
        warnings.warn(
            f"K nearly has {rigid + nearly} rigid-body modes instead of {rigid}: the energy of "
            f"the others is {abs(energies[rigid + nearly - 1]):.1g} of its terms. If that is the "
            f"rounding of K, as of files with few digits, say rigid={rigid + nearly}; if it is "
            f"that of soft springs, rigid={rigid}",
            UserWarning,
            stacklevel=5,
        )


class Flexibility:
    """The flexibility of a structure without the motions of rigid bodies.

    Parameters
    ----------
    K, M : sparse matrix, shape (n, n)
        Stiffness, positive semidefinite but for R, and mass.
    R : array, shape (n, rigid)
        Rigid-body modes, independent.
    solver : callable, optional
        Solves with `anchors` held; default: by factors of its own.

    Attributes
    ----------
    R : array
        The same motions, orthonormal in M.

    Raises
    ------
    MasslessMotion
        If a rigid body has no mass.
    """

    def __init__(self, K: Any, M: Any, R: Array, solver: Solver | None = None) -> None:
        self.K, self.M = sparse.csc_array(K), sparse.csc_array(M)
        self.R = orthonormal(R, self.M)
        held = anchors(K, R)
        self._free = np.setdiff1d(np.arange(R.shape[0]), held)
        self._solve: Callable[[Array], Array] | None = None
        if solver is not None:
            self._solve = solver(held)
        elif self._free.size:
            self._solve = self._factored()

    def _factored(self) -> Callable[[Array], Array]:
        """Return the solver of the degrees of freedom that are not held."""
        inner = sparse.csc_array(self.K[self._free][:, self._free])
        try:
            factors = scipy.sparse.linalg.splu(inner)
        except RuntimeError:
            raise NotHeld("the degrees of freedom left out are not held by springs") from None

        def solve(f: Array) -> Array:
            x = np.zeros_like(f)
            x[self._free] = factors.solve(np.ascontiguousarray(f[self._free]))
            return x

        return solve

    def solve(self, f: Array) -> Array:
        """Return displacements of forces in equilibrium: K x = f, some x being zero.

        Raises
        ------
        NotHeld
            If there are none.
        """
        x = np.zeros_like(f) if self._solve is None else self._solve(f)
        terms = abs(self.K) @ np.abs(x) + np.abs(f)
        if np.abs(self.K @ x - f).max(initial=0.0) > INDEPENDENT * terms.max(initial=0.0):
            raise NotHeld("the degrees of freedom left out are not held by springs")
        return x

    def elastic(self, f: Array) -> Array:
        """Return the elastic displacements of any forces: P K^- P' f."""
        f = f - self.M @ (self.R @ (self.R.T @ f))
        x = np.zeros_like(f) if self._solve is None else self._solve(f)
        elastic: Array = x - self.R @ (self.R.T @ (self.M @ x))
        return elastic

    def modes(self, count: int) -> tuple[Array, Array]:
        """Return the lowest elastic modes: Omega^2, and shapes orthonormal in M.

        There are fewer where fewer have mass.
        """
        n = self.K.shape[0]
        with_mass = int((abs(self.M).sum(axis=1) > 0.0).sum()) - self.R.shape[1]
        count = max(0, min(count, with_mass))
        if count == 0:
            return np.zeros(0), np.zeros((n, 0))
        if n <= _DENSE or count >= with_mass - 1:
            return self._all(count)
        inverse = scipy.sparse.linalg.LinearOperator((n, n), matvec=self.elastic, dtype=np.float64)
        start = self.elastic(self.M @ np.random.default_rng(0).normal(size=n))
        squares, shapes = scipy.sparse.linalg.eigsh(
            self.K, count, self.M, sigma=0.0, OPinv=inverse, v0=start
        )
        return squares, shapes

    def _all(self, count: int) -> tuple[Array, Array]:
        """Return modes by the eigenvalues 1/Omega^2 of L' (P K^- P') L, where M = L L'."""
        masses, axes = scipy.linalg.eigh(self.M.toarray())
        heavy = masses > _MASSLESS * masses[-1]
        L = axes[:, heavy] * np.sqrt(masses[heavy])
        displaced = self.elastic(L)
        inverse, turned = scipy.linalg.eigh(0.5 * (L.T @ displaced + displaced.T @ L))
        moving = np.abs(inverse) > RIGID * np.abs(inverse).max(initial=0.0)
        inverse, shapes = inverse[moving], displaced @ turned[:, moving] / inverse[moving]
        order = np.argsort(1.0 / inverse)[:count]
        return 1.0 / inverse[order], shapes[:, order]


def anchors(K: Any, R: Array) -> Any:
    """Return as many degrees of freedom as there are rigid-body modes, which hold them best."""
    rigid = R.shape[1]
    if not rigid:
        return np.zeros(0, dtype=np.int64)
    _, _, order = scipy.linalg.qr((R / unit_stiffness(K)[:, np.newaxis]).T, pivoting=True)
    return np.sort(order[:rigid])


class NotHeld(ValueError):  # noqa: N818
    """Forces are not in equilibrium, so that a part would move without end."""


class MasslessMotion(ValueError):  # noqa: N818
    """A motion has neither energy of strain nor of motion.

    Parameters
    ----------
    motion : array, shape (n,)
        Its displacements.
    """

    def __init__(self, motion: Array) -> None:
        super().__init__("a motion has neither mass nor stiffness")
        self.motion = motion


def orthonormal(R: Array, M: Any) -> Array:
    """Return combinations of R that are orthonormal in M.

    Raises
    ------
    MasslessMotion
        If one of them has no mass.
    """
    if not R.shape[1]:
        return R
    G = R.T @ (M @ R)
    size = np.sqrt(np.maximum(np.diagonal(G), 0.0))
    size = np.where(size > 0.0, size, 1.0)
    masses, turned = scipy.linalg.eigh(0.5 * (G + G.T) / np.outer(size, size))
    # Terms of the motion's mass that cancel count: a body at rest has none.
    terms = np.sum(np.abs(R) * (abs(M) @ np.abs(R)), axis=0) / size**2
    if masses[0] <= _MASSLESS * max(1.0, terms.max()):
        raise MasslessMotion(R @ (turned[:, 0] / size))
    combined: Array = R @ (turned / size[:, np.newaxis] / np.sqrt(masses))
    return combined
