"""Response to the periodic impulses of an impact mode, without natural modes.

Unit impulses along the rows of W at tau = 1, and opposite ones at tau = -1, displace the
structure by

    X(tau) = sum_k 2 (-1)^(k-1) sin(kappa_k tau) (kappa_k^2 omega^2 M - K)^(-1) W^T
             + omega^-2 sum_m c_m(tau) (M^(-1) K / omega^2)^m M^(-1) W^T

with kappa_k = (2k-1) pi/2. The first sum runs over the harmonics 1 ... H of the fundamental
frequency Omega, each from `FrequencyResponse`; the second is the Taylor series, in
mu = lambda/omega^2, of what remains of s(mu, tau), with

    c_m(tau) = sum_{k>H} 2 (-1)^(k-1) sin(kappa_k tau) / kappa_k^(2m+2).

It converges at the rate (Omega_N / ((2H+1) Omega))^2. H = 0 needs only products with K and
solves with M. Above the spectrum nothing cancels: where K couples neighbours with springs, all
terms of a displacement have one sign: entries of 1e-30 keep all their digits, while a sum over
modes loses everything below its rounding error.
"""

from __future__ import annotations

from collections.abc import Iterator
from weakref import WeakKeyDictionary

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.model import System
from vibroimpact_solvers.receptance.coefficients import (
    IMPULSES,
    Truncation,
    coefficients,
    truncations,
)
from vibroimpact_solvers.receptance.coordinates import Coordinates
from vibroimpact_solvers.receptance.frequency_response import DirectFrequencyResponse
from vibroimpact_solvers.receptance.partial_modes import PartialModalResponse

FrequencyResponse = DirectFrequencyResponse | PartialModalResponse
"""Steady-state response to unit harmonic forces at the constraints, one frequency at a time."""

_BLOCK = 64  # powers held at a time
_TERMS = 8  # numbers of terms are multiples of it
_FEW = 64  # numbers in one power up to which powers are stored
_ONE = np.ones(1)


