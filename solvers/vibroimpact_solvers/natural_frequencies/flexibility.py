"""The static flexibility of the modes that a modal model leaves out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from vibroimpact_solvers import condensation
from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.spectrum import LowestModes, moving_part

_ROUNDS: Final = 60  # steps of refinement at most
_EXACT: Final = 1e-15  # residual relative to the load at which refinement ends
_SHIFTS: Final = -0.1 * np.array([1.0, 0.5, 2.0, 0.3, 3.0, 0.7, 1.5, 0.2, 0.4, 2.5])
"""Of the factors, over the bound of the eigenvalues that are left out: the first one is best."""
_CLEAR: Final = 0.05  # distance of a shift to the modes from which it is as good as any, over it


def residual_flexibility(
    system: System,
    lines: Sequence[Constraint | None],
    lowest: LowestModes,
    participations: tuple[Floats, Floats],
    count: int,
) -> tuple[Floats, Floats]:
    """Return the flexibility of all modes but the first ones, and its errors.

    Each (constraint, constraint), ``W (K^-1 - sum_j e_j e_j^T / lambda_j) W^T`` over the first
    modes; rigid-body modes are left out of it, so that it is that of the elastic modes.

    Parameters
    ----------
    system : System
        What moves.
    lines : sequence of Constraint or None
        The constraints in its coordinates; None: held.
    lowest : LowestModes
        All modes, or the lowest ones.
    participations : pair of arrays, (constraint, mode)
        ``W E`` of the modes computed, and its errors.
    count : int
        Number of modes that are kept elsewhere.
    """
    natural = lowest.natural
    rows, uncertainties = participations
    elastic = np.flatnonzero(natural.roots[count:] != 0.0) + count
    values = natural.eigenvalues[elastic]
    wrong = np.zeros(values.size) if natural.errors is None else natural.errors[elastic]
    part, uncertainty = rows[:, elastic], uncertainties[:, elastic]
    flexibility = (part / values) @ part.T
    size, relative = np.abs(part), wrong / np.abs(values)
    weights = 1.0 / (np.abs(values) * np.maximum(1.0 - relative, EPS))
    error = (size * weights * (relative + EPS * (values.size + 4))) @ size.T
    with np.errstate(invalid="ignore"):
        mixed = (size * weights) @ uncertainty.T
        error += mixed + mixed.T + (uncertainty * weights) @ uncertainty.T
    if np.isfinite(lowest.beyond):
        free = [place for place, line in enumerate(lines) if line is not None]
        block = np.ix_(free, free)
        more = _beyond(system, [line for line in lines if line is not None], lowest)
        flexibility[block] += more[0]
        error[block] += more[1]
    return 0.5 * (flexibility + flexibility.T), error


def _beyond(
    system: System, lines: Sequence[Constraint], lowest: LowestModes
) -> tuple[Floats, Floats]:
    """Return the flexibility of all modes that were not computed, and its errors.

    ``K x = b`` is solved in the space orthogonal to the modes, with factors of ``K - sigma M``
    and refinement. As no eigenvalue is below `beyond` there, ``2 b^T x - x^T K x`` errs by no
    more than the square of the residual in the norm of ``M^-1``, divided by it.
    """
    moving = moving_part(system)
    kept = condensation.massive(system)
    modes = lowest.natural.modes[kept]
    directions = np.zeros((system.n, len(lines)))
    for column, line in zip(directions.T, lines, strict=True):
        column[list(line.dofs)] = line.weights
    loads = directions[kept]
    heavy = moving.M @ modes
    shift = _shift(lowest)
    solve = moving.K.plus(-shift, moving.M).factorize()

    def without_modes(b: Floats) -> Floats:
        return np.asarray(b - heavy @ (modes.T @ b))

    b = without_modes(loads)
    x, residual, before = np.zeros_like(b), b, np.inf
    for _ in range(_ROUNDS):
        look()
        change = solve(np.ascontiguousarray(residual))
        x = x + change - modes @ (heavy.T @ change)
        residual = without_modes(b - moving.K @ x)
        left = float(np.linalg.norm(residual)) / max(float(np.linalg.norm(b)), 1e-300)
        if left <= _EXACT or left > 0.5 * before:
            break
        before = left
    stiff = moving.K @ x
    value = b.T @ x
    value = value + value.T - x.T @ stiff
    inverse = np.sqrt(np.maximum((residual * moving.solve_M(residual)).sum(axis=0), 0.0))
    lengths = np.sqrt(np.maximum((loads * moving.solve_M(loads)).sum(axis=0), 0.0))
    angles = lowest.natural.angles
    turned = 0.0 if angles is None else float(np.linalg.norm(angles))
    rounded = 8.0 * EPS * (np.abs(x).T @ (abs(moving.K.to_sparse()) @ np.abs(x)))
    error = np.outer(inverse, inverse) + 2.0 * turned * np.outer(lengths, lengths)
    return value, error / lowest.beyond + rounded + 8.0 * EPS * (np.abs(b).T @ np.abs(x))


def _shift(lowest: LowestModes) -> float:
    """Return a small negative value, far from the eigenvalues of unstable structures too."""
    shifts = _SHIFTS * lowest.beyond
    apart = np.abs(shifts[:, np.newaxis] - lowest.natural.eigenvalues).min(axis=1, initial=np.inf)
    return float(shifts[np.minimum(apart, _CLEAR * lowest.beyond).argmax()])
