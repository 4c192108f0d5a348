"""Responses to triangle-wave impulses without natural modes.

Unit impulses along the rows of W at tau = 1, repelling at tau = -1, move the structure by

    X(tau) = sum_k 2 (-1)^(k-1) sin(kappa_k tau) (kappa_k^2 omega^2 M - K)^(-1) W^T
             + omega^-2 sum_m c_m(tau) (M^(-1) K / omega^2)^m M^(-1) W^T

with kappa_k = (2k-1) pi/2. The first sum runs over the harmonics 1 ... H of the fundamental
frequency Omega, each a wave of `Waves`; the second is the Taylor series, in mu = lambda/omega^2,
of what remains of s(mu, tau), with

    c_m(tau) = sum_{k>H} 2 (-1)^(k-1) sin(kappa_k tau) / kappa_k^(2m+2).

It converges with the rate (Omega_N / ((2H+1) Omega))^2. H = 0 needs only products with K and
solves with M. Above the spectrum nothing cancels: where K couples neighbours with springs, all
terms of a displacement have one sign, so even entries of 1e-30 have all their digits, while a
sum over modes loses what is smaller than its rounding.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.matrices import Solve
from vibroimpact_solvers.model import System
from vibroimpact_solvers.receptance.rows import Rows
from vibroimpact_solvers.receptance.waves import FactorizedWaves, Waves

IMPULSES: Final = 1e-18
"""Relative truncation of the series where only sums at the impulses are wanted."""
ENTRYWISE: Final = 1e-48
"""The same where entries of 1e-30 of the largest must keep their digits."""

_FAST = 0.5  # a rate of convergence at which another harmonic would not pay
_BLOCK = 64  # powers held at a time
_TERMS = 8  # numbers of terms are multiples of it
_FEW = 64  # numbers per power up to which powers are kept
_ONE = np.ones(1)


@dataclass(frozen=True, slots=True)
class Truncation:
    """Where the two sums stop.

    Parameters
    ----------
    harmonics : int
        H above.
    terms : int
        Terms of the series.
    rate : float
        Its rate of convergence.
    """

    harmonics: int
    terms: int
    rate: float

    @property
    def remainder(self) -> float:
        """Bound of what is left out, relative to the series' first term."""
        return self.rate**self.terms / (1.0 - self.rate)


def truncations(
    bound: float, Omega: Floats, depth: float, harmonics: int | None = None
) -> tuple[Floats, Floats, Floats]:
    """Return harmonics, terms and rates of `truncation` for many frequencies.

    They are floating-point numbers, as there may be more of them than an integer holds.
    """
    ratio = bound / Omega
    if harmonics is None:
        needed = np.maximum(0.0, np.ceil((ratio / math.sqrt(_FAST) - 1.0) / 2.0))
    else:
        needed = np.full(ratio.shape, float(harmonics))
    rate = np.minimum((ratio / (2.0 * needed + 1.0)) ** 2, 1.0 - 1e-6)
    terms = np.ones(rate.shape)
    some = rate > 0.0
    terms[some] = np.ceil(np.log(depth * (1.0 - rate[some])) / np.log(rate[some]))
    return needed, np.maximum(1.0, terms), rate


def truncation(
    bound: float, Omega: float, depth: float, harmonics: int | None = None
) -> Truncation:
    """Return where to stop for a relative error `depth`.

    Parameters
    ----------
    bound : float
        No natural frequency is above it.
    Omega : float
        Fundamental frequency.
    depth : float
        Relative error allowed.
    harmonics : int, optional
        Number of harmonics; absent: as few as make the series fast.
    """
    needed, terms, rate = truncations(bound, np.array([Omega]), depth, harmonics)
    return Truncation(int(needed[0]), int(terms[0]), float(rate[0]))


def coefficients(harmonics: int, terms: int, tau: Floats) -> Floats:
    """Return ``kappa_(H+1)^(2m) c_m(tau)``, bounded for all m, shape (term, tau)."""
    times = tuple(float(t) for t in tau)
    return _coefficients(harmonics, terms, times)


@lru_cache(maxsize=64)
def _coefficients(harmonics: int, terms: int, times: tuple[float, ...]) -> Floats:
    tau = np.array(times)
    found = np.empty((terms, tau.size))
    for m in range(terms):
        found[m] = _small_coefficient(harmonics, m, tau) if m < 2 else _tail(harmonics, m, tau)
    found.setflags(write=False)
    return found