class TriangleWaveResponse:
    """Response of one system to periodic impulses at some of its constraints.

    `bound` is one of the natural frequencies. There are `harmonics` at all frequencies, or as few
    as make the series fast; they come from `frequency_response`, or from a factorization each.
    """

    def __init__(
        self,
        system: System,
        active: tuple[int, ...],
        bound: float,
        harmonics: int | None = None,
        frequency_response: FrequencyResponse | None = None,
    ) -> None:
        self.system, self.bound, self.harmonics = system, bound, harmonics
        self.directions = np.ascontiguousarray(system.directions(active).T)
        self.coordinates = Coordinates.along(system.constraints[index] for index in active)
        self.frequency_response = frequency_response or DirectFrequencyResponse(
            system, self.directions, bound
        )
        self._known_powers: WeakKeyDictionary[Coordinates, list[Floats]] = WeakKeyDictionary()
        self._solve_mass = system.solve_M

    def truncation(self, omega: float, depth: float) -> Truncation:
        """Return where the sums stop at one frequency."""
        needed, terms, rate = truncations(
            self.bound, np.array([0.5 * np.pi * omega]), depth, self.harmonics
        )
        return Truncation(int(needed[0]), int(terms[0]), float(rate[0]))

    @property
    def mobility(self) -> Floats:
        """``W M^(-1) W^T``, shape (constraint, constraint)."""
        return np.asarray(self.directions.T @ self._solve_mass(self.directions))

    def impulse_matrices(
        self, omega: Floats, depth: float = IMPULSES
    ) -> tuple[Floats, Floats, Floats]:
        """Return S, ``sum_j a_j a_j^T / cos^2(gamma_j)``, and the error that harmonics cause in S.

        Each is (frequency, constraint, constraint). The first takes impulses to displacements
        of the constraints at tau = 1 (eq. 10.89); half the second over omega^2 is the energy of
        unit impulses.
        """
        count = self.directions.shape[1]
        S, energy, error = np.zeros((3, omega.size, count, count))
        for harmonics, group, terms in self._groups(omega, depth):
            m = np.arange(terms)
            factors = coefficients(harmonics, terms, _ONE)[:, 0]
            moments = self._moments(terms)
            weights = self._rates(omega[group], harmonics)[:, np.newaxis] ** m * factors
            S[group] = _weighted(weights, moments)
            energy[group] = _weighted(weights * (2 * m + 1), moments)
            for f in group:
                for k in range(1, harmonics + 1):
                    look()
                    kappa, square = (k - 0.5) * np.pi, omega[f] ** 2
                    harmonic = self.frequency_response.receptance(kappa * omega[f])
                    response = square * harmonic.value
                    S[f] += 2.0 * response
                    energy[f] += 4.0 * kappa**2 * square**2 * harmonic.slope - 2.0 * response
                    error[f] += 2.0 * harmonic.error
        return S / (omega**2)[:, np.newaxis, np.newaxis], energy, error

    def displacements(
        self, omega: Floats, p: Floats, tau: Floats, rows: Coordinates, depth: float
    ) -> Floats:
        """Return displacements under impulses p, (frequency, constraint), as (frequency, tau, row).

        The sums are truncated at `depth`, relative to the largest displacement.
        """
        pieces: list[Floats] = [np.empty(0)] * omega.size
        for harmonics, group, terms in self._groups(omega, depth):
            series = self._series(omega[group], p[group], tau, rows, harmonics, terms)
            for place, f in enumerate(group):
                pieces[f] = series[place] + self._harmonic_sum(omega[f], p[f], tau, rows, harmonics)
        return np.array(pieces)

    def curvature(self, omega: float, p: Floats, rows: Coordinates) -> Floats:
        """Return a bound of the second derivative by tau of displacements, shape (row,)."""
        limit = self.truncation(omega, IMPULSES)
        rate = self._rates(np.array([omega]), limit.harmonics)[0]
        factors = coefficients(limit.harmonics, limit.terms, _ONE)[:, 0]
        unit = (limit.harmonics + 0.5) * np.pi
        bound = np.zeros(1)
        for start, block in self._powers(rows, limit.terms + 1):
            for m, power in enumerate(block, start=start):
                # c_m'' = -c_(m-1); c_0'' is minus the sum of the first H harmonics.
                factor = 2.0 * limit.harmonics if m == 0 else factors[m - 1] * unit**2
                bound = bound + factor * rate**m * np.abs(power @ p)
        bound = bound / omega**2
        for k in range(1, limit.harmonics + 1):
            look()
            kappa = (k - 0.5) * np.pi
            harmonic = self.frequency_response.displacements(kappa * omega, rows)
            bound = bound + 2.0 * kappa**2 * np.abs(harmonic @ p)
        return np.asarray(bound)

    def _groups(self, omega: Floats, depth: float) -> Iterator[tuple[int, list[int], int]]:
        """Yield a number of harmonics, the frequencies that need it, and their number of terms.

        The choice for a frequency does not depend on the other frequencies, so that the pieces
        of a job give the numbers of the whole to the last bit.
        """
        needed, terms, rates = truncations(self.bound, 0.5 * np.pi * omega, depth, self.harmonics)
        # Without stiffness (rate 0) all terms after the first vanish.
        terms = np.where(rates > 0.0, np.ceil(terms / _TERMS) * _TERMS, 1.0)
        needs = [(int(h), int(m)) for h, m in zip(needed, terms, strict=True)]
        for harmonics, count in sorted(set(needs)):
            group = [f for f, need in enumerate(needs) if need == (harmonics, count)]
            yield harmonics, group, count

    def _rates(self, omega: Floats, harmonics: int) -> Floats:
        # Powers are scaled by the bound, so that high ones neither overflow nor vanish.
        return np.asarray((self.bound / (omega * (harmonics + 0.5) * np.pi)) ** 2)

    def _powers(self, rows: Coordinates, terms: int) -> Iterator[tuple[int, Floats]]:
        """Yield blocks of ``(M^(-1) K / bound^2)^m M^(-1) W^T``, (term, row, constraint).

        Blocks of few coordinates are stored, as several outputs need them.
        """
        if rows.size * self.directions.shape[1] > _FEW:
            yield from self._new_powers(rows, terms)
            return
        kept = self._known_powers.setdefault(rows, [])
        if sum(map(len, kept)) < terms:
            kept[:] = [block for _, block in self._new_powers(rows, -(-terms // _BLOCK) * _BLOCK)]
        for place, block in enumerate(kept):
            if place * _BLOCK < terms:
                yield place * _BLOCK, block[: terms - place * _BLOCK]

    def _new_powers(self, rows: Coordinates, terms: int) -> Iterator[tuple[int, Floats]]:
        vector = self._solve_mass(self.directions)
        start, block = 0, [rows(vector)]
        for m in range(1, terms):
            look()
            vector = self._solve_mass(self.system.K @ vector) / (self.bound**2 or 1.0)
            if len(block) == _BLOCK:
                yield start, np.array(block)
                start, block = m, []
            block.append(rows(vector))
        yield start, np.array(block)

    def _moments(self, terms: int) -> Floats:
        blocks = self._powers(self.coordinates, terms)
        return np.concatenate([block for _, block in blocks])

    def _series(
        self, omega: Floats, p: Floats, tau: Floats, rows: Coordinates, harmonics: int, terms: int
    ) -> Floats:
        factors = coefficients(harmonics, terms, tau)
        rates = self._rates(omega, harmonics)
        total: Floats | float = 0.0
        for start, block in self._powers(rows, terms):
            m = np.arange(start, start + len(block))
            weights = factors[m].T * rates[:, np.newaxis, np.newaxis] ** m
            for a in range(p.shape[1]):
                part = _weighted(weights, block[:, :, a])
                total = total + p[:, a, np.newaxis, np.newaxis] * part
        return np.asarray(total / omega[:, np.newaxis, np.newaxis] ** 2)

    def _harmonic_sum(
        self, omega: float, p: Floats, tau: Floats, rows: Coordinates, harmonics: int
    ) -> Floats | float:
        total: Floats | float = 0.0
        for k in range(1, harmonics + 1):
            look()
            kappa = (k - 0.5) * np.pi
            sign = 2.0 if k % 2 == 1 else -2.0
            harmonic = self.frequency_response.displacements(kappa * omega, rows) @ p
            total = total + np.outer(sign * np.sin(kappa * tau), harmonic)
        return total


def _weighted(weights: Floats, terms: Floats) -> Floats:
    """Return ``sum_m weights[..., m] terms[m]``, term by term.

    A matrix product would be faster, but its rounding depends on its number of rows.
    """
    shape = (*weights.shape[:-1], *[1] * (terms.ndim - 1))
    total = weights[..., 0].reshape(shape) * terms[0]
    for m in range(1, len(terms)):
        total += weights[..., m].reshape(shape) * terms[m]
    return np.asarray(total)
