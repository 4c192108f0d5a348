"""How much errors of the damping and of complex modes mix the modes of a driven structure.

An error e of the coupling of mode p to mode k makes each of p's vibrations drive k. In the vector
of p, mode k then has the share ``e / |s_p - s_k|``, s being their rates: however small that is, it
counts where p vibrates beside its resonance without damping, and k reaches a stop that p does not.
Modes whose rates are nearly the same are left as they are, and k is driven by ``e`` times p.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.periodic_motions.groups import Turned
from vibroimpact_solvers.periodic_motions.pairs import Complexes, Pairs
from vibroimpact_solvers.time_history.basis import Basis
from vibroimpact_solvers.time_history.complex_modes import NEAR
from vibroimpact_solvers.time_history.structure import Structure

_TURNED: Final = 8.0 * EPS  # share of a mode in another that it was turned against
_NONE: Final = np.zeros((0, 0))


@dataclass(frozen=True, eq=False, slots=True)
class Mixing:
    """Bounds of what errors add to the vectors and to the rates of pairs.

    Parameters
    ----------
    far : array, shape (pair, pair)
        Share of pair k in the vector of pair p, ``[k, p]``; empty where nothing is mixed.
    near : array, shape (pair, pair)
        How pair p drives pair k of nearly the same rate, per unit of time.
    rates : array, shape (2, pair), complex
        Both rates of each pair.
    """

    far: Floats
    near: Floats
    rates: Complexes

    @classmethod
    def of(cls, structure: Structure, basis: Basis, pairs: Pairs, equal: Turned) -> Mixing:
        """Return that of a structure whose modes, some of them turned, are those of a basis."""
        modes, turns = basis.modes, np.where(np.arange(pairs.nu.size) < pairs.rotations.stop, 1j, 1)
        nu = np.where(np.arange(pairs.nu.size) < pairs.hyperbolas.stop, pairs.nu, 0.0)
        rates = np.stack([pairs.alpha + turns * nu, pairs.alpha - turns * nu])
        system, left = structure.system, _NONE
        if system.C is None and not equal.groups:
            return cls(_NONE, _NONE, rates)
        far, near = basis.mixing
        if system.C is not None:
            left = modes.left_out / structure.scale
        if left.any() or equal.spread.any():
            each = np.eye(modes.roots.size)
            driven = np.linalg.norm(basis.kick(each), axis=1)
            coupling = np.zeros(far.shape)
            if left.any():
                coupling += driven.T @ left @ np.linalg.norm(basis.velocity(each), axis=1)
            placed = np.linalg.norm(basis.displacement(each), axis=1)
            for group, spread in zip(equal.groups, equal.spread, strict=True):
                pushed = np.outer(driven[group].sum(axis=0), placed[group].sum(axis=0))
                coupling += pushed * (spread / structure.scale**2)
            np.fill_diagonal(coupling, 0.0)
            apart = np.abs(rates[0, :, np.newaxis] - rates[0])
            apart = np.minimum(apart, np.abs(rates[0, :, np.newaxis] - rates[1]))
            apart = np.minimum(apart, np.abs(rates[1, :, np.newaxis] - rates[0]))
            apart = np.minimum(apart, np.abs(rates[1, :, np.newaxis] - rates[1]))
            close = apart <= NEAR * np.abs(rates).max(axis=0)
            far = far + np.where(close, 0.0, coupling) / np.where(close, 1.0, apart)
            near = near + np.where(close, coupling, 0.0)
        for group in equal.groups:
            places = basis.place[group]
            places = places[places >= 0]
            share = _TURNED * (1.0 - np.eye(places.size))
            far[places[:, np.newaxis], places] += share
        # Nothing brings back what slides without drag: it is not driven by roundings either.
        slides = (rates == 0.0).all(axis=0)
        far[slides], near[slides] = 0.0, 0.0
        if not (far.any() or near.any()):
            return cls(_NONE, _NONE, rates)
        return cls(far, near, rates)

    def __bool__(self) -> bool:
        return self.far.size > 0

    def of_forms(self, forms: Floats | Complexes) -> Floats:
        """Return errors of forms (…, 2, pair), of both numbers of each pair, (…, pair)."""
        return np.asarray(np.linalg.norm(forms, axis=-2) @ self.far)

    def _of_drives(self, drives: Floats | Complexes) -> Floats:
        """Return errors of kicks, or of loads, as those of forms."""
        return np.asarray(np.linalg.norm(drives, axis=-2) @ self.far.T)

    def of_steady(self, rates: Floats, load: Complexes, steady: Complexes) -> Floats:
        """Return absolute errors of steady responses, shape (cell, load, pair).

        Parameters
        ----------
        rates : array, shape (cell, load)
        load : array, shape (load, 2, pair)
        steady : array, shape (cell, load, 2, pair)
        """
        turning = 1j * rates[..., np.newaxis]
        apart = np.minimum(np.abs(turning - self.rates[0]), np.abs(turning - self.rates[1]))
        driven = self._of_drives(load) + _lengths(steady) @ self.near.T
        return _gained(driven, apart)

    def of_response(self, cells: Floats, sign: float, kicks: Floats, after: Floats) -> Floats:
        """Return absolute errors of responses to kicks, one per cell, shape (cell, kick, pair).

        Parameters
        ----------
        cells : array, shape (cell,)
            Their lengths.
        sign : float
        kicks : array, shape (kick, 2, pair)
        after : array, shape (cell, kick, 2, pair)
            The responses.
        """
        lengths = cells[:, np.newaxis]
        with np.errstate(under="ignore"):
            there = np.exp(self.rates[:, np.newaxis] * lengths)
        apart = np.abs(1.0 - sign * there)
        # A rigid body does not come back by itself, but falls from one half to the other half.
        apart = np.where(apart == 0.0, 1.0, apart).min(axis=0)[:, np.newaxis]
        # A pair is driven for as long as the other lasts.
        lasts = np.minimum(lengths, 1.0 / np.maximum(-self.rates.real.max(axis=0), 1.0 / lengths))
        moved = (_lengths(after) * lasts[:, np.newaxis]) @ self.near.T
        return _gained(self._of_drives(kicks) + moved, apart)


def _lengths(states: Floats | Complexes) -> Floats:
    """Return the lengths of pairs, 0 for those without bound: no motion has them."""
    lengths = np.linalg.norm(states, axis=-2)
    return np.asarray(np.where(np.isfinite(lengths), lengths, 0.0))


def _gained(driven: Floats, apart: Floats) -> Floats:
    """Return drives divided by distances from resonance; what is not driven stays at rest."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(driven == 0.0, 0.0, driven / apart))
