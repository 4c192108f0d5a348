"""Accelerations of time histories: between impacts, in contacts, and where there are none."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.solvers.test_truth import median, outcome
from vibroimpact_solvers import ensemble, time_history
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.laws import Linear
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.presets import bouncing_ball
from vibroimpact_solvers.time_history import Harmonic, Power, Problem, Sampled, State

pytestmark = pytest.mark.needs("compiled kernels")

M, K, C = (
    np.array(rows)
    for rows in ([[1.0, 0.0], [0.0, 2.0]], [[3.0, -1.0], [-1.0, 2.0]], [[0.1, 0.05], [0.05, 0.3]])
)
LOAD = (Harmonic(1, 0.7, 1.1, 0.2),)
STATES = frozenset({"x", "v", "a"})


def structure(restitution: float = 1.0, law: Linear | None = None) -> System:
    stop = Constraint.at(0, gap=0.3, restitution=restitution)
    stop = stop if law is None else replace(stop, law=law)
    mass, stiffness, damping = map(SymmetricMatrix.dense, (M, K, C))
    return System(mass, stiffness, (stop,), C=damping)


def problem(system: System, **more: Any) -> Problem:
    given: dict[str, Any] = {
        "t": np.linspace(0.0, 10.0, 75),
        "outputs": STATES,
        "load": LOAD,
    } | more
    return Problem(system, State(np.zeros(2), np.array([1.0, 0.5])), 10.0, **given)


def solved(given: Problem) -> time_history.Result:
    return time_history.solve(given, time_history.plan(given))


def forces(t: Any) -> Any:
    """Return the loads on both masses, shape (time, dof)."""
    return np.stack([np.zeros(t.size), 0.7 * np.cos(1.1 * t + 0.2)], axis=1)


def check(result: time_history.Result, right: Any) -> None:
    assert result.a is not None
    assert result.error_a is not None
    assert (np.abs(result.a - right) <= result.error_a).all()
    assert result.error_a.max() < 1e-12 * np.abs(right).max()


def by_the_equation(result: time_history.Result, force: Any) -> Any:
    assert result.x is not None
    assert result.v is not None
    return (force - result.v @ C - result.x @ K) / M.diagonal()


@pytest.mark.parametrize("restitution", [1.0, 0.7])
def test_the_equation_of_motion(restitution: float) -> None:
    result = solved(problem(structure(restitution=restitution)))
    force = forces(result.t)
    check(result, by_the_equation(result, force))


def test_a_sampled_load() -> None:
    t, values = np.linspace(0.0, 10.0, 9), np.array([0.0, 1.0, -2.0, 0.5, 1.0, 1.0, 3.0, 0.0, 1.0])
    load = (Sampled(np.array([1.0, -0.5]), t, values),)
    result = solved(problem(structure(restitution=0.7), load=load))
    force = np.interp(np.linspace(0.0, 10.0, 75), t, values)[:, np.newaxis] * [1.0, -0.5]
    check(result, by_the_equation(result, force))


def test_stops_of_finite_stiffness() -> None:
    stop = structure(law=Linear(50.0, damping=0.4))
    result = solved(problem(stop, outputs=STATES | {"force"}))
    force = forces(result.t)
    assert result.force is not None
    assert result.x is not None
    assert np.count_nonzero(result.force) > 5
    force[:, 0] -= np.sign(result.x[:, 0]) * result.force[:, 0]
    check(result, by_the_equation(result, force))


def test_a_ball_falls_and_rests() -> None:
    ball = bouncing_ball((Constraint((0,), (1.0,), 0.0, None, restitution=0.5),))
    given = Problem(
        ball, State(np.array([0.2]), np.zeros(1)), 2.0, t=np.array([0.1, 0.3, 1.5, 2.0]),
        outputs=STATES | {"contacts"},
    )  # fmt: skip
    result = solved(given)
    assert result.a is not None
    assert result.contact_rest is not None
    assert result.contact_rest.size == 1
    at_rest = result.t >= result.contact_rest[0]
    assert at_rest.tolist() == [False, False, True, True]
    np.testing.assert_allclose(result.a[:, 0], np.where(at_rest, 0.0, -9.81), rtol=1e-14)


def test_random_motions_against_extended_precision() -> None:
    report = outcome("histories", 20, lambda case: True)
    assert not report.failures
    assert len(report.ratios["a"]) > 12
    assert median(report, "a") < 500.0


def test_histories_are_the_same_with_others_and_without() -> None:
    whole = problem(structure(restitution=0.7), t=np.linspace(0.0, 10.0, 200))
    all_of_them = solved(whole)
    for outputs in ({"a"}, {"x", "a"}, {"v", "a"}, {"x", "v"}, {"a", "energy"}):
        some = solved(replace(whole, outputs=frozenset(outputs)))
        for name in outputs & STATES:
            value, right = getattr(some, name), getattr(all_of_them, name)
            np.testing.assert_allclose(value, right, rtol=0.0, atol=1e-14)


def test_many_motions_at_once() -> None:
    given = problem(structure(restitution=0.7))
    alone = solved(given)
    x, v = np.zeros((2, 2)), np.array([[0.3, 0.1], [1.0, 0.5]])
    many = ensemble.Problem(given.system, x, v, 10.0, given.t, outputs=STATES, load=LOAD)
    motions = ensemble.solve(many, ensemble.plan(many))
    assert motions.a is not None
    assert motions.error_a is not None
    np.testing.assert_array_equal(motions.a[1], alone.a)
    np.testing.assert_array_equal(motions.error_a[1], alone.error_a)


@pytest.mark.parametrize(
    "more",
    [{"limiter": Power(3.0, 1.0)}, {"method": "RK45"}, {"digits": 30}],
    ids=["soft limiter", "integrator", "digits"],
)
def test_motions_without_accelerations(more: Any) -> None:
    with pytest.raises(ModelError) as caught:
        problem(structure(), **more)
    assert caught.value.pointer == ("outputs",)
    assert caught.value.code == "not_possible"
