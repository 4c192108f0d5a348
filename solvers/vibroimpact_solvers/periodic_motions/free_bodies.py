"""Structures that nothing holds but their stops: which sequences of impacts they can have.

In a period of the drive the load, which has no mean, changes no momentum of a free body in the
end, and damping none either, as the body comes back to where it was. The impulses along each
rigid-body mode r that they move have to cancel, ``sum_j p_j w_j . r = 0``; the response to one
impulse per period has no bound.
"""

from __future__ import annotations

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import System
from vibroimpact_solvers.periodic_motions.problem import Problem

PLANNED = 400
"""Degrees of freedom up to which a plan computes the modes of what may be free."""

_SOFT = 1e-10  # eigenvalues below this part of the largest may be those of rigid bodies
_ONE_WAY = (
    "; the walls push a rigid-body mode one way only, so that no motion has these impacts: it "
    "would gain momentum in each period"
)


def may_be_free(system: System) -> bool:
    """Whether a structure may have rigid-body modes."""
    soft = _SOFT * spectrum.largest_frequency(system) ** 2
    return not system.K.plus(-soft, system.M).is_positive_definite()


def sentence(problem: Problem, natural: spectrum.Spectrum) -> str:
    """Return why a structure has no motion with the impacts of a problem; empty: it may have one.

    Raises
    ------
    ModelError
        Where the impulses may cancel: these motions, whose mean position is one more unknown, are
        computed for symmetric sequences only.
    """
    if problem.symmetric:
        return ""
    impacts = problem.impacts
    rows = natural.participations(problem.system.constraints)[0][[i.constraint for i in impacts]]
    pushes = rows[:, natural.roots == 0.0] * np.array([i.side for i in impacts])[:, np.newaxis]
    pushes = pushes[:, pushes.any(axis=0)]
    if not pushes.size:
        return ""
    if ((pushes >= 0.0).all(axis=0) | (pushes <= 0.0).all(axis=0)).any():
        return _ONE_WAY
    message = (
        "the impacts move a rigid-body mode, which nothing brings back: such motions are computed "
        "only for the sequence 'symmetric'"
    )
    raise ModelError(("sequence",), message, code="rigid_body")
