"""Whether neighbouring motions stay near an impact mode: multipliers of its half-period map.

A member that is its own mirror image after half a period (equal gaps, no load) has the
half-period map ``P = -S Phi(2/omega)`` with the flight Phi and the saltation matrices S of its
impacts; any other one the map of the whole period, ``S_lower Phi S_upper Phi``, of which the
square roots are taken. Two multipliers are 1 always: a shift in time leaves the motion as it is,
and a change of energy leads to a neighbouring member. Both are taken out before the others are
computed, as their common eigenvector would spread an error of 1e-8 instead of 1e-16.

Errors of the map are bounded by norms: what roundings, errors of natural frequencies and errors
of the motion do to flights and impacts. Multipliers magnify them by their condition numbers, the
inverse cosines between left and right eigenvectors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy.linalg

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels import saltation

DIRECTION_DEPENDENT: Final = (
    "direction-dependent: impacts at coupled constraints, struck together, end differently "
    "depending on which of them comes first"
)

LARGEST: Final = 3000
"""Degrees of freedom up to which the map is made: its multipliers take gigabytes and hours."""

_EPS = float(np.finfo(np.float64).eps)
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
    drift : array, shape (mode,)
        Errors of the natural frequencies of the modes that take part.
    spoilt : float
        Relative error of the rows.
    error : array, shape (frequency,)
        Relative error of the motion.
    """

    roots: Floats
    load: Floats
    omega: Floats
    upper: Side
    lower: Side
    mirrored: bool
    silent: Floats
    drift: Floats
    spoilt: float
    error: Floats


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


def growth(orbits: Orbits) -> tuple[Floats, Floats]:
    """Return the growth of the fastest deviation per half period and its error, (frequency,).

    It is the spectral radius of the half-period map; 1 for stable members. It is nan where a
    member grazes a wall, and everywhere if impacts struck together do not commute. The error is
    relative and infinite where the map does not tell its multipliers.
    """
    values, errors = multipliers(orbits)
    sizes = np.abs(values)
    radius = sizes.max(axis=1, initial=1.0)
    fastest = np.maximum(0.0, -orbits.silent).max(initial=0.0)
    with np.errstate(over="ignore"):
        silent = np.minimum(np.exp(fastest * 2.0 / orbits.omega), np.finfo(np.float64).max)
    radius = np.where(np.isnan(radius), np.nan, np.maximum(radius, silent))
    with np.errstate(over="ignore", invalid="ignore"):
        above = (sizes + errors).max(axis=1, initial=1.0) / radius - 1.0
        # The largest one is at least what it seems to be without its error; 1 is there anyway.
        least = np.maximum((sizes - errors).max(axis=1, initial=1.0), silent)
        return radius, np.maximum(np.maximum(above, 1.0 - least / radius), 4.0 * _EPS)


def multipliers(
    orbits: Orbits,
) -> tuple[np.ndarray[tuple[int, int], np.dtype[np.complex128]], Floats]:
    """Return the multipliers of half a period and their errors, each (frequency, 2 mode).

    The two that are 1 always come first. Where the map of the whole period was needed they
    are square roots of its multipliers. They are nan where `growth` is.
    """
    n = orbits.roots.size
    found = np.full((orbits.omega.size, 2 * n), np.nan, dtype=np.complex128)
    errors = np.zeros(found.shape)
    if not all(commutes(side.rows @ side.rows.T) for side in (orbits.upper, orbits.lower)):
        return found, errors
    for f in range(orbits.omega.size):
        # Slow modes are measured by what they do in a flight: in units of their own frequency
        # they would spoil the digits of the map.
        scale = np.maximum(np.abs(orbits.roots), orbits.omega[f])
        period = PeriodMap(orbits, f, scale)
        if period.grazes:
            continue
        values, doubts = period.multipliers()
        found[f, :2] = 1.0
        found[f, 2:], errors[f, 2:] = values, doubts
        if not orbits.mirrored:
            found[f, 2:] = np.sqrt(values)
            with np.errstate(divide="ignore", invalid="ignore"):
                # No root is off by more than the root of what its square is off by.
                slope = 0.5 * doubts / np.abs(found[f, 2:])
                errors[f, 2:] = np.fmin(slope, np.sqrt(doubts))
    return found, errors


