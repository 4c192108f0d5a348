"""Frequency response of large structures: few natural modes and a series for all others.

The squared frequencies are divided into intervals. About the middle sigma of an interval all
natural modes within a radius d, larger than half the interval, are computed, and
`spectrum.modes_between` proves that none is missing. The other modes add up to a function that
is smooth in the interval:

    (z M - K)^(-1) w = sum_j e_j (e_j . w)/(z - lambda_j)  +  sum_m (sigma - z)^m v_m,
    v_0 = (sigma M - K)^(-1) w',   v_(m+1) = (sigma M - K)^(-1) M v_m,
    w' = w - sum_j M e_j (e_j . w)

The first term of the series is the static correction of modal analysis, shifted to sigma; the
others are mode accelerations. As no omitted mode is closer to sigma than d, the remainder after
T terms is at most

    (|z - sigma|/d)^T / (d - |z - sigma|)  (w . M^(-1) w - sum_j (e_j . w)^2)

in magnitude. Factors, modes and series of an interval serve all frequencies and harmonics in it.
The intervals depend on the structure alone, so that all pieces of a job use the same ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
import scipy.linalg

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.factors import Solve
from vibroimpact_solvers.model import System
from vibroimpact_solvers.receptance.coordinates import Coordinates
from vibroimpact_solvers.receptance.frequency_response import ConstraintReceptance
from vibroimpact_solvers.spectrum import EigenvalueCount, EigenvalueCounter, SpectrumSlice

METHOD: Final = "partial"
"""Name of the method in a plan."""
MODES_PER_INTERVAL: Final = 15
"""Natural modes in an interval if they were spread evenly over the squared frequencies."""
EXACT: Final = 1e-20
"""Default relative truncation error: below rounding, even where the weights sum to large values."""

_MAX_MODES = 16 * MODES_PER_INTERVAL  # more modes about an interval: it is halved
_MAX_HALVINGS = 16  # halvings of an interval at most
_MAX_BLUR = 0.1  # error of the counts by rounding, relative to the radius
_MAX_MODES_UNDIVIDED = 2000  # modes about one interval that halving does not separate


@dataclass(frozen=True, slots=True)
class ExpansionSize:
    """How many modes are kept about an interval, and how many terms of the series."""

    factor: int  # radius over half the width of the interval
    terms: int  # terms of the series for the omitted modes

    @classmethod
    def of(cls, tolerance: float | None) -> ExpansionSize:
        """Return the cheapest one for a relative error of the impulses."""
        depth = EXACT if tolerance is None else max(EXACT, 1e-3 * tolerance)
        factor = 4 if depth < 1e-9 else 2
        return cls(factor, math.ceil(-math.log(depth) / math.log(factor)))


@dataclass(frozen=True, eq=False, slots=True)
class Interval:
    """Modes and series that give the frequency response in one interval of squared frequency."""

    # Middle sigma, and the distance d from it within which no mode is omitted
    shift: float
    radius: float
    eigenvalues: Floats  # (mode,)
    # Modal participations ``W E`` at the impacted constraints, (constraint, mode)
    participation: Floats
    modes: Floats  # modes at the degrees of freedom that are evaluated, (dof, mode)
    powers: Floats  # ``radius^m v_m``, (term, dof, constraint)
    moments: Floats  # ``radius^m W v_m``, (term, constraint, constraint)
    residual: Floats  # part of ``w . M^(-1) w`` that belongs to the omitted modes, (constraint,)
    eigenvalue_error: float  # absolute error of the eigenvalues

    @property
    def nbytes(self) -> int:
        """Memory held."""
        arrays = (self.eigenvalues, self.participation, self.modes, self.powers, self.moments)
        return sum(array.nbytes for array in arrays)

    def weights(self, z: float) -> tuple[Floats, Floats]:
        """Return the factors of the modes and of the powers at a squared frequency."""
        apart = z - self.eigenvalues
        # At a natural frequency to the last bit: take its neighbour instead.
        apart[apart == 0.0] = EPS * z
        steps = np.full(len(self.powers), (self.shift - z) / self.radius)
        steps[0] = 1.0
        return 1.0 / apart, np.cumprod(steps)

    def receptance(self, z: float) -> ConstraintReceptance:
        """Return the receptance between the constraints at a squared frequency."""
        near, series = self.weights(z)
        # Contracted term by term: rounding does not depend on what else is computed.
        W = self.participation
        value = (W * near) @ W.T + np.tensordot(series, self.moments, 1)
        slope = (W * near**2) @ W.T
        m = np.arange(1, len(series))
        slope += np.tensordot(m * series[:-1] / self.radius, self.moments[1:], 1)
        away = abs(z - self.shift) / self.radius
        left = np.sqrt(np.outer(self.residual, self.residual)) / (self.radius * (1.0 - away))
        error = left * away ** len(series)
        steep = (np.abs(W) * near**2) @ np.abs(W).T + left / (self.radius * (1.0 - away))
        error += self.eigenvalue_error * steep
        return ConstraintReceptance(value, slope, error)


class PartialModalResponse:
    """Frequency response from the natural modes near each frequency.

    `directions` are ``W^T``, (dof, constraint), and `bound` is one of the natural frequencies;
    `dofs` are evaluated besides those of the constraints.
    """

    def __init__(
        self,
        system: System,
        directions: Floats,
        bound: float,
        dofs: Integers,
        expansion: ExpansionSize,
    ) -> None:
        self.system, self.directions = system, directions
        self.bound, self.expansion = bound, expansion
        every = {dof for c in system.constraints for dof in c.dofs}
        self.dofs = np.array(sorted(every.union(dofs.tolist())), dtype=np.int64)
        self.width = interval_width(system.n, bound)
        self._counter: EigenvalueCounter | None = None
        self._solve_mass = system.solve_M
        self._cache_key = _cache_key(system, directions, self.dofs, expansion)

    def displacements(self, frequency: float, at: Coordinates) -> Floats:
        """Return the response of some coordinates, shape (coordinate, constraint)."""
        z = frequency**2
        interval = self._interval_at(z)[0]
        near, series = interval.weights(z)
        some = np.searchsorted(self.dofs, at.dofs)
        picked = (interval.modes[some] * near) @ interval.participation.T
        picked += np.tensordot(series, interval.powers[:, some], 1)
        return at.combined(picked)

    def receptance(self, frequency: float) -> ConstraintReceptance:
        """Return the receptance between the constraints."""
        return self._interval_at(frequency**2)[0].receptance(frequency**2)

    def natural_frequencies(self, low: float, high: float) -> Floats:
        """Return all natural frequencies between two, ascending."""
        parts, z = [np.empty(0)], low**2
        while z < high**2:
            interval, end = self._interval_at(z)
            values = interval.eigenvalues
            parts.append(values[(values >= z) & (values < end)])
            z = end
        roots = np.sqrt(np.sort(np.concatenate(parts)))
        return np.asarray(roots[roots <= high])

    def _interval_at(self, z: float) -> tuple[Interval, float]:
        """Return the interval that holds a squared frequency, and its end."""
        for level in range(_MAX_HALVINGS + 1):
            width = self.width / 2.0**level
            index = math.floor(z / width)
            index += (index + 1) * width <= z  # where the quotient was rounded down
            name = self._cache_key + f"{level} {index}".encode()
            interval: Interval | _TooManyModes = spectrum.CACHE.get(
                name, partial(self._expand, (index + 0.5) * width, width, level)
            )
            if isinstance(interval, Interval):
                return interval, (index + 1) * width
        raise AssertionError("intervals of the finest level are never halved")

    def _expand(self, shift: float, width: float, level: int) -> Interval | _TooManyModes:
        """Compute the modes about an interval and the series of the others."""
        if self._counter is None:
            self._counter = EigenvalueCounter.of(self.system)
        radius = 0.5 * width * self.expansion.factor
        low, high = self._counter.count(shift - radius), self._counter.count(shift + radius)
        if max(low.error, high.error) > _MAX_BLUR * radius:
            message = f"rounding blurs the natural modes around the frequency {math.sqrt(shift):g}"
            raise ConvergenceError(message)
        count = high.below - low.below
        if count > _MAX_MODES and level < _MAX_HALVINGS:
            return _TooManyModes()
        if count > _MAX_MODES_UNDIVIDED:
            message = f"{count} natural modes lie around the frequency {math.sqrt(shift):g}"
            raise ConvergenceError(message)
        sigma, solve = self._factors(shift, width)
        near = spectrum.modes_between(self.system, low, high, sigma, solve, self._solve_mass)
        return self._expansion_about(near, sigma, _inner_radius(low, high, sigma), solve)

    def _factors(self, shift: float, width: float) -> tuple[float, Solve]:
        K, M = self.system.K, self.system.M
        for nudge in (0.0, 1e-3, -1e-3, 1e-2, -1e-2):
            sigma = shift + nudge * width
            try:
                return sigma, K.plus(-sigma, M).factorize()
            except scipy.linalg.LinAlgError:
                continue
        raise ConvergenceError(f"the structure cannot be factorized at {math.sqrt(shift):g}")

    def _expansion_about(
        self, near: SpectrumSlice, sigma: float, radius: float, solve: Solve
    ) -> Interval:
        modes, M = near.modes, self.system.M
        mass_modes = M @ modes
        participation = self.directions.T @ modes
        rest = self.directions - mass_modes @ participation.T
        vector = self._mass_orthogonal(-solve(rest), modes, mass_modes)
        count = participation.shape[0]
        powers = np.empty((self.expansion.terms, self.dofs.size, count))
        moments = np.empty((self.expansion.terms, count, count))
        for m in range(self.expansion.terms):
            if m:
                vector = self._mass_orthogonal(-radius * solve(M @ vector), modes, mass_modes)
            powers[m] = vector[self.dofs]
            moments[m] = self.directions.T @ vector
        whole = np.diagonal(self.directions.T @ self._solve_mass(self.directions))
        residual = np.maximum(whole - (participation**2).sum(axis=1), 4.0 * EPS * whole)
        error = max(float(near.error.max(initial=0.0)), 2.0 * EPS * self.bound**2)
        picked = np.ascontiguousarray(modes[self.dofs])
        values = near.eigenvalues
        return Interval(
            sigma, radius, values, participation, picked, powers, moments, residual, error
        )

    @staticmethod
    def _mass_orthogonal(vectors: Floats, modes: Floats, mass_modes: Floats) -> Floats:
        """Remove the modes again: their components, left by rounding, would grow term by term."""
        return np.asarray(vectors - modes @ (mass_modes.T @ vectors))


@dataclass(frozen=True, slots=True)
class _TooManyModes:
    """Marks an interval that has to be halved."""

    nbytes: int = 0


def interval_count(n: int, bound: float, frequencies: Floats) -> int:
    """Return in how many undivided intervals some frequencies lie."""
    return np.unique(np.floor(frequencies**2 / interval_width(n, bound))).size


def interval_width(n: int, bound: float) -> float:
    """Return the width of the intervals, a squared frequency."""
    return bound**2 * min(1.0, MODES_PER_INTERVAL / n)


def _cache_key(
    system: System, directions: Floats, dofs: Integers, expansion: ExpansionSize
) -> bytes:
    """Return the key under which intervals are cached."""
    parts = (system.M.digest(), system.K.digest(), directions.tobytes(), dofs.tobytes())
    return b"interval" + b"".join(parts) + repr(expansion).encode()


def _inner_radius(low: EigenvalueCount, high: EigenvalueCount, sigma: float) -> float:
    """Return the distance from the shift within which the counts prove that no mode is missing."""
    return min(high.at - high.error - sigma, sigma - low.at - low.error)
