"""Price of impact modes without all natural modes: estimated floating-point operations."""

from __future__ import annotations

import numpy as np

from vibroimpact_solvers import receptance, spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.impact_modes.problem import DISPLACEMENTS, Problem
from vibroimpact_solvers.matrices import Form
from vibroimpact_solvers.model import System
from vibroimpact_solvers.plan import Stage, Step

SMALL = 256
"""Degrees of freedom up to which a full matrix is factorized at single frequencies."""


ALWAYS_MODAL = 256
"""Degrees of freedom up to which all natural modes are always computed."""
_EACH_HARMONIC = 1e5  # operations by partial modes, at each constraint
_ALL_INTERVALS = 64  # harmonics per degree of freedom from which on all intervals are visited


def can_factorize(system: System) -> bool:
    """Whether factorizations at single frequencies are cheap."""
    return system.n <= SMALL or Form.DENSE not in {system.M.form, system.K.form}


def interval_flops(problem: Problem) -> float:
    """Return the operations for the modes about one interval and the series of the others."""
    system, expansion = problem.system, receptance.ExpansionSize.of(problem.tolerance)
    kept = receptance.MODES_PER_INTERVAL * expansion.factor
    solves = 2.5 * kept + expansion.terms * len(problem.active)
    flops = 3.0 * spectrum.factor_flops(system) + solves * spectrum.solve_flops(system)
    return flops + 8.0 * system.n * kept**2


def products_flops(problem: Problem) -> float:
    """Return the operations of the products with M and K in the power series."""
    system = problem.system
    return 100.0 * 2.0 * (system.K.entries + system.M.entries) * len(problem.active)


def factorized_flops(problem: Problem) -> float:
    """Return the operations of a factorization for each harmonic of each frequency."""
    return harmonic_count(problem) * spectrum.factor_flops(problem.system)


def harmonic_count(problem: Problem) -> float:
    """Return the number of harmonics of all frequencies at which the structure is solved."""
    orders = _orders(problem).size if "harmonics" in problem.outputs else 0
    return problem.total(_harmonics(problem)) + orders * problem.omega.size


def harmonic_frequencies(problem: Problem) -> Floats:
    """Return the frequencies of all these harmonics, of the sampled frequencies."""
    counts = _harmonics(problem).astype(np.int64)
    first = np.cumsum(counts) - counts
    odd = 2.0 * (np.arange(counts.sum()) - np.repeat(first, counts)) + 1.0
    frequencies = np.repeat(problem.sample, counts) * odd
    if "harmonics" in problem.outputs:
        requested = np.outer(problem.sample, _orders(problem)).ravel()
        return np.concatenate([frequencies, requested])
    return frequencies


def _harmonics(problem: Problem) -> Floats:
    """Return the number of harmonics that each sampled frequency needs for its impulses."""
    bound = spectrum.largest_frequency(problem.system)
    return receptance.truncations(bound, problem.sample, receptance.IMPULSES)[0]


def _orders(problem: Problem) -> Floats:
    return np.arange(1.0, problem.highest_harmonic + 1.0, 2.0)


def solves_flops(problem: Problem, partial: Step | None) -> float:
    """Return the price of all harmonics: each factorized, or evaluated by partial modes."""
    if partial is None:
        return factorized_flops(problem)
    return _EACH_HARMONIC * harmonic_count(problem)


def partial_step(problem: Problem, *, at_any_price: bool = False) -> Step | None:
    """Return the step for the modes near the harmonics, None where factorizing costs less."""
    system = problem.system
    harmonics = harmonic_count(problem)
    if system.n <= ALWAYS_MODAL or not harmonics:
        return None
    bound = spectrum.largest_frequency(system)
    expansion = receptance.ExpansionSize.of(problem.tolerance)
    if harmonics > _ALL_INTERVALS * system.n:
        intervals = -(-system.n // receptance.MODES_PER_INTERVAL)
    else:
        frequencies = harmonic_frequencies(problem)
        intervals = receptance.interval_count(system.n, bound, frequencies)
    kept, each = receptance.MODES_PER_INTERVAL * expansion.factor, interval_flops(problem)
    if not at_any_price and intervals * each > harmonics * spectrum.factor_flops(system):
        return None
    places = problem.output_dofs.size if problem.outputs & DISPLACEMENTS else 0
    places += len(problem.system.constraints)
    size = 8.0 * intervals * places * (kept + expansion.terms * len(problem.active))
    reason = (
        f"few of {system.n} natural modes matter: about {kept} near each of {intervals} intervals "
        f"that hold {harmonics:.0f} harmonics, their number proved by Sylvester's law of inertia; "
        "the others by their static correction in the interval and "
        f"{expansion.terms - 1} mode accelerations"
    )
    flops = intervals * each
    return Step(Stage.SPECTRUM, receptance.METHOD, reason, flops, size, intervals, expansion)
