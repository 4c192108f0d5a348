"""Impact modes as their stability depends on them: places, velocities and their errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats


class Radius(NamedTuple):
    """Largest modulus of the multipliers of half a period, at least 1, and bounds of it."""

    value: float
    low: float
    high: float

    @classmethod
    def unknown(cls) -> Self:
        """Return the radius of a motion that grazes a wall."""
        return cls(np.nan, np.nan, np.nan)


@dataclass(frozen=True, eq=False, slots=True)
class Side:
    """Impacts at one corner of the triangle wave, tau = 1 or tau = -1."""

    # ``W E`` of the constraints with impacts; no rows if there are none, (constraint, mode)
    rows: Floats
    row_errors: Floats  # absolute errors of these rows, (constraint, mode)
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
    rounding: Floats  # what rounding took from them, relative to them, (mode,)
    load: Floats  # static load of each mode, (mode,)
    omega: Floats  # triangle-wave frequencies, (frequency,)
    omega_rounding: Floats  # what rounding took from them, relative to them, (frequency,)
    # Impacts at tau = 1 and at tau = -1
    upper: Side
    lower: Side
    mirrored: bool  # whether the second half of the period mirrors the first
    other_roots: Floats  # signed natural frequencies of the other modes, (mode,)
    root_error: Floats  # errors of those of the participating modes beside rounding, (mode,)
    row_error: float  # relative error of the rows
    error: Floats  # relative error of the motion, (frequency,)

    def force_error(self, f: int) -> Floats:
        """Return the errors of the modal forces at one frequency, (mode,).

        They are relative to the antisymmetric and the symmetric component of the motion, whose
        magnitudes add up to the larger of the displacements at both ends.
        """
        size = np.maximum(np.abs(self.upper.position[f]), np.abs(self.lower.position[f]))
        turn = self.roots / self.omega[f]
        # Phases are rounded, and so are the natural frequencies.
        off = self.root_error / self.omega[f] + 1.5 * EPS * np.abs(turn)
        with np.errstate(divide="ignore", invalid="ignore"):
            # Near a pole, where sin vanishes, the displacement depends strongly on the frequency.
            steep = np.where(turn > 0.0, 2.0 * off / np.abs(np.sin(2.0 * turn)), 0.0)
            own = np.where(turn == 0.0, 0.0, 2.0 * off / np.abs(turn))
        relative = self.error[f] + self.row_error + 4.0 * EPS + steep + own
        squares = np.square(self.roots)
        return np.asarray(relative * (squares * size + np.abs(self.load)))

    def curvatures(self, f: int, sign: float) -> tuple[Floats, Floats]:
        """Return acceleration over velocity of all struck coordinates before their impacts.

        Those at tau = `sign`, 1 or -1, and errors, each (constraint,), 1 per unit of time; not
        finite where a coordinate grazes its wall.
        """
        side = self.upper if sign > 0.0 else self.lower
        acceleration = self.load - self.roots * np.abs(self.roots) * side.position[f]
        rows, sizes = side.rows, np.abs(side.rows)
        approach = rows @ (sign * side.velocity[f])
        off = sizes @ self.force_error(f) + 4.0 * EPS * (sizes @ np.abs(acceleration))
        relative = self.error[f] + self.row_error + 4.0 * EPS
        with np.errstate(divide="ignore", invalid="ignore"):
            curvature = (rows @ acceleration) / approach
            off += np.abs(curvature) * relative * (sizes @ side.velocity_size[f])
            return np.asarray(curvature), np.asarray(off / np.abs(approach))
