"""The start of a motion of a structure whose natural frequencies differ by much (`is_wide`).

Modal coordinates are ``e_j^T M x``. Of a deflection that varies slowly along the structure, those
of the highest modes are differences of large terms: a rounding of the deflection would be a motion
with the velocity of the highest frequency. The same coordinates are ``e_j^T K x / lambda_j``, which
of such a deflection are sums of small terms. Both are computed with M x and K x in twice the
precision, and for each mode that with the smaller error is taken; so are velocities.

The deviations that the motion starts with are these errors, and the roundings of the state.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.kernels import doubled
from vibroimpact_solvers.kernels.deviations import SAFETY
from vibroimpact_solvers.kernels.next_impact import ROUNDING, SIMULTANEOUS
from vibroimpact_solvers.kernels.rigid_state import NOT_GRAZING, STRIKES
from vibroimpact_solvers.spectrum import products
from vibroimpact_solvers.time_history.run import Arrays
from vibroimpact_solvers.time_history.structure import Structure

_ROUNDED: Final = 2.0  # roundings of each number of a state
_GRAZING: Final = 1  # the row of `kernels.rigid_state.workspace`
_NONE: Final = np.zeros((0, 0))


def begin(structure: Structure, arrays: Arrays, x: Floats, v: Floats) -> None:
    """Start a motion from displacements and velocities, each (dof,), with its deviations."""
    configuration, unit = structure.configuration(), 1.0 / structure.scale
    basis, errors = configuration.basis, configuration.kernel.errors
    (q, q_error), (rate, rate_error) = _modal_coordinates(structure, x, v)
    z = basis.pairs_of(q - basis.still, unit * rate, basis.loads_at_start())
    arrays.start(z)
    now, deviations = arrays.progress[0], arrays.Z[1:]
    now["largest"] = np.sqrt((basis.own * basis.whole(z, level=1.0) ** 2).sum())
    sizes = np.stack(basis.magnitudes(z))
    sizes = _ROUNDED * sizes + np.stack([q_error, unit * rate_error]) / EPS
    signs = np.random.default_rng(3).choice([-1.0, 1.0], (len(deviations), *sizes.shape))
    for deviation, (dq, d_rate) in zip(deviations, signs * sizes, strict=True):
        deviation[:] = basis.pairs_of(dq, d_rate)
    basis.doubt_loads(arrays.Z)
    # The state is given: what constant loads carry too far is missing in what is free.
    for column, deviation in enumerate(deviations if len(basis.carried) else ()):
        deviation -= (-errors.still if column & 1 else errors.still) * basis.carried[0]
    if now["largest"] > 0.0:
        longest = max(map(basis.length, deviations), default=0.0)
        now["growth"] = max(now["growth"], SAFETY * longest / now["largest"])
    now["begun"] = 1
    grazing = arrays.work[1][_GRAZING]
    grazing[:] = NOT_GRAZING
    grazing[_strikes(structure, z, x, v)] = STRIKES


def _strikes(structure: Structure, z: Floats, x: Floats, v: Floats) -> Floats:
    """Return which coordinates start at a wall, to the last bit, and move into it."""
    configuration = structure.configuration()
    lower, upper = structure.limits
    y, velocity = structure.W @ x, structure.W @ v
    towards = np.where(y == upper, velocity, np.where(-y == lower, -velocity, 0.0))
    length = np.sqrt((configuration.kernel.errors.own * z**2).sum())
    slight = ROUNDING * length * np.sqrt(structure.mobility.diagonal()) * structure.scale
    return np.asarray(towards > SIMULTANEOUS * slight)


def _modal_coordinates(
    structure: Structure, x: Floats, v: Floats
) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
    """Return modal coordinates and velocities, and the errors of each, (mode,)."""
    natural, shapes, system = structure.natural, structure.shapes, structure.system
    low = _NONE if natural.modal_matrix_low is None else natural.modal_matrix_low
    if low.size and system.C is not None and (natural.roots == 0.0).sum() > 1:
        low = _NONE  # those of rigid bodies are turned
    rounding = EPS * EPS if low.size else 0.5 * EPS  # of entries of the modes
    angles = np.zeros(natural.roots.size) if natural.angles is None else natural.angles
    moved = np.stack([x, v], axis=1)
    both = zip(products.product(system.M, moved), products.product(system.K, moved), strict=True)
    given = [np.concatenate(parts, axis=1) for parts in both]
    projected, errors = _projected(shapes, low, given, rounding)
    (by_mass, by_force), (by_mass_error, by_force_error) = (
        np.split(each, 2, axis=1) for each in (projected, errors)
    )
    by_mass_error += angles[:, np.newaxis] * np.linalg.norm(by_mass, axis=0)
    by_force_error += angles[:, np.newaxis] * np.linalg.norm(by_force, axis=0)
    values = natural.roots * (1.0 + _rests(structure))
    values = (values * np.abs(values))[:, np.newaxis]
    known = np.zeros(natural.roots.size) if natural.errors is None else natural.errors
    with np.errstate(divide="ignore", invalid="ignore"):
        by_force = by_force / values
        by_force_error = by_force_error / np.abs(values)
        by_force_error += (known[:, np.newaxis] / np.abs(values) + EPS) * np.abs(by_force)
    better = by_force_error < by_mass_error  # not where they are nan
    q = np.where(better, by_force, by_mass)
    error = np.where(better, by_force_error, by_mass_error) + EPS * np.abs(q)
    return (q[:, 0], error[:, 0]), (q[:, 1], error[:, 1])


def _projected(
    shapes: Floats, low: Floats, given: Sequence[Floats], rounding: float
) -> tuple[Floats, Floats]:
    """Return products of all modes with some columns, and their errors, each (mode, column).

    The matrix of modes is read along its rows: the loop over modes is a vector loop.
    """
    high, rest, error = given
    whole, part = doubled.product(high.T, rest.T, shapes, low, False)
    size = doubled.roundings(len(shapes)) + rounding
    return (whole + part).T, ((size * np.abs(high) + error).T @ np.abs(shapes)).T


def _rests(structure: Structure) -> Floats:
    rounding = structure.natural.rounding
    return np.zeros(structure.natural.roots.size) if rounding is None else rounding
