"""The equations of a family, differentiated by parameters.

Impulses z and modal amplitudes A of a component satisfy, at each frequency,

    mode j:  p'_j A_j + s'_j f_j/omega^2 = share (r_j . z)/omega^2 ,
    wall i:  sum_j r_ij (p_j A_j + s_j f_j/omega^2) = wall_i ,

with the profiles p, s at tau = 1 and their derivatives p', s' by tau (`functions`), rows r of the
modes at the struck walls, and loads f. Both are linear in z and A, so that the derivatives solve
them with other right-hand sides (`elimination`), whose terms are made here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.impact_modes.derivatives.functions import Phases, Profile
from vibroimpact_solvers.impact_modes.derivatives.rates import Rates

_NODES: Final = 0.5 + 0.5 * np.array([-np.sqrt(0.6), 0.0, np.sqrt(0.6)])
_WEIGHTS: Final = np.array([5.0, 8.0, 5.0]) / 18.0
"""Of the mean of a slope between two close eigenvalues, by Gauss."""


class Frequency(NamedTuple):
    """Frequencies omega, (frequency,), and their rates, (parameter, frequency)."""

    omega: Floats
    rate: Floats

    @property
    def square(self) -> Floats:
        """``omega^2``, (frequency, 1)."""
        return np.asarray(np.square(self.omega)[:, np.newaxis])

    @property
    def relative(self) -> Floats:
        """Rates relative to omega, (parameter, frequency, 1)."""
        return np.asarray((self.rate / self.omega)[..., np.newaxis])


@dataclass(frozen=True, eq=False, slots=True)
class Component:
    """One component of the motion, antisymmetric or symmetric."""

    phases: Phases
    rows: Floats  # r, (unknown, mode)
    wrong: Floats  # their errors
    A: Floats  # amplitudes, (frequency, mode)
    A_error: Floats
    load: Floats  # f, zeros for the antisymmetric component, (mode,)
    uncertainty: Floats  # of gamma, (frequency, mode)
    # Profiles at tau = 1, and their derivatives by tau
    place: Profile
    speed: Profile


@dataclass(frozen=True, eq=False, slots=True)
class ComponentRates:
    """Rates of the data of a component with all parameters."""

    rows: Floats  # of r, (parameter, unknown, mode)
    row_errors: Floats
    mu: Floats  # of mu, (parameter, frequency, mode)
    mu_error: Floats
    force: Floats | None  # of f/omega^2, None where there is no load, (parameter, frequency, mode)


def component_rates(one: Component, rates: Rates, at: Frequency, combine: Floats) -> ComponentRates:
    """Return the rates of a component; `combine` makes rows of unknowns of those of constraints."""
    mu = rates.values / at.square
    error = rates.value_errors / at.square + 2.0 * EPS * np.abs(mu)
    if at.rate.any():
        by_frequency = 2.0 * one.phases.mu * at.relative
        mu = mu - by_frequency
        error = error + 2.0 * EPS * np.abs(by_frequency)
    force = None
    if one.phases.symmetric and (one.load.any() or rates.load.any()):
        force = (rates.load - 2.0 * one.load * at.relative) / at.square
    return ComponentRates(
        combine @ rates.rows, np.abs(combine) @ rates.row_errors, mu, error, force
    )


class Terms(NamedTuple):
    """What functionals of modal coordinates change by while the amplitudes stay.

    Each (parameter, frequency, mode).
    """

    value: Floats
    size: Floats  # sum of the magnitudes of the terms
    error: Floats  # beside their rounding


def terms(
    one: Component, own: ComponentRates, rates: Rates, at: Frequency, profile: Profile
) -> Terms:
    """Return the rates of ``p A + s f/omega^2`` of all modes while the amplitudes stay."""
    by_mu = profile.p_slope * one.A
    value = by_mu * own.mu
    size = np.abs(value)
    # A phase that is wrong by some amount moves a slope by about as much.
    wave = np.abs(one.A) * np.maximum(np.abs(profile.p_slope), _slope_size(one.phases))
    lost = wave * one.uncertainty + np.abs(profile.p_slope) * one.A_error
    error = np.abs(by_mu) * own.mu_error + lost * np.abs(own.mu)
    if own.force is not None:
        force = one.load / at.square
        parts = profile.s * own.force, profile.s_slope * force * own.mu
        value = value + parts[0] + parts[1]
        size = size + np.abs(parts[0]) + np.abs(parts[1])
        error = error + np.abs(profile.s_slope * force) * own.mu_error
    return Terms(value, size, error)


def _slope_size(phases: Phases) -> Floats:
    """Return about how large slopes of profiles by mu are at other phases, (frequency, mode)."""
    one = np.ones_like(phases.gamma)
    return one if phases.symmetric else one / np.maximum(1.0, phases.gamma)


def add_pairs(
    whole: Terms, one: Component, rates: Rates, at: Frequency, slopes: tuple[Floats, Floats]
) -> None:
    """Add what the first mode of each pair takes from the second; `slopes` of p and s."""
    A, force = one.A[:, rates.second], one.load[rates.second] / at.square
    base = slopes[0] * A + slopes[1] * force
    rate = rates.mixed / at.square
    size = np.abs(slopes[0] * A) + np.abs(slopes[1] * force)
    error = size * (rates.mixed_errors / at.square)
    error = error + size * np.abs(rate) * one.uncertainty[:, rates.second]
    added = Terms(base * rate, size * np.abs(rate), error)
    for target, values in zip(whole, added, strict=True):
        for place, mode in enumerate(rates.first.tolist()):
            target[..., mode] += values[..., place]


def averaged(phases: Phases, rates: Rates, tau: float | None, order: int) -> list[Floats]:
    """Return divided differences of pairs: of p, s and, at an impact, of p', s'.

    At a time, or of a harmonic where tau is None; each (frequency, pair).
    """
    sums: list[Floats] = []
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        middle = _between(phases, rates, float(node))
        if tau is None:
            profiles = [middle.of_harmonic(order)]
        elif tau == 1.0:
            profiles = list(middle.at_impact())
        else:
            profiles = [middle.at_time(tau)]
        parts = [part for each in profiles for part in (each.p_slope, each.s_slope)]
        parts = [weight * part for part in parts]
        sums = parts if not sums else [a + b for a, b in zip(sums, parts, strict=True)]
    return sums


def _between(phases: Phases, rates: Rates, node: float) -> Phases:
    """Return phases at a part of the way from the second to the first modes of the pairs."""
    first, second = rates.first, rates.second
    mu = phases.mu[:, second] + node * (phases.mu[:, first] - phases.mu[:, second])
    return Phases(mu, np.sqrt(np.abs(mu)), np.zeros_like(mu), phases.symmetric)
