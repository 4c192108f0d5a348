"""Multipliers of impact modes by the map of deviations over half a period or all of it.

Errors of the map are bounded entry by entry: the effect of rounding, errors of natural frequencies
and errors of the motion on free motions and impacts. With left and right eigenvectors y and x and
errors E of the map a multiplier errs by ``|y|^T E |x| / |y . x|``, to first order.

Multipliers come in pairs ``m, 1/m`` and in conjugate ones, as the structure is conservative and can
be driven backwards: one that is on the unit circle to within its error, and farther from all others
than both errors, is on the circle exactly. Otherwise ``1/conj(m)`` would be another one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np
import scipy.linalg

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.kernels import saltation
from vibroimpact_solvers.stability.orbits import Orbits, Radius

_ALONE: Final = 1e-3  # largest error of a multiplier that is told from others


def radius(orbits: Orbits, f: int) -> Radius:
    """Return the largest modulus of the multipliers of half a period at one frequency.

    Where the map of the whole period is needed they are square roots of its multipliers.
    """
    # Slow modes are scaled by the frequency of the motion: in units of their own frequency
    # they would cost digits of the map.
    scale = np.maximum(np.abs(orbits.roots), orbits.omega[f])
    period = PeriodMap(orbits, f, scale)
    if period.grazes:
        return Radius.unknown()
    values, errors = period.multipliers()
    errors = np.where(_on_circle(values, errors), 0.0, errors)
    # Of those on the circle exactly a quotient may be rounded.
    sizes = np.where(errors == 0.0, 1.0, np.abs(values))
    if not orbits.mirrored:
        sizes = np.sqrt(sizes)
        with np.errstate(divide="ignore", invalid="ignore"):
            # The error of a square root is at most the root of the error of its square.
            errors = np.fmin(0.5 * errors / sizes, np.sqrt(errors))
    # Two are always 1.
    high, low = ((sizes + sign * errors).max(initial=1.0) for sign in (1.0, -1.0))
    return Radius(float(sizes.max(initial=1.0)), float(low), float(high))


def _on_circle(
    values: np.ndarray[tuple[int], np.dtype[np.complex128]], errors: Floats
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Tell which multipliers are on the unit circle exactly."""
    apart = np.abs(values[:, np.newaxis] - values)
    np.fill_diagonal(apart, np.inf)
    # Twice: the mirror image of a disc across the circle is a little larger, and both may touch.
    with np.errstate(invalid="ignore"):
        alone = (apart > 2.0 * (errors[:, np.newaxis] + errors)).all(axis=1)
    close = np.abs(np.abs(values) - 1.0) <= errors
    return np.asarray(alone & close & (errors < _ALONE))


