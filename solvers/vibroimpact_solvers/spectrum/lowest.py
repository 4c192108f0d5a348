"""The lowest natural modes of a large structure, with proof that none is missing.

Counts of the eigenvalues below a value (Sylvester's law of inertia) bracket as many as are asked
for; shift-invert Lanczos finds all in the bracket (`slicing`). The residuals

    r_j = K e_j - lambda_j M e_j ,    lambda_j = e_j^T K e_j / e_j^T M e_j

are computed in twice the working precision. An eigenvalue lies within ``rho_j = |r_j|``, in the
norm of ``M^-1``, of ``lambda_j`` (Krylov and Weinstein). With the distance ``gap_j`` to all other
eigenvalues it lies within ``rho_j^2 / gap_j`` too (Temple and Kato), and the mode within
``rho_j / gap_j`` of its direction in the norm of M (Davis and Kahan). Modes whose eigenvalues are
too close to be told apart are taken together: then this holds for the space that they span.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.linalg

from vibroimpact_solvers import condensation
from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.factors import Solve
from vibroimpact_solvers.kernels import doubled
from vibroimpact_solvers.matrices import SymmetricMatrix, frozen
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.model import System
from vibroimpact_solvers.spectrum import products
from vibroimpact_solvers.spectrum.bounds import largest_frequency
from vibroimpact_solvers.spectrum.inertia import EigenvalueCount, EigenvalueCounter
from vibroimpact_solvers.spectrum.modes import Spectrum
from vibroimpact_solvers.spectrum.slicing import modes_between

_LEAST: Final = 64.0 * EPS  # first end of a bracket over the largest eigenvalue: rigid-body modes
_SPARE: Final = 8  # modes in the bracket besides those that are asked for
_CLEAR: Final = 10.0  # first end of a bracket over the error of a count
_NARROW: Final = 1.01  # ratio of values between which a bracket is not divided any more
_BEFORE: Final = 0.1  # room below zero over the end of the bracket
_TOGETHER: Final = 100.0  # distance of eigenvalues over their errors below which they are together
_NOISE: Final = 4.0  # roundings of a mode's own elastic terms below which it counts as rigid
_SAFETY: Final = 1.01  # covers the roundings of the bounds themselves
_NONE: Final = np.zeros((0, 0))


@dataclass(frozen=True, eq=False, slots=True)
class LowestModes:
    """All natural modes below a value."""

    natural: Spectrum  # the modes, ascending
    beyond: float  # no other eigenvalue is below this one


def lowest_modes(system: System, count: int, below: float | None = None) -> LowestModes:
    """Return the lowest natural modes: at least so many, or all with eigenvalues below a value.

    Raises
    ------
    ConvergenceError
        Where the modes cannot be counted or one is not found.
    """
    moving = moving_part(system)
    counter = EigenvalueCounter.of(moving)
    largest = largest_frequency(moving) ** 2
    high = _end(counter, largest, count, below)
    if high.below == 0:
        modes = np.empty((system.n, 0))
        return LowestModes(Spectrum(np.empty(0), modes, system.n), high.at - high.error)
    low = _start(counter, largest, high)
    shift, solve = _factors(moving, low, high)
    near = modes_between(moving, low, high, shift, solve, moving.solve_M)
    natural = _certified(moving, near.modes, high, counter.least, solve)
    beyond = high.at - high.error
    return LowestModes(natural if moving is system else _whole(system, natural), beyond)


def moving_part(system: System) -> System:
    """Return the structure without the degrees of freedom that have no mass."""
    if not system.massless.size:
        return system
    condensed = condensation.of(system)
    return System(condensed.M, condensed.K, ())


def count_below(system: System, value: float) -> int:
    """Return the number of eigenvalues below a value."""
    return EigenvalueCounter.of(moving_part(system)).count(value).below


def _end(
    counter: EigenvalueCounter, largest: float, count: int, below: float | None
) -> EigenvalueCount:
    """Return a value with at least so many eigenvalues below it, and few more where possible.

    Where `below` is given: at least that value, and far from the modes below it where possible.
    """
    least = _LEAST * largest if below is None else below
    now = counter.count(least)
    if least <= _CLEAR * now.error:
        # Below some errors of the counts nothing is proved.
        least = max(least, _CLEAR * counter.count(_LEAST * largest).error)
        least = min(least, 1.05 * largest)
        now = counter.count(least)
    if below is None and now.below < count:
        return _bisected(counter, least, 1.05 * largest, count)
    most, ratio = now.below + _SPARE, 2.0
    while now.at < largest:
        look()
        more = counter.count(ratio * now.at)
        if more.below > most:
            break
        now, ratio = more, ratio * ratio
    return now


def _bisected(counter: EigenvalueCounter, low: float, high: float, count: int) -> EigenvalueCount:
    """Return a value between one with fewer eigenvalues below it and one with all of them."""
    best = EigenvalueCount(high, counter.M.n, 0.0)
    while high > _NARROW * low and best.below > count + _SPARE:
        look()
        now = counter.count(math.sqrt(low * high))
        if now.below >= count:
            high, best = now.at, now
        else:
            low = now.at
    return best


def _start(counter: EigenvalueCounter, largest: float, high: EigenvalueCount) -> EigenvalueCount:
    """Return a value below all eigenvalues."""
    at = -_BEFORE * high.at
    while at > -1.05 * largest:
        look()
        now = counter.count(at)
        if now.below == 0:
            return now
        at *= 4.0
    return EigenvalueCount(at, 0, 0.0)


def _factors(system: System, low: EigenvalueCount, high: EigenvalueCount) -> tuple[float, Solve]:
    """Return a value in the middle of a bracket, and what solves with ``K - value M``."""
    middle, width = 0.5 * (low.at + high.at), high.at - low.at
    for nudge in (0.0, 1e-3, -1e-3, 1e-2, -1e-2):
        look()
        try:
            shift = middle + nudge * width
            return shift, system.K.plus(-shift, system.M).factorize()
        except scipy.linalg.LinAlgError:
            continue
    raise ConvergenceError(f"the structure cannot be factorized at {math.sqrt(middle):g}")


@dataclass(frozen=True, eq=False, slots=True)
class _Residuals:
    """What the residuals of some modes tell, each (mode,)."""

    values: Floats  # lambda_j
    roundings: Floats  # bounds of their own errors
    norms: Floats  # bounds of rho_j
    couplings: Floats  # ``e_i^T r_j``, (mode, mode)
    residuals: Floats  # r_j, (dof, mode)


def _certified(
    system: System, modes: Floats, high: EigenvalueCount, least: float, solve: Solve
) -> Spectrum:
    """Return all modes below a value with their errors; `solve` is that of `_factors`."""
    modes, low = _corrected(system, modes, least, solve)
    now = _residuals(system, modes, low, least)
    order = np.argsort(now.values, kind="stable")
    values, rho = now.values[order], now.norms[order]
    couplings = np.abs(now.couplings[np.ix_(order, order)])
    np.fill_diagonal(couplings, 0.0)
    errors, angles = np.empty((2, values.size))
    apart = np.diff(values) > _TOGETHER * (rho[1:] + rho[:-1])
    ends = [0, *(np.flatnonzero(apart) + 1).tolist(), values.size]
    edges = np.concatenate([[-np.inf], values + rho, [high.at - high.error]])
    for start, stop in itertools.pairwise(ends):
        some = slice(start, stop)
        size = float(np.linalg.norm(rho[some]))
        above = edges[-1] if stop == values.size else values[stop] - rho[stop]
        gap = min(values[start] - edges[start], above - values[stop - 1]) - size
        inside = float(np.linalg.norm(couplings[some, some]))
        temple = size**2 / gap + inside if gap > 0.0 else np.inf
        errors[some] = _SAFETY * min(size, temple)
        angles[some] = _SAFETY * math.sqrt(2.0) * size / gap + 4.0 * EPS if gap > 0.0 else np.inf
    errors += now.roundings[order] + EPS * np.abs(values)
    modes, low = modes[:, order], low[:, order]
    magnitudes = np.abs(modes)
    own = (magnitudes * (abs(system.K.to_sparse()) @ magnitudes)).sum(axis=0)
    rigid = np.abs(values) <= np.maximum(errors, _NOISE * EPS * own)
    errors = np.where(rigid, errors + np.abs(values), errors)
    values = np.where(rigid, 0.0, values)
    again = np.argsort(values, kind="stable")
    values, errors = values[again], errors[again]
    return Spectrum(
        frozen(np.sign(values) * np.sqrt(np.abs(values))),
        frozen(np.ascontiguousarray(modes[:, again])),
        system.n,
        float(errors.max()),
        errors=frozen(errors),
        angles=frozen(angles[again]),
        modal_matrix_low=frozen(np.ascontiguousarray(low[:, again])),
        proved=bool((values + errors < high.at - high.error).all()),
    )


def _corrected(system: System, modes: Floats, least: float, solve: Solve) -> tuple[Floats, Floats]:
    """Return modes with ``e^T M e = 1`` in two parts, without what they have of fast modes.

    Rounded modes contain all others by a rounding of each, and the fastest ones are a large part
    of the residual: ``-(K - sigma M)^-1 r`` takes them out, where it is orthogonal to the modes.
    """
    x = modes / np.sqrt((modes * (system.M @ modes)).sum(axis=0))
    r = _residuals(system, x, np.zeros_like(x), least).residuals
    look()
    change = -solve(np.ascontiguousarray(r))
    change -= x @ (x.T @ (system.M @ change))
    high = x + change
    part = high - x
    return high, (x - (high - part)) + (change - part)


def _residuals(system: System, x: Floats, x_low: Floats, least: float) -> _Residuals:
    """Return what the residuals of modes ``x + x_low`` tell; least as of `inertia`."""
    stiff, stiff_low, stiff_error = _product(system.K, x, x_low)
    heavy, heavy_low, heavy_error = _product(system.M, x, x_low)
    s, s_low = products.along(x, stiff, stiff_low)
    g, g_low = products.along(x, heavy, heavy_low)
    s_low, g_low = s_low + (x_low * stiff).sum(axis=0), g_low + (x_low * heavy).sum(axis=0)
    excess = (g - 1.0) + g_low
    below = s_low - s * excess / (1.0 + excess)
    values = s + below
    low = below - (values - s)
    scaled = doubled.product(heavy, heavy_low, np.diag(values), np.diag(low), False)
    first = stiff - scaled[0]
    r = first + (stiff_low - scaled[1])
    size = np.abs(x)
    error = stiff_error + np.abs(values) * heavy_error
    terms = (size * (np.abs(stiff) + np.abs(values * heavy))).sum(axis=0)
    unknown = (size * error).sum(axis=0) + doubled.roundings(system.n) * terms
    lower = np.abs(x_low) * (np.abs(stiff) + np.abs(values * heavy))
    unknown += system.n * EPS * lower.sum(axis=0)
    error += doubled.roundings(values.size) * np.abs(scaled[0])
    error += 4.0 * EPS * (np.abs(first) + np.abs(stiff_low) + np.abs(scaled[1]))
    error += unknown * np.abs(heavy)
    look()
    norms = np.sqrt(np.maximum((r * system.solve_M(r)).sum(axis=0), 0.0))
    inertia = np.sqrt(least * system.M.main_diagonal)[:, np.newaxis]
    norms = _SAFETY * (norms + np.linalg.norm(error / inertia, axis=0))
    return _Residuals(values, unknown + np.abs(low), norms, x.T @ r, r)


def _product(A: SymmetricMatrix, x: Floats, x_low: Floats) -> tuple[Floats, Floats, Floats]:
    """Return ``A (x + x_low)`` in two parts, and bounds of its errors."""
    high, low, error = products.product(A, x)
    if not x_low.any():
        return high, low, error
    terms = A.n if A.pattern is None else int(np.diff(A.pattern[1]).max(initial=0))
    rounded = (min(terms, 2 * A.width + 1) + 2) * EPS * (abs(A.to_sparse()) @ np.abs(x_low))
    return high, low + A @ x_low, error + rounded + EPS * np.abs(low)


def _whole(system: System, natural: Spectrum) -> Spectrum:
    """Return modes of the condensed structure with the rows of what has no mass.

    The condensed stiffness is rounded, so that their errors are estimates.
    """
    condensed = condensation.of(system)
    assert isinstance(natural.modal_matrix, np.ndarray)
    few = natural.modal_matrix
    modes = condensed.whole(few)
    sizes: SymmetricMatrix = condensed.sizes
    magnitudes = np.abs(few)
    own = 2.0 * EPS * (magnitudes * (sizes @ magnitudes)).sum(axis=0)
    assert natural.errors is not None
    assert natural.angles is not None
    return Spectrum(
        natural.roots,
        frozen(modes),
        system.n,
        natural.uncertainty + float(own.max()),
        errors=frozen(natural.errors + own),
        angles=frozen(natural.angles + 8.0 * EPS),
        proved=False,
    )
