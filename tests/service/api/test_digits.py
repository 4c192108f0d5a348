"""More digits over HTTP: used where doubles do not hold, refused by name where impossible."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from starlette.testclient import TestClient

from vibroimpact_schema import examples
from vibroimpact_service.kinds import KINDS

COMPUTE = "/v1/compute/time-history"


@pytest.fixture
def content() -> dict[str, Any]:
    example: dict[str, Any] = examples.requests("time-history")["digits"]["request"]
    return example


def asked(http: TestClient, content: dict[str, Any]) -> Any:
    answer = http.post(COMPUTE, json=content)
    assert answer.status_code == 200, answer.text
    return KINDS["time-history"].result.model_validate_json(answer.content)


def test_digits_hold_what_doubles_do_not(http: TestClient, content: dict[str, Any]) -> None:
    plan = http.post("/v1/plan/time-history", json=content).json()
    assert any("again with 40 decimal digits" in step["reason"] for step in plan["steps"])
    exact, double = asked(http, content), asked(http, {**content, "digits": None})
    assert double.error.digits is None
    assert double.error.predictable_until < content["t_end"]
    assert exact.error.digits == 40
    assert exact.error.predictable_until == content["t_end"]
    assert exact.error.condition < 1e-3
    more = asked(http, {**content, "digits": 60})
    assert exact.impacts == more.impacts or np.allclose(
        exact.impacts.time,
        more.impacts.time,
        rtol=1e-15,
    )
    np.testing.assert_allclose(exact.x, more.x, rtol=1e-14)


def test_digits_are_left_alone_where_doubles_hold(
    http: TestClient, content: dict[str, Any]
) -> None:
    short = {**content, "t_end": 5.0, "t": [5.0]}
    result = asked(http, short)
    assert result.error.digits is None
    assert result.x == asked(http, {**short, "digits": None}).x


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"digits": 16}, "out_of_range"),
        ({"digits": 2000}, "out_of_range"),
        ({"digits": 30.5}, "wrong_type"),
        ({"method": "RK45"}, "not_possible"),
        ({"limiter": {"law": "power"}}, "not_possible"),
        ({"initial": {"impact_mode": {"Omega": 3.0, "active": [0]}}}, "not_possible"),
    ],
)
def test_wrong_digits_are_named(
    http: TestClient, content: dict[str, Any], change: dict[str, Any], code: str
) -> None:
    answer = http.post(COMPUTE, json={**content, **change})
    assert answer.status_code == 422, answer.text
    (error,) = answer.json()["errors"]
    assert (error["pointer"], error["code"]) == ("/digits", code)


def test_what_only_the_motion_tells_is_refused_too(
    http: TestClient, content: dict[str, Any]
) -> None:
    corner = {
        "M": {"scalar": 1, "n": 2}, "K": [[0, 0], [0, 0]],
        "constraints": [
            {"dof": 0, "gap": {"upper": 1}},
            {"direction": {"dofs": [0, 1], "weights": [0.6, 0.8]}, "gap": {"upper": 1}},
        ],
    }  # fmt: skip
    initial = {"x": [0, 0], "v": [1, 0.5]}
    body = {
        **content, "system": corner, "initial": initial, "tolerance": 1e-15, "dofs": [0],
        "t_end": 2.0, "t": [2.0],
    }  # fmt: skip
    answer = http.post(COMPUTE, json=body)
    assert answer.status_code == 422, answer.text
    assert "in which order constraints 0 and 1 strike" in answer.json()["detail"]
