"""Motions that begin at rest, and may be there again at their end: errors are not relative to 0."""

from __future__ import annotations

import numpy as np
import pytest

from vibroimpact_solvers import time_history as th
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System


def one_mass(force: float) -> System:
    one = SymmetricMatrix.diagonal(np.ones(1))
    return System(one, one, (Constraint.at(0, 10.0),), force=np.array([force]))


@pytest.mark.parametrize("turns", [1, 20])
def test_a_mass_that_comes_back_to_rest_is_known(turns: int) -> None:
    """x = 1 - cos t ends at 0; 0.2.0 knew nothing of it from t = 0 on."""
    times = np.linspace(0.0, 2.0 * np.pi * turns, 4 * turns + 1)
    rest = th.State(np.zeros(1), np.zeros(1))
    outputs = frozenset({"x", "v"})
    problem = th.Problem(one_mass(1.0), rest, float(times[-1]), t=times, outputs=outputs)
    result = th.solve(problem, th.plan(problem))
    assert result.error_predictable_until == times[-1]
    for values, errors, exact in (
        (result.x, result.error_x, 1.0 - np.cos(times)), (result.v, result.error_v, np.sin(times)),
    ):  # fmt: skip
        assert values is not None
        assert errors is not None
        assert (np.abs(values[:, 0] - exact) <= errors[:, 0]).all()
        assert errors.max() < 1e-13


def test_a_driven_mass_that_comes_back_to_rest_is_known() -> None:
    """x'' + x = cos(t/2) from rest: x = (4/3)(cos(t/2) - cos t), at rest after 4 pi."""
    times = np.linspace(0.0, 4.0 * np.pi, 9)
    rest = th.State(np.zeros(1), np.zeros(1))
    problem = th.Problem(
        one_mass(0.0), rest, float(times[-1]), t=times, outputs=frozenset({"x"}),
        load=(th.Harmonic(0, 1.0, 0.5, 0.0),),
    )  # fmt: skip
    result = th.solve(problem, th.plan(problem))
    assert result.error_predictable_until == times[-1]
    assert result.x is not None
    assert result.error_x is not None
    exact = 4.0 / 3.0 * (np.cos(0.5 * times) - np.cos(times))
    assert (np.abs(result.x[:, 0] - exact) <= result.error_x[:, 0]).all()
    assert result.error_x.max() < 1e-13


def test_a_mass_with_drag_falls_from_zero_at_a_wall() -> None:
    """The search began with steps relative to a displacement that was 0, and went no further."""
    c, m, g = 0.5, 2.0, 9.81
    system = System(
        SymmetricMatrix.diagonal(np.array([m])),
        SymmetricMatrix.diagonal(np.zeros(1)),
        (Constraint((0,), (1.0,), None, 0.0, 0.5),),
        C=SymmetricMatrix.diagonal(np.array([c])),
        force=np.array([-m * g]),
    )
    times, rest = np.linspace(0.25, 1.0, 4), th.State(np.zeros(1), np.zeros(1))
    problem = th.Problem(system, rest, 1.0, t=times, outputs=frozenset({"x", "v"}))
    result = th.solve(problem, th.plan(problem))
    assert result.x is not None
    assert result.v is not None
    limit = m * g / c
    np.testing.assert_allclose(result.v[:, 0], limit * np.expm1(-c / m * times), rtol=1e-14)
    fallen = limit * (times + m / c * np.expm1(-c / m * times))
    np.testing.assert_allclose(result.x[:, 0], -fallen, rtol=1e-13)