class PeriodMap:
    """The half-period map of one motion, or its whole-period map if it is not mirrored.

    It acts on deviations from the state after the impacts at tau = -1, scaled as in
    `kernels.saltation`; `scale` are their units, (mode,). `X` is the map and `E` bounds of the
    errors of its entries, each (2 mode, 2 mode). If the motion grazes a wall, `grazes`, there is
    no map.
    """

    def __init__(self, orbits: Orbits, f: int, scale: Floats) -> None:
        self.orbits, self.f, self.scale = orbits, f, scale
        self.X = np.eye(2 * orbits.roots.size)
        self.E, self.grazes = np.zeros(self.X.shape), False
        self._free_motion()
        self._impact(1.0)
        if orbits.mirrored:
            self.X *= -1.0
            return
        self._free_motion()
        # The second half ends with the velocity at the beginning of the first, reversed.
        self._impact(-1.0)

    def multipliers(self) -> tuple[np.ndarray[tuple[int], np.dtype[np.complex128]], Floats]:
        """Return all multipliers but the two that are 1, and their errors."""
        restriction = _Restriction.of(
            self.X, self.orbits, self.f, self.scale, self.orbits.force_error(self.f)
        )
        solution: Any = scipy.linalg.eig(restriction.within, left=True, right=True)
        values, left, right = solution
        cosines = np.abs((left.conj() * right).sum(axis=0))
        y, x = (np.abs(restriction.basis @ vectors) for vectors in (left, right))
        size = float(np.linalg.norm(self.X)) + float(np.linalg.norm(restriction.within))
        error = (y * (self.E @ x)).sum(axis=0) + 4.0 * EPS * size
        error += restriction.turned(left, right)
        with np.errstate(divide="ignore", invalid="ignore"):
            return values.astype(np.complex128), np.asarray(error / cosines)

    def _free_motion(self) -> None:
        orbits, duration = self.orbits, 2.0 / float(self.orbits.omega[self.f])
        rates, n = np.abs(orbits.roots), orbits.roots.size
        # Bound of the growth of each mode; its errors act as errors of its phase.
        slow = np.maximum(1.0, self.scale * np.minimum(duration, 1.0 / np.maximum(rates, 1e-300)))
        with np.errstate(over="ignore"):
            grown = slow * np.exp(np.minimum(np.maximum(0.0, -orbits.roots) * duration, 300.0))
        off = (orbits.root_error + EPS * rates) * duration + 4.0 * EPS
        before = np.abs(self.X[:n]) + np.abs(self.X[n:])
        # The first n columns move each mode from a place, the others from a velocity.
        unit = np.zeros((2 * n, 2))
        unit[:n, 0] = unit[n:, 1] = 1.0
        saltation.advance(unit, orbits.roots, self.scale, duration)
        by_place, by_speed = np.abs(unit[:, :1]), np.abs(unit[:, 1:])
        both = by_place * np.tile(self.E[:n], (2, 1)) + by_speed * np.tile(self.E[n:], (2, 1))
        self.E = both + np.tile((grown * off)[:, np.newaxis] * before, (2, 1))
        saltation.advance(self.X, orbits.roots, self.scale, duration)

    def _impact(self, sign: float) -> None:
        orbits, scale = self.orbits, self.scale
        rows, n = (orbits.upper if sign > 0.0 else orbits.lower).rows, orbits.roots.size
        for row, curvature, off in zip(rows, *orbits.curvatures(self.f, sign), strict=True):
            if not np.isfinite(curvature):
                self.grazes = True
                return
            jump = np.eye(2 * n)
            saltation.strike(jump, row, scale, float(curvature))
            wrong = (2.0 * orbits.row_error + 4.0 * EPS) * (np.abs(jump - np.eye(2 * n)))
            wrong[n:, :n] += 2.0 / float(row @ row) * off * np.abs(np.outer(row, row / scale))
            self.E = np.abs(jump) @ self.E + wrong @ np.abs(self.X) + EPS * np.abs(self.X)
            saltation.strike(self.X, row, scale, float(curvature))


@dataclass(frozen=True, eq=False, slots=True)
class _Restriction:
    """A map without shifts in time and changes of energy.

    With the rate F of the motion, ``P F = F``, and with the gradient H of its energy,
    ``H^T P = H^T`` and ``H^T F = 0``: between the two P is block-triangular. Errors of the
    directions of F and H turn the basis by as much towards them.
    """

    within: Floats  # (2 mode - 2, 2 mode - 2)
    basis: Floats  # (2 mode, 2 mode - 2)
    from_gradient: Floats  # what P takes from H into the basis, (2 mode - 2,)
    into_rate: Floats  # what it takes from the basis to F, (2 mode - 2,)
    rate_error: float  # of the direction of F
    gradient_error: float  # of that of H

    @classmethod
    def of(cls, P: Floats, orbits: Orbits, f: int, scale: Floats, force_error: Floats) -> Self:
        """Restrict a map."""
        eigenvalues = orbits.roots * np.abs(orbits.roots)
        position, velocity = orbits.lower.position[f], orbits.lower.velocity[f]
        force = orbits.load - eigenvalues * position
        F = np.concatenate([scale * velocity, force])
        H = np.concatenate([-force / scale, velocity])
        length, steepness = float(np.linalg.norm(F)), float(np.linalg.norm(H))
        pair = np.stack([F / length, H / steepness], axis=1)
        basis = np.linalg.qr(pair, mode="complete")[0][:, 2:]
        slow = (orbits.error[f] + orbits.row_error) * orbits.lower.velocity_size[f]
        return cls(
            np.asarray(basis.T @ P @ basis),
            basis,
            basis.T @ (P @ pair[:, 1]),
            (pair[:, 0] @ P) @ basis,
            float(np.linalg.norm(np.concatenate([scale * slow, force_error]))) / length,
            float(np.linalg.norm(np.concatenate([slow, force_error / scale]))) / steepness,
        )

    def turned(self, left: Any, right: Any) -> Floats:
        """Return what the errors of the basis add to the multipliers, times the cosines."""
        return np.asarray(
            self.gradient_error * np.abs(left.conj().T @ self.from_gradient)
            + self.rate_error * np.abs(self.into_rate @ right)
        )
