"""Many motions at once: which threads compute them, and that they are those of each alone."""

from __future__ import annotations

import numpy as np
import pytest

from vibroimpact_solvers import time_history
from vibroimpact_solvers.errors import Cancelled
from vibroimpact_solvers.model import Constraint
from vibroimpact_solvers.presets import chain
from vibroimpact_solvers.time_history import many


@pytest.mark.parametrize("count", [2, 40])
def test_short_motions_stay_in_one_thread(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """They are made in Python, where threads would wait for each other; all can be stopped."""
    monkeypatch.setattr(many, "ThreadPoolExecutor", None)
    system = chain(3, [Constraint.at(0, 0.5)])
    state = time_history.State(np.zeros(3), np.array([1.0, 0.0, 0.0]))
    problems = [
        time_history.Problem(system, state, 5.0 + 0.1 * place, np.array([5.0]))
        for place in range(count)
    ]
    calls = [0]

    def report() -> None:
        calls[0] += 1

    found = list(many.solve_many(problems, report))
    for problem, one in zip(problems, found, strict=True):
        alone = time_history.solve(problem, time_history.plan(problem))
        np.testing.assert_array_equal(one.x, alone.x)
    assert calls[0] >= count

    def stopped() -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        list(many.solve_many(problems, stopped))


def test_long_motions_are_shared_among_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[int] = []
    pool = many.ThreadPoolExecutor

    def counted(threads: int) -> many.ThreadPoolExecutor:
        made.append(threads)
        return pool(threads)

    monkeypatch.setattr(many, "ThreadPoolExecutor", counted)
    monkeypatch.setattr(many, "cores", lambda: 2)
    system = chain(3, [Constraint.at(0, 0.5)])
    state = time_history.State(np.zeros(3), np.array([1.0, 0.0, 0.0]))
    problems = [
        time_history.Problem(system, state, 6000.0 + 0.1 * place, np.array([5.0]))
        for place in range(40)
    ]
    found = list(many.solve_many(problems))
    assert made == [2]
    assert [one.count_impacts for one in found] == [
        time_history.solve(problem, time_history.plan(problem)).count_impacts
        for problem in problems
    ]
