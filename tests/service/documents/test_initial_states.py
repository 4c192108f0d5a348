"""Initial states of many motions: in all forms in which that of one motion is given."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from vibroimpact_service.documents import planning
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.store import Store

SYSTEM: dict[str, Any] = {
    "preset": "two_mass",
    "Omega0": 1.0,
    "coupling": 0.5,
    "constraints": [{"dof": 0, "gap": 0.5}],
}
STATE = {"x": [0.1, 0.2], "v": [0.3, -0.4]}
MODE = {"impact_mode": {"Omega": 1.2}}


def content(kind: str, initial: Any) -> dict[str, Any]:
    if kind == "attractors":
        lossy = [{"dof": 0, "gap": 0.5, "restitution": 0.8}]
        return {
            "system": SYSTEM | {"zeta": 0.05, "constraints": lossy},
            "load": [{"dof": 1, "amplitude": 0.3}], "frequency": [1.1], "initial": initial,
            "settle": 20, "observe": 40,
        }  # fmt: skip
    t = [0.0, 1.0, 9.0]
    return {
        "system": SYSTEM, "t_end": 9.0, "t": t, "initial": initial,
        "outputs": ["x", "v", "impacts"],
    }  # fmt: skip


def planned(store: Store, kind: str, initial: Any) -> planning.Planned:
    request = KINDS[kind].request.model_validate(content(kind, initial))
    return planning.plan(store, KINDS[kind], request)


def solved(store: Store, kind: str, initial: Any) -> Any:
    of, problem, plan, _ = planned(store, kind, initial)
    return of.solver.solve(problem, plan)


@pytest.mark.parametrize("kind", ["ensemble", "attractors"])
def test_one_state_is_a_row_of_states(store: Store, kind: str) -> None:
    rows = {name: [values] for name, values in STATE.items()}
    problems = [planned(store, kind, each).problem for each in (STATE, rows, [STATE])]
    for problem in problems:
        np.testing.assert_array_equal(problem.x, [STATE["x"]])
        np.testing.assert_array_equal(problem.v, [STATE["v"]])


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("kind", ["ensemble", "attractors"])
def test_a_list_of_states_and_modes_is_a_motion_each(store: Store, kind: str) -> None:
    problem = planned(store, kind, [STATE, MODE, STATE]).problem
    (alone,) = planned(store, kind, MODE).problem.x
    np.testing.assert_array_equal(problem.x, [STATE["x"], alone, STATE["x"]])
    np.testing.assert_array_equal(problem.v[0], STATE["v"])


@pytest.mark.needs("compiled kernels")
def test_one_of_an_ensemble_on_an_impact_mode_is_the_motion_on_it(store: Store) -> None:
    alone, many = (solved(store, kind, MODE) for kind in ("time-history", "ensemble"))
    assert alone.impact_time.size > 2
    np.testing.assert_array_equal(many.x[0, 0], alone.x[0])
    np.testing.assert_array_equal(many.v[0, 0], alone.v[0])
    np.testing.assert_allclose(many.x[0], alone.x, atol=1e-12)
    np.testing.assert_allclose(many.impact_time, alone.impact_time, atol=1e-12)
    # At tau = 0 it is half-way between impacts at opposite walls, a quarter period from each.
    assert alone.impact_time[0] == pytest.approx(0.5 * np.pi / 1.2, abs=1e-9)
    np.testing.assert_allclose(many.x[0, 0], 0.0, atol=1e-12)


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize(
    ("initial", "pointer", "code"),
    [
        ([STATE, {"x": [0.1], "v": [0.3]}], "/initial/1/x", "wrong_length"),
        ([STATE, STATE | {"v": [0.3]}], "/initial/1/v", "wrong_length"),
        ({"x": [0.1], "v": [0.3]}, "/initial/x", "wrong_length"),
        ([STATE, {"impact_mode": {"Omega": 0.3}}], "/initial/1/impact_mode/Omega", "phantom"),
        ({"impact_mode": {"Omega": 0.3}}, "/initial/impact_mode/Omega", "phantom"),
        (
            {"impact_mode": {"Omega": 1.2, "active": [1]}},
            "/initial/impact_mode/active/0",
            "index_out_of_range",
        ),
    ],
)
@pytest.mark.parametrize("kind", ["ensemble", "attractors"])
def test_what_is_none_is_pointed_at(
    store: Store, kind: str, initial: Any, pointer: str, code: str
) -> None:
    with pytest.raises(ProblemError) as caught:
        planned(store, kind, initial)
    (fault,) = caught.value.errors
    assert (fault.pointer, fault.code) == (pointer, code)


def test_a_motion_without_an_initial_state_starts_at_rest(store: Store) -> None:
    """Bit for bit as from zeros, and 0.4 s of a drive are enough to meet the stop."""
    drive = {"load": [{"dof": 0, "amplitude": 3.0, "frequency": 1.0}]}
    absent = content("time-history", None) | drive
    del absent["initial"]
    zeros = {"x": [0.0, 0.0], "v": [0.0, 0.0]}
    results = []
    for each in (absent, absent | {"initial": zeros}):
        request = KINDS["time-history"].request.model_validate(each)
        of, problem, plan, _ = planning.plan(store, KINDS["time-history"], request)
        results.append(of.solver.solve(problem, plan))
    rest, same = results
    assert rest.impact_time.size > 0
    np.testing.assert_array_equal(rest.x, same.x)
    np.testing.assert_array_equal(rest.x[0], 0.0)


def test_rest_beyond_a_stop_is_refused_by_its_field(store: Store) -> None:
    preloaded = SYSTEM | {"constraints": [{"dof": 0, "gap": {"lower": 1.0, "upper": -0.1}}]}
    absent = content("time-history", None) | {"system": preloaded}
    del absent["initial"]
    request = KINDS["time-history"].request.model_validate(absent)
    with pytest.raises(ProblemError) as caught:
        planning.plan(store, KINDS["time-history"], request)
    assert [error.pointer for error in caught.value.errors] == ["/initial/x"]
