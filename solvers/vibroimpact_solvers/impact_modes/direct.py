"""An antisymmetric family evaluated without natural modes, see `receptance`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Booleans, Floats, Integers
from vibroimpact_solvers.impact_modes.family import Impulses
from vibroimpact_solvers.impact_modes.problem import Frequencies, Problem
from vibroimpact_solvers.receptance import (
    ENTRYWISE,
    IMPULSES,
    Coordinates,
    FrequencyResponse,
    TriangleWaveResponse,
)

ROUNDED: Final = 64.0 * EPS
"""Estimated relative rounding of an entry of a displacement."""

_UNCERTAIN = 1e-13  # relative error of displacements, beside that of the impulses
_POINTS = (
    65,
    257,
    1025,
    8193,
)  # numbers of times at which limits are checked


@dataclass(frozen=True, eq=False, slots=True)
class Forces:
    """Impulses p at frequencies omega, shape (frequency, constraint): they define the motion."""

    omega: Floats
    p: Floats
    error: Floats  # relative errors of the impulses, (frequency,)

    def at(self, chosen: Booleans) -> Forces:
        """Return those of some of the frequencies."""
        return Forces(self.omega[chosen], self.p[chosen], self.error[chosen])


class DirectFamily:
    """One antisymmetric family, by direct solves and a power series.

    Frequencies and outputs of the problem are not used; `bound` is one of the natural
    frequencies. The harmonics come from `frequency_response`, or from a factorization each, or,
    unless `factorizes`, from the series alone.
    """

    def __init__(
        self,
        problem: Problem,
        bound: float,
        *,
        factorizes: bool = True,
        frequency_response: FrequencyResponse | None = None,
    ) -> None:
        self.factorizes = factorizes
        harmonics = None if factorizes else 0
        self.response = TriangleWaveResponse(
            problem.system, problem.active, bound, harmonics, frequency_response
        )
        self.limits = Coordinates.along(problem.system.constraints)
        self.gaps = np.array([c.upper for c in problem.struck], dtype=np.float64)

    @property
    def mobility(self) -> Floats:
        """``W M^(-1) W^T``, shape (constraint, constraint)."""
        return self.response.mobility

    def solutions(self, at: Frequencies, *, with_motion: bool = True) -> tuple[Impulses, Forces]:
        """Return impulses and motions at some frequencies."""
        omega = at.omega
        S, energy, S_error = self.response.impulse_matrices(omega)
        # Bound of the change of S with the relative change of all natural frequencies.
        slope = (np.abs(energy) + np.abs(S)) / (omega**2)[:, np.newaxis, np.newaxis]
        p, error = np.zeros((omega.size, self.gaps.size)), np.full(omega.size, np.inf)
        for f in range(omega.size):
            try:
                inverse = np.linalg.inv(S[f])
            except np.linalg.LinAlgError:
                continue
            p[f] = inverse @ self.gaps
            remainder = self.response.truncation(float(omega[f]), IMPULSES).remainder
            change = 8.0 * EPS * slope[f] + remainder * np.abs(S[f]) + S_error[f]
            absolute = np.abs(inverse) @ (change @ np.abs(p[f]) + EPS * np.abs(self.gaps))
            error[f] = absolute.max() / np.abs(p[f]).max()
        return Impulses(p, p, error), Forces(omega, p, error)

    def motion_errors(self, motion: Forces, x: Floats, dofs: Integers) -> Floats:
        """Return estimated errors of displacements x, (frequency, …, dof), as (frequency, dof)."""
        size = largest_displacements(x)
        largest = size.max(axis=1, initial=0.0)
        error = np.minimum(motion.error, 1.0)
        return np.asarray((error * largest)[:, np.newaxis] + ROUNDED * size)

    def energy_errors(self, motion: Forces) -> Floats:
        """Return estimated errors of the energies, shape (frequency,)."""
        relative = 2.0 * np.minimum(motion.error, 1.0) + ROUNDED
        return np.asarray(relative * np.abs(self.energy(motion)))

    def displacements(self, motion: Forces, tau: Floats, dofs: Integers) -> Floats:
        """Return displacements, shape (frequency, tau, dof)."""
        omega, p = motion.omega, motion.p
        return self.response.displacements(omega, p, tau, Coordinates(dofs), ENTRYWISE)

    def energy(self, motion: Forces) -> Floats:
        """Return the total energies, shape (frequency,)."""
        _, matrices, _ = self.response.impulse_matrices(motion.omega)
        work = np.einsum("fa,fab,fb->f", motion.p, matrices, motion.p)
        return np.asarray(0.5 * work / motion.omega**2)

    def harmonics(self, motion: Forces, orders: Integers, dofs: Integers) -> Floats:
        """Return Fourier amplitudes for odd orders, shape (frequency, order, dof)."""
        rows = Coordinates(dofs)
        b = np.zeros((motion.omega.size, orders.size, dofs.size))
        for f, omega in enumerate(motion.omega):
            for k, order in enumerate(orders):
                sign = 2.0 if order % 4 == 1 else -2.0
                frequency = 0.5 * np.pi * order * omega
                response = self.response.frequency_response.displacements(frequency, rows)
                b[f, k] = sign * (response @ motion.p[f])
        return b

    def check_path(
        self, motion: Forces, error: Floats, problem: Problem
    ) -> tuple[Floats, Booleans]:
        """Return a time at which a limit is exceeded or nan, and whether that is certain.

        `error` is the relative error of the impulses, shape (frequency,).
        """
        size = motion.omega.size
        witness, certified = np.full(size, np.nan), np.zeros(size, dtype=np.bool_)
        for f, omega in enumerate(motion.omega):
            witness[f], certified[f] = self._check(
                float(omega), motion.p[f], float(error[f]), problem
            )
        return witness, certified

    def _check(self, omega: float, p: Floats, error: float, problem: Problem) -> tuple[float, bool]:
        system = problem.system
        rows = self.limits
        walls = [(c.lower, c.upper) for c in system.constraints]
        limit = np.array([min(w for w in pair if w is not None) for pair in walls])
        doubt = 2.0 * (error + _UNCERTAIN) * np.abs(limit)
        curvature = self.response.curvature(omega, p, rows)
        # Shortly before an impact the coordinate rises towards its wall: within twice this time
        # the bound of its curvature excludes both a higher value and one beyond the other wall.
        end = np.ones(limit.size)
        slope = np.maximum(self.mobility @ p / omega**2, 0.0)
        for place, index in enumerate(problem.active):
            bend, room = curvature[index], 2.0 * limit[index]
            back = (np.sqrt(slope[place] ** 2 + 2.0 * bend * room) - slope[place]) / bend
            end[index] -= 0.5 * min(2.0 * slope[place] / bend, back, 1.0)
        at, force = np.array([omega]), p[np.newaxis]
        for points in _POINTS:
            tau = np.linspace(0.0, 1.0, points)
            y = np.abs(self.response.displacements(at, force, tau, rows, IMPULSES)[0])
            passed = np.argwhere((y > limit + doubt) & (tau[:, np.newaxis] <= end))
            if passed.size:
                return float(tau[passed[0, 0]]), True
            reach = np.maximum(y[1:], y[:-1]) + curvature / (8.0 * (points - 1) ** 2)
            open_steps = (reach > limit - doubt) & (tau[:-1, np.newaxis] < end)
            if not open_steps.any():
                return np.nan, True
        return np.nan, False


def largest_displacements(x: Floats) -> Floats:
    """Return the largest magnitudes of displacements (frequency, …, dof), as (frequency, dof)."""
    between = tuple(range(1, x.ndim - 1))
    return np.asarray(np.abs(x).max(axis=between, initial=0.0) if between else np.abs(x))
