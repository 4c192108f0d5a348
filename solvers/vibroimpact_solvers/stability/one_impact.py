"""Multipliers of impact modes that strike one constraint once a half-period, or once a period.

Deviations move freely for a time T, with the transition matrix Phi, and are multiplied by the
saltation matrix S; T is half a period, and ``P = -S Phi``, where that mirrors the other half, else
a period, and ``P = S Phi``. With mass-normalized modes a deviation z of the multiplier nu of
``S Phi`` jumps by ``(a w, b w)``, w being the participations of the modes in the struck
coordinate, so that

    z_j = (nu - Phi_j)^-1 (a, b) w_j.

S reverses the displacement of the struck coordinate, and its velocity but for ``2 g`` times the
displacement, with the curvature g, its acceleration over its velocity: two equations for a and b.
With ``L = (nu + 1/nu)/2``, the phases ``phi_j = Omega_j T``, ``c = cos phi``, ``s = sin phi``, and
``sum_j w_j^2 = 1``, their determinant vanishes where

    (L^2 - 1) G^2 + E (D - g) = 0,
    G = sum w_j^2/(L - c_j), E = sum w_j^2 s_j/(Omega_j (L - c_j)),
    D = sum w_j^2 Omega_j s_j/(L - c_j).

The double poles of the squares cancel; what is left is ``1 + sum R_j/(L - c_j)`` with

    R_j = w_j^2 (2 w_j^2 c_j - g s_j/Omega_j
          + sum_(i /= j) w_i^2 s_j (s_i (Omega_i/Omega_j + Omega_j/Omega_i) - 2 s_j)/(c_j - c_i)),

the zeros of which are enclosed by discs (`kernels.secular`). Each of the n zeros L is one of a pair
``nu, 1/nu``: a real one between -1 and 1 is a pair on the unit circle exactly. The zero -1, or 1 if
there is no mirror image, is the pair of multipliers that are 1, of a shift in time and a change of
energy.

Modes of one natural frequency take part as one: of the others, none does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from vibroimpact_solvers.arrays import EPS, Booleans, Floats
from vibroimpact_solvers.kernels import free_motion, secular
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.stability.orbits import Orbits, Radius


def applies(orbits: Orbits) -> bool:
    """Whether one constraint is struck once a half-period, or once a period, and no mode grows."""
    upper, lower = orbits.upper.rows.shape[0], orbits.lower.rows.shape[0]
    struck = upper if orbits.mirrored else upper + lower
    return struck == 1 and bool((orbits.roots >= 0.0).all()) and orbits.roots.size > 1


@dataclass(frozen=True, eq=False, slots=True)
class FreeMotion:
    """Modes of different natural frequencies that one impact joins, each (mode,)."""

    orbits: Orbits
    modes: free_motion.FreeMotion
    weight: Floats  # squares of the participations, of sum 1
    weight_error: Floats

    @classmethod
    def of(cls, orbits: Orbits) -> Self:
        """Return the modes of impact modes to which this `applies`."""
        side = orbits.upper if orbits.upper.rows.shape[0] else orbits.lower
        order = np.argsort(orbits.roots, kind="stable")
        roots, error = orbits.roots[order], orbits.root_error[order]
        row, row_error = np.abs(side.rows[0, order]), side.row_errors[0, order]
        row_error = row_error + orbits.row_error * row
        squares, square_error = row * row, (2.0 * row + row_error) * row_error
        starts = np.flatnonzero(np.concatenate([[True], ~_together(roots, error)]))
        spread = np.maximum.reduceat(roots, starts) - roots[starts]
        squares, square_error = (np.add.reduceat(a, starts) for a in (squares, square_error))
        whole, whole_error = squares.sum(), square_error.sum()
        relative = whole_error / whole + EPS * (squares.size + 4.0)
        low = roots[starts] * orbits.rounding[order][starts]
        return cls(
            orbits,
            free_motion.FreeMotion(roots[starts], low, np.maximum.reduceat(error, starts) + spread),
            squares / whole,
            square_error / whole + relative * squares / whole,
        )

    def radius(self, f: int) -> Radius:
        """Return the largest modulus of the multipliers of half a period at one frequency."""
        if self.weight.size < 2:  # one multiplier, which is known
            return Radius(1.0, 1.0, 1.0)
        modes = self._modes(f)
        if not np.isfinite(modes.curvature):
            return Radius.unknown()
        if not (np.diff(modes.pole) > 0.0).all():  # two modes return at once
            return Radius(1.0, 1.0, np.inf)
        equation = secular.Equation(*np.empty((4, modes.pole.size)))
        secular.residues(modes, equation)
        home, alone = np.empty((2, modes.pole.size - 1), dtype=np.int64)
        x, y, correction, circle = np.empty((4, modes.pole.size - 1))
        zeros = secular.Zeros(home, x, y, correction, circle, alone)
        progress = np.zeros(1, secular.PROGRESS)
        while not secular.find(modes, equation, zeros, progress, secular.PIECE):
            look()
        return _radius(modes, zeros, 1.0 if self.orbits.mirrored else 0.5)

    def _modes(self, f: int) -> free_motion.Modes:
        """Return the modes as the kernel takes them, in units of the duration of free motion."""
        omega, mirrored = float(self.orbits.omega[f]), self.orbits.mirrored
        phases = free_motion.Phases(*np.empty((len(free_motion.Phases._fields), self.weight.size)))
        low = omega * float(self.orbits.omega_rounding[f])
        free_motion.turn(self.modes, omega, low, mirrored, phases)
        terms = self.weight * phases.bend
        rounding = EPS * (terms.size + 16.0) * float(np.abs(terms).sum())
        order = np.argsort(phases.pole, kind="stable")
        parts = [part[order] for part in (self.weight, self.weight_error, *phases)]
        known = -1.0 if mirrored else 1.0
        return free_motion.Modes._make([*parts, known, float(terms.sum()), rounding])


def _together(roots: Floats, error: Floats) -> Booleans:
    """Whether each root but the first may be equal to the one before it."""
    return np.asarray(np.diff(roots) <= 4.0 * (error[1:] + error[:-1] + EPS * roots[1:]))


def _radius(modes: free_motion.Modes, zeros: secular.Zeros, share: float) -> Radius:
    """Return the largest ``|nu|^share`` of zeros in discs.

    On ellipses with foci -1 and 1, ``|L - 1| + |L + 1| = 2 cosh log |nu|``. The gradient of the
    logarithm is ``|L^2 - 1|^(-1/2)``.
    """
    # From the known zero, towards the other focus: two numbers of which none is a difference.
    x = -modes.known * (modes.pole[zeros.home]) - modes.known * zeros.x
    y, off = np.abs(zeros.y), zeros.radius
    near, far = np.hypot(x, y), np.hypot(x - 2.0, y)
    with np.errstate(divide="ignore", invalid="ignore"):
        excess = 0.5 * (_sagitta(x, y, near) + _sagitta(2.0 - x, y, far))  # cosh log |nu| - 1
        steep = np.sqrt(np.maximum(near - off, 0.0) * np.maximum(far - off, 0.0))
        slope = np.where(off > 0.0, off / steep, 0.0)
        exponent = _area(excess)
        high = np.fmin(_area(excess + off), exponent + slope)
        low = np.fmax(_area(np.maximum(excess - off, 0.0)), exponent - slope)
    circled = (zeros.alone == 1) & (y == 0.0) & (x >= off) & (x + off <= 2.0)
    exponent, low, high = (np.where(circled, 0.0, part) for part in (exponent, low, high))
    with np.errstate(over="ignore"):
        value, least, most = (
            float(np.exp(share * part.max(initial=0.0))) for part in (exponent, low, high)
        )
    return Radius(value, least, np.inf if np.isnan(most) else most)


def _sagitta(length: Floats, y: Floats, hypotenuse: Floats) -> Floats:
    """Return ``hypot(length, y) - length`` without cancelling."""
    return np.where(length > 0.0, y * y / (hypotenuse + length), hypotenuse - length)


def _area(excess: Floats) -> Floats:
    """Return the inverse hyperbolic cosine of ``1 + excess``."""
    return np.asarray(np.log1p(excess + np.sqrt(excess * (2.0 + excess))))
