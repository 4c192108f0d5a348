"""Loads that are straight lines between samples: measured forces, and moving bases."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.truth import histories
from vibroimpact_solvers import time_history
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

_RNG = np.random.default_rng(5)
_TIMES = np.concatenate([[0.0], np.cumsum(_RNG.uniform(0.02, 0.4, 50))])
_VALUES = 3.0 * _RNG.normal(size=51)


def document(K: Any, C: Any = None, **more: Any) -> dict[str, Any]:
    M = np.diag([1.0, 0.7])
    base = {"M": M.tolist(), "K": K, "x": [0.0, 0.0], "v": [0.1, -0.3]}
    wall = {"weights": [1.0], "lower": 0.4, "upper": 0.5, "restitution": 0.6}
    both = [{"dofs": [0], **wall}, {"dofs": [1], **wall, "lower": None}]
    by_base = [(-M @ np.ones(2)).tolist(), _TIMES.tolist(), _VALUES.tolist()]
    given = {"sampled": [by_base], "constraints": both, "t_end": 6.0}
    output = {"t": np.linspace(0.0, 6.0, 13).tolist()}
    return base | ({} if C is None else {"C": C}) | given | output | more


_STIFF = [[3.0, -1.0], [-1.0, 2.0]]
_FREE = [[1.0, -1.0], [-1.0, 1.0]]
_NONE = [[0.0, 0.0], [0.0, 0.0]]


@pytest.mark.parametrize(
    "given",
    [
        document(_STIFF),
        document(_STIFF, [[0.2, 0.0], [0.0, 0.4]]),
        document(_FREE),
        document(_FREE, [[0.3, 0.0], [0.0, 0.1]]),
        document(_NONE),
        document(_NONE, [[0.3, 0.0], [0.0, 0.3]]),
        document(_STIFF, force=[0.0, 2.5]),
        document(_FREE, load=[[0, 1.3, 2.0, 0.4]]),
    ],
    ids=["stiff", "coupled", "free", "free coupled", "bodies", "dragged", "pressed", "harmonic"],
)
def test_motions_beside_the_reference(given: dict[str, Any]) -> None:
    report = histories.checked(given)
    assert report.counts["horizon at the end"] == 1
    assert report.ratios


def test_motions_do_not_depend_on_what_the_memory_held(monkeypatch: pytest.MonkeyPatch) -> None:
    empty = np.empty

    def poisoned(shape: Any, dtype: Any = np.float64, *arguments: Any, **more: Any) -> Any:
        array = empty(shape, dtype, *arguments, **more)
        if array.dtype == np.float64:
            array.fill(np.inf)
        return array

    given = histories.problem_of(document(_STIFF, [[0.2, 0.0], [0.0, 0.4]]))
    plan = time_history.plan(given)
    expected = time_history.solve(given, plan)
    monkeypatch.setattr(np, "empty", poisoned)
    result = time_history.solve(given, plan)
    np.testing.assert_array_equal(result.x, expected.x)
    assert result.error_condition == expected.error_condition


def problem(t: Any, values: Any, **more: Any) -> time_history.Problem:
    eye = SymmetricMatrix.dense([[1.0]])
    system = System(eye, SymmetricMatrix.dense([[0.0]]), (Constraint.at(0, gap=100.0),))
    load = time_history.Sampled(np.ones(1), np.array(t), np.array(values))
    state = time_history.State(np.zeros(1), np.zeros(1))
    outputs = frozenset({"x", "v"})
    return time_history.Problem(
        system, state, 2.0, t=np.array([1.0, 2.0]), outputs=outputs, load=(load,), **more
    )


def solved(given: time_history.Problem) -> time_history.Result:
    return time_history.solve(given, time_history.plan(given))


def test_a_body_under_a_triangular_pulse() -> None:
    result = solved(problem([0.0, 1.0, 2.0], [0.0, 6.0, 0.0]))
    np.testing.assert_allclose(result.x[:, 0], [1.0, 6.0], rtol=1e-15)
    np.testing.assert_allclose(result.v[:, 0], [3.0, 6.0], rtol=1e-15)


def test_samples_beyond_the_end_and_before_the_beginning_are_allowed() -> None:
    result = solved(problem([-1.0, 1.0, 3.0], [-6.0, 6.0, -6.0]))
    np.testing.assert_allclose(result.x[:, 0], [1.0, 6.0], rtol=1e-15)


@pytest.mark.parametrize(
    ("t", "values", "more", "pointer"),
    [
        ([0.0, 1.0], [0.0, 6.0], {}, "t"),
        ([0.5, 3.0], [0.0, 6.0], {}, "t"),
        ([0.0, 1.0, 1.0, 3.0], [0.0, 6.0, 1.0, 1.0], {}, "t"),
        ([0.0, 3.0], [0.0, 6.0, 1.0], {}, "values"),
        ([0.0, 3.0], [0.0, np.nan], {}, "values"),
        ([0.0, 3.0], [0.0, 1.0], {"digits": 30}, None),
        ([0.0, 3.0], [0.0, 1.0], {"limiter": time_history.Power(3.0, 1.0, 1.0)}, None),
    ],
)
def test_refusals(t: Any, values: Any, more: dict[str, Any], pointer: str | None) -> None:
    with pytest.raises(ModelError) as caught:
        problem(t, values, **more)
    assert caught.value.pointer == ("load", 0, *([] if pointer is None else [pointer]))


def test_windows_are_one_motion() -> None:
    given = histories.problem_of(document(_STIFF) | {"t_end": 6.0})
    plan = time_history.plan(given)
    whole, part = time_history.solve(given, plan), None
    rows = []
    for index in range(5):
        part = time_history.follow(time_history.Window(given, index, 5), plan, part)
        rows.append(part.x)
    np.testing.assert_allclose(np.concatenate(rows), whole.x, rtol=0.0, atol=1e-13)


def test_an_integrator_follows_the_same_load() -> None:
    given = document(_STIFF, constraints=[])
    given["constraints"] = [
        {"dofs": [0], "weights": [1.0], "lower": 1e3, "upper": 1e3, "restitution": 1.0}
    ]
    exact = solved(histories.problem_of(given))
    compared = solved(histories.problem_of(given, method="DOP853", tolerance=1e-10))
    np.testing.assert_allclose(compared.x, exact.x, atol=1e-4)


def test_motions_of_an_ensemble_are_those_of_its_states() -> None:
    from vibroimpact_solvers import ensemble

    single = histories.problem_of(document(_STIFF))
    x, v = np.array([[0.0, 0.0], [0.1, 0.2]]), np.array([[0.1, -0.3], [0.0, 0.0]])
    given = ensemble.Problem(
        single.system, x, v, single.t_end, t=single.t, outputs=single.outputs, load=single.load
    )
    result = ensemble.solve(given, ensemble.plan(given))
    alone = solved(single)
    assert (result.x[0] == alone.x).all()
    assert result.impact_count[0] == alone.count_impacts