class PeriodMap:
    """The half-period map of a member, or that of the whole period of one without mirror.

    It acts on deviations from the state after the impacts at tau = -1, `kernels.saltation`
    says how they are measured.

    Parameters
    ----------
    orbits : Orbits
    f : int
        Which member.
    scale : array, shape (mode,)
        What deviations are measured by.

    Attributes
    ----------
    X : array, shape (2 mode, 2 mode)
    grazes : bool
        Whether the member grazes a wall, so that there is no map.
    size, error : float
        Bounds of the norm of X and of that of its error.
    """

    def __init__(self, orbits: Orbits, f: int, scale: Floats) -> None:
        self.orbits, self.f, self.scale = orbits, f, scale
        self.X = np.eye(2 * orbits.roots.size)
        self.size, self.error, self.grazes = 1.0, 0.0, False
        self._fly()
        self._strike(orbits.upper, 1.0)
        if orbits.mirrored:
            self.X *= -1.0
            return
        self._fly()
        # The fall ends with the velocity that the rise begins with, reversed.
        self._strike(orbits.lower, -1.0)

    def multipliers(self) -> tuple[np.ndarray[tuple[int], np.dtype[np.complex128]], Floats]:
        """Return all multipliers but the two that are 1, and their errors."""
        orbits, f, scale = self.orbits, self.f, self.scale
        within, turned = _without_trivial(self.X, orbits, f, scale, self._forces()[1])
        error = self.error + (turned + 4.0 * _EPS) * self.size
        error += 4.0 * _EPS * float(np.linalg.norm(within))
        found: Any = scipy.linalg.eig(within, left=True, right=True)
        values, left, right = found
        cosines = np.abs((left.conj() * right).sum(axis=0))
        with np.errstate(divide="ignore"):
            return values.astype(np.complex128), np.asarray(error / cosines)

    def _forces(self) -> tuple[Floats, Floats]:
        """Return the errors of the modes' restoring forces at both turns, each (mode,)."""
        orbits, f = self.orbits, self.f
        turn, off = orbits.roots / orbits.omega[f], orbits.drift / orbits.omega[f]
        with np.errstate(divide="ignore", invalid="ignore"):
            # Next to a pole, where sin vanishes, the place of a mode depends on its frequency.
            steep = np.where(turn > 0.0, 2.0 * off / np.abs(np.sin(2.0 * turn)), 0.0)
            own = np.where(turn == 0.0, 0.0, 2.0 * off / np.abs(turn))
        relative = orbits.error[f] + orbits.spoilt + 4.0 * _EPS + steep + own
        squares = np.square(orbits.roots)
        upper, lower = (
            relative * (squares * np.abs(side.place[f]) + np.abs(orbits.load))
            for side in (orbits.upper, orbits.lower)
        )
        return upper, lower

    def _fly(self) -> None:
        orbits, flight = self.orbits, 2.0 / float(self.orbits.omega[self.f])
        saltation.fly(self.X, orbits.roots, self.scale, flight)
        rates = np.abs(orbits.roots)
        # What a flight does to a mode at most, and how its errors show: as errors of its phase.
        slow = np.maximum(1.0, self.scale * np.minimum(flight, 1.0 / np.maximum(rates, 1e-300)))
        with np.errstate(over="ignore"):
            grown = slow * np.exp(np.minimum(np.maximum(0.0, -orbits.roots) * flight, 300.0))
        off = (orbits.drift + _EPS * rates) * flight + 4.0 * _EPS
        norm, wrong = float(grown.max(initial=1.0)), float((grown * off).max(initial=0.0))
        self.error = norm * self.error + wrong * self.size
        self.size *= norm

    def _strike(self, side: Side, sign: float) -> None:
        orbits, f, scale = self.orbits, self.f, self.scale
        acceleration = orbits.load - orbits.roots * np.abs(orbits.roots) * side.place[f]
        velocity = sign * side.speed[f]
        none = np.zeros(orbits.roots.size)
        doubts = self._forces()[0 if sign > 0.0 else 1]
        for row in side.rows:
            approach = float(row @ velocity)
            curvature = float(row @ acceleration) / approach if approach else np.inf
            if not np.isfinite(curvature):
                self.grazes = True
                return
            saltation.strike(self.X, row, scale, curvature, none, 1.0)
            relative = orbits.error[f] + orbits.spoilt + 4.0 * _EPS
            roundings = 4.0 * _EPS * float(np.abs(row) @ np.abs(acceleration))
            off = (float(np.abs(row) @ doubts) + roundings) / abs(approach)
            off += abs(curvature) * relative * float(np.abs(row) @ np.abs(velocity)) / abs(approach)
            factor = 2.0 / float(row @ row)
            turn = factor * float(np.linalg.norm(row * scale) * np.linalg.norm(row / scale))
            bend = factor * float(np.linalg.norm(row) * np.linalg.norm(row / scale))
            norm = 1.0 + max(turn, 2.0) + bend * abs(curvature)
            wrong = (2.0 * orbits.spoilt + 4.0 * _EPS) * norm + bend * off
            self.error = norm * self.error + wrong * self.size
            self.size *= norm


def _without_trivial(
    P: Floats, orbits: Orbits, f: int, scale: Floats, doubts: Floats
) -> tuple[Floats, float]:
    """Return P where neither time nor energy of the motion changes, and the error of where.

    With the rate F of the motion, ``P F = F``, and with the gradient H of its energy,
    ``H^T P = H^T`` and ``H^T F = 0``: between the two P is block-triangular.
    """
    eigenvalues = orbits.roots * np.abs(orbits.roots)
    place, speed = orbits.lower.place[f], orbits.lower.speed[f]
    force = orbits.load - eigenvalues * place
    F = np.concatenate([scale * speed, force])
    H = np.concatenate([-force / scale, speed])
    length, steepness = float(np.linalg.norm(F)), float(np.linalg.norm(H))
    pair = np.stack([F / length, H / steepness], axis=1)
    basis = np.linalg.qr(pair, mode="complete")[0][:, 2:]
    relative = orbits.error[f] + orbits.spoilt
    turned = float(np.linalg.norm(doubts)) / length + relative
    turned += float(np.linalg.norm(doubts / scale)) / steepness + relative
    return np.asarray(basis.T @ P @ basis), turned