def _small_coefficient(harmonics: int, m: int, tau: Floats) -> Floats:
    """Return one of the first two: its closed form without the harmonics that are solved for.

    Small differences of large numbers: the wider type keeps their digits.
    """
    t = tau.astype(np.longdouble)
    half_pi = np.longdouble("1.5707963267948966192313216916397514421")
    total = t if m == 0 else 0.5 * (t - t**3 / 3.0)
    for k in range(1, harmonics + 1):
        kappa = (2 * k - 1) * half_pi
        total = total - (-1.0) ** (k - 1) * 2.0 * np.sin(kappa * t) / kappa ** (2 * m + 2)
    return np.asarray(total * ((2 * harmonics + 1) * half_pi) ** (2 * m), dtype=np.float64)


def _tail(harmonics: int, m: int, tau: Floats) -> Floats:
    """Return one of the others, summed until what follows is below rounding."""
    first = harmonics + 1
    reach = (2 * first - 1) * 10.0 ** (17.0 / (2 * m + 2))
    k = np.arange(first, first + math.ceil(reach / 2.0) + 1)
    kappa = (2 * k - 1) * (0.5 * np.pi)
    weights = np.where(k % 2 == 1, 2.0, -2.0) * (kappa[0] / kappa) ** (2 * m) / kappa**2
    return np.asarray(weights @ np.sin(np.outer(kappa, tau)))


