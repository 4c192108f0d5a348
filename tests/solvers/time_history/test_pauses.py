"""Motions from many initial states look at their signal."""

from __future__ import annotations

import numpy as np
import pytest

from tests.solvers.time_history.test_windows import sticky
from vibroimpact_solvers import time_history as th
from vibroimpact_solvers.errors import Cancelled
from vibroimpact_solvers.time_history import rigid_motions, run


@pytest.mark.parametrize("first", [0, 1])
def test_motions_of_many_can_be_stopped(first: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every motion looks at the signal, also where it goes on alone: the first and all others."""
    given = sticky()
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
