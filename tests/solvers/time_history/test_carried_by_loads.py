"""What loads carry along may be larger than the motion: errors are those of the motion."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.solvers.time_history.test_slow_and_many import checked, wall
from tests.truth import histories
from tests.truth.verdicts import Report
from vibroimpact_solvers import time_history
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

SOFT = {"M": [[1.0]], "K": [[1e-4]], "constraints": [wall(0, 0.1, 0.9)], "x": [0.0], "v": [0.3]}
"""A mass on a soft spring, between walls that are near."""


def ratio(report: Report) -> float:
    return min(report.ratios["x"] + report.ratios["v"])


def test_a_deflection_that_walls_prevent() -> None:
    """Its equilibrium is at 1000, the walls are at 0.1: so much larger are its roundings."""
    document: dict[str, Any] = {**SOFT, "force": [0.1], "t": [0.4, 1.3, 2.9], "t_end": 3.0}
    assert 1.0 < ratio(checked(document)) < 1e3


def test_sampled_loads_whose_response_walls_prevent() -> None:
    t = [0.0, 0.4, 1.1, 1.7, 2.4, 3.0]
    load = [[[1.0], t, [0.3, -0.2, 0.5, 0.1, -0.4, 0.2]]]
    document: dict[str, Any] = {**SOFT, "sampled": load, "t": [0.4, 1.3, 2.9], "t_end": 3.0}
    assert 1.0 < ratio(checked(document)) < 1e4


@pytest.mark.parametrize("apart", [2e-3, 3e-2])
def test_a_response_near_resonance_is_as_uncertain_as_its_stiffness(apart: float) -> None:
    """1 - omega^2 is the difference of numbers that are rounded."""
    for k in range(8):
        document = {
            "M": [[1.0]], "K": [[1.0]], "constraints": [wall(0, 1e4)], "x": [0.0], "v": [0.1],
            "load": [[0, 1.0, float(np.sqrt(1.0 + apart * (1.0 + 0.01 * k))), 0.3]],
            "t": [1.0 / apart, 2.0 / apart], "t_end": 2.0 / apart,
        }  # fmt: skip
        checked(document)


@pytest.mark.parametrize("damping", [0.0, 0.3])
@pytest.mark.parametrize("turn", [1e-9, 1e-4, 1e-2, 0.3])
def test_a_slow_load_moves_a_rigid_body(turn: float, damping: float) -> None:
    """Its steady response would be larger than the motion by 1/turn^2, and lose as many digits."""
    document = {
        "M": [[0.7]], "K": [[0.0]], "C": [[damping]], "constraints": [wall(0, 1.0, 0.8)],
        "x": [0.2], "v": [-1.3], "load": [[0, -2.0, turn / 4.0, 0.7]], "t": [0.3, 1.9, 3.7],
        "t_end": 4.0,
    }  # fmt: skip
    report = checked(document)
    assert report.counts["horizon at the end"] == 1
    assert ratio(report) < 1e3
    problem = histories.problem_of(document)
    assert time_history.solve(problem, time_history.plan(problem)).error_condition < 1e4


@pytest.mark.parametrize("damping", [0.0, 0.3])
def test_a_slow_load_presses_a_rigid_body_to_its_wall(damping: float) -> None:
    """The impulse of the wall is the integral of the load; the other body goes on freely."""
    document = {
        "M": [[0.7, 0.0], [0.0, 1.1]], "K": [[0.0, 0.0], [0.0, 0.0]],
        "C": [[damping, 0.0], [0.0, damping]], "constraints": [wall(0, 1.0, 0.0)],
        "x": [0.9, 0.0], "v": [1.0, 0.1], "load": [[0, 2.0, 0.1, 0.7], [1, 1.0, 0.1, 0.0]],
        "t": [1.9, 3.7], "t_end": 4.0,
    }  # fmt: skip
    checked(document)
    problem = histories.problem_of(document)
    result = time_history.solve(problem, time_history.plan(problem))
    (start,) = result.contact_rest
    pushed = 20.0 * (np.sin(0.1 * 4.0 + 0.7) - np.sin(0.1 * start + 0.7))
    assert result.contact_impulse[0] == pytest.approx(pushed, rel=1e-12)


def test_a_slow_load_moves_a_rigid_body_between_soft_limiters() -> None:
    """As one moves it that turns as fast as may be, by its steady response."""
    one = SymmetricMatrix.diagonal([1.0])
    system = System(one, SymmetricMatrix.diagonal([0.0]), (Constraint.at(0, 0.5),))
    found = []
    start = time_history.State(np.array([0.1]), np.array([0.3]))
    for t_end in (9.9, 10.1):  # beside where the load turns by a radian until the end
        problem = time_history.Problem(
            system, start, t_end, t=np.array([2.0, 7.0]),
            load=(time_history.Harmonic(0, 0.4, 0.1, 0.2),), limiter=time_history.Power(3.0, 5.0),
            outputs=frozenset({"x", "v"}),
        )  # fmt: skip
        found.append(time_history.solve(problem, time_history.plan(problem)))
    for name in ("x", "v"):
        np.testing.assert_allclose(getattr(found[0], name), getattr(found[1], name), atol=1e-11)