class Receptance:
    """Responses of one system to unit impulses at some of its constraints.

    Parameters
    ----------
    system : System
    active : tuple of int
        The constraints.
    bound : float
        Upper bound of the natural frequencies.
    harmonics : int, optional
        Number of harmonics at all frequencies; absent: at each as few as make the series fast.
    waves : Waves, optional
        Where the harmonics come from; absent: a factorization for each.
    """

    def __init__(
        self,
        system: System,
        active: tuple[int, ...],
        bound: float,
        harmonics: int | None = None,
        waves: Waves | None = None,
    ) -> None:
        self.system, self.bound, self.harmonics = system, bound, harmonics
        self.directions = np.ascontiguousarray(system.directions(active).T)
        self.coordinates = Rows.along(system.constraints[index] for index in active)
        self.waves = waves or FactorizedWaves(system, self.directions, bound)
        self._kept: WeakKeyDictionary[Rows, list[Floats]] = WeakKeyDictionary()
        self._solve_mass: Solve = system.M.factorize()

    def truncation(self, omega: float, depth: float) -> Truncation:
        """Return where the sums stop at one frequency."""
        return truncation(self.bound, 0.5 * np.pi * omega, depth, self.harmonics)

    @property
    def mobility(self) -> Floats:
        """``W M^(-1) W^T``, shape (constraint, constraint)."""
        return np.asarray(self.directions.T @ self._solve_mass(self.directions))

    def impulse_matrices(
        self, omega: Floats, depth: float = IMPULSES
    ) -> tuple[Floats, Floats, Floats]:
        """Return S, ``sum_j a_j a_j^T / cos^2(gamma_j)``, and the error of S by that of waves.

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
                    kappa, square = (k - 0.5) * np.pi, omega[f] ** 2
                    felt = self.waves.response(kappa * omega[f])
                    response = square * felt.value
                    S[f] += 2.0 * response
                    energy[f] += 4.0 * kappa**2 * square**2 * felt.slope - 2.0 * response
                    error[f] += 2.0 * felt.error
        return S / (omega**2)[:, np.newaxis, np.newaxis], energy, error

    def displacements(
        self, omega: Floats, p: Floats, tau: Floats, rows: Rows, depth: float
    ) -> Floats:
        """Return displacements under impulses p, shape (frequency, tau, row).

        Parameters
        ----------
        omega : array, shape (frequency,)
        p : array, shape (frequency, constraint)
        tau : array, shape (tau,)
        rows : callable
            Picks the wanted rows.
        depth : float
            Truncation, relative to the largest displacement.
        """
        pieces: list[Floats] = [np.empty(0)] * omega.size
        for harmonics, group, terms in self._groups(omega, depth):
            found = self._series(omega[group], p[group], tau, rows, harmonics, terms)
            for place, f in enumerate(group):
                pieces[f] = found[place] + self._waves(omega[f], p[f], tau, rows, harmonics)
        return np.array(pieces)

    def curvature(self, omega: float, p: Floats, rows: Rows) -> Floats:
        """Return a bound of the second derivative by tau of displacements, shape (row,)."""
        limit = self.truncation(omega, IMPULSES)
        rate = self._rates(np.array([omega]), limit.harmonics)[0]
        factors = coefficients(limit.harmonics, limit.terms, _ONE)[:, 0]
        unit = (limit.harmonics + 0.5) * np.pi
        bound = np.zeros(1)
        for start, block in self._powers(rows, limit.terms + 1):
            for m, power in enumerate(block, start=start):
                # c_m'' = -c_(m-1) and c_0'' makes up for the harmonics that c_0 lacks.
                factor = 2.0 * limit.harmonics if m == 0 else factors[m - 1] * unit**2
                bound = bound + factor * rate**m * np.abs(power @ p)
        bound = bound / omega**2
        for k in range(1, limit.harmonics + 1):
            kappa = (k - 0.5) * np.pi
            wave = self.waves.rows(kappa * omega, rows)
            bound = bound + 2.0 * kappa**2 * np.abs(wave @ p)
        return np.asarray(bound)

    def _groups(self, omega: Floats, depth: float) -> Iterator[tuple[int, list[int], int]]:
        """Yield numbers of harmonics, the frequencies that need them, and terms for these.

        What a frequency gets does not depend on those beside it, so that the pieces of a job
        give the numbers of the whole to the last bit.
        """
        needed, terms, rates = truncations(self.bound, 0.5 * np.pi * omega, depth, self.harmonics)
        # Without stiffness (rate 0) the first term is all there is.
        terms = np.where(rates > 0.0, np.ceil(terms / _TERMS) * _TERMS, 1.0)
        needs = [(int(h), int(m)) for h, m in zip(needed, terms, strict=True)]
        for harmonics, count in sorted(set(needs)):
            group = [f for f, need in enumerate(needs) if need == (harmonics, count)]
            yield harmonics, group, count

    def _rates(self, omega: Floats, harmonics: int) -> Floats:
        # Powers are measured by the bound, so that high ones neither grow nor vanish.
        return np.asarray((self.bound / (omega * (harmonics + 0.5) * np.pi)) ** 2)

    def _powers(self, rows: Rows, terms: int) -> Iterator[tuple[int, Floats]]:
        """Yield blocks of ``(M^(-1) K / bound^2)^m M^(-1) W^T``, (term, row, constraint).

        Few rows are kept: the terms do not depend on what else is asked.
        """
        if rows.size * self.directions.shape[1] > _FEW:
            yield from self._new_powers(rows, terms)
            return
        kept = self._kept.setdefault(rows, [])
        if sum(map(len, kept)) < terms:
            kept[:] = [block for _, block in self._new_powers(rows, -(-terms // _BLOCK) * _BLOCK)]
        for place, block in enumerate(kept):
            if place * _BLOCK < terms:
                yield place * _BLOCK, block[: terms - place * _BLOCK]

    def _new_powers(self, rows: Rows, terms: int) -> Iterator[tuple[int, Floats]]:
        vector = self._solve_mass(self.directions)
        start, block = 0, [rows(vector)]
        for m in range(1, terms):
            vector = self._solve_mass(self.system.K @ vector) / self.bound**2
            if len(block) == _BLOCK:
                yield start, np.array(block)
                start, block = m, []
            block.append(rows(vector))
        yield start, np.array(block)

    def _moments(self, terms: int) -> Floats:
        blocks = self._powers(self.coordinates, terms)
        return np.concatenate([block for _, block in blocks])

    def _series(
        self, omega: Floats, p: Floats, tau: Floats, rows: Rows, harmonics: int, terms: int
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

    def _waves(
        self, omega: float, p: Floats, tau: Floats, rows: Rows, harmonics: int
    ) -> Floats | float:
        total: Floats | float = 0.0
        for k in range(1, harmonics + 1):
            kappa = (k - 0.5) * np.pi
            sign = 2.0 if k % 2 == 1 else -2.0
            wave = self.waves.rows(kappa * omega, rows) @ p
            total = total + np.outer(sign * np.sin(kappa * tau), wave)
        return total


def _weighted(weights: Floats, terms: Floats) -> Floats:
    """Return ``sum_m weights[..., m] terms[m]``, term by term.

    A matrix product would be quicker, but its roundings depend on how many rows it has.
    """
    shape = (*weights.shape[:-1], *[1] * (terms.ndim - 1))
    total = weights[..., 0].reshape(shape) * terms[0]
    for m in range(1, len(terms)):
        total += weights[..., m].reshape(shape) * terms[m]
    return np.asarray(total)
