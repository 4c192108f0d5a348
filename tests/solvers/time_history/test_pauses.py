"""Motions from many initial states look at their signal."""

from __future__ import annotations

import numpy as np
import pytest

from vibroimpact_solvers import time_history as th
from vibroimpact_solvers.errors import Cancelled
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.time_history import rigid_motions, run

STICKY = System(
    SymmetricMatrix.dense(np.eye(2)),
    SymmetricMatrix.dense(np.array([[2.0, -1.0], [-1.0, 2.0]])),
    (Constraint((0,), (1.0,), None, 0.05, 0.0), Constraint((1,), (1.0,), 0.1, 0.5, 0.6)),
    C=SymmetricMatrix.dense(np.array([[0.2, -0.1], [-0.1, 0.3]])),
)
LOAD = (th.Harmonic(0, 0.6, 0.5), th.Harmonic(1, -0.5, 0.35, 0.4))


def problem(system: System, load: tuple[th.Harmonic, ...]) -> th.Problem:
    start = th.State(np.zeros(2), np.array([0.2, 0.3]))
    outputs = frozenset(th.OUTPUTS)
    times = np.linspace(0.0, 30.0, 151)
    return th.Problem(system, start, 30.0, t=times, load=load, outputs=outputs)


@pytest.mark.parametrize("first", [0, 1])
def test_motions_of_many_can_be_stopped(first: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every motion looks at the signal, also where it goes on alone: the first and all others."""
    given = problem(STICKY, LOAD)
    monkeypatch.setattr(run, "budget", lambda *_: 5)
    prepared = th.many.prepare(given, th.plan(given)).rigid
    assert isinstance(prepared, rigid_motions.RigidMotions)
    looks = 0

    def tick(done: int, total: int) -> None:
        nonlocal looks
        looks += 1
        if looks == 20:
            raise Cancelled

    x, v = np.zeros((3, 2)), np.full((3, 2), 0.1)
    with pytest.raises(Cancelled):
        prepared.solve_some(x, v, first, 3, tick)
    assert looks == 20
