"""Natural modes of structures with degrees of freedom without mass.

The modes are those of the condensed structure (`condensation`); their rows at degrees of freedom
without mass follow by the static relation, so that the modes have the length of the whole
structure, ``K e_j = lambda_j M e_j`` holds in all rows, and sums of modes need not know of it.

In small structures the condensed stiffness and the relation are known in ball arithmetic: as sums
of two doubles, whose remaining errors are among the proved errors of the modes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.linalg

from vibroimpact_solvers import condensation
from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.kernels import doubled
from vibroimpact_solvers.matrices import Form
from vibroimpact_solvers.model import System
from vibroimpact_solvers.spectrum import refinement

_ROUNDS = 4.0  # roundings that a row which was computed in double precision errs by


def refined(system: System) -> refinement.RefinedModes:
    """Return the modes with proved errors; their errors include those of the static rows."""
    exact, massive = condensation.doubled(system), condensation.massive(system)
    M = system.M.part(massive)
    _, start = scipy.linalg.eigh(exact.K, M.to_dense(), check_finite=False)
    stiffness = refinement.Stiffness(exact.K, exact.K_low, exact.K_error)
    mass = M.data[0] if M.form is Form.DIAGONAL else M.to_dense()
    few = refinement.refine(mass, stiffness, np.asarray(start))
    high, low = doubled.product(exact.static, exact.static_low, few.modes, few.modes_low, False)
    magnitudes = np.abs(few.modes)
    error = 4.0 * doubled.roundings(massive.size) * (np.abs(exact.static) @ magnitudes)
    error += exact.static_error @ magnitudes
    modes, modes_low = np.zeros((2, system.n, massive.size))
    modes[massive], modes[system.massless] = few.modes, high
    modes_low[massive], modes_low[system.massless] = few.modes_low, low
    # An error of a mode in the norm of M moves a coordinate by no more than it times the norm of
    # its row: the errors of the static rows are covered by angles of their ratio.
    angles = few.angles + _relative(error, high)
    return replace(few, modes=modes, modes_low=modes_low, angles=angles)


def in_doubles(system: System) -> tuple[Floats, float]:
    """Return modes in double precision, and an estimate of the relative errors of static rows."""
    condensed = condensation.of(system)
    massless = system.massless
    _, few = scipy.linalg.eigh(
        condensed.K.to_dense(), condensed.M.to_dense(), check_finite=False, overwrite_a=True
    )
    modes = condensed.whole(np.asarray(few))
    # One step of refinement; how much it changes tells what is left.
    change = condensed.solve_static((system.K @ modes)[massless])
    modes[massless] -= change
    rows = modes[massless]
    # Rows below the roundings of all others are wrong by no more than these.
    size = np.linalg.norm(rows, axis=1)
    told = size > EPS * np.linalg.norm(modes, axis=1).max()
    error = np.abs(change) + _ROUNDS * EPS * np.abs(rows)
    return modes, _relative(error[told], rows[told])


def _relative(error: Floats, rows: Floats) -> float:
    """Return the largest error of a row over its norm; rows that are zero follow nothing."""
    size, wrong = np.linalg.norm(rows, axis=1), np.linalg.norm(error, axis=1)
    some = size > 0.0
    return float((wrong[some] / size[some]).max(initial=0.0))
