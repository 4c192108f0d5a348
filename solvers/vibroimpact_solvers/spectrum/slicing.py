"""All natural modes of a large structure between two frequencies (spectrum slicing).

Shift-invert Lanczos finds them, and Sylvester's law of inertia at both ends proves that none is
missing. What Lanczos misses, mostly copies of repeated eigenvalues, is searched for again in
the space orthogonal to the modes already known.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy.linalg
import scipy.sparse.linalg

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.factors import Solve
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.model import System
from vibroimpact_solvers.spectrum.inertia import EigenvalueCount

_DENSE: Final = 3  # full matrices where more than 1/3 of all modes are needed
_ROUNDS: Final = 12  # searches for missing modes at most


@dataclass(frozen=True, eq=False, slots=True)
class SpectrumSlice:
    """All natural modes with eigenvalues between two values."""

    # The values; no other eigenvalue is between them
    low: float
    high: float
    eigenvalues: Floats  # (mode,)
    modes: Floats  # with ``e_i^T M e_j = delta_ij``, (dof, mode)
    # Bound of the errors of the eigenvalues: residuals in the norm of ``M^-1``, (mode,)
    error: Floats


def modes_between(
    system: System,
    low: EigenvalueCount,
    high: EigenvalueCount,
    shift: float,
    solve: Solve,
    solve_mass: Solve,
) -> SpectrumSlice:
    """Return all modes between two values; raise `ConvergenceError` if one is not found.

    `shift` lies between the two; `solve` and `solve_mass` solve with ``K - shift M`` and with M.
    """
    count = high.below - low.below
    room = max(low.error, high.error)
    values, modes = np.empty(0), np.empty((system.n, 0))
    if count * _DENSE > system.n:
        pairs = scipy.linalg.eigh(system.K.to_dense(), system.M.to_dense(), check_finite=False)
        some = slice(low.below, high.below)
        values, modes = np.asarray(pairs[0])[some], np.asarray(pairs[1])[:, some]
    for round_ in range(_ROUNDS):
        missing = count - values.size
        if missing <= 0:
            break
        more = _search(system, shift, solve, modes, missing, round_)
        spread = more[0]
        inside = (spread > low.at - room) & (spread < high.at + room)
        values = np.concatenate([values, spread[inside]])
        modes = np.concatenate([modes, more[1][:, inside]], axis=1)
    if values.size != count:
        message = (
            f"{values.size} natural modes were found between the squared frequencies "
            f"{low.at:g} and {high.at:g} instead of {count}"
        )
        raise ConvergenceError(message)
    values, modes = _refined(system, modes)
    residual = system.K @ modes - (system.M @ modes) * values
    error = np.sqrt(np.maximum((residual * solve_mass(residual)).sum(axis=0), 0.0))
    error += 2.0 * EPS * np.abs(values)
    return SpectrumSlice(low.at, high.at, values, modes, error)


def _search(
    system: System, shift: float, solve: Solve, known: Floats, count: int, round_: int
) -> tuple[Floats, Floats]:
    """Return the modes closest to the shift in the space orthogonal to known ones."""
    n = system.n
    mass_known = system.M @ known

    def apply(b: Floats) -> Floats:
        look()
        x = solve(np.ravel(b))
        return np.asarray(x - known @ (mass_known.T @ x)) if known.size else x

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
    """Return eigenvalues and modes in the span of approximate modes (Rayleigh-Ritz)."""
    if not modes.size:
        return np.empty(0), modes
    stiffness, mass = modes.T @ (system.K @ modes), modes.T @ (system.M @ modes)
    values, turn = scipy.linalg.eigh(0.5 * (stiffness + stiffness.T), 0.5 * (mass + mass.T))
    return np.asarray(values), np.asarray(modes @ turn)
