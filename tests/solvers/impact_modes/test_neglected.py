"""What of a structure has no effect on impact modes is said by the result."""

from __future__ import annotations

import numpy as np

from vibroimpact_solvers import impact_modes as modes
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

OMEGA = np.array([1.0])


def neglected(restitution: float, damping: float | None) -> list[str] | None:
    M, K = SymmetricMatrix.diagonal([1.0]), SymmetricMatrix.diagonal([1.0])
    C = None if damping is None else SymmetricMatrix.diagonal([damping])
    system = System(M, K, (Constraint.at(0, 1.0, restitution),), C)
    problem = modes.Problem(system, OMEGA)
    return modes.solve(problem, modes.plan(problem)).neglected


def test_damping_and_restitution_are_named() -> None:
    sentences = neglected(0.5, 0.1)
    assert sentences is not None
    assert len(sentences) == 2
    assert "C" in sentences[0]
    assert "constraint 0" in sentences[1]


def test_nothing_is_named_where_nothing_is_neglected() -> None:
    assert neglected(1.0, None) is None
    assert neglected(1.0, 0.0) is None
