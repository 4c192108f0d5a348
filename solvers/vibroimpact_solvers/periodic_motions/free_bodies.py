"""Structures that nothing holds but their stops: which sequences of impacts they can have.

In a period of the drive the load, which has no mean, changes no momentum of a free body in the
end, and damping none either, as the body comes back to where it was. The impulses along each
rigid-body mode r that they move have to cancel, ``sum_j p_j w_j . r = 0``, or to balance a constant
load on it (`balance`).
"""

from __future__ import annotations

from typing import Final

import numpy as np
import scipy.linalg

from vibroimpact_solvers import condensation, spectrum
from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.body import once_per_body
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import System
from vibroimpact_solvers.periodic_motions.balance import one_way
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.problem import Problem

PLANNED: Final = 50
"""Degrees of freedom up to which a plan looks for rigid-body modes: it takes milliseconds."""

_SOFT: Final = 1e-10  # eigenvalues below this part of the largest may be those of rigid bodies
_NOISE: Final = 4.0  # roundings of a mode's own elastic terms, as of the natural modes
_NOTHING, _CLEAR = 1e-12, 1e-6  # parts of a direction that a mode moves not at all, and for sure
_ONE_WAY = (
    "; the walls push a rigid-body mode one way only, so that no motion has these impacts: it "
    "would gain momentum in each period"
)


def expected(problem: Problem) -> str:
    """Return what `sentence` is going to say, as far as it is clear without the modes.

    A plan computes no natural modes: those of hundreds of degrees of freedom take longer than
    a plan may, and kernels that may be missing. Where a mode is hardly moved, or several modes
    are, or a constant load may move it, the solution tells.
    """
    system = problem.system
    if problem.symmetric or system.loaded or system.n > PLANNED or not _may_be_free(system):
        return ""
    rows = system.directions([impact.constraint for impact in problem.impacts])
    modes = _rigid_modes(system)
    sizes = np.linalg.norm(rows, axis=1)[:, np.newaxis] * np.linalg.norm(modes, axis=0)
    moved = rows @ modes / sizes
    moved[np.abs(moved) <= _NOTHING] = 0.0
    moved = moved[:, moved.any(axis=0)]
    if moved.shape[1] != 1 or (np.abs(moved[moved != 0.0]) < _CLEAR).any():
        return ""
    return _ONE_WAY if one_way(problem, moved) else ""


def sentence(problem: Problem, driven: Driven) -> str:
    """Return why a structure has no motion with the impacts of a problem; empty: it may have one.

    Raises
    ------
    ModelError
        Where the impulses may cancel, and damping couples the rigid-body modes to others.
    """
    if problem.symmetric or driven.balance.loaded:
        return ""
    natural = driven.structure.natural
    rows = natural.participations(problem.system.constraints)[0]
    moved = rows[[impact.constraint for impact in problem.impacts]][:, natural.roots == 0.0]
    if not moved.any():
        return ""
    if one_way(problem, moved):
        return _ONE_WAY
    if driven.balance.coupled:
        message = (
            "the impacts move a rigid-body mode that damping couples to other modes: such motions "
            "are computed only for the sequence 'symmetric'"
        )
        raise ModelError(("sequence",), message, code="rigid_body")
    return ""


@once_per_body
def _may_be_free(system: System) -> bool:
    """Whether a structure may have rigid-body modes."""
    soft = _SOFT * spectrum.largest_frequency(system) ** 2
    return not system.K.plus(-soft, system.M).is_positive_definite()


@once_per_body
def _rigid_modes(system: System) -> Floats:
    """Return the modes with no more stiffness than roundings, shape (dof, mode)."""
    if system.massless.size:
        condensed = condensation.of(system)
        M, K = condensed.M, condensed.K
    else:
        M, K = system.M, system.K
    values, modes = scipy.linalg.eigh(K.to_dense(), M.to_dense(), check_finite=False)
    modes = modes[:, np.abs(values) <= _SOFT * np.abs(values).max()]
    if system.massless.size:
        modes = condensed.whole(modes)
    # Rayleigh's quotient errs by the square of the error of a mode only.
    wide = np.asarray(system.K.to_dense(), dtype=np.longdouble)
    elastic = np.abs((modes * (wide @ modes)).sum(axis=0))
    own = (np.abs(modes) * (np.abs(wide) @ np.abs(modes))).sum(axis=0)
    return np.asarray(modes[:, elastic <= _NOISE * EPS * own])
