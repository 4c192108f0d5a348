"""Stability of impact modes: the multipliers of the half-period map.

A motion that is its own mirror image after half a period (equal gaps, no load) has the
half-period map ``P = -S Phi(2/omega)``, with the transition matrix Phi of the free motion and the
saltation matrices S of the impacts. Any other motion has the map of the whole period,
``S_lower Phi S_upper Phi``; the square roots of its multipliers are taken. Two multipliers are
always 1: a shift in time does not change the motion, and a change of energy leads to a
neighbouring impact mode. Both are removed before the others are computed, as their common
eigenvector would cause an error of 1e-8 instead of 1e-16.

Errors of the map are bounded entry by entry: the effect of rounding, errors of natural frequencies
and errors of the motion on free motions and impacts. With left and right eigenvectors y and x and
errors E of the map a multiplier errs by ``|y|^T E |x| / |y . x|``, to first order.

Multipliers come in pairs ``m, 1/m`` and in conjugate ones, as the structure is conservative and can
be driven backwards: one that is on the unit circle to within its error, and farther from all others
than both errors, is on the circle exactly. Otherwise ``1/conj(m)`` would be another one.

Examples
--------
>>> import numpy as np
>>> from vibroimpact_solvers import impact_modes
>>> from vibroimpact_solvers.model import Constraint
>>> from vibroimpact_solvers.presets import chain
>>> Omega = np.array([2.1, 4.0])  # near grazing, and far above the spectrum
>>> system = chain(13, [Constraint.at(5, gap=1.0)])
>>> problem = impact_modes.Problem(system, Omega * 2 / np.pi, outputs=frozenset({"stability"}))
>>> impact_modes.solve(problem, impact_modes.plan(problem)).stability.round(2)
array([6.92, 1.  ])
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np
import scipy.linalg

from vibroimpact_solvers.arrays import EPS, Booleans, Floats
from vibroimpact_solvers.kernels import saltation
from vibroimpact_solvers.meter import look

DIRECTION_DEPENDENT: Final = (
    "direction-dependent: the outcome of simultaneous impacts at coupled constraints depends on "
    "which of them comes first"
)

LARGEST: Final = 3000
"""Degrees of freedom up to which the map is computed: beyond, it takes gigabytes and hours."""

_ALONE = 1e-3  # largest error of a multiplier that is told from others
_COUPLED = 1e-12  # cosine of the angle between two constraints above which they are coupled


@dataclass(frozen=True, eq=False, slots=True)
class Side:
    """Impacts at one corner of the triangle wave, tau = 1 or tau = -1."""

    # ``W E`` of the constraints with impacts; no rows if there are none, (constraint, mode)
    rows: Floats
    position: Floats  # modal coordinates, (frequency, mode)
    # Modal velocities at the end of the rise or at its beginning: before the impacts at tau = 1,
    # after those at tau = -1; and bounds of them that their errors are relative to, each
    # (frequency, mode). As impacts reverse the motion they are ``W E p/omega``.
    velocity: Floats
    velocity_size: Floats


@dataclass(frozen=True, eq=False, slots=True)
class Orbits:
    """Impact modes of one family: all that their stability depends on."""

    # Signed natural frequencies of the participating modes, rad per unit of time, (mode,)
    roots: Floats
    load: Floats  # static load of each mode, (mode,)
    omega: Floats  # triangle-wave frequencies, (frequency,)
    # Impacts at tau = 1 and at tau = -1
    upper: Side
    lower: Side
    mirrored: bool  # whether the second half of the period mirrors the first
    other_roots: Floats  # signed natural frequencies of the other modes, (mode,)
    root_error: Floats  # errors of the natural frequencies of the participating modes, (mode,)
    row_error: float  # relative error of the rows
    error: Floats  # relative error of the motion, (frequency,)


def commutes(mobility: Floats) -> bool:
    """Whether the order of simultaneous impacts at constraints with this mobility is irrelevant.

    It is ``W M^(-1) W^T``, shape (constraint, constraint).
    """
    size = np.sqrt(np.diagonal(mobility))
    coupling = np.abs(mobility - np.diag(np.diagonal(mobility)))
    return bool((coupling <= _COUPLED * np.outer(size, size)).all())


def neutral(modulus: Floats, error: Floats) -> Booleans:
    """Whether the largest modulus of multipliers is 1 within its error, shapes (motion,).

    As far as can be told, deviations then neither grow nor decay. Nothing is told where there is
    no modulus or its error is not bounded.
    """
    with np.errstate(invalid="ignore"):
        return np.asarray((np.abs(modulus - 1.0) <= error) & np.isfinite(error))


def growth(orbits: Orbits) -> tuple[Floats, Floats]:
    """Return the spectral radius of the half-period map and its relative error, (frequency,).

    It is 1 for stable motions, nan where a motion grazes a wall, and nan everywhere if
    simultaneous impacts do not commute. The error is infinite where the multipliers cannot be
    computed from the map.
    """
    values, errors = multipliers(orbits)
    # Without error are those on the circle exactly, of whose quotients a modulus may be rounded.
    sizes = np.where(errors == 0.0, 1.0, np.abs(values))
    sizes[np.isnan(values)] = np.nan
    radius = sizes.max(axis=1, initial=1.0)
    fastest = np.maximum(0.0, -orbits.other_roots).max(initial=0.0)
    with np.errstate(over="ignore"):
        others = np.minimum(np.exp(fastest * 2.0 / orbits.omega), np.finfo(np.float64).max)
    radius = np.where(np.isnan(radius), np.nan, np.maximum(radius, others))
    with np.errstate(over="ignore", invalid="ignore"):
        above = (sizes + errors).max(axis=1, initial=1.0) / radius - 1.0
        # The largest multiplier is at least this large; 1 is always among them.
        least = np.maximum((sizes - errors).max(axis=1, initial=1.0), others)
        return radius, np.maximum(np.maximum(above, 1.0 - least / radius), 4.0 * EPS)


def multipliers(
    orbits: Orbits,
) -> tuple[np.ndarray[tuple[int, int], np.dtype[np.complex128]], Floats]:
    """Return the multipliers of half a period and their errors, each (frequency, 2 mode).

    The two that are always 1 come first; errors of those on the unit circle exactly are 0. Where
    the map of the whole period is needed they are square roots of its multipliers. They are nan
    where `growth` is.
    """
    n = orbits.roots.size
    all_values = np.full((orbits.omega.size, 2 * n), np.nan, dtype=np.complex128)
    errors = np.zeros(all_values.shape)
    if not all(commutes(side.rows @ side.rows.T) for side in (orbits.upper, orbits.lower)):
        return all_values, errors
    for f in range(orbits.omega.size):
        look()
        # Slow modes are scaled by the frequency of the motion: in units of their own frequency
        # they would cost digits of the map.
        scale = np.maximum(np.abs(orbits.roots), orbits.omega[f])
        period = PeriodMap(orbits, f, scale)
        if period.grazes:
            continue
        values, value_errors = period.multipliers()
        all_values[f, :2] = 1.0
        all_values[f, 2:], errors[f, 2:] = values, value_errors
        on_circle = _on_circle(values, value_errors)
        all_values[f, 2:][on_circle] = values[on_circle] / np.abs(values[on_circle])
        value_errors = np.where(on_circle, 0.0, value_errors)
        errors[f, 2:] = value_errors
        values = all_values[f, 2:].copy()
        if not orbits.mirrored:
            all_values[f, 2:] = np.sqrt(values)
            with np.errstate(divide="ignore", invalid="ignore"):
                # The error of a square root is at most the root of the error of its square.
                slope = 0.5 * value_errors / np.abs(all_values[f, 2:])
                errors[f, 2:] = np.fmin(slope, np.sqrt(value_errors))
    return all_values, errors


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
        self._impact(orbits.upper, 1.0)
        if orbits.mirrored:
            self.X *= -1.0
            return
        self._free_motion()
        # The second half ends with the velocity at the beginning of the first, reversed.
        self._impact(orbits.lower, -1.0)

    def multipliers(self) -> tuple[np.ndarray[tuple[int], np.dtype[np.complex128]], Floats]:
        """Return all multipliers but the two that are 1, and their errors."""
        restriction = _Restriction.of(self.X, self.orbits, self.f, self.scale, self._force_error())
        solution: Any = scipy.linalg.eig(restriction.within, left=True, right=True)
        values, left, right = solution
        cosines = np.abs((left.conj() * right).sum(axis=0))
        y, x = (np.abs(restriction.basis @ vectors) for vectors in (left, right))
        size = float(np.linalg.norm(self.X)) + float(np.linalg.norm(restriction.within))
        error = (y * (self.E @ x)).sum(axis=0) + 4.0 * EPS * size
        error += restriction.turned(left, right)
        with np.errstate(divide="ignore", invalid="ignore"):
            return values.astype(np.complex128), np.asarray(error / cosines)

    def _force_error(self) -> Floats:
        """Return the errors of the modal forces, (mode,).

        They are relative to the antisymmetric and the symmetric component of the motion, whose
        magnitudes add up to the larger of the displacements at both ends.
        """
        orbits, f = self.orbits, self.f
        size = np.maximum(np.abs(orbits.upper.position[f]), np.abs(orbits.lower.position[f]))
        turn = orbits.roots / orbits.omega[f]
        # Phases are rounded, and so are the natural frequencies.
        off = orbits.root_error / orbits.omega[f] + 1.5 * EPS * np.abs(turn)
        with np.errstate(divide="ignore", invalid="ignore"):
            # Near a pole, where sin vanishes, the displacement depends strongly on the frequency.
            steep = np.where(turn > 0.0, 2.0 * off / np.abs(np.sin(2.0 * turn)), 0.0)
            own = np.where(turn == 0.0, 0.0, 2.0 * off / np.abs(turn))
        relative = orbits.error[f] + orbits.row_error + 4.0 * EPS + steep + own
        squares = np.square(orbits.roots)
        return np.asarray(relative * (squares * size + np.abs(orbits.load)))

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

    def _impact(self, side: Side, sign: float) -> None:
        orbits, f, scale = self.orbits, self.f, self.scale
        acceleration = orbits.load - orbits.roots * np.abs(orbits.roots) * side.position[f]
        velocity = sign * side.velocity[f]
        force_error, n = self._force_error(), orbits.roots.size
        relative = orbits.error[f] + orbits.row_error + 4.0 * EPS
        for row in side.rows:
            approach = float(row @ velocity)
            curvature = float(row @ acceleration) / approach if approach else np.inf
            if not np.isfinite(curvature):
                self.grazes = True
                return
            roundings = 4.0 * EPS * float(np.abs(row) @ np.abs(acceleration))
            off = (float(np.abs(row) @ force_error) + roundings) / abs(approach)
            size = float(np.abs(row) @ side.velocity_size[f])
            off += abs(curvature) * relative * size / abs(approach)
            jump = np.eye(2 * n)
            saltation.strike(jump, row, scale, curvature)
            wrong = (2.0 * orbits.row_error + 4.0 * EPS) * (np.abs(jump - np.eye(2 * n)))
            wrong[n:, :n] += 2.0 / float(row @ row) * off * np.abs(np.outer(row, row / scale))
            self.E = np.abs(jump) @ self.E + wrong @ np.abs(self.X) + EPS * np.abs(self.X)
            saltation.strike(self.X, row, scale, curvature)


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
