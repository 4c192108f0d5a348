"""Estimated floating-point operations of the methods for impact modes without all natural modes."""

from __future__ import annotations

import numpy as np

from vibroimpact_solvers import receptance, spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.impact_modes.problem import Problem
from vibroimpact_solvers.matrices import Form
from vibroimpact_solvers.model import System

SMALL = 256
"""Degrees of freedom up to which a full matrix is factorized at single frequencies."""


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
    return total(problem, _harmonics(problem)) + orders * problem.omega.size


def total(problem: Problem, values: Floats) -> float:
    """Return the sum over all frequencies of what is known at the sampled ones."""
    return float(values.sum()) * (problem.omega.size / values.size)


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
