"""Complex modes: eigenvalues and eigenvectors of the modes that damping couples, with errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import EPS, Booleans, Floats, Integers
from vibroimpact_solvers.errors import PlanError

ILL: Final = 1e8
"""Condition number of the complex modes from which they are not used."""
_CLOSE: Final = 1e-2  # of its own size, from another rate, at which complex modes may be one
NEAR: Final = 5e-2
"""Distance from another rate, of its own size, within which errors of vectors are slow."""
_PARALLEL: Final = 0.5  # sine of the angle between such modes below which they are almost one

Complexes = NDArray[np.complex128]


@dataclass(frozen=True, eq=False, slots=True)
class ComplexModes:
    """Eigenvalues and eigenvectors of a first-order matrix, improved once.

    Parameters
    ----------
    rates : array, shape (2 mode,)
    vectors : array, shape (2 mode, 2 mode)
        As columns.
    condition : float
        Condition number of the vectors without dimension.
    errors : array, shape (2 mode,)
        Absolute errors of the rates, to first order.
    vector_error : float
        Error of the vectors relative to their lengths, those of near modes apart.
    far : array, shape (2 mode, 2 mode)
        Bounds of what column j has of the vector i too much, ``[i, j]``, near modes apart.
    near : array, shape (2 mode, 2 mode)
        Bounds of how a mode drives another near one, per unit of time.
    oscillating, real : array of int
        Places of the rates with positive imaginary parts, and of the real ones, which descend.
    chains : list of tuple
        Places in `oscillating` of a driven and of a driving mode, and the coupling of the two.
    """

    rates: Complexes
    vectors: Complexes
    condition: float
    errors: Floats
    vector_error: float
    far: Floats
    near: Floats
    oscillating: Integers
    real: Integers
    chains: list[tuple[int, int, complex]]


def complex_modes(A: Floats, root: Floats, doubt: Floats, *, chained: bool = True) -> ComplexModes:
    """Return the complex modes of a real matrix.

    The eigenvectors V and eigenvalues s of LAPACK leave ``V^-1 A V = s + E``, E being of the size
    of roundings of the largest rate, in all modes. A step of Newton's method takes its diagonal
    to the rates and ``E_ij / (s_j - s_i)`` to the vectors; what remains are the roundings of the
    residual, which are those of the rate itself where modes are coupled weakly.

    Parameters
    ----------
    A : array, shape (2 mode, 2 mode)
    root : array, shape (2 mode,)
        Scales in which rates have no dimension.
    doubt : array, shape (2 mode, 2 mode)
        Absolute errors of the entries of A.
    chained : bool
        Whether of two modes that are almost equal one may drive the other.

    Returns
    -------
    ComplexModes

    Raises
    ------
    PlanError
        If the vectors depend on one another almost linearly.
    """
    scaled = root[:, np.newaxis] * A / root
    rates, vectors = (each.astype(np.complex128) for each in np.linalg.eig(scaled))
    real: Booleans = rates.imag == 0.0
    upper = np.flatnonzero(rates.imag > 0.0)
    chains, feeds = [], np.zeros(scaled.shape, dtype=np.complex128)
    together = np.eye(rates.size, dtype=bool)  # what no vector is corrected by
    for i, k in _almost_equal(rates, vectors, upper) if chained else ():
        two = upper[[i, k]]
        kappa = _chain(scaled, rates, vectors, two)
        if kappa is not None:
            chains.append((i, k, kappa))
            for pair, feed in ((two, kappa), (two + 1, kappa.conjugate())):
                feeds[pair[0], pair[1]] = feed
                together[np.ix_(pair, pair)] = True
    condition = float(np.linalg.cond(vectors))
    if not condition < ILL:
        message = (
            "damping makes modes of the structure almost equal, which complex modes cannot tell "
            "apart"
        )
        raise PlanError(message, ("system", "C"))
    inverse = np.linalg.inv(vectors)
    E = inverse @ (scaled @ vectors - vectors * rates - vectors @ feeds)
    apart = rates - rates[:, np.newaxis]
    apart[together | (apart == 0.0)] = np.inf
    free = np.diag(together.sum(axis=0) == 1)
    rates = rates + np.where(free, E, 0.0).diagonal()
    rates[real] = rates[real].real
    step = E / apart
    chains = [(i, k, _improve(rates, step, E, upper[[i, k]], kappa)) for i, k, kappa in chains]
    vectors = vectors + vectors @ step
    vectors[:, real] = vectors[:, real].real
    size = np.abs(vectors)
    residual = EPS * (np.abs(scaled) @ size + size * np.abs(rates) + size @ np.abs(feeds))
    residual += (root[:, np.newaxis] * doubt / root) @ size
    bound = np.abs(inverse) @ residual
    # Rates that are equal to the last bit are not told apart.
    equal = np.isinf(apart)
    bound += np.where(equal & ~together, np.abs(E), 0.0)
    # Modes near one another exchange energy so slowly that it counts as an error of their rates.
    near = equal | (np.abs(apart) < NEAR * np.abs(rates))
    errors = np.where(near, bound, 0.0).sum(axis=0)
    far = np.where(near, 0.0, bound) / np.abs(apart)
    vector_error = float(far.sum(axis=0).max())
    others = np.where(near & ~np.eye(rates.size, dtype=bool), bound, 0.0)
    vectors = vectors / root[:, np.newaxis]
    # Real modes are used by their sums and differences, which must not drown the smaller one.
    vectors[:, real] /= np.linalg.norm(vectors[:, real], axis=0)
    places = np.flatnonzero(real)
    places = places[np.argsort(-rates[places].real)]
    return ComplexModes(
        rates, vectors, condition, errors, vector_error, far, others, upper, places, chains
    )


def _almost_equal(rates: Complexes, vectors: Complexes, upper: Integers) -> list[tuple[int, int]]:
    """Return the pairs of oscillating modes with almost the same rate and the same vector.

    Of three that are almost equal none is returned: the condition number decides.
    """
    if upper.size < 2:
        return []
    own = rates[upper]
    apart = np.abs(own[:, np.newaxis] - own)
    np.fill_diagonal(apart, np.inf)
    units = vectors[:, upper] / np.linalg.norm(vectors[:, upper], axis=0)
    sine = np.sqrt(np.maximum(0.0, 1.0 - np.abs(units.conj().T @ units) ** 2))
    close = (apart < _CLOSE * np.abs(own)) & (sine < _PARALLEL)
    once = np.flatnonzero(close.sum(axis=1) == 1)
    others = close.argmax(axis=1)
    return [(int(i), int(others[i])) for i in once if i < others[i] and others[i] in once]


def _chain(scaled: Floats, rates: Complexes, vectors: Complexes, two: Integers) -> complex | None:
    """Replace complex modes that are almost equal by two of which one drives the other.

    Schur vectors of the two: ``A q1 = s1 q1``, ``A q2 = s2 q2 + kappa q1``. They stand at right
    angles however near the modes are, and span the same motions.

    Parameters
    ----------
    scaled : array, shape (2 mode, 2 mode)
        The matrix without dimension.
    rates, vectors : array
        Those of the modes and of their conjugates, which LAPACK puts behind them, are replaced.
    two : array of int, shape (2,)
        Places of the modes.

    Returns
    -------
    complex, optional
        kappa; None where the two cannot be told from the others.
    """
    middle = 0.5 * rates[two].sum()
    # Rates of modes that are one are off by the root of a rounding, each time by another one.
    radius = abs(rates[two[0]] - rates[two[1]]) + 1e-7 * abs(middle)
    schur: Any = scipy.linalg.schur  # its stubs know selections of real rates only
    T, Q, count = schur(
        scaled.astype(np.complex128), output="complex", sort=lambda s: abs(s - middle) <= radius
    )
    if count != 2:
        return None
    rates[two], rates[two + 1] = T.diagonal()[:2], T.diagonal()[:2].conj()
    vectors[:, two], vectors[:, two + 1] = Q[:, :2], Q[:, :2].conj()
    return complex(T[0, 1])


def _improve(
    rates: Complexes, step: Complexes, E: Complexes, two: Integers, kappa: complex
) -> complex:
    """Take what two modes in a chain leave of the matrix to their rates, vectors and coupling.

    With ``B = [[s1, kappa], [0, s2]] + E`` the first vector becomes ``q1 + x q2``, where
    ``B12 x^2 - (B22 - B11) x - B21 = 0`` makes the two triangular again.

    Parameters
    ----------
    rates : array, shape (2 mode,)
        Those of the modes and of their conjugates are replaced.
    step : array, shape (2 mode, 2 mode)
        Takes the steps of their vectors.
    E : array, shape (2 mode, 2 mode)
        What is left, in the basis of the vectors.
    two : array of int, shape (2,)
        Places of the modes.
    kappa : complex

    Returns
    -------
    complex
        The new coupling.
    """
    left = E[np.ix_(two, two)]
    kappa += complex(left[0, 1])
    first, second = rates[two] + left.diagonal()
    half = 0.5 * (second - first)
    root = np.sqrt(half * half + kappa * left[1, 0])
    low = half + root if abs(half + root) > abs(half - root) else half - root
    x = -left[1, 0] / low if low != 0.0 else 0.0
    rates[two] = first + kappa * x, second - kappa * x
    rates[two + 1] = rates[two].conj()
    step[two[1], two[0]], step[two[1] + 1, two[0] + 1] = x, np.conj(x)
    return kappa
