"""Derivatives of the energies of impact modes, see `kernels.motions`.

At tau = 0 a mode has ``q = U`` and ``q' = omega D``, so that

    E = sum_j [(omega D)^2 + lambda U^2]/2 - f U .
"""

from __future__ import annotations

from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.impact_modes.derivatives.equations import (
    Component,
    ComponentRates,
    Frequency,
)
from vibroimpact_solvers.impact_modes.derivatives.rates import Rates

_ROUNDINGS: Final = 8.0
_LARGEST: Final = 700.0  # g up to which cosh(g) is finite

Amplitudes = tuple[Component, ComponentRates, Floats, Floats]
"""A component, its rates, and those of its amplitudes with their errors."""


def energy_rates(
    parts: list[Amplitudes], values: Floats, rates: Rates, at: Frequency
) -> tuple[Floats, Floats]:
    """Return rates of the energies and their errors, each (parameter, frequency).

    `values` are the eigenvalues, (mode,).
    """
    total, error = np.zeros((2, *at.rate.shape))
    for one, own, A, A_error in parts:
        scaled = one.phases.scaled
        g = np.where(scaled, one.phases.gamma, 0.0)
        small = 1.0 / np.cosh(np.minimum(g, _LARGEST))
        # Profiles of unstable modes are over cosh(g), which changes with mu.
        shrink = np.where(scaled, np.tanh(g) / (2.0 * np.where(scaled, g, 1.0)), 0.0)
        place, unsure = one.A * small, one.A_error * small
        change = (A + shrink * own.mu * one.A) * small
        wrong = (A_error + np.abs(shrink * one.A) * own.mu_error) * small
        if not one.phases.symmetric:
            pieces = [at.square * place * change, at.square * at.relative * place**2]
            lost = at.square * (np.abs(place) * wrong + unsure * np.abs(change))
        else:
            pulled = np.where(scaled, 0.0, one.load)
            force = values * place - pulled
            pieces = [force * change, 0.5 * rates.values * place**2]
            pieces.append(-np.where(scaled, 0.0, rates.load) * place)
            if scaled.any():
                safe = np.where(values != 0.0, values, 1.0)
                sunk = 0.5 * (one.load / safe) ** 2 * rates.values - one.load * rates.load / safe
                pieces.append(np.where(scaled, sunk, 0.0))
            lost = np.abs(force) * wrong + unsure * np.abs(values * change)
            lost += 0.5 * rates.value_errors * place**2 + unsure * np.abs(rates.values * place)
            if rates.first.size:
                mixed = 0.5 * place[:, rates.first] * rates.mixed * place[:, rates.second]
                total += mixed.sum(axis=2)
                error += _ROUNDINGS * EPS * np.abs(mixed).sum(axis=2)
        for piece in pieces:
            total += piece.sum(axis=2)
            error += _ROUNDINGS * EPS * np.abs(piece).sum(axis=2)
        error += lost.sum(axis=2)
    return total, error
