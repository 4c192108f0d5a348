"""Natural modes between two frequencies of a large structure, none missed.

Shift-invert Lanczos finds them, and Sylvester's law of inertia proves at both ends that they
are all there. What Lanczos leaves out, copies of repeated eigenvalues above all, is sought for
again in what is orthogonal to the modes already found.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy.linalg
import scipy.sparse.linalg

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.matrices import Solve
from vibroimpact_solvers.model import System
from vibroimpact_solvers.spectrum.inertia import Count

_EPS = float(np.finfo(np.float64).eps)
_DENSE: Final = 3  # a full matrix where more than this part of all modes is wanted
_ROUNDS: Final = 12  # searches for what is still missing


@dataclass(frozen=True, eq=False, slots=True)
class Window:
    """All natural modes with eigenvalues between two values.

    Parameters
    ----------
    low, high : float
        The values; no other eigenvalue is between them.
    eigenvalues : array, shape (mode,)
    modes : array, shape (dof, mode)
        With ``e_i^T M e_j = delta_ij``.
    doubt : array, shape (mode,)
        Bound of the eigenvalues' errors: residuals in the norm of ``M^-1``.
    """

    low: float
    high: float
    eigenvalues: Floats
    modes: Floats
    doubt: Floats


def window(
    system: System, low: Count, high: Count, shift: float, solve: Solve, solve_mass: Solve
) -> Window:
    """Return the modes between two counts, proved to be all.

    Parameters
    ----------
    system : System
    low, high : Count
        At both ends.
    shift : float
        Between them.
    solve, solve_mass : callable
        Solve with ``K - shift M`` and with M.

    Raises
    ------
    ConvergenceError
        Where some mode is not found.
    """
    wanted = high.below - low.below
    room = max(low.doubt, high.doubt)
    values, modes = np.empty(0), np.empty((system.n, 0))
    if wanted * _DENSE > system.n:
        found = scipy.linalg.eigh(system.K.to_dense(), system.M.to_dense(), check_finite=False)
        both = low.below, high.below
        values, modes = np.asarray(found[0])[slice(*both)], np.asarray(found[1])[:, slice(*both)]
    for round_ in range(_ROUNDS):
        missing = wanted - values.size
        if missing <= 0:
            break
        more = _search(system, shift, solve, modes, missing, round_)
        spread = more[0]
        inside = (spread > low.at - room) & (spread < high.at + room)
        values = np.concatenate([values, spread[inside]])
        modes = np.concatenate([modes, more[1][:, inside]], axis=1)
    if values.size != wanted:
        message = (
            f"{values.size} natural modes were found between the square frequencies "
            f"{low.at:g} and {high.at:g}, where there are {wanted}"
        )
        raise ConvergenceError(message)
    values, modes = _refined(system, modes)
    residual = system.K @ modes - (system.M @ modes) * values
    doubt = np.sqrt(np.maximum((residual * solve_mass(residual)).sum(axis=0), 0.0))
    doubt += 2.0 * _EPS * np.abs(values)
    return Window(low.at, high.at, values, modes, doubt)


def _search(
    system: System, shift: float, solve: Solve, known: Floats, count: int, round_: int
) -> tuple[Floats, Floats]:
    """Return eigenvalues closest to the shift, and modes, among what is orthogonal to some."""
    n = system.n
    heavy = system.M @ known

    def apply(b: Floats) -> Floats:
        x = solve(np.ravel(b))
        return np.asarray(x - known @ (heavy.T @ x)) if known.size else x

    operator = scipy.sparse.linalg.LinearOperator((n, n), matvec=apply, dtype=np.float64)
    mass = system.M.to_sparse()
    start = np.random.default_rng(round_).standard_normal(n)
    count = min(count, n - 2)
    eigsh: Any = scipy.sparse.linalg.eigsh
    basis = min(n, max(2 * count + 1, 20))
    try:
        values, modes = eigsh(
            mass, k=count, M=mass, sigma=shift, OPinv=operator, v0=apply(mass @ start), ncv=basis
        )
    except scipy.sparse.linalg.ArpackNoConvergence as error:
        values, modes = error.eigenvalues, error.eigenvectors
    return np.asarray(values), np.asarray(modes)


def _refined(system: System, modes: Floats) -> tuple[Floats, Floats]:
    """Return eigenvalues and modes of the space that some modes span (Rayleigh and Ritz)."""
    if not modes.size:
        return np.empty(0), modes
    stiffness, mass = modes.T @ (system.K @ modes), modes.T @ (system.M @ modes)
    values, turn = scipy.linalg.eigh(0.5 * (stiffness + stiffness.T), 0.5 * (mass + mass.T))
    return np.asarray(values), np.asarray(modes @ turn)
