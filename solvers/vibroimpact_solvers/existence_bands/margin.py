"""The data of the certified search: natural modes with their errors, of every limit."""

from __future__ import annotations

import numpy as np

from vibroimpact_solvers.arrays import EPS
from vibroimpact_solvers.existence_bands.problem import Problem
from vibroimpact_solvers.kernels import bands
from vibroimpact_solvers.spectrum import Spectrum


def margin_of(problem: Problem, natural: Spectrum) -> tuple[bands.Margin, bool]:
    """Return the margins of all limits, and whether their errors are proved."""
    constraints = problem.system.constraints
    roots, values = natural.roots, natural.eigenvalues
    wrong = np.zeros(roots.size) if natural.errors is None else natural.errors
    rows, row_errors = natural.participations(constraints)
    row_errors = 2.0 * (row_errors + EPS * np.abs(rows))
    longest = (0.5 * np.pi / problem.start) ** 2
    # Over the whole range a mode of so small an eigenvalue is a rigid-body mode.
    rigid = (np.abs(values) <= wrong) | (np.abs(values) * longest <= EPS)
    (struck,) = problem.active
    own, loose = np.abs(rows[struck]), row_errors[struck]
    silent = own <= loose
    swings, still = ~silent & ~rigid & (values > 0.0), ~silent & (rigid | (values <= 0.0))
    own_error = loose * (2.0 * own + loose) + EPS * own * own
    # An antisymmetric motion reaches equally far on both sides: the nearer wall counts.
    walls = [(c.lower, c.upper) for c in constraints]
    gaps = np.array([min(w for w in pair if w is not None) for pair in walls])
    ratio = (gaps / gaps[struck])[:, np.newaxis]
    beta, alpha = rows * rows[struck], ratio * (own * own)
    doubt = ratio * own_error + row_errors * (own + loose) + np.abs(rows) * loose
    doubt += 2.0 * EPS * (alpha + np.abs(beta))
    # The term of a rigid-body mode is wrong by its eigenvalue times q squared.
    stiff = (np.abs(values) + wrong) * longest
    # Farther from its poles than the resolution, a silent mode adds no more than this over q.
    heard = (own + loose) * (np.abs(rows) + row_errors + ratio * (own + loose))
    heard *= 2.0 / np.maximum(np.abs(values) * problem.edge_width, 1.0 / longest)
    shift = np.sqrt(values + wrong, where=swings, out=np.zeros(roots.size))
    shift -= np.sqrt(np.maximum(values - wrong, 0.0))
    margin = bands.Margin(
        np.ascontiguousarray(roots[swings]),
        np.ascontiguousarray((shift + EPS * roots)[swings]),
        np.ascontiguousarray(alpha[:, swings]),
        np.ascontiguousarray(beta[:, swings]),
        np.ascontiguousarray(doubt[:, swings]),
        alpha[:, still].sum(axis=1),
        beta[:, still].sum(axis=1),
        (doubt + stiff * (alpha + np.abs(beta)))[:, still].sum(axis=1),
        # Estimates of errors are too large to tell silent modes.
        (heard if natural.proved else 0.0 * heard)[:, silent].sum(axis=1),
        struck,
    )
    return margin, natural.proved and bool((rigid | (values > 0.0)).all())
