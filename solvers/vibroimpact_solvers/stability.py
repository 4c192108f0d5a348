"""Whether neighbouring motions stay near an impact mode: multipliers of its half-period map.

A member that is its own mirror image after half a period (equal gaps, no load) has the
half-period map ``P = -S Phi(2/omega)`` with the flight Phi and the saltation matrices S of its
impacts; any other one the map of the whole period, ``S_lower Phi S_upper Phi``, of which the
square roots are taken. Two multipliers are 1 always: a shift in time leaves the motion as it is,
and a change of energy leads to a neighbouring member. Both are taken out before the others are
computed, as their common eigenvector would spread an error of 1e-8 instead of 1e-16.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels import saltation

DIRECTION_DEPENDENT: Final = (
    "direction-dependent: impacts at coupled constraints, struck together, end differently "
    "depending on which of them comes first"
)

_COUPLED = 1e-12  # cosine of the angle between two constraints from which on they are coupled


@dataclass(frozen=True, eq=False, slots=True)
class Side:
    """Impacts at one turn of the triangle wave, tau = 1 or tau = -1.

    Parameters
    ----------
    rows : array, shape (constraint, mode)
        ``W E`` of the constraints that are struck; no rows where nothing is.
    place : array, shape (frequency, mode)
        Modal coordinates.
    speed : array, shape (frequency, mode)
        Modal velocities at the end of the rise or at its beginning: before the impacts at
        tau = 1, after those at tau = -1.
    """

    rows: Floats
    place: Floats
    speed: Floats


@dataclass(frozen=True, eq=False, slots=True)
class Orbits:
    """Members of a family, as far as their stability depends on them.

    Parameters
    ----------
    roots : array, shape (mode,)
        Signed natural frequencies of the modes that take part, rad per unit of time.
    load : array, shape (mode,)
        Static load of each.
    omega : array, shape (frequency,)
        Triangle-wave frequencies.
    upper, lower : Side
        Impacts at tau = 1 and at tau = -1.
    mirrored : bool
        Whether the second half of the period mirrors the first.
    silent : array, shape (mode,)
        Signed natural frequencies of the modes that take no part.
    """

    roots: Floats
    load: Floats
    omega: Floats
    upper: Side
    lower: Side
    mirrored: bool
    silent: Floats


def commutes(mobility: Floats) -> bool:
    """Whether impacts at these constraints, struck together, end the same in any order.

    Parameters
    ----------
    mobility : array, shape (constraint, constraint)
        ``W M^(-1) W^T``.
    """
    size = np.sqrt(np.diagonal(mobility))
    coupling = np.abs(mobility - np.diag(np.diagonal(mobility)))
    return bool((coupling <= _COUPLED * np.outer(size, size)).all())


def radii(orbits: Orbits) -> Floats:
    """Return the growth of the fastest deviation per half period, shape (frequency,).

    It is the spectral radius of the half-period map; 1 for stable members. It is nan where a
    member grazes a wall, and everywhere if impacts struck together do not commute.
    """
    values = multipliers(orbits)
    radius = np.abs(values).max(axis=1, initial=1.0)
    growth = np.maximum(0.0, -orbits.silent).max(initial=0.0)
    with np.errstate(over="ignore"):
        silent = np.minimum(np.exp(growth * 2.0 / orbits.omega), np.finfo(np.float64).max)
    return np.asarray(np.where(np.isnan(radius), np.nan, np.maximum(radius, silent)))


def multipliers(orbits: Orbits) -> np.ndarray[tuple[int, int], np.dtype[np.complex128]]:
    """Return the multipliers of half a period, shape (frequency, 2 mode).

    The two that are 1 always come first. Where the map of the whole period was needed they
    are square roots of its multipliers. They are nan where `radii` is.
    """
    n = orbits.roots.size
    found = np.full((orbits.omega.size, 2 * n), np.nan, dtype=np.complex128)
    if not all(commutes(side.rows @ side.rows.T) for side in (orbits.upper, orbits.lower)):
        return found
    for f in range(orbits.omega.size):
        # Slow modes are measured by what they do in a flight: in units of their own frequency
        # they would spoil the digits of the map.
        scale = np.maximum(np.abs(orbits.roots), orbits.omega[f])
        P = period_map(orbits, f, scale)
        if P is None:
            continue
        values = np.linalg.eigvals(_without_trivial(P, orbits, f, scale)).astype(np.complex128)
        found[f, :2] = 1.0
        found[f, 2:] = values if orbits.mirrored else np.sqrt(values)
    return found


def period_map(orbits: Orbits, f: int, scale: Floats) -> Floats | None:
    """Return the half-period map, or that of the whole period of a member without mirror.

    It acts on deviations from the state after the impacts at tau = -1, `kernels.saltation`
    says how they are measured. None where the member grazes a wall.
    """
    flight = 2.0 / float(orbits.omega[f])
    X = np.eye(2 * orbits.roots.size)
    saltation.fly(X, orbits.roots, scale, flight)
    if not _strike(X, orbits, orbits.upper, f, scale, 1.0):
        return None
    if orbits.mirrored:
        return -X
    saltation.fly(X, orbits.roots, scale, flight)
    # The fall ends with the velocity that the rise begins with, reversed.
    return X if _strike(X, orbits, orbits.lower, f, scale, -1.0) else None


def _strike(X: Floats, orbits: Orbits, side: Side, f: int, scale: Floats, sign: float) -> bool:
    acceleration = orbits.load - orbits.roots * np.abs(orbits.roots) * side.place[f]
    velocity = sign * side.speed[f]
    none = np.zeros(orbits.roots.size)
    for row in side.rows:
        approach = float(row @ velocity)
        if approach == 0.0:
            return False
        curvature = float(row @ acceleration) / approach
        if not np.isfinite(curvature):
            return False
        saltation.strike(X, row, scale, curvature, none, 1.0)
    return True


def _without_trivial(P: Floats, orbits: Orbits, f: int, scale: Floats) -> Floats:
    """Return P where neither the time nor the energy of the motion changes.

    With the rate F of the motion, ``P F = F``, and with the gradient H of its energy,
    ``H^T P = H^T`` and ``H^T F = 0``: between the two P is block-triangular.
    """
    eigenvalues = orbits.roots * np.abs(orbits.roots)
    place, speed = orbits.lower.place[f], orbits.lower.speed[f]
    force = orbits.load - eigenvalues * place
    F = np.concatenate([scale * speed, force])
    H = np.concatenate([-force / scale, speed])
    pair = np.stack([F / np.linalg.norm(F), H / np.linalg.norm(H)], axis=1)
    basis = np.linalg.qr(pair, mode="complete")[0][:, 2:]
    return np.asarray(basis.T @ P @ basis)
